"""The arm's loop over the twin: retargeting, envelope and servos in a row, in simulated time."""

import itertools
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from paths import HELPERS

from highfive.hil.arm.arm_figures import ArmResults, arm_figures, arm_summary
from highfive.hil.arm.arm_trial import arm_trial
from highfive.hil.arm.contact_outcome import ReferenceTrajectory
from highfive.hil.arm.loop import ArmLoop
from highfive.hil.arm.planner import Retarget
from highfive.hil.arm.planner_values import ExpectedContact, PalmGoal
from highfive.hil.arm.reachability import cell_point, facing
from highfive.hil.arm.rig_planner import full_errors, retarget_settings
from highfive.hil.arm.simulated_driver import SimulatedDriver, mounted_arm
from highfive.hil.arm_model.servo_arm import default_arm, solve
from highfive.hil.bench.contact import contact_figures, played, played_by, twin_loop
from highfive.hil.drivers.bus.cycle_ring import Mode
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.latch import Latch
from highfive.hil.drivers.values import JointCommand
from highfive.hil.report.arm_report import arm_section
from highfive.hil.safety.limits_file import load_limits
from highfive.hil.safety.people import Sighting
from highfive.hil.safety.rules import Rule
from highfive.hil.safety.startup import Check
from highfive.hil.safety.states import State
from highfive.hil.sim.people.grid import CELLS
from highfive.mocap_bridge.frames import PalmPose
from highfive.model.errors import HighFiveError

READY = default_arm().ready

RATE_HZ = 120.0
TICK_NS = round(1e9 / RATE_HZ)
UP = np.array([0.0, 0.0, 1.0])
HEAD = np.array([1.1, 0.0, 1.65])
LIMITS = load_limits()


@pytest.fixture
def loop() -> ArmLoop:
    return twin_loop()


def over(
    twin: SimulatedDriver,
    estop: Latch | None = None,
    mismatches: tuple[str, ...] = (),
) -> ArmLoop:
    retarget = Retarget(default_arm(), READY, retarget_settings(load_rig(), load_limits(), on_the_way=0.0))
    return ArmLoop(
        twin,
        retarget,
        LIMITS,
        lambda: Check(twin.now(), mismatches),
        estop or Latch(twin),
        twin,
    )


def new_twin() -> SimulatedDriver:
    return SimulatedDriver(mounted_arm(), full_errors(load_rig()))


def still_hand(cell: str, seconds: float = 1.2, rate_hz: float = RATE_HZ) -> ReferenceTrajectory:
    """A hand that waits at a cell, and an avatar that comes to it from 0.4 m away."""
    normal, place, goals = facing(), cell_point(cell), []
    count = round(seconds * rate_hz) + 20
    for tick in range(count):
        left = max(seconds - tick / rate_hz, 0.0)
        ours = PalmPose(place - 0.33 * left * normal, normal, UP, 0.33 * normal * (left > 0.0))
        theirs = PalmPose(place, -normal, UP, np.zeros(3))
        contact = ExpectedContact(place, 1e-6 * np.eye(3), normal, left) if left < 1.0 else None
        goals.append(PalmGoal(ours, theirs, HEAD, contact))
    palms, due = np.array([goal.palm.position for goal in goals]), round(seconds * rate_hz)
    return ReferenceTrajectory(
        "neutral", cell, tuple(goals), np.tile(place, (count, 1)), palms, np.tile(normal, (count, 1)), due, due
    )


@pytest.mark.parametrize("cell", ["A1", "B2", "B3"])
@pytest.mark.slow
def test_a_hand_that_waits_is_met(loop: ArmLoop, cell: str) -> None:
    trial = played(still_hand(cell), loop)
    assert trial.met.touched
    assert trial.met.error < 0.010
    assert abs(trial.met.late) < 0.1
    assert loop.state is State.READY  # and the arm is at rest again


