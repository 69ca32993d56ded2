"""Streams of other programs, recorded beside a session: over the real library, on this machine alone."""

import math
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pylsl
import pytest
from mcap.reader import make_reader
from recorded_trials import head_of, ticks_of
from trial_results import some_results

from highfive.hil.recording import lsl_inlets
from highfive.hil.recording.background import BackgroundRecorder
from highfive.hil.recording.lsl_inlets import LslInlets
from highfive.hil.recording.recorder import SessionRecorder
from highfive.hil.recording.recording import read_recording
from highfive.hil.recording.stream_samples import StreamSamples, check_stream_names
from highfive.hil.session.session_streams import SessionStreams
from highfive.hil.trials.summary import SessionSettings
from highfive.mocap_bridge.sources.lsl import configure
from highfive.mocap_bridge.sources.timeline import AHEAD_NS
from highfive.model.errors import HighFiveError

PATIENCE_S = 60.0
"""Of the tests, for what happens within a second or two on a machine that is not busy."""
LONGEST_TRIP_S = 0.7
"""The library drops a round of probes whose answers take longer."""


@dataclass
class Taker:
    """Keeps what it is given, in order."""

    samples: list[StreamSamples] = field(default_factory=list)
    events: list[tuple[str, str]] = field(default_factory=list)
    news: threading.Condition = field(default_factory=threading.Condition)

    def record_stream(self, samples: StreamSamples) -> None:
        with self.news:
            self.samples.append(samples)
            self.news.notify_all()

    def record_event(self, event: str, at_ns: int | None = None, *, detail: str) -> None:
        assert at_ns is not None
        with self.news:
            self.events.append((event, detail))
            self.news.notify_all()

    def wait(self, for_what: Callable[[], Any]) -> None:
        with self.news:
            assert self.news.wait_for(for_what, PATIENCE_S), self.events

    def told(self, event: str) -> int:
        return sum(name == event for name, _ in self.events)

    def rows(self, name: str) -> list[list[float | str]]:
        return [list(row) for chunk in self.samples if chunk.name == name for row in chunk.values]


@pytest.fixture(autouse=True, scope="module")
def this_machine_alone() -> None:
    configure(local_only=True)


@pytest.fixture
def taker() -> Taker:
    return Taker()


@pytest.fixture
def streams(taker: Taker) -> SessionStreams:
    return SessionStreams(lambda event: taker.record_event(event.happened.value, event.time_ns, detail=event.text))


@pytest.fixture
def follow(taker: Taker, streams: SessionStreams) -> Iterator[Callable[..., LslInlets]]:
    opened: list[LslInlets] = []

    def begin(*names: str) -> LslInlets:
        opened.append(LslInlets(names, taker, streams, local_only=True))
        return opened[-1]

    yield begin
    for inlets in opened:
        inlets.close()


def test_a_stream_is_looked_at_so_often_that_the_present_is_near_its_newest_sample() -> None:
    assert 1e9 * lsl_inlets._STEP_S < 0.5 * AHEAD_NS  # else a stream that is sound is no more valid now and then


def outlet(name: str, channels: int, *, text: bool = False, labels: tuple[str, ...] = (), source: str = "") -> Any:
    kind = pylsl.cf_string if text else pylsl.cf_float32
    info = pylsl.StreamInfo(name, "Markers" if text else "EEG", channels, 0 if text else 250, kind, source or name)
    about = info.desc().append_child("channels")
    for label in labels:
        about.append_child("channel").append_child_value("label", label)
    return pylsl.StreamOutlet(info)


def test_numbers_and_texts_come_in_order_with_their_stamps(taker: Taker, follow: Callable[..., LslInlets]) -> None:
    eeg, markers = outlet("TestEEG", 3, labels=("Fz", "", "Pz")), outlet("TestPsychoPy", 1, text=True)
    inlets = follow("TestEEG", "TestPsychoPy")
    taker.wait(lambda: taker.told("lsl_found") == 2)
    now = pylsl.local_clock()
    sent = [[float(i), math.nan if i % 7 == 0 else -0.5 * i, 1e30] for i in range(300)]
    for i, row in enumerate(sent):
        eeg.push_sample(row, now + 0.004 * i)
        if i % 100 == 0:
            markers.push_sample([f"stimulus {i} \u2603"], now + 0.004 * i)
    taker.wait(lambda: len(taker.rows("TestEEG")) == 300 and len(taker.rows("TestPsychoPy")) == 3)
    inlets.close()
    np.testing.assert_array_equal(taker.rows("TestEEG"), np.array(sent, dtype=np.float32))
    assert taker.rows("TestPsychoPy") == [[f"stimulus {i} \u2603"] for i in (0, 100, 200)]
    chunks = [chunk for chunk in taker.samples if chunk.name == "TestEEG"]
    assert [chunk.begins for chunk in chunks] == [True] + [False] * (len(chunks) - 1)
    assert chunks[0].labels == ("Fz", "2", "Pz") and not chunks[0].text
    stamps = np.array([stamp for chunk in chunks for stamp in chunk.stamps])
    np.testing.assert_allclose(stamps, now + 0.004 * np.arange(300), atol=1e-9)
    # One machine has one clock: what the library measures of it is how long its packets take.
    ours = np.array([time_ns for chunk in chunks for time_ns in chunk.times_ns])
    assert np.all(np.abs(1e-9 * ours - stamps) < LONGEST_TRIP_S)


