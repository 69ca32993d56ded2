"""Everything that stops the arm, and everything that makes it hold or retract, provoked in the loop."""

import json
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from envelope_cases import FAR, LIMITS, READY_POSE, REST, TICK_NS, Loop, kinematics, said, well

from highfive.hil.drivers.values import JointState
from highfive.hil.safety.envelope import step
from highfive.hil.safety.limits import JOINTS
from highfive.hil.safety.people import Human
from highfive.hil.safety.rules import Rule
from highfive.hil.safety.startup import Check
from highfive.hil.safety.states import Event, State
from highfive.model.geometry.rotations import Array

PACE = np.array([1.5, 0.5, -0.5, 1.0, 0.5, 1.0])
MOVING_TICKS = 40


def moving(**other: Any) -> Loop:
    """An arm in motion."""
    loop = Loop(start=READY_POSE, **other).tracking()
    for tick in range(MOVING_TICKS):
        loop.tick(READY_POSE + PACE * tick / 120)
    assert np.abs(loop.before.motion.velocities).max() > 1.0  # pyright: ignore[reportOptionalMemberAccess]
    return loop


def wanted_on(loop: Loop) -> Array:
    return READY_POSE + PACE * len(loop.commanded) / 120


def stops(loop: Loop, rule: Rule, reason: str, ticks: int = 1, **other: Any) -> None:
    """With ``other`` known, for so many ticks, the arm brakes by that rule, stands, and stays until acknowledged."""
    for _ in range(ticks):
        began = len(loop.commanded)
        loop.tick(wanted_on(loop), **other)
        if loop.report.event is Event.FAULT:
            break
    assert loop.state is State.STOPPING, loop.report
    assert rule in loop.report.acted
    assert reason in loop.report.reason
    assert "\n" not in loop.report.reason
    for _ in range(60):  # and the fault stays
        loop.tick(wanted_on(loop), **other)
        if loop.state is State.STOPPED:
            break
    assert loop.state is State.STOPPED
    change = np.abs(np.diff(loop.speeds()[began - 2 :], axis=0))
    assert (change <= LIMITS.braking * TICK_NS * 1e-9 + 1e-6).all()  # braked, not jerked
    assert reason in loop.report.reason
    stays(loop)


def stays(loop: Loop) -> None:
    """It holds, with torque, whatever is wanted, until a person acknowledges and the servos are checked again."""
    place = loop.commanded[-1]
    for _ in range(30):
        command = loop.tick(wanted_on(loop))
        assert command is not None
        assert np.array_equal(command.positions, place)
        assert (command.currents > 0.0).all()
    assert loop.before.stopped_by
    loop.tick(wanted_on(loop), acknowledge=True)
    assert not loop.before.stopped_by
    assert loop.state is State.UNCHECKED
    loop.follow(READY_POSE, 5)  # the check from before does not count
    assert loop.state is State.UNCHECKED
    assert loop.report.reason == "the servos have to be checked"
    assert np.array_equal(loop.commanded[-1], place)
    again = Loop(loop.limits, now_ns=loop.now_ns)
    again.before, again.measured, again.commanded, again.times = loop.before, loop.measured, [place], [loop.now_ns]
    again.ready()
    again.tick(place)
    assert again.state is State.TRACKING
    assert not again.report.reason


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_wanted_position_that_is_no_number(bad: float) -> None:
    loop = moving()
    requested = READY_POSE.copy()
    requested[3] = bad
    loop.tick(requested)
    assert loop.state is State.STOPPING
    assert Rule.NOT_FINITE in loop.report.acted
    assert "requested positions" in loop.report.reason
    assert np.isfinite(loop.commanded[-1]).all()
    json.dumps(loop.report.record())


@pytest.mark.parametrize("shape", [(5,), (7,), (6, 1), ()])
def test_the_wrong_number_of_positions(shape: tuple[int, ...]) -> None:
    loop = moving()
    loop.tick(np.zeros(shape))
    assert loop.state is State.STOPPING
    assert Rule.NOT_FINITE in loop.report.acted


