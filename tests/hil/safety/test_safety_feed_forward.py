"""What goals lead by: its own limits, those of the joints, and the rules for the person on the sum that is sent."""

import numpy as np
import pytest
from envelope_cases import FAR, LIMITS, READY_POSE, TICK_NS, Loop, plate
from hypothesis import given, settings
from hypothesis import strategies as st

from highfive.hil.drivers.values import JointState
from highfive.hil.safety import feed_forward
from highfive.hil.safety.feed_forward import no_lead
from highfive.hil.safety.limits_file import lowered
from highfive.hil.safety.motion import Motion
from highfive.hil.safety.people import Human
from highfive.hil.safety.rules import Rule
from highfive.hil.safety.speeds import closing_speed, face_speed
from highfive.hil.safety.states import State
from highfive.model.geometry.rotations import Array

SECONDS = TICK_NS * 1e-9
STRETCHED = np.array([0.0, 0.5, -0.3, 0.0, -0.2, 0.0])


@given(seed=st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=40)
def test_an_offset_never_breaks_a_limit_and_gets_where_it_is_wanted(seed: int) -> None:
    """References that use their limits up, and requests that jump; then both are let be."""
    rng, offset, tick = np.random.default_rng(seed), no_lead(len(LIMITS.joints)), SECONDS
    most, low, high = LIMITS.acceleration, LIMITS.lowest, LIMITS.highest
    positions, speeds, requested, goals = rng.uniform(low, high), np.zeros(6), np.zeros(6), []
    for step in range(400):
        requested = rng.uniform(-0.1, 0.1, 6) if step < 300 else requested
        before, last = Motion(positions, speeds), offset
        pushed = np.clip(speeds + rng.choice([-1.0, 0.0, 1.0], 6) * most * tick, -LIMITS.speed, LIMITS.speed)
        inside = (positions + tick * pushed > low) & (positions + tick * pushed < high)
        speeds = np.where(inside, pushed, 0.0) if step < 300 else np.zeros(6)
        pushes = np.abs(speeds - before.velocities) / tick
        within = feed_forward.bounds(LIMITS, offset, positions + tick * speeds, tick)
        rates = feed_forward.next_rates(LIMITS, offset, requested, before, speeds, within, tick)
        positions = positions + tick * speeds
        offset = feed_forward.moved(LIMITS, offset, rates, positions, tick)
        goals.append(positions + offset.offsets)
        if step > 2:
            speed = (goals[-1] - goals[-2]) / tick
            change = np.abs(speed - (goals[-2] - goals[-3]) / tick) / tick
            assert (np.abs(speed) <= LIMITS.speed + 1e-6).all()
            stopped = (goals[-1] <= low) | (goals[-1] >= high) | (goals[-2] <= low) | (goals[-2] >= high)
            stopped |= np.maximum(np.abs(offset.offsets), np.abs(last.offsets)) >= LIMITS.feed_forward.largest
            assert (stopped | (change <= np.maximum(most, pushes) * 1.001 + 1e-6)).all()
            assert (goals[-1] >= low - 1e-9).all()
            assert (goals[-1] <= high + 1e-9).all()
    np.testing.assert_allclose(goals[-1], np.clip(positions + requested, low, high), atol=2e-3)


def near_somebody(rng: np.random.Generator, human: Human) -> tuple[Loop, Array, Array]:
    """A loop in which goals shall lead by anything, changing all the time; goals (T, J), and where the arm was."""
    loop = Loop(start=READY_POSE, human=human).tracking()
    goals, was = [loop.commanded[-1]], [loop.measured]
    requested = np.zeros(6)
    for tick in range(100):
        if tick % 6 == 0:
            requested = rng.uniform(-0.3, 0.3, 6)  # more than may be
        share = min(1.0, tick * SECONDS / 0.4)
        before = loop.measured.copy()
        loop.tick(READY_POSE + share * (STRETCHED - READY_POSE), feed_forward=requested)
        goals.append(loop.commanded[-1])
        was.append(before)
    return loop, np.array(goals), np.array(was)


@given(seed=st.integers(0, 2**32 - 1), ahead=st.floats(0.05, 0.3), side=st.floats(-0.15, 0.15))
@settings(deadline=None, max_examples=30)
@pytest.mark.slow
def test_goals_that_lead_keep_the_rules_for_hand_and_face(seed: int, ahead: float, side: float) -> None:
    """What is sent, as it is sent: joints and plate, whatever is requested of it, near a hand and near a head."""
    rng, end = np.random.default_rng(seed), plate(STRETCHED)
    palm, head = end + np.array([ahead - 0.2, side, 0.0]), end + np.array([ahead, side, 0.2])
    for human, which in (
        (Human(FAR.head, palm, np.zeros(3), 0), "hand"),
        (Human(head, FAR.palm, np.zeros(3), 0), "head"),
    ):
        loop, goals, was = near_somebody(rng, human)
        times = SECONDS * np.arange(len(goals))
        assert (goals >= LIMITS.lowest - 1e-9).all() and (goals <= LIMITS.highest + 1e-9).all()
        assert (np.abs(np.diff(goals, axis=0)) <= LIMITS.speed * SECONDS * 1.001 + 1e-9).all()
        plates, bodies = (np.array([plate(pose) for pose in poses]) for poses in (goals, was))
        if which == "hand":
            place = np.tile(palm, (len(goals), 1))
            still = np.zeros_like(place)
            assert closing_speed(times, plates, place, LIMITS.contact, bodies, still) <= LIMITS.contact.speed
        else:
            assert face_speed(times, plates[:, None], np.tile(head, (len(goals), 1)), LIMITS.face) <= LIMITS.face.speed
        leads = goals[1:] - np.array([r.reference for r in loop.reports[-100:]])
        assert np.abs(leads).max() <= LIMITS.feed_forward.largest + 1e-9


