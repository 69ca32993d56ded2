"""A recording goes out at its rate, with its faults, until it is stopped."""

import threading
import time

import numpy as np

from highfive.mocap_bridge.files.recording import Recording, make_recording
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.servers.faults import Faults, parse_fault
from highfive.mocap_bridge.servers.serving import frames_of, serve


class Notebook:
    """A server that writes down what it is sent."""

    port = 0

    def __init__(self) -> None:
        self.frames: list[MarkerFrame] = []
        self.times: list[float] = []
        self.calls: list[str] = []

    def send(self, frame: MarkerFrame) -> None:
        self.frames.append(frame)
        self.times.append(time.monotonic())

    def hang_up(self) -> None:
        self.calls.append("hang up")

    def answer(self) -> None:
        self.calls.append("answer")

    def close(self) -> None:
        self.calls.append("close")


def recording(frames: int = 60, rate: float = 200.0) -> Recording:
    points = np.random.default_rng(0).uniform(size=(frames, 2, 3))
    return make_recording(rate, ["A:x", "A:y"], points, np.ones((frames, 2), dtype=bool))


def test_frames_go_on_counting_when_they_begin_again() -> None:
    looped = frames_of(recording(5), loop=True)
    frames = [next(looped) for _ in range(12)]
    assert [frame.number for frame in frames] == list(range(12))
    assert [frame.source_time_ns for frame in frames] == [round(k * 5e6) for k in range(12)]
    assert np.array_equal(frames[7].positions, frames[2].positions)
    assert len(list(frames_of(recording(5)))) == 5
    assert list(frames_of(recording(0), loop=True)) == []


def test_the_rate_is_the_recordings() -> None:
    notebook, count = Notebook(), 0

    def sent(_: MarkerFrame) -> None:
        nonlocal count
        count += 1

    serve(recording(), notebook, sent=sent)
    assert count == len(notebook.frames) == 60
    assert notebook.times[-1] - notebook.times[0] > 0.25  # 59 periods of 5 ms; never too early


def test_told_to_stop_it_stops_at_once() -> None:
    notebook, stop = Notebook(), threading.Event()
    serve(recording(), notebook, loop=True, stop=stop, sent=lambda frame: stop.set() if frame.number == 70 else None)
    assert [frame.number for frame in notebook.frames] == list(range(71))


def test_a_disconnect_hangs_up_once_and_answers_once() -> None:
    notebook = Notebook()
    serve(recording(), notebook, Faults([parse_fault("disconnect@0.1-0.2")]))
    assert notebook.calls == ["hang up", "answer"]
    assert [frame.number for frame in notebook.frames] == [k for k in range(60) if not 20 <= k < 40]