@pytest.mark.parametrize("name", ["positions", "velocities", "currents"])
def test_servos_that_say_no_number(name: str) -> None:
    loop = moving()
    arm = said(loop.measured, loop.now_ns + TICK_NS)
    getattr(arm, name)[1] = np.nan
    stops(loop, Rule.NOT_FINITE, f"the servos' {name}", arm=arm)


@pytest.mark.parametrize("name", ["head", "palm", "palm_velocity"])
def test_a_person_who_is_no_number(name: str) -> None:
    loop = moving()
    stops(loop, Rule.NOT_FINITE, "the person's", human=replace(FAR, **{name: np.array([0.0, np.nan, 0.0])}))


def test_kinematics_that_are_no_number() -> None:
    loop = moving()
    loop.kinematics = lambda positions: (kinematics(positions)[0] * np.nan, kinematics(positions)[1])
    before = loop.commanded[-1]
    loop.tick(wanted_on(loop))
    assert Rule.NOT_FINITE in loop.report.acted
    assert np.array_equal(loop.commanded[-1], before)  # nobody knows how near the person is
    loop.tick(wanted_on(loop))
    assert loop.state is State.STOPPED


@pytest.mark.parametrize(
    ("bits", "name"),
    [(1, "input voltage"), (4, "overheating"), (16, "electrical shock"), (32, "overload"), (128, "bit 7")],
)
def test_an_error_of_a_servo(bits: int, name: str) -> None:
    loop = moving()
    errors = np.zeros(6, dtype=np.int64)
    errors[2] = bits
    arm = replace(said(loop.measured, loop.now_ns + TICK_NS), errors=errors)
    stops(loop, Rule.SERVO_ERROR, f"the servo of elbow reports {name}", arm=arm)


def test_a_servo_that_stopped_by_itself() -> None:
    """Goals are refused by a servo whose watchdog has tripped."""
    loop = moving()
    tripped = np.zeros(6, dtype=bool)
    tripped[3] = True
    arm = replace(said(loop.measured, loop.now_ns + TICK_NS), tripped=tripped)
    stops(loop, Rule.SERVO_ERROR, f"the servo of {JOINTS[3]} stopped by itself", arm=arm)


def test_one_servo_that_does_not_answer() -> None:
    loop = moving()
    answered = np.ones(6, dtype=bool)
    answered[4] = False
    since = loop.now_ns
    for _ in range(20):
        arm = replace(said(loop.measured, loop.now_ns + TICK_NS), answered=answered)
        loop.tick(wanted_on(loop), arm=arm)
        if loop.state is not State.TRACKING:
            break
    silent_s = 1e-9 * (loop.now_ns - since)
    assert LIMITS.servo.silent_s < silent_s <= LIMITS.servo.silent_s + 1.01e-9 * TICK_NS
    stops(moving(), Rule.SILENT_SERVO, "wrist_angle has not answered", ticks=20, arm=arm)


def test_no_servo_that_answers() -> None:
    stops(moving(), Rule.SILENT_SERVO, "wrist_rotate have not answered", ticks=20, arm=None)


def test_one_lost_reply_stops_nothing() -> None:
    loop = moving()
    loop.follow(wanted_on(loop), 3, arm=None)
    assert loop.state is State.TRACKING


def test_a_hot_servo() -> None:
    loop = moving()
    hot = well(loop.now_ns)
    hot.temperatures[1] = LIMITS.servo.temperature
    loop.tick(wanted_on(loop), health=hot)
    assert loop.state is State.TRACKING
    hot.temperatures[1] += 1.0
    stops(loop, Rule.TEMPERATURE, "shoulder has 61 °C, at most 60", health=hot)


@pytest.mark.parametrize("volts", [10.9, 14.1])
def test_a_voltage_outside_its_limits(volts: float) -> None:
    loop = moving()
    health = well(loop.now_ns)
    health.voltages[5] = volts
    stops(loop, Rule.VOLTAGE, f"wrist_rotate has {volts} V, not 11.0 to 14.0", health=health)


def test_temperatures_that_nobody_reads() -> None:
    stops(moving(), Rule.HEALTH, "have not been read", health=None)
    loop = moving()
    old = well(loop.now_ns - 2_100_000_000)
    stops(loop, Rule.HEALTH, "are 2.1 s old", health=old)


