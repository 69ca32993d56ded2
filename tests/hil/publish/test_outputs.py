"""Where a session goes: what is told of its streams at its end, and between two recordings."""

from pathlib import Path

import numpy as np
import pytest
from recorded_trials import head_of, ticks_of
from trial_results import some_results

from highfive.hil.publish.outputs import SessionOutputs
from highfive.hil.recording.background import BackgroundRecorder
from highfive.hil.recording.recorder import SessionRecorder
from highfive.hil.recording.recording import read_recording
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.session.kinds import VECTORS
from highfive.hil.trials.summary import SessionSettings

RESULT = some_results()[1]
MS = 1_000_000


def recorder(path: Path) -> BackgroundRecorder:
    return BackgroundRecorder(SessionRecorder(path, SessionSettings(seed=1, model="m", trials=1)), paced=False)


@pytest.mark.slow
def test_what_was_only_counted_is_told_before_the_end_and_in_the_recording_in_which_it_was(tmp_path: Path) -> None:
    paths = [tmp_path / f"{name}.mcap" for name in ("one", "two")]
    with VirtualClock() as clock, SessionOutputs(recorder(paths[0]), clock=clock) as outputs:
        lab = outputs.streams.open("lab", VECTORS)
        for block, path in enumerate(paths):
            if block:
                outputs.go_on_in(recorder(path))
            outputs.begin_trial(head_of(RESULT))
            for k, tick in enumerate(ticks_of(RESULT, clock.now() + block * 10_000 * MS)):
                lab.add(tick.at_ns, np.zeros(3 + (block * len(RESULT.times) + k) % 2), tick.at_ns)
                outputs.record_tick(tick)
        outputs.end()
    again = len(RESULT.times) - 2  # the first sample is none, the second is told
    for block, path in enumerate(paths):
        events = [(m.data["event"], m.data.get("detail", "")) for m in read_recording(path).channels["/event"]]
        told = [detail for event, detail in events if event == "changed its channels"]
        assert told[-1] == f"lab changed its channels: {again + 2 * block} times more since that was told last"
        assert len(told) == 2 - block and events[-1][0] == "session_end"


def test_a_session_of_which_nothing_is_kept_is_not_said_to_go_on(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    outputs = SessionOutputs(recorder(tmp_path / "one.mcap"))
    with outputs:
        outputs.discard()
        outputs.end()
    assert not list(tmp_path.iterdir())
    assert not [record.getMessage() for record in caplog.records]
