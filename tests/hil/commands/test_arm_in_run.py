"""An experiment's trials with an arm, in virtual time: it answers, plays again, and leaves who is near it alone."""

from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import numpy as np
import pytest
from helpers.virtual_stage import VirtualStage
from numpy.typing import NDArray
from virtual_system import VirtualSystem

from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.lifecycle import emulator_options, virtual_arm
from highfive.hil.commands.shown_again import recorded_motion, recorded_trial
from highfive.hil.drivers.emulator.bus_faults import parse_faults
from highfive.hil.drivers.emulator.emulator_process import make_bus
from highfive.hil.drivers.emulator.virtual_rig import VirtualRig
from highfive.hil.experiments.stage import RunFailedError, TrialBrokenOffError
from highfive.hil.experiments.trial_row import TrialRow
from highfive.hil.recording.recording import read_recording
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.safety.states import State
from highfive.hil.trials.live_partner import LivePerson, live_source
from highfive.hil.trials.partners import simulated_partners
from highfive.hil.view.commands import Command

ADDRESS = "vicon://lab"


class Run(VirtualStage):
    """A stage with a virtual arm."""

    def __init__(self, clock: VirtualClock, stack: ExitStack, folder: Path, person: LivePerson | None = None) -> None:
        self.virtual = VirtualRig(clock, make_bus(emulator_options(ArmOptions())))
        self.loop = stack.enter_context(virtual_arm(self.virtual))
        super().__init__(clock, stack, folder, person, loop=self.loop)

    def way(self, row: TrialRow) -> NDArray[np.float64]:
        """(C, J) rad, of the arm in a trial."""
        session, span = recorded_trial(self.folder / row.recording, f"{row.trial}, asked as {row.ask}")
        return np.array([message.data["positions"] for message in session.read(span, ("/arm",)).of("/arm")])

    def met(self, row: TrialRow) -> NDArray[np.float64]:
        """(3,) m, her palm as palms met."""
        path, title = self.folder / row.recording, f"{row.trial}, asked as {row.ask}"
        session, span = recorded_trial(path, title)
        motion = recorded_motion(path, title)
        due = round(1e9 * float(session.read(span, ("/contact",)).of("/contact")[-1].data["met_time"]))
        return motion.people[motion.row(due)].palm.position


def plate(run: Run, joints: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3,) m, where it is at joints (J,), rad."""
    arm = run.loop.retarget.arm
    return arm.plate_at(arm.standing(joints)).position


@pytest.fixture
def clock() -> Iterator[VirtualClock]:
    with VirtualClock() as clock:
        yield clock


@pytest.mark.slow(35)
def test_it_answers_and_goes_the_same_way_again_and_rests_after_each_trial(clock: VirtualClock, tmp_path: Path) -> None:
    with ExitStack() as stack:
        run = Run(clock, stack, tmp_path)
        run.play("I1", "interactive", 1)  # it begins where the emulator has it, not where it rests
        first = run.play("I2", "interactive", 2)
        run.play("I3", "interactive", 3)
        again = run.play("R2", "own_replay", 4, first)
        assert not run.loop.trouble
        run.stage.close()
        ways = [run.way(row) for row in (first, again)]
        met = run.met(first)
        away = [np.linalg.norm([plate(run, joints) - met for joints in way], axis=1) for way in ways]
    assert first.contact_ns and again.contact_ns and again.contact_ns > first.contact_ns  # it is shown again
    assert away[0].min() < 0.02 and away[1].min() < 0.06  # the plate comes to where palms met
    assert all(one[0] > 0.2 and one[-1] > 0.2 for one in away)  # from, and back to, where it rests
    assert abs(int(away[1].argmin()) - int(away[0].argmin())) < 12  # cycles: a tenth of a second
    assert all(np.abs(way[-1] - ways[0][0]).max() < 0.03 for way in ways)


@pytest.mark.slow(20)
def test_an_arm_that_does_not_answer_is_not_played_to_who_stays_within_its_reach(
    clock: VirtualClock, tmp_path: Path
) -> None:
    """She goes on raising her hand where she stands; the arm stands again before the run goes on."""
    recording = simulated_partners(1, ("neutral",), ("B2",), 3)[0].recording
    system = VirtualSystem(clock, recording)
    with ExitStack() as stack:
        source = stack.enter_context(closing(live_source(ADDRESS, None, system.wiring)))
        run = Run(clock, stack, tmp_path, LivePerson(source, ADDRESS, clock=clock))
        first = run.play("I1", "interactive", 1)
        assert first.contact_ns
        with pytest.raises(TrialBrokenOffError, match=r"m from the arm's base.*does not answer her; expected"):
            run.play("R1", "own_replay", 2, first)
        assert not run.loop.trouble
        assert run.play("I2", "interactive", 3).contact_ns  # it is fit to answer her again


@pytest.mark.slow(20)
def test_what_is_broken_off_brings_the_arm_to_rest_and_what_stops_it_ends_the_run(
    clock: VirtualClock, tmp_path: Path
) -> None:
    with ExitStack() as stack:
        run = Run(clock, stack, tmp_path)
        whole = run.play("I1", "interactive", 1)
        poses = run.page.poses

        def presses(after: int, do: object) -> None:
            while run.page.poses < after:
                clock.wait_until(clock.now() + 1_000_000)
            do()  # pyright: ignore[reportCallIssue]

        clock.start("experimenter", lambda: presses(poses + 150, lambda: run.page.pressed.append(Command("break_off"))))
        with pytest.raises(TrialBrokenOffError, match="by the experimenter"):
            run.play("I1", "interactive", 2)
        rested = run.loop.measured
        assert rested is not None and np.abs(rested - run.way(whole)[-1]).max() < 0.03
        poses = run.page.poses
        clock.start("somebody", lambda: presses(poses + 150, run.loop.estop.pull))
        with pytest.raises(RunFailedError, match=r"the arm was stopped: .*emergency stop"):
            run.play("I1", "interactive", 3)
        with pytest.raises(RunFailedError, match="emergency"):
            run.play("I1", "interactive", 4)


@pytest.mark.slow
def test_a_stop_on_the_way_back_is_said_at_once_and_the_trial_counts(
    clock: VirtualClock, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with ExitStack() as stack:
        run = Run(clock, stack, tmp_path)

        def pull() -> None:
            while run.loop.state is not State.RETRACTING:
                clock.wait_until(clock.now() + 50_000_000)
            run.loop.estop.pull()

        clock.start("hand on the button", pull)
        row = run.play("I1", "interactive", 1)
        assert row.contact_ns is not None
        assert sum("the arm was stopped: emergency stop" in said for said in caplog.messages) == 1
        with pytest.raises(RunFailedError, match="the arm was stopped: emergency stop"):
            run.play("I2", "interactive", 2)
        run.stage.close()
        found = read_recording(run.folder / row.recording)
    (fault,) = [message.data for message in found.channels["/event"] if message.data["event"] == "fault"]
    assert "emergency stop" in fault["detail"]


@pytest.mark.slow
def test_a_trial_in_which_the_arm_was_not_fit_to_follow_does_not_count(clock: VirtualClock, tmp_path: Path) -> None:
    """Its supply was gone for a moment in the pause before: its servos say so until somebody looks at them."""
    with ExitStack() as stack:
        run = Run(clock, stack, tmp_path)
        run.play("I1", "interactive", 1)
        run.virtual.bus.set_faults(parse_faults(["brownout@0.02-0.12"]), run.virtual.now())
        clock.wait_until(clock.now() + 200_000_000)
        with pytest.raises(RunFailedError, match="voltage"):
            run.play("I2", "interactive", 2)