def parted(loop: Loop, by: float, **other: Any) -> JointState:
    return replace(said(loop.measured, loop.now_ns + TICK_NS), apart=np.array([0, 0, by, 0, 0, 0.0]), **other)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_two_servos_of_a_joint_that_do_not_agree(sign: float) -> None:
    """For so long, and not before: a reading at another instant of a fast movement is no slip."""
    loop = moving()
    for _ in range(30):
        loop.tick(wanted_on(loop), arm=parted(loop, sign * 0.99 * LIMITS.servo.shadow))
    assert loop.state is State.TRACKING
    loop = moving()
    for _ in range(round(0.09 / 1e-9 / TICK_NS)):
        loop.tick(wanted_on(loop), arm=parted(loop, sign * 1.01 * LIMITS.servo.shadow))
    loop.tick(wanted_on(loop))
    assert loop.state is State.TRACKING
    ticks = 0
    while loop.state is State.TRACKING and ticks < 30:
        loop.tick(wanted_on(loop), arm=parted(loop, sign * 0.05))
        ticks += 1
    assert ticks * TICK_NS * 1e-9 == pytest.approx(LIMITS.servo.shadow_s, abs=2e-9 * TICK_NS)
    assert loop.state is State.STOPPING and Rule.SHADOW_MISMATCH in loop.report.acted
    assert "the two servos of elbow have been more than 0.03 rad apart for" in loop.report.reason


def test_two_servos_of_which_one_is_silent_are_not_compared() -> None:
    """What is known of them then is from different times."""
    loop = moving()
    there = np.array([True, True, False, True, True, True])
    for _ in range(4):
        loop.tick(wanted_on(loop), arm=parted(loop, 0.5, answered=there))
    assert loop.state is State.TRACKING and loop.before.watch.parted_ns == (None,) * 6


def test_a_joint_that_does_not_follow() -> None:
    loop = moving()
    stuck = loop.measured.copy()
    since = None
    for _ in range(80):
        loop.tick(wanted_on(loop), arm=said(stuck, loop.now_ns + TICK_NS))
        strays = np.abs(loop.commanded[-2] - stuck).max() > LIMITS.servo.following
        since = loop.now_ns if since is None and strays else since
        if loop.state is not State.TRACKING:
            break
    assert since is not None
    assert loop.state is State.STOPPING
    assert Rule.FOLLOWING in loop.report.acted
    assert "waist has been more than 0.35 rad off" in loop.report.reason
    strayed_s = 1e-9 * (loop.now_ns - since)
    assert strayed_s == pytest.approx(LIMITS.servo.following_s, abs=1.1e-9 * TICK_NS)


def test_a_joint_that_strays_for_a_moment_stops_nothing() -> None:
    loop = moving()
    for _ in range(4):
        loop.follow(loop.commanded[-1], 10)
        for _ in range(25):  # of the 30 that it takes
            loop.tick(loop.commanded[-1], arm=said(loop.measured + 0.5, loop.now_ns + TICK_NS))
    assert loop.state is State.TRACKING


def test_a_loop_that_is_late_again_and_again() -> None:
    loop = moving()
    for _ in range(4):  # now and then is no harm
        loop.tick(wanted_on(loop), elapsed_ns=2 * TICK_NS)
        loop.tick(wanted_on(loop))
    assert loop.state is State.TRACKING
    for _ in range(int(LIMITS.timing.late_run)):
        assert loop.state is State.TRACKING
        loop.tick(wanted_on(loop), elapsed_ns=2 * TICK_NS)
    assert loop.state is State.STOPPING
    assert Rule.DEADLINE in loop.report.acted
    assert "6 commands in a row were late" in loop.report.reason
    assert loop.before.stopped_by == {Rule.DEADLINE}