def paced(rate_hz: float, seconds: float = 0.9) -> np.ndarray:
    """(T, J) references of a hand that waits, in ticks of a pace, from the tick on in which it is known, each 0.1 s."""
    loop = twin_loop()
    loop.begin()
    due, found = loop.clock.now(), []
    for goal in still_hand("B2", seconds, rate_hz).goals[: round(seconds * rate_hz) + 1]:
        loop.clock.wait_until(due)
        loop.note_frame()
        found.append(loop.tick(goal).report.reference)
        due += round(1e9 / rate_hz)
    return np.array([found[round(0.1 * tenth * rate_hz)] for tenth in range(1, round(10 * seconds) + 1)], dtype=float)


@pytest.mark.parametrize("rate_hz", [90.0, 100.0])
def test_the_arm_is_as_quick_at_another_pace_of_the_frames(rate_hz: float) -> None:
    usual, other = paced(RATE_HZ), paced(rate_hz)
    assert np.abs(usual[-1] - usual[0]).max() > 0.4
    np.testing.assert_allclose(other, usual, atol=0.015)


def test_what_is_sent_keeps_the_limits(loop: ArmLoop) -> None:
    trial = played(still_hand("A3"), loop)
    sent = np.array([tick.report.sent.positions for tick in trial.ticks if tick.report.sent is not None])
    speeds = np.abs(np.diff(sent, axis=0)) * RATE_HZ
    assert (sent >= LIMITS.lowest - 1e-9).all()
    assert (sent <= LIMITS.highest + 1e-9).all()
    assert (speeds <= LIMITS.speed * 1.01).all()
    found = trial.separation_speeds(loop.retarget.arm, LIMITS)
    assert 0.0 < found["wire_closing_speed"] <= LIMITS.contact.speed
    assert found["wire_face_speed"] <= LIMITS.face.speed


def test_the_driver_gets_what_the_report_says_and_nothing_else(loop: ArmLoop) -> None:
    """Number for number: nothing is added between the envelope and the wire."""
    trial = played(still_hand("A3"), loop)
    went = {cycle.begun_ns: cycle.sent for cycle in trial.cycles if cycle.sent is not None}
    leads = []
    for report in (tick.report for tick in trial.ticks):
        command = went.get(report.time_ns)
        if command is None:  # the first waits for the check, the last for the cycle after it
            continue
        assert report.sent is not None and report.reference is not None
        assert np.array_equal(command.positions, report.sent.positions)
        assert np.array_equal(command.currents, report.sent.currents)
        leads.append(np.abs(report.sent.positions - report.reference).max())
    assert len(leads) >= len(trial.ticks) - 3
    assert 0.01 < max(leads) <= LIMITS.feed_forward.largest  # goals do lead, and the report has it


def test_what_goes_over_the_bus_keeps_the_limits_too(loop: ArmLoop) -> None:
    """With what is added because the joints give way; high five after high five."""
    played(still_hand("B2"), loop)
    trial = played(still_hand("A3"), loop)
    goals = trial.sent[np.isfinite(trial.sent).all(axis=1)]
    assert len(goals) > 100
    assert (goals >= LIMITS.lowest - 1e-9).all()
    assert (goals <= LIMITS.highest + 1e-9).all()
    assert (np.abs(np.diff(goals, axis=0)) * RATE_HZ <= LIMITS.speed * 1.01).all()
    most = np.array([joint.acceleration for joint in LIMITS.joints])
    assert (np.abs(np.diff(goals, 2, axis=0)) * RATE_HZ**2 <= most * 1.01).all()


def test_a_joint_is_where_the_envelope_wants_it_although_it_gives_way(loop: ArmLoop) -> None:
    """The servos answer to the error only: gravity alone would leave the shoulder lower."""
    waiting = still_hand("B2").goals[0]
    ticks, cycles = loop.play([PalmGoal(waiting.palm, waiting.person, HEAD)] * 240)
    reference = ticks[-1].report.reference
    assert reference is not None
    actual = cycles[-1].state.positions
    alone = np.array(loop.retarget.settings.sag) * default_arm().gravity(actual)
    assert np.abs(alone).max() > np.radians(0.5)
    assert np.abs(actual - reference).max() < 0.2 * np.abs(alone).max()


