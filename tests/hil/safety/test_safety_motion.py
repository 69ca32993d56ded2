"""Position, speed and acceleration: whatever is wanted, every joint can always still brake before its limits."""

import numpy as np
import pytest
from envelope_cases import LIMITS, READY_POSE, Loop, said
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from highfive.hil.safety import motion
from highfive.hil.safety.motion import Motion, at_rest, braking_speed
from highfive.hil.safety.rules import Rule
from highfive.hil.safety.states import State

POSES = arrays(float, 6, elements=st.floats(-8.0, 8.0))
TICKS_S = st.floats(0.0, 0.0125)
WITHIN = arrays(float, 6, elements=st.floats(0.0, 1.0)).map(
    lambda share: LIMITS.lowest + share * (LIMITS.highest - LIMITS.lowest)
)


def stopped(commanded: Motion, dt: float) -> Motion:
    """The joints after braking, by the law that the envelope itself uses."""
    for _ in range(2000):
        if not commanded.velocities.any():
            return commanded
        velocities, acted = motion.within_limits(LIMITS, commanded, motion.braked(LIMITS, commanded, dt), dt)
        assert (np.abs(velocities - commanded.velocities) <= LIMITS.braking * dt + 1e-9).all()
        assert not acted  # nothing has to brake it harder
        commanded = motion.moved(commanded, velocities, None, dt)
    raise AssertionError("it never stood still")


@given(WITHIN, st.lists(st.tuples(POSES, TICKS_S, st.floats(0.0, 1.0)), max_size=60), st.floats(1e-3, 0.0125))
@settings(max_examples=150, deadline=None)
def test_a_joint_can_always_brake_before_its_limits(start: np.ndarray, wants: list, braking_dt: float) -> None:
    """Random wants, ticks and slowing for the person; then braking with ticks of yet another length."""
    commanded = at_rest(start)
    for requested, dt, share in wants:
        within, _ = motion.target_position(LIMITS, requested)
        velocities_to, _ = motion.towards(LIMITS, commanded, within, dt)
        velocities, _ = motion.within_limits(LIMITS, commanded, velocities_to, dt)
        assert (np.abs(velocities - commanded.velocities) <= LIMITS.acceleration * dt + 1e-9).all()
        assert (np.abs(velocities) <= LIMITS.speed + 1e-9).all()
        commanded = motion.moved(commanded, share * velocities, within, dt)
        assert (LIMITS.lowest - 1e-9 <= commanded.positions).all()
        assert (commanded.positions <= LIMITS.highest + 1e-9).all()
    end = stopped(commanded, braking_dt)
    assert (LIMITS.lowest - 1e-9 <= end.positions).all()
    assert (end.positions <= LIMITS.highest + 1e-9).all()


@given(st.floats(0.0, 4.0), st.floats(0.5, 40.0), st.floats(1e-4, 0.02))
@settings(deadline=None)
def test_the_braking_speed_leaves_just_the_room(room: float, acceleration: float, dt: float) -> None:
    v = braking_speed(room, acceleration, dt)
    assert v * dt + v * v / (2 * acceleration) == pytest.approx(room, abs=1e-12)


def test_no_room_is_no_speed() -> None:
    assert braking_speed(0.0, 20.0, 0.008) == braking_speed(-1.0, 20.0, 0.008) == braking_speed(0.0, 20.0, 0.0) == 0.0


def test_what_is_wanted_within_the_limits_is_sent_as_it_is() -> None:
    """A smooth motion is neither late nor changed."""
    loop = Loop(start=READY_POSE).tracking()
    sent, requested = [], []
    for tick in range(240):
        requested.append(READY_POSE + 0.2 * (1.0 - np.cos(2 * np.pi * tick / 240)) * np.ones(6))
        command = loop.tick(requested[-1])
        assert command is not None
        sent.append(command.positions)
    assert np.allclose(sent, requested, atol=1e-9)
    assert loop.report.acted == frozenset()