def test_without_the_rule_an_offset_alone_would_be_too_fast_near_a_face() -> None:
    """The arm stands in the face zone; the offset may not throw the plate about there."""
    head = plate(READY_POSE) + np.array([0.15, 0.0, 0.1])
    loop = Loop(start=READY_POSE, human=Human(head, FAR.palm, np.zeros(3), 0)).tracking()
    for tick in range(60):
        loop.tick(READY_POSE, feed_forward=np.full(6, 0.1 if tick % 20 < 10 else -0.1))
    speeds = np.linalg.norm(np.diff([plate(goal) for goal in loop.commanded], axis=0), axis=1) / SECONDS
    assert 0.5 * LIMITS.face.speed < speeds.max() <= LIMITS.face.speed
    assert any(Rule.FEED_FORWARD in report.acted for report in loop.reports)
    free = Loop(start=READY_POSE).tracking()
    for tick in range(60):
        free.tick(READY_POSE, feed_forward=np.full(6, 0.1 if tick % 20 < 10 else -0.1))
    fast = np.linalg.norm(np.diff([plate(goal) for goal in free.commanded], axis=0), axis=1) / SECONDS
    assert fast.max() > 1.5 * LIMITS.face.speed


def test_a_request_that_is_no_number_stops_the_arm() -> None:
    loop = Loop(start=READY_POSE).tracking()
    loop.tick(READY_POSE, feed_forward=np.full(6, np.nan))
    assert loop.state is State.STOPPING
    assert Rule.NOT_FINITE in loop.report.acted
    assert np.isfinite(loop.commanded[-1]).all()


def test_a_held_arm_keeps_what_its_goals_lead_by() -> None:
    """At an emergency stop, too: the goal is where the arm is, and what its load takes."""
    loop = Loop(start=READY_POSE).tracking()
    loop.follow(READY_POSE, 60, feed_forward=np.full(6, 0.04))
    loop.tick(READY_POSE, estop_ns=loop.now_ns)
    np.testing.assert_allclose(loop.commanded[-1] - loop.measured, 0.04, atol=1e-3)
    loop.follow(READY_POSE, 30, estop_ns=loop.now_ns, feed_forward=np.full(6, -0.1))
    np.testing.assert_allclose(loop.commanded[-1] - loop.measured, 0.04, atol=1e-3)


@pytest.mark.parametrize("slow", [0.1, 0.22])
def test_no_point_is_faster_than_its_limit_anywhere(slow: float) -> None:
    """The reduced speed for an arm in whose room nobody is tracked; goals that lead included."""
    limits = lowered(LIMITS, {"motion.point_speed": slow})
    loop, rng = Loop(limits, start=READY_POSE).tracking(), np.random.default_rng(0)
    for tick in range(300):
        loop.tick(READY_POSE + min(1.0, tick / 40) * (STRETCHED - READY_POSE), feed_forward=rng.uniform(-0.1, 0.1, 6))
    speeds = np.linalg.norm(np.diff([plate(goal) for goal in loop.commanded], axis=0), axis=1) / SECONDS
    assert 0.9 * slow < speeds.max() <= slow
    assert any(Rule.POINT_SPEED in report.acted for report in loop.reports)


def test_the_arm_is_compared_with_the_reference_it_is_to_hold() -> None:
    """A joint that stands where it shall be does not stray, however far its goal leads."""
    limits = lowered(LIMITS, {"servo.following": 0.05, "servo.following_s": 0.02})
    loop = Loop(limits, start=READY_POSE).tracking()
    loop.follow(READY_POSE, 60, feed_forward=np.full(6, 0.09))
    assert isinstance(loop.inputs(None).arm, JointState)
    assert loop.state is State.TRACKING


def test_goals_that_lead_are_slow_while_nobody_knows_where_the_person_is() -> None:
    """It retracts as fast as it may, and requests jump: what is sent is no faster than near a face."""
    loop, rng = Loop(lowered(LIMITS, {"face.speed": 0.1}), start=STRETCHED).tracking(), np.random.default_rng(1)
    loop.human, requested = None, np.zeros(6)
    for tick in range(400):
        requested = rng.uniform(-0.1, 0.1, 6) if tick % 6 == 0 else requested
        loop.tick(STRETCHED, feed_forward=requested)
    assert any(report.state is State.RETRACTING for report in loop.reports)
    speeds = np.linalg.norm(np.diff([plate(goal) for goal in loop.commanded], axis=0), axis=1) / SECONDS
    assert 0.05 < speeds.max() <= 1.1 * 0.1  # the two postures' Jacobians differ