@pytest.mark.slow
def test_nothing_is_compiled_any_more_once_the_arm_is_ready() -> None:
    """With torque on nobody waits: the servos' watchdogs and the rule for late commands take a pause for a fault."""
    lines = (
        "import sys",
        "from test_arm_loop import played, still_hand, twin_loop",
        "ours = [m for n, m in sys.modules.items() if n.startswith(('highfive.hil.arm.', 'highfive.hil.arm_model.'))]",
        "count = lambda: {n: len(f.signatures) for m in ours for n, f in vars(m).items() if hasattr(f, 'signatures')}",
        "assert len(count()) > 10",
        "loop = twin_loop(); before = count(); played(still_hand('B2'), loop); assert before == count(), count()",
    )
    where = os.pathsep.join([str(Path(__file__).parent), str(HELPERS), os.environ.get("PYTHONPATH", "")])
    subprocess.run([sys.executable, "-c", "\n".join(lines)], check=True, env=os.environ | {"PYTHONPATH": where})


def test_nothing_moves_while_the_check_finds_something() -> None:
    twin = new_twin()
    loop = over(twin, mismatches=("its torque is off", "another"))
    with pytest.raises(HighFiveError, match=r"its torque is off \(and 1 more\)"):
        loop.play(still_hand("B2").goals)
    assert twin.mode is Mode.HOLDING  # no command came


def test_the_emergency_stop_ends_a_high_five_where_it_is() -> None:
    twin = new_twin()
    estop = Latch(twin)
    loop = over(twin, estop)
    loop.begin()
    goals = still_hand("B2").goals
    for goal in goals[:80]:
        loop.tick(goal)
        twin.wait_until(twin.now() + TICK_NS)
    estop.pull()
    stopped = [loop.tick(goal) for goal in goals[80:90]]
    assert loop.state is State.ESTOPPED
    assert "emergency stop" in loop.trouble
    places = np.array([tick.report.sent.positions for tick in stopped if tick.report.sent is not None])
    assert (places == places[0]).all()
    with pytest.raises(HighFiveError, match="emergency stop"):
        loop.begin()
    before = loop.state
    loop.rest()
    assert loop.state is before  # what was stopped is not brought to rest


@pytest.mark.parametrize("left", [100, 1])
def test_a_controlled_stop_is_played_to_its_end(left: int) -> None:
    """Even where it begins with the last goal: the arm is never left with the goal of a motion."""
    twin = new_twin()
    loop = over(twin)

    def goals() -> Iterator[PalmGoal]:
        for number, goal in enumerate(still_hand("B2").goals[: 80 + left]):
            if number == 80:
                twin.wait_until(twin.now() + 100_000_000)  # for so long the servos would have heard nothing
            yield goal

    ticks, _ = loop.play(goals())
    assert "paused" in loop.trouble
    assert loop.state is State.STOPPED
    sent = np.array([tick.report.sent.positions for tick in ticks if tick.report.sent is not None])
    assert np.abs(np.diff(sent[60:80], axis=0)).max() > 0.002  # it was moving
    stood = twin.newest()
    for _ in range(40):
        twin.wait_until(twin.now() + TICK_NS)
    after = twin.newest()
    assert stood is not None and after is not None
    np.testing.assert_allclose(after.state.positions, stood.state.positions, atol=0.02)