@given(st.lists(POSES, min_size=1, max_size=30))
@settings(max_examples=40, deadline=None)
def test_what_is_sent_keeps_every_limit_whatever_is_wanted(wants: list) -> None:
    loop = Loop(start=READY_POSE).tracking()
    for requested in wants:
        loop.follow(requested, 3)
    assert loop.state is State.TRACKING, loop.report
    sent, speeds = np.array(loop.commanded), loop.speeds()
    assert (LIMITS.lowest <= sent + 1e-9).all()
    assert (sent <= LIMITS.highest + 1e-9).all()
    assert (np.abs(speeds) <= LIMITS.speed + 1e-6).all()
    dt = np.diff(loop.times)[1:, None] * 1e-9
    assert (np.abs(np.diff(speeds, axis=0)) <= LIMITS.acceleration * dt + 1e-6).all()


def test_a_position_beyond_the_limit_is_not_sent() -> None:
    loop = Loop(start=READY_POSE).tracking().follow(np.full(6, 9.0), 600)
    assert Rule.POSITION in loop.report.acted
    assert np.allclose(loop.commanded[-1], LIMITS.highest, atol=1e-3)
    assert (loop.commanded[-1] <= LIMITS.highest).all()


def test_a_joint_wanted_far_outside_does_not_hold_up_the_others() -> None:
    requested = READY_POSE + 0.2
    requested[0] = 1e6
    loop = Loop(start=READY_POSE).tracking().follow(requested, 600)
    assert np.allclose(loop.commanded[-1][1:], requested[1:], atol=1e-6)


def test_a_jump_is_made_with_the_acceleration_and_the_speed_of_the_limits() -> None:
    loop = Loop(start=READY_POSE).tracking()
    acted = set()
    for tick in range(60):  # 4 rad/s, which is too fast
        loop.tick(READY_POSE + np.array([4.0 * tick / 120, 0, 0, 0, 0, 0]))
        acted |= loop.report.acted
    assert {Rule.ACCELERATION, Rule.SPEED} <= acted
    assert loop.speeds()[:, 0].max() == pytest.approx(LIMITS.speed[0], rel=1e-6)


def test_a_joint_that_is_behind_makes_up_for_it_slowly() -> None:
    loop = Loop(start=READY_POSE).tracking()
    there = READY_POSE + np.array([1.0, 0, 0, 0, 0, 0])
    loop.follow(there, 60)
    assert Rule.CATCH_UP in loop.report.acted
    assert loop.speeds()[20:, 0].max() <= LIMITS.motion.catch_up + 1e-6
    loop.follow(there, 90)
    assert np.allclose(loop.commanded[-1], there, atol=1e-6)
    assert np.max(loop.commanded, axis=0)[0] <= there[0] + 1e-6  # and does not shoot past


def test_a_late_tick_makes_the_arm_late_not_fast() -> None:
    loop = Loop(start=READY_POSE).tracking()
    pace = np.array([2.0, 0, 0, 0, 0, 0])
    for tick in range(30):
        loop.tick(READY_POSE + pace * tick / 120)
    before = loop.commanded[-1]
    loop.tick(READY_POSE + pace * 36 / 120, elapsed_ns=50_000_000)
    assert (loop.commanded[-1] - before)[0] <= LIMITS.speed[0] * 0.0125 + 1e-9


def test_a_joint_that_begins_outside_its_limits_only_comes_back() -> None:
    start = READY_POSE.copy()
    start[1] = LIMITS.lowest[1] - 0.05
    loop = Loop(start=start).tracking()
    loop.follow(start - 1.0, 60)
    assert min(commanded[1] for commanded in loop.commanded) >= start[1]
    loop.follow(READY_POSE, 300)
    assert np.allclose(loop.commanded[-1], READY_POSE, atol=1e-6)


def test_two_ticks_at_once_move_nothing() -> None:
    loop = Loop(start=READY_POSE).tracking().follow(READY_POSE + 0.5, 10)
    before = loop.commanded[-1]
    loop.tick(READY_POSE + 0.5, elapsed_ns=0, arm=said(before, loop.now_ns))
    assert np.array_equal(loop.commanded[-1], before)