@pytest.mark.parametrize(("elapsed_ns", "reason"), [(81_000_000, "paused for 81 ms"), (-1_000_000, "1.0 ms backwards")])
def test_a_loop_whose_clock_jumps(elapsed_ns: int, reason: str) -> None:
    loop = moving()
    before = loop.commanded[-1]
    loop.tick(wanted_on(loop), elapsed_ns=elapsed_ns)
    assert Rule.DEADLINE in loop.report.acted
    assert reason in loop.report.reason
    assert np.abs(loop.commanded[-1] - before).max() <= LIMITS.speed.max() * 0.0125


def test_a_person_not_seen_is_held_for_and_then_retracted_from() -> None:
    """100 ms, then 500 ms; with torque all the while, slowly, and to where the arm rests."""
    loop = moving()
    began, states, seen = loop.now_ns, {}, loop.now_ns
    for _ in range(900):
        loop.human = replace(FAR, age_ns=loop.now_ns + TICK_NS - seen)
        command = loop.tick(wanted_on(loop))
        assert command is not None
        assert (command.currents > 0.0).all()
        states.setdefault(loop.state, (1e-9 * (loop.now_ns - began), loop.report.acted))
    for state, when, rule in (
        (State.HOLDING, LIMITS.stale.hold_s, Rule.STALE_HOLD),
        (State.RETRACTING, LIMITS.stale.retract_s, Rule.STALE_RETRACT),
    ):
        assert states[state][0] == pytest.approx(when, abs=1.01e-9 * TICK_NS)
        assert rule in states[state][1]
    assert loop.state is State.READY
    assert np.abs(loop.commanded[-1] - REST).max() < 0.01
    retracting = loop.speeds()[[r.state is State.RETRACTING for r in loop.reports[-len(loop.commanded) + 1 :]]]
    assert np.abs(retracting).max() <= LIMITS.motion.retract + 1e-6


def test_the_way_back_is_the_known_path() -> None:
    """Through every way point from the nearest one on, straight from one to the next."""
    start = READY_POSE + np.array([0.4, 0.3, -0.2, 0.5, 0.2, 0.1])
    loop = Loop(start=start).tracking()
    loop.human = None
    loop.follow(start, 1200)
    commanded = np.array(loop.commanded)
    for way_point in LIMITS.way_points:
        assert np.abs(commanded - way_point).max(axis=1).min() < 0.01
    between = commanded[np.abs(commanded - READY_POSE).max(axis=1).argmin() :]
    share = (between[:, 1] - READY_POSE[1]) / (REST[1] - READY_POSE[1])
    straight = READY_POSE + share[:, None] * (REST - READY_POSE)
    assert np.abs(between - straight).max() < 0.012


def test_nothing_wanted_is_stale_too() -> None:
    loop = moving()
    states = []
    for _ in range(80):
        loop.tick(None)
        states.append(loop.state)
    assert State.HOLDING in states
    assert states[-1] is State.RETRACTING


def test_current_is_low_unless_the_hand_is_known_to_be_away() -> None:
    loop = Loop(start=READY_POSE).tracking()
    palm = kinematics(READY_POSE)[0][0]
    cases: list[tuple[Human | None, Array]] = [
        (FAR, LIMITS.current),
        (Human(FAR.head, palm + np.array([LIMITS.contact.near + 0.01, 0, 0]), np.zeros(3), 0), LIMITS.current),
        (Human(FAR.head, palm + np.array([LIMITS.contact.near - 0.01, 0, 0]), np.zeros(3), 0), LIMITS.contact_current),
        (Human(FAR.head, None, None, 0), LIMITS.contact_current),
        (None, LIMITS.contact_current),
    ]
    for human, currents in cases:
        loop.human = human
        command = loop.tick(READY_POSE)
        assert command is not None
        assert np.array_equal(command.currents, currents)
        assert (Rule.CURRENT in loop.report.acted) is (currents is LIMITS.contact_current)


