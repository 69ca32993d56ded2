"""A recorded session, a high five at a time."""

from pathlib import Path

import numpy as np
import pytest
from recorded_trials import record_trial
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
