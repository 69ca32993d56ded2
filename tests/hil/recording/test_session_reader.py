"""A recorded session, a high five at a time."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from recorded_trials import head_of, record_trial, ticks_of
from trial_results import some_results

from highfive.hil.recording.recorder import SessionRecorder
from highfive.hil.recording.recording import read_recording
from highfive.hil.recording.session_reader import read_session
from highfive.hil.trials.summary import SessionSettings
from highfive.hil.view import SHIPPED_RECORDING
from highfive.model.errors import HighFiveError


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("session") / "session.mcap"
    with SessionRecorder(path, SessionSettings(seed=3, model="default", trials=2)) as recorder:
        for result in some_results()[:2]:
            record_trial(recorder, result)
    return path


@pytest.mark.slow
def test_high_fives_come_one_by_one_with_their_own_time(recorded: Path) -> None:
    session, results = read_session(recorded), some_results()
    for high_five, result in zip(session, results, strict=False):
        assert high_five.number == result.number and high_five.about["emotion"] == result.emotion
        person = high_five.arrays("/person")
        np.testing.assert_allclose(person["time"], result.times, atol=1e-9)
        np.testing.assert_allclose(person["wrist"], [one.wrist for one in result.people], atol=1e-5)
        assert high_five.arrays("/avatar")["quaternions"].shape == (len(result.times), 53, 4)
        assert high_five.arrays("/markers")["positions"].shape == (len(result.times), 16, 3)
        assert high_five.contact is not None and high_five.contact["met"] is True
    assert len(list(session)) == len(list(session)) == 2  # as often as one likes
    assert session.settings["model"] == "default" and len(session.joints) == 53


@pytest.mark.slow
def test_a_notebook_shows_what_is_there_and_not_every_number(recorded: Path) -> None:
    session = read_session(recorded)
    assert repr(session) == f"<{recorded}: 2 high fives>"
    assert repr(session[1]).startswith("<high five 2: ") and "/tick " in repr(session[1])
    assert len(repr(session[1])) < 1000


@pytest.mark.slow
def test_all_at_once_is_the_same(recorded: Path) -> None:
    whole = read_recording(recorded).channels
    for topic in ("/avatar", "/tick", "/frame", "/contact"):
        assert [m for one in read_session(recorded) for m in one.messages[topic]] == list(whole[topic])


def test_recordings_of_earlier_versions_are_read(recorded: Path) -> None:
    """The one that comes along was recorded before messages were flat and markers were points."""
    old = list(read_session(SHIPPED_RECORDING))
    assert [one.about["emotion"] for one in old] == ["neutral", "happy", "angry", "sad"]
    assert old[0].arrays("/markers")["positions"].shape[1:] == (16, 3)
    assert old[0].arrays("/avatar")["quaternions"].shape[1:] == (53, 4)
    with pytest.raises(HighFiveError, match="no topic '/frame'"):
        old[0].arrays("/frame")


def test_one_whose_end_is_missing_is_read_up_to_there(recorded: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    content = recorded.read_bytes()
    cut.write_bytes(content[: int(0.8 * len(content))])
    first, second = read_session(cut)
    assert first.contact is not None and second.contact is None
    assert 0 < len(second.messages["/tick"]) < len(some_results()[1].times)


@pytest.mark.parametrize("content", [b"", b"nothing of the kind"])
def test_what_is_no_session_is_one_line(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "other.mcap"
    path.write_bytes(content)
    with pytest.raises(HighFiveError, match=r"other\.mcap"):
        read_session(path)
    with pytest.raises(HighFiveError, match="No such file"):
        read_session(tmp_path / "none.mcap")


def _with_one_replaced(source: Path, path: Path, topic: str, number: int, content: bytes) -> None:
    """A copy of a recording in which one message of a topic, counted from 0, has another content."""
    with source.open("rb") as file, path.open("wb") as copy:
        writer, channels, seen = Writer(copy), {}, 0
        writer.start()
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            if channel.id not in channels:
                assert schema is not None
                of = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, of)
            hit = channel.topic == topic and seen == number
            seen += channel.topic == topic
            data = content if hit else message.data
            writer.add_message(channels[channel.id], message.log_time, data, message.publish_time)
        writer.finish()


@pytest.mark.parametrize(
    "content",
    [
        *(pytest.param(content, marks=pytest.mark.slow) for content in (b"", b"{", b"[1, 2]", b"\xff\xfe")),
        b"[" * 100_000,
    ],
)
@pytest.mark.slow
def test_one_malformed_message_is_left_out_and_reading_goes_on(content: bytes, recorded: Path, tmp_path: Path) -> None:
    path = tmp_path / "malformed.mcap"
    _with_one_replaced(recorded, path, "/tick", 3, content)
    whole, found = list(read_session(recorded)), list(read_session(path))
    assert [len(one.messages["/tick"]) for one in found] == [
        len(one.messages["/tick"]) - (one.number == whole[0].number) for one in whole
    ]
    assert read_recording(path).complete


@pytest.mark.parametrize("content", [b"{}", b"{", b'{"trial": "second", "markers": 7}'])
@pytest.mark.slow
def test_a_trial_message_without_its_number_is_of_the_high_five_that_ticks_say(
    content: bytes, recorded: Path, tmp_path: Path
) -> None:
    path = tmp_path / "unnumbered.mcap"
    _with_one_replaced(recorded, path, "/trial", 1, content)
    for found, whole in zip(read_session(path), read_session(recorded), strict=True):
        assert found.number == whole.number and found.contact == whole.contact
        np.testing.assert_array_equal(found.arrays("/markers")["positions"], whole.arrays("/markers")["positions"])
        np.testing.assert_array_equal(found.arrays("/person")["time"], whole.arrays("/person")["time"])


@pytest.mark.slow
def test_the_first_is_at_0_and_what_is_left_out_is_said_once(
    recorded: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "malformed.mcap"
    _with_one_replaced(recorded, path, "/tick", 3, b"{")
    session = read_session(path)
    assert len(session) == 2 and session[0].number == 0 and session[-1].number == session[1].number == 1
    assert [one.number for one in session[:]] == [0, 1] and session.complete
    assert [record.getMessage() for record in caplog.records] == ["malformed.mcap: left out: 1 malformed message"]


def test_a_damaged_chunk_is_passed_over(recorded: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    content, path = bytearray(recorded.read_bytes()), tmp_path / "damaged.mcap"
    chunks = sorted({span.last[0] for span in read_session(recorded).spans})
    content[chunks[0] + 200] ^= 1
    path.write_bytes(content)
    whole, found = read_session(recorded), read_session(path)
    assert [span.number for span in found.spans] == [0, 1] and found.complete
    assert found.spans[0].ticks < whole.spans[0].ticks and found.spans[1].ticks == whole.spans[1].ticks
    assert [record.getMessage() for record in caplog.records] == ["damaged.mcap: left out: 1 damaged chunk"]


def test_a_newer_format_is_refused_and_says_what_to_do(recorded: Path, tmp_path: Path) -> None:
    path, newer = tmp_path / "newer.mcap", {"format": 3, "settings": {"versions": {"high-five": "9.1"}}, "joints": []}
    _with_one_replaced(recorded, path, "/session", 0, json.dumps(newer).encode())
    for read in (read_session, read_recording):
        with pytest.raises(HighFiveError, match=r"format 3, .*reads up to 2; open it with .*\(9\.1\), or a newer one"):
            read(path)


def test_a_folder_with_one_recording_opens_it_and_others_say_what_is_there(tmp_path: Path) -> None:
    with pytest.raises(HighFiveError, match="a folder without a recording"):
        read_session(tmp_path)
    shutil.copy(SHIPPED_RECORDING, tmp_path / "session.mcap")
    assert len(read_session(tmp_path)) == len(read_session(SHIPPED_RECORDING))
    (tmp_path / "b").mkdir()
    shutil.copy(SHIPPED_RECORDING, tmp_path / "b" / "session.mcap")
    with pytest.raises(HighFiveError, match=r"a folder of 2 recordings; give one of them: b/session.mcap, session"):
        read_session(tmp_path)


def test_a_contact_is_where_its_tick_is_however_late_ticks_came(tmp_path: Path) -> None:
    """On a machine that is too busy, each tick of this one begins half as late again as its frame was captured."""
    result, path = some_results()[0], tmp_path / "late.mcap"
    with SessionRecorder(path, SessionSettings(seed=3, model="default", trials=1)) as recorder:
        recorder.begin_trial(head_of(result))
        for tick in ticks_of(result):
            recorder.record_tick(replace(tick, at_ns=round(1.5 * tick.time_ns)))
        recorder.end_trial(result)
    (found,) = read_session(path)
    assert found.contact is not None
    times, palms = found.arrays("/avatar")["time"], found.arrays("/person")["palm"]
    met = int(np.argmin(np.abs(times - found.contact["met_time"])))
    assert times[met] == pytest.approx(1.5 * result.contact_time, abs=1e-5)
    at = int(np.argmin(np.abs(np.array(result.times) - result.contact_time)))
    np.testing.assert_allclose(palms[met], result.people[at].palm.position, atol=1e-4)