def test_the_emergency_stop_freezes_the_arm_where_it_is() -> None:
    loop = moving()
    lag = 0.06 * PACE
    there = loop.measured - lag  # the servos are behind what they were told
    pulled = loop.now_ns
    command = loop.tick(wanted_on(loop), estop_ns=pulled, arm=said(there, loop.now_ns + TICK_NS, PACE))
    assert command is not None
    assert loop.state is State.ESTOPPED
    assert Rule.ESTOP in loop.report.acted
    assert np.allclose(command.positions, there)  # not where they were going
    assert "8.3 ms after it was pulled" in loop.report.reason
    loop.follow(wanted_on(loop), 20, estop_ns=pulled)
    assert np.array_equal(loop.commanded[-1], command.positions)
    loop.tick(wanted_on(loop), estop_ns=pulled, acknowledge=True)  # still pulled
    assert loop.state is State.ESTOPPED
    stays(loop)


def test_an_emergency_stop_of_an_arm_that_was_stopped_already_keeps_why() -> None:
    loop = moving()
    requested = READY_POSE.copy()
    requested[3] = np.nan
    loop.tick(requested)
    assert loop.state is State.STOPPING
    loop.tick(wanted_on(loop), estop_ns=loop.now_ns)
    assert loop.state is State.ESTOPPED and loop.before.stopped_by == {Rule.NOT_FINITE, Rule.ESTOP}
    assert re.fullmatch(r"requested positions.*; then emergency stop, seen .*", loop.report.reason)


def test_an_emergency_stop_believes_no_wild_reading() -> None:
    loop = moving()
    commanded = loop.commanded[-1]
    answered = np.array([True, True, True, True, True, False])
    arm = replace(said(commanded + 3.0, loop.now_ns + TICK_NS), answered=answered)
    command = loop.tick(wanted_on(loop), estop_ns=loop.now_ns, arm=arm)
    assert command is not None
    moved = command.positions - commanded
    assert np.allclose(moved[:5], LIMITS.servo.following)
    assert moved[5] == 0.0
    loop = moving()
    commanded = loop.commanded[-1]
    loop.tick(wanted_on(loop), estop_ns=loop.now_ns, arm=None)
    assert np.array_equal(loop.commanded[-1], commanded)


def test_an_emergency_stop_that_came_late_says_so() -> None:
    loop = moving()
    loop.tick(wanted_on(loop), estop_ns=loop.now_ns - 30_000_000)
    assert "later than 20 ms" in loop.report.reason


def test_nothing_is_sent_and_nothing_moves_before_the_check() -> None:
    loop = Loop(start=READY_POSE)
    loop.follow(READY_POSE + 1.0, 10)
    assert loop.commanded == []
    assert Rule.START_UP in loop.report.acted
    assert loop.report.reason == "the servos have to be checked"
    loop.check = Check(loop.now_ns, ("servo 4: operating_mode is 3, it has to be 5",))
    loop.follow(READY_POSE + 1.0, 10)
    assert loop.commanded == []
    assert "operating_mode is 3" in loop.report.reason
    loop.check = Check(loop.now_ns, ())
    loop.tick(READY_POSE, health=None)  # and not with a fault either
    assert loop.commanded == []
    some = np.array([True] * 5 + [False])  # nor from where a joint only was
    loop.tick(READY_POSE, arm=replace(said(READY_POSE, loop.now_ns + TICK_NS), answered=some))
    assert loop.commanded == []
    loop.tick(READY_POSE)
    assert loop.state is State.READY
    assert np.array_equal(loop.commanded[-1], READY_POSE)


def test_the_report_can_be_recorded() -> None:
    loop = moving()
    report = loop.report
    record = json.loads(json.dumps(report.record(), allow_nan=False))
    assert record["state"] == "tracking"
    assert record["asked"] == pytest.approx((READY_POSE + PACE * (MOVING_TICKS - 1) / 120).tolist())
    assert report.sent is not None
    assert record["positions"] == report.sent.positions.tolist()
    assert record["acted"] == []
    assert record["gap"] == pytest.approx(report.gap)


def test_a_step_changes_nothing_that_was_passed_in() -> None:
    """The same again gives the same: state in, state out."""
    loop = moving()
    inputs, now = loop.inputs(wanted_on(loop)), loop.now_ns + TICK_NS
    first = step(LIMITS, kinematics, loop.before, inputs, now)
    second = step(LIMITS, kinematics, loop.before, inputs, now)
    assert first[2].record() == second[2].record()