def test_a_person_who_is_not_seen_any_more_is_held_for_and_retracted_from() -> None:
    twin = new_twin()
    loop = over(twin)
    loop.begin()
    states = []
    for tick, goal in enumerate((*still_hand("B2").goals[:60], *still_hand("B2").goals)):
        seen = goal if tick < 60 else PalmGoal(goal.palm)
        states.append(loop.tick(seen).report.state)
        twin.wait_until(twin.now() + TICK_NS)
        if tick < 60:
            loop.note_frame()
    assert list(dict.fromkeys(states)) == [
        State.UNCHECKED, State.READY, State.TRACKING, State.HOLDING, State.RETRACTING,
    ] or list(dict.fromkeys(states)) == [State.READY, State.TRACKING, State.HOLDING, State.RETRACTING]  # fmt: skip


@pytest.mark.parametrize("part", ["head_seen", "person_seen"])
def test_a_source_whose_clock_stands_still_does_not_make_a_measurement_younger(part: str) -> None:
    """Head or hand were measured once; the source says for ever that this was a millisecond ago."""
    twin = new_twin()
    loop = over(twin)
    loop.begin()
    ages: dict[State, float] = {}
    for tick, goal in enumerate(still_hand("B2", 2.0).goals[:140]):
        loop.note_frame()
        seen = {"head_seen": Sighting(), "person_seen": Sighting()}
        if tick > 60:
            seen[part] = Sighting(1_000_000)
        state = loop.tick(replace(goal, **seen)).report.state
        assert tick < 5 or tick > 60 or state is State.TRACKING
        if tick > 60:
            ages.setdefault(state, (tick - 60) / RATE_HZ)
        twin.wait_until(twin.now() + TICK_NS)
    assert ages[State.HOLDING] <= LIMITS.stale.hold_s
    assert ages[State.RETRACTING] <= LIMITS.stale.retract_s


@pytest.mark.slow
def test_the_summary_tells_it_all(loop: ArmLoop) -> None:
    trials = [played(still_hand(cell), loop) for cell in ("B2", "B1")]
    rows = [arm_figures(n, trial, loop.retarget, LIMITS) for n, trial in enumerate(trials, 3)]
    summary = arm_summary(rows, loop.retarget)
    assert summary["trials"] == 2
    assert summary["missed"] == 0
    assert summary["missed_cycles"] == 0
    assert summary["unanswered"] == 0
    assert summary["error_mm"]["max"] >= summary["error_mm"]["median"] > 0.0
    assert 0.0 < summary["closing_speed"]["wire"] <= LIMITS.contact.speed
    assert summary["face_speed"]["wire"] <= LIMITS.face.speed
    assert summary["cycles"] == sum(len(trial.cycles) for trial in trials)
    assert set(summary["rules"]) <= {rule.value for rule in Rule}
    assert [(row["trial"], row["cell"]) for row in summary["rows"]] == [(3, "B2"), (4, "B1")]
    # People count from 1, as in the table of all high fives.
    rows = [row for row in arm_section(summary, {}).split("<tr>") if "B2</td>" in row or "B1</td>" in row]
    cells = [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in rows]
    assert [(row[0], row[2]) for row in cells] == [("4", "B2"), ("5", "B1")]


