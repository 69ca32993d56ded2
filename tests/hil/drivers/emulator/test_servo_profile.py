"""The profile generator against what any profile must do, and against the manual's equations."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from highfive.hil.drivers.emulator.servo_profile import (
    RECTANGLE,
    STEP,
    TRAPEZOID,
    TRIANGLE,
    Profile,
    to_position,
    to_velocity,
)

ANGLES, SPEEDS = st.floats(-7.0, 7.0), st.floats(-3.0, 3.0)
FASTEST, PUSHES = st.floats(0.05, 4.0), st.floats(0.2, 50.0)


def integrated(profile: Profile, end: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    times = np.linspace(0.0, end, 301)
    course = np.array([profile.at(time) for time in times])
    return times, course[:, 0], course[:, 1]


@given(ANGLES, SPEEDS, ANGLES, FASTEST, PUSHES)
def test_a_course_arrives_at_rest_without_a_jump(start, velocity, goal, fastest, push) -> None:
    profile = to_position(start, velocity, goal, fastest, push)
    assert profile.at(profile.duration) == pytest.approx((goal, 0.0), abs=1e-6)
    assert profile.at(0.0) == pytest.approx((start, velocity))
    assert profile.at(profile.duration + 5.0) == (goal, 0.0)
    times, position, speed = integrated(profile, profile.duration)
    step = times[1]
    assert np.abs(np.diff(position)).max() <= max(abs(velocity), fastest) * step + 1e-6
    assert np.abs(np.diff(speed)).max() <= push * step + 1e-6
    assert np.abs(speed).max() <= max(abs(velocity), fastest) + 1e-9
    slack = (abs(velocity) + fastest) * step  # a kink between two points
    assert position[-1] - start == pytest.approx(np.trapezoid(speed, times), abs=slack + 1e-6)


@given(ANGLES, SPEEDS, ANGLES, FASTEST, PUSHES, st.floats(0.01, 0.99), ANGLES)
def test_a_new_goal_goes_on_from_where_the_course_is(start, velocity, goal, fastest, push, share, other) -> None:
    first = to_position(start, velocity, goal, fastest, push)
    time = share * first.duration
    second = to_position(*first.at(time), other, fastest, push)
    assert second.at(0.0) == pytest.approx(first.at(time))
    assert second.at(second.duration)[0] == pytest.approx(other, abs=1e-6)


def test_times_of_the_manual() -> None:
    """t1 = 64 · velocity / acceleration in ms: register units of 0.229 rev/min and 214.577 rev/min²."""
    velocity, push = 100, 20
    speed, acceleration = velocity * 0.229 * math.tau / 60.0, push * 214.577 * math.tau / 3600.0
    profile = to_position(0.0, 0.0, 30.0, speed, acceleration)
    assert profile.kind == TRAPEZOID
    assert profile.phases[0][0] == pytest.approx(64.0 * velocity / push * 1e-3, rel=2e-3)
    assert profile.duration == pytest.approx(30.0 / speed + speed / acceleration)


def test_kinds_of_the_manual() -> None:
    assert to_position(0.0, 0.0, 1.0, 0.0, 5.0).kind == STEP
    assert to_position(0.0, 0.0, 1.0, 2.0, 0.0).kind == RECTANGLE
    assert to_position(0.0, 0.0, 1.0, 1.0, 5.0).kind == TRAPEZOID
    assert to_position(0.0, 0.0, 0.1, 1.0, 5.0).kind == TRIANGLE
    assert to_position(0.0, 0.0, 1.0, 0.0, 5.0).at(0.0) == (1.0, 0.0)
    assert to_position(0.0, 0.0, 1.0, 2.0, 0.0).at(0.25) == pytest.approx((0.5, 2.0))


@given(ANGLES, ANGLES, st.floats(0.1, 5.0), st.floats(0.0, 5.0))
def test_a_timed_course_takes_its_time(start, goal, whole, speeding) -> None:
    profile = to_position(start, 0.0, goal, whole, speeding, timed=True)
    assert profile.duration == pytest.approx(whole)
    assert profile.at(whole * (1 - 1e-9))[0] == pytest.approx(goal, abs=1e-6)
    assert profile.at(whole / 2.0)[0] == pytest.approx((start + goal) / 2.0, abs=1e-9), "it is symmetric"


@given(SPEEDS, SPEEDS, st.floats(0.1, 50.0))
def test_to_a_velocity(velocity, goal, push) -> None:
    assume(abs(goal - velocity) > 1e-6)
    profile = to_velocity(0.0, velocity, goal, push)
    assert profile.duration == pytest.approx(abs(goal - velocity) / push)
    assert profile.at(profile.duration + 3.0)[1] == pytest.approx(goal)
    assert to_velocity(0.0, velocity, goal, 0.0).at(0.0)[1] == goal