def test_each_is_one_of_the_sessions_streams_with_a_bound_of_its_clock(
    taker: Taker, streams: SessionStreams, follow: Callable[..., LslInlets]
) -> None:
    gaze, events = outlet("TestGaze", 2), outlet("TestCues", 1, text=True)
    follow("TestGaze", "TestCues")
    taker.wait(lambda: taker.told("lsl_found") == 2)
    said_s, said_ns = pylsl.local_clock(), time.monotonic_ns()
    at_ns = said_ns + 20_000_000
    events.push_sample(["go"], said_s)
    for i in range(50):
        gaze.push_sample([float(i), 0.5], said_s - 0.2 + 0.004 * i)
    taker.wait(lambda: len(taker.rows("TestGaze")) == 50 and taker.rows("TestCues"))
    found = {state.stream: state for state in streams.states(at_ns)}
    assert found.keys() == {"lsl/TestGaze", "lsl/TestCues"}
    for state in found.values():
        # One machine has one clock: the bound is half a round trip, however long that takes, and holds.
        assert state.bound_ms is not None and 0.0 < state.bound_ms < 1e3 * LONGEST_TRIP_S
        assert abs(state.offset_s) <= 1e-3 * state.bound_ms + 1e-3 and state.resets == 0
    cues = found["lsl/TestCues"]
    assert cues.bound_ms is not None and cues.age_ms == pytest.approx(20.0, abs=cues.bound_ms + 1.0)
    assert [event for event, _ in taker.events] == ["lsl_found", "lsl_found"]
    del gaze
    taker.wait(lambda: taker.told("lsl_lost"))
    taker.wait(lambda: [state.stream for state in streams.states(at_ns)] == ["lsl/TestCues"])


def test_one_that_ends_comes_back_as_another(taker: Taker, follow: Callable[..., LslInlets]) -> None:
    first = outlet("TestComesBack", 2)
    follow("TestComesBack")
    taker.wait(lambda: taker.told("lsl_found"))
    first.push_sample([1.0, 2.0])
    taker.wait(lambda: taker.rows("TestComesBack"))
    del first
    taker.wait(lambda: taker.told("lsl_lost"))
    second = outlet("TestComesBack", 1, text=True)
    taker.wait(lambda: taker.told("lsl_changed"))
    second.push_sample(["three"])
    taker.wait(lambda: len(taker.rows("TestComesBack")) == 2)
    assert taker.rows("TestComesBack") == [[1.0, 2.0], ["three"]]
    assert [event for event, _ in taker.events] == ["lsl_found", "lsl_lost", "lsl_changed"]
    assert taker.events[-1][1] == "TestComesBack is another than before: 1 channel, text, type Markers"


def test_of_two_of_one_name_one_is_recorded(taker: Taker, follow: Callable[..., LslInlets]) -> None:
    one, other = outlet("TestTwo", 1, source="a"), outlet("TestTwo", 1, source="b")
    inlets = follow("TestTwo")
    taker.wait(lambda: taker.told("lsl_found") and taker.told("lsl_double"))
    for i in range(20):
        one.push_sample([float(i)])
        other.push_sample([100.0 + i])
    taker.wait(lambda: len(taker.rows("TestTwo")) == 20)
    inlets.close()
    values = [row[0] for row in taker.rows("TestTwo")]
    assert values in ([float(i) for i in range(20)], [100.0 + i for i in range(20)])
    assert sorted(event for event, _ in taker.events) == ["lsl_double", "lsl_found"]


def test_one_that_is_not_there_is_said_once_and_taken_when_it_comes(
    taker: Taker, follow: Callable[..., LslInlets], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lsl_inlets, "PATIENCE_NS", 100_000_000)
    follow("TestLate")
    taker.wait(lambda: taker.told("lsl_absent"))
    late = outlet("TestLate", 1)
    taker.wait(lambda: taker.told("lsl_found"))
    late.push_sample([5.0])
    taker.wait(lambda: taker.rows("TestLate") == [[5.0]])
    assert [event for event, _ in taker.events] == ["lsl_absent", "lsl_found"]


