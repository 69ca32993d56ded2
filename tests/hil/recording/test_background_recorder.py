"""A recording in a thread of its own: what is safe when, and a disk that hangs. The stand-in for that is a pipe that
nobody empties: writing to it waits as it does for a network drive that is gone."""

import fcntl
import logging
import os
import threading
import time
from collections.abc import Callable, Iterator
from itertools import cycle, islice
from pathlib import Path

import pytest
from recorded_trials import head_of, ticks_of
from trial_results import some_results

from highfive.hil.recording.background import RESERVE, WAITING, BackgroundRecorder, said_in
from highfive.hil.recording.mcap_file import McapFile
from highfive.hil.recording.recorder import SessionRecorder
from highfive.hil.recording.recording import read_recording
from highfive.hil.recording.session_reader import read_session
from highfive.hil.recording.stream_samples import StreamSamples
from highfive.hil.runtime.clock import MachineClock
from highfive.hil.runtime.console import say_aside
from highfive.hil.session.shown import Shown
from highfive.hil.session.stream import StreamState
from highfive.hil.trials.summary import SessionSettings

RESULT = some_results()[1]
SETTINGS = SessionSettings(seed=1, model="m", trials=1)
DEADLINE_S = 60.0
"""After which a test that waits fails; nothing is judged by it."""
PIPE_HOLDS = 1 << 20
"""Bytes: more than the beginning of a recording, less than what the tests write."""


class QuickClock(MachineClock):
    """Runs fifty times as fast."""

    def now(self) -> int:
        """ns"""
        return 50 * super().now()


@pytest.fixture
def pipe(tmp_path: Path) -> Iterator[tuple[Path, int]]:
    """A pipe to record into, and its other end."""
    path = tmp_path / "session.mcap"
    os.mkfifo(path)
    end = os.open(path, os.O_RDWR | os.O_NONBLOCK)
    fcntl.fcntl(end, fcntl.F_SETPIPE_SZ, PIPE_HOLDS)
    yield path, end
    os.close(end)


def fill(recorder: BackgroundRecorder, ticks: int, events: int) -> None:
    """A high five of so many ticks and events; each call returns, or the test never ends."""
    recorder.record_event("session_start")
    recorder.begin_trial(head_of(RESULT))
    for one in islice(cycle(list(ticks_of(RESULT))), ticks):
        recorder.record_tick(one)
    for number in range(events):
        recorder.record_event("marker", detail=str(number))


def emptied(end: int, over: Callable[[], bool], into: Path) -> None:
    """Reads what is written until that is ``over``."""
    with into.open("wb") as file:
        while True:
            last = over()
            try:
                while content := os.read(end, 1 << 16):
                    file.write(content)
            except BlockingIOError:
                if last:
                    return
                time.sleep(0.001)


def test_a_disk_that_hangs_holds_nobody_and_is_told_once(
    pipe: tuple[Path, int], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path, end = pipe
    recorder = BackgroundRecorder(SessionRecorder(path, SETTINGS), paced=True, clock=QuickClock())
    with said_in(recorder):
        fill(recorder, WAITING + 1000, RESERVE + 500)
        fill(recorder, 10, 0)
    lost = recorder.lost
    # All but what is left out waits, or is in the pipe, which holds a few hundred ticks.
    assert 1500 - 1000 < lost <= 1500 + 12
    recorder.close()
    told = [record.getMessage() for record in caplog.records]
    assert len(told) == 2 and "parts of the recording are left out from now on" in told[0]
    assert told[1] == recorder.trouble and "has not answered for 5 s" in told[1] and "\n" not in told[1]
    recorder.record_event("later")  # nobody minds
    emptied(end, lambda: True, cut := tmp_path / "cut.mcap")
    assert not read_recording(cut).complete and read_recording(cut).settings["seed"] == 1


@pytest.mark.slow
def test_a_disk_that_answers_again_has_all_but_what_was_counted(
    pipe: tuple[Path, int], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path, end = pipe
    recorder = BackgroundRecorder(SessionRecorder(path, SETTINGS), paced=True)
    ticks, events = WAITING + 1000, 50
    fill(recorder, ticks, events)
    lost, closing = recorder.lost, threading.Thread(target=recorder.close)
    closing.start()
    emptied(end, lambda: not closing.is_alive(), whole := tmp_path / "whole.mcap")
    assert lost and not recorder.trouble
    recording = read_recording(whole)
    assert recording.complete
    assert len(recording.channels["/tick"]) == ticks - lost
    assert [one.data["detail"] for one in recording.channels["/event"][1:]] == [str(i) for i in range(events)]
    assert [f"the recording lacks {lost} parts" in record.getMessage() for record in caplog.records] == [
        False,
        True,
    ]


def give_event(recorder: BackgroundRecorder) -> None:
    recorder.record_event("answer", detail="late")


def give_log(recorder: BackgroundRecorder) -> None:
    with said_in(recorder):
        say_aside("late", logging.WARNING)


def give_samples(recorder: BackgroundRecorder) -> None:
    recorder.record_stream(StreamSamples("EEG", ("Fz",), False, [[1.0]], [1.0], [10**12], 10**12, True))


def give_picture(recorder: BackgroundRecorder) -> None:
    recorder.record_shown(1, Shown(1, 10**12, 10**12), 0)


def give_state(recorder: BackgroundRecorder) -> None:
    recorder.record_streams([StreamState("EEG", None, 0.0, 0.0, None, 0.0, True, 0)], 10**12)


GIVEN = {
    "/event": give_event, "/log": give_log, "/lsl/EEG": give_samples, "/shown": give_picture, "/streams": give_state,
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("begun", [False, True])
@pytest.mark.parametrize("topic", GIVEN)
def test_what_comes_between_high_fives_is_in_the_file_though_nothing_follows(
    topic: str, begun: bool, tmp_path: Path
) -> None:
    """Then a kill loses none of it. Before the first high five as after the last."""
    path = tmp_path / "session.mcap"
    with BackgroundRecorder(SessionRecorder(path, SETTINGS), paced=True, clock=QuickClock()) as recorder:
        if begun:
            fill(recorder, 20, 0)
            recorder.end_trial(RESULT)
        GIVEN[topic](recorder)
        until = time.monotonic() + DEADLINE_S
        while not written(path, topic, begun):
            assert time.monotonic() < until
            time.sleep(0.01)
    assert read_recording(path).complete


def written(path: Path, topic: str, begun: bool) -> bool:
    found = [channel for _, channel, _ in McapFile(path).messages() if channel.topic == topic]
    return len(found) == (2 if topic == "/event" and begun else 1)


def test_what_comes_before_the_first_high_five_is_of_it(tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    with BackgroundRecorder(SessionRecorder(path, SETTINGS), paced=True) as recorder:
        give_samples(recorder)
        fill(recorder, 20, 0)
    (high_five,) = read_session(path)
    (sample,) = high_five.of("/lsl/EEG")
    assert (sample.time_ns, sample.data["time_ns"], sample.data["labels"]) == (0, 10**12, ["Fz"])
