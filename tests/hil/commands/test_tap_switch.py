"""A switch over LSL says the tap: over the real library, on this machine alone; and what a trial makes of it."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pylsl
import pytest
from command_line import failing
from helpers.experiments import protocol, study
from helpers.virtual_stage import VirtualStage

from highfive.hil.commands.clips import SIMULATED, load_clips
from highfive.hil.commands.tap_switch import TapSwitch
from highfive.hil.experiments.stage import RunFailedError, TrialBrokenOffError
from highfive.hil.recording.stream_samples import StreamSamples
from highfive.hil.runtime.clock import MACHINE
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.mocap_bridge.sources.lsl import configure
from highfive.model.errors import HighFiveError

fails = failing("experiment", "run")
PATIENCE_S = 60.0
"""For what happens within a second or two on a machine that is not busy."""


@pytest.fixture
def follow() -> Iterator[Callable[..., TapSwitch]]:
    configure(local_only=True)
    opened: list[TapSwitch] = []

    def begin(name: str) -> TapSwitch:
        opened.append(TapSwitch(name, local_only=True))
        return opened[-1]

    yield begin
    for switch in opened:
        switch.close()


def said(switch: TapSwitch, push: Callable[[], Any], since_ns: int) -> int:
    """When the switch says that it was pressed; it is pressed again and again until somebody hears it."""
    end = time.monotonic() + PATIENCE_S
    while (found := switch.tapped_since(since_ns)) is None and time.monotonic() < end:
        push()
        time.sleep(0.05)
    assert found is not None
    return found


def test_a_text_is_a_tap_at_the_time_that_its_sender_stamped(follow: Callable[..., TapSwitch]) -> None:
    outlet = pylsl.StreamOutlet(pylsl.StreamInfo("TestDummy", "Markers", 1, 0, pylsl.cf_string, "dummy"))
    switch = follow("TestDummy")
    said(switch, lambda: outlet.push_sample(["tap"]), 0)
    time.sleep(0.3)
    before, stamp = MACHINE.now(), pylsl.local_clock()
    outlet.push_sample([" "])  # nothing
    outlet.push_sample(["tap"], stamp)
    found = said(switch, lambda: None, before - 2_000_000)
    assert abs(found - before) < 20_000_000


def test_a_level_is_a_tap_as_it_rises(follow: Callable[..., TapSwitch]) -> None:
    outlet = pylsl.StreamOutlet(pylsl.StreamInfo("TestMat", "Level", 1, 0, pylsl.cf_float32, "mat"))
    switch, level = follow("TestMat"), [0.0]

    def press() -> None:
        level[0] = 1.0 - level[0]
        outlet.push_sample(level)

    said(switch, press, 0)


def samples(*values: float | str, at_ns: int, begins: bool = False) -> StreamSamples:
    text = isinstance(values[0], str)
    times = [at_ns + n for n in range(len(values))]
    return StreamSamples("s", ("a",), text, [[value] for value in values], [0.0] * len(values), times, at_ns, begins)


@pytest.mark.parametrize(
    ("chunks", "taps"),
    [
        ([(0.0, 0.0, 1.0, 1.0, 0.0, 1.0)], [2, 5]),
        ([(1.0, 1.0, 1.0)], []),  # held as it began
        ([(1.0, 0.0, 1.0)], [2]),
        ([("tap", "", "tap")], [0, 2]),
        ([(float("nan"), 1.0)], [1]),
    ],
)
def test_what_counts_as_a_tap(follow: Callable[..., TapSwitch], chunks: list[tuple], taps: list[int]) -> None:
    switch = follow("NobodyHasThisName")
    for chunk in chunks:
        switch.record_stream(samples(*chunk, at_ns=1000, begins=True))
    found, since = [], 0
    while (at_ns := switch.tapped_since(since)) is not None:
        found.append(at_ns - 1000)
        since = at_ns + 1
    assert found == taps


@pytest.mark.slow(15)
def test_the_clip_begins_with_the_switch_and_the_row_has_its_time(
    follow: Callable[..., TapSwitch], tmp_path: Path
) -> None:
    """Her hand is on the shoulder all the time, and tells nothing; a press before the cue is none."""
    clips = load_clips(SIMULATED, protocol("tipping"))
    outlet = pylsl.StreamOutlet(pylsl.StreamInfo("TestQuiet", "Markers", 1, 0, pylsl.cf_string, "quiet"))
    switch = follow("TestQuiet")
    switch.wait(PATIENCE_S)
    for name, pressed_s in (("before", -0.5), ("pressed", 0.001)):
        with VirtualClock() as clock, ExitStack() as stack:
            run = VirtualStage(clock, stack, tmp_path / name, template="tipping", clips=clips, switch=switch)
            at_ns = clock.now() + round(1e9 * pressed_s)
            switch.record_stream(samples("tap", at_ns=at_ns))
            if pressed_s > 0.0:
                row = run.play("I1", "interactive", 1, style="angry", clip=3, cell="")
                assert row.contact_ns == at_ns
            else:
                with pytest.raises(TrialBrokenOffError, match=r"was not tapped|it took longer"):
                    run.play("I1", "interactive", 1, style="angry", clip=3, cell="")
    del outlet


@pytest.mark.slow
def test_a_switch_that_is_gone_ends_the_run_before_the_next_trial(
    follow: Callable[..., TapSwitch], tmp_path: Path
) -> None:
    """As a source that is gone: the trial is not lost, it is not begun."""
    switch = follow("NobodyHasThisName")
    with pytest.raises(HighFiveError, match=r"NobodyHasThisName is not there; is its name right"):
        switch.wait(0.1)
    clips = load_clips(SIMULATED, protocol("tipping"))
    with VirtualClock() as clock, ExitStack() as stack:
        run = VirtualStage(clock, stack, tmp_path / "gone", template="tipping", clips=clips, switch=switch)
        with pytest.raises(RunFailedError, match="is not there"):
            run.play("I1", "interactive", 1, style="angry", clip=3, cell="")


def test_refused_in_one_line(fails: Callable[..., str], tmp_path: Path) -> None:
    folder = study(tmp_path, "morph", {"participants = 16": "participants = 1"})
    words = ("--study", folder, "--participant", "P01", "--consent", "1", "--no-open")
    assert "leave out --tap-switch" in fails(*words, "--tap-switch", "Dummy")
    with pytest.raises(HighFiveError, match="without quotation marks"):
        TapSwitch("it's")