def test_a_stamp_that_is_no_time_ends_that_stream_alone(taker: Taker, follow: Callable[..., LslInlets]) -> None:
    wrong, right = outlet("TestWrong", 1), outlet("TestRight", 1)
    follow("TestWrong", "TestRight")
    taker.wait(lambda: taker.told("lsl_found") == 2)
    wrong.push_sample([1.0], 1e300)
    taker.wait(lambda: taker.told("lsl_refused"))
    right.push_sample([2.0])
    taker.wait(lambda: taker.rows("TestRight") == [[2.0]])
    assert not taker.rows("TestWrong")


@pytest.mark.parametrize("names", [("",), ("a'b",), ('a"b',), ("twice", "twice")])
def test_names_that_cannot_be(names: tuple[str, ...]) -> None:
    with pytest.raises(HighFiveError, match="--record-lsl"):
        check_stream_names(names)


def chunk(values: list[list[Any]], times_ns: list[int], *, begins: bool = False, text: bool = False) -> StreamSamples:
    stamps = [1e-9 * time_ns - 100.0 for time_ns in times_ns]
    labels = ("answer",) if text else ("Fz", "Cz")
    return StreamSamples("T", labels, text, values, stamps, times_ns, times_ns[-1], begins)


@pytest.mark.parametrize("paced", [True, False])
def test_the_recording_gives_them_back(tmp_path: Path, paced: bool) -> None:
    result, path, start = some_results()[1], tmp_path / "session.mcap", 5_000_000_000
    ticks = [t for t in ticks_of(result)][1:100]
    recorder = BackgroundRecorder(SessionRecorder(path, SessionSettings(seed=1, model="m", trials=1)), paced=paced)
    zero = ticks[0].at_ns
    with recorder:
        recorder.record_event("lsl_found", start, detail="T")  # before the session's clock begins
        recorder.record_stream(chunk([[1.0, math.nan]], [zero - 50], begins=True))
        recorder.begin_trial(head_of(result))
        for tick in ticks:
            recorder.record_tick(tick)
        recorder.record_stream(chunk([[2.0, math.inf], [3.0, 0.1]], [zero + 70, zero + 80]))
        recorder.record_stream(chunk([["yes"]], [zero + 90], begins=True, text=True))
        recorder.end_trial(result)
    recording = read_recording(path)
    assert recording.complete
    found = [(m.time_ns, m.data["values"], m.data["time_ns"], m.data["labels"]) for m in recording.channels["/lsl/T"]]
    assert found == [
        (0, [1.0, None], zero - 50, ["Fz", "Cz"]),
        (70, [2.0, None], zero + 70, ["Fz", "Cz"]),
        (80, [3.0, 0.1], zero + 80, ["Fz", "Cz"]),
        (90, ["yes"], zero + 90, ["answer"]),
    ]
    stamps = [m.data["stamp"] for m in recording.channels["/lsl/T"]]
    np.testing.assert_allclose(stamps, 1e-9 * (zero + np.array([-50, 70, 80, 90])) - 100.0, atol=1e-9)
    assert recording.channels["/event"][0].time_ns == 0 and recording.channels["/event"][0].data["detail"] == "T"


@pytest.mark.slow
def test_streams_with_stamps_of_no_known_clock_neither_stretch_the_recording_nor_cut_it_up(tmp_path: Path) -> None:
    """An hour ahead, in ms, years ago, and five seconds late: four streams at 100 Hz beside ticks at 120 Hz."""
    path, (one, *_), begun_ns, seconds = tmp_path / "session.mcap", ticks_of(some_results()[1]), 40_000 * 10**9, 10
    off = {"Ahead": 3600 * 10**9, "Millis": 999 * begun_ns, "Ago": -(10**17), "Late": -5 * 10**9}
    with SessionRecorder(path, SessionSettings(seed=1, model="m", trials=1)) as recorder:
        recorder.begin_trial(head_of(some_results()[1]))
        events = [(round(k * 1e9 / 120), "") for k in range(120 * seconds)]
        events += [(k * 10_000_000 + 3, name) for k in range(100 * seconds) for name in off]
        for passed_ns, name in sorted(events):
            now = begun_ns + passed_ns
            if name:
                times = [now + off[name]]
                recorder.record_stream(StreamSamples(name, ("x",), False, [[0.0]], [1.0], times, now, passed_ns < 9))
            else:
                recorder.record_tick(replace(one, time_ns=passed_ns, at_ns=now))
    with path.open("rb") as file:
        found = make_reader(file).get_summary()
    assert found is not None and found.statistics is not None
    assert found.statistics.message_end_time <= seconds * 10**9
    assert len(found.chunk_indexes) <= 2 * seconds + 2
    channels = read_recording(path).channels
    for name, moved in off.items():
        messages = channels[f"/lsl/{name}"]
        assert len(messages) == 100 * seconds and messages[-1].data["time_ns"] == begun_ns + moved + 9_990_000_003
        late = 0 if name != "Late" else 5 * 10**9
        assert messages[-1].time_ns == 9_990_000_003 - late