@pytest.mark.slow
def test_a_long_session_keeps_figures_of_every_high_five_and_ticks_of_the_first(
    loop: ArmLoop, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("highfive.hil.arm.arm_figures.WHOLE", 1)
    lag, results = loop.retarget.settings.lag, ArmResults()
    trials = [played(still_hand(cell), loop) for cell in ("B2", "B1")]
    for number, trial in enumerate(trials):
        results.add(number, trial, loop.retarget, LIMITS)
    assert list(results.whole) == [0] and results.whole[0] is trials[0]
    for figures, trial in zip(results.figures, trials, strict=True):
        np.testing.assert_allclose(figures.following, trial.following_error(lag), atol=1e-6)
        np.testing.assert_allclose(figures.currents, trial.currents, atol=1e-6)
        assert len(figures.took_ms) == len(trial.cycles)
    assert sum(sys.getsizeof(value) for value in vars(results.figures[1]).values()) < 100_000


@pytest.mark.parametrize(("stop", "broken_off"), [(100, True), (160, False)])
def test_a_high_five_in_which_the_arm_was_stopped_says_nothing_of_how_palms_meet(stop: int, broken_off: bool) -> None:
    """The session goes on with its avatar; the arm stands. After the contact, a stop takes nothing back."""
    twin = new_twin()
    estop = Latch(twin)
    loop, reference, ticks = over(twin, estop), still_hand("B2"), []
    loop.begin()
    for number, goal in enumerate(reference.goals):
        if number == stop:
            estop.pull()
        loop.note_frame()
        ticks.append(loop.tick(goal))
        twin.wait_until(twin.now() + TICK_NS)
    trial = arm_trial(reference, loop.retarget, ticks, loop.cycles(), loop.relaxation)
    summary = arm_summary([arm_figures(0, trial, loop.retarget, LIMITS)], loop.retarget)
    assert (trial.broken_off, trial.met.touched) == (broken_off, not broken_off)
    assert summary["broken_off"] == int(broken_off) and summary["missed"] == 0
    assert (summary["error_mm"]["median"] is None) == broken_off
    assert "emergency stop" in summary["stopped"]


def test_a_high_five_that_was_stopped_is_counted_and_the_next_one_played(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the bench does with the emulated rig, over twins: the first arm is stopped in its second high five."""
    estop, done = Latch(), []

    class Stopped(SimulatedDriver):
        """Somebody pulls the emergency stop in the second high five, before the palms meet."""

        count = 0

        def drive(self, command: JointCommand) -> None:
            super().drive(command)
            self.count += len(done)
            if self.count == 100:
                estop.pull()

    reference = [still_hand(cell) for cell in ("B2", "B1", "A2")]
    loops = [over(Stopped(mounted_arm(), full_errors(load_rig())), estop), over(new_twin())]

    def made_ready(_: object) -> AbstractContextManager[ArmLoop]:
        return nullcontext(loops.pop(0))

    monkeypatch.setattr("highfive.hil.bench.contact.ready_arm", made_ready)
    results, figures = played_by("rig", reference, lambda *_: lambda *_, **__: done.append(1))
    assert [(one.met.cell, one.met.touched, bool(one.stopped)) for one in results] == [
        ("B2", True, False), ("B1", False, True), ("A2", True, False),
    ]  # fmt: skip
    assert np.isnan(results[1].met.error)  # how near it came before it was stopped says nothing
    assert figures["stops"] == 1
    assert "emergency stop" in figures["stopped"][0]
    assert contact_figures([one.met for one in results])["missed"] == ["neutral B1"]
    assert not loops


def test_the_way_back_is_clear_of_everything() -> None:
    """From every cell's posture straight to the first way point, and along the path."""
    arm, path = default_arm(), LIMITS.way_points
    starts = [solve(arm, cell_point(cell), facing(), READY)[0] for cell in CELLS]
    ways = [(start, path[0]) for start in starts] + list(itertools.pairwise(path))
    least = min(arm.clearance(a + s * (b - a)) for a, b in ways for s in np.linspace(0.0, 1.0, 41))
    assert least > 0.09


def test_no_tick_is_made_up_for_after_a_pause_and_late_wake_ups_do_not_add_up() -> None:
    """After a pause the plan would run ahead of the arm; sleeps that end a little late must not stretch the motion."""

    class Late(SimulatedDriver):
        pauses = 0

        def wait_until(self, time_ns: int) -> None:
            self.pauses += 1
            super().wait_until(time_ns + (30_000_000 if self.pauses == 40 else 200_000))

    loop = over(Late(mounted_arm(), full_errors(load_rig())))
    ticks, _ = loop.play(still_hand("B2").goals[:100])
    assert len(ticks) == 100, loop.trouble
    apart = 1e-9 * np.diff([tick.frame_ns for tick in ticks]) * RATE_HZ  # periods
    assert apart.max() > 3.0
    assert (apart > 0.7).all()
    assert np.delete(apart, apart.argmax()).mean() < 1.01
