"""Where goals lead an arm: never where it must not be, never at once, and where they say in the end."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highfive.hil.arm.arm_files import limits_of
from highfive.hil.arm.goal_course import COURSE, GoalCourse
from highfive.hil.arm_model.arm_folder import DEFAULT_ARM, find_arm, shipped
from highfive.hil.arm_model.servo_arm import default_arm, mounted
from highfive.model.errors import HighFiveError

ARM = default_arm()
LIMITS = limits_of(ARM.folder)
NAMES = ARM.folder.names
READY = np.array(ARM.folder.ready)
S = 1_000_000_000


def named(angles: np.ndarray) -> dict[str, float]:
    return dict(zip(NAMES, angles.tolist(), strict=True))


def course() -> GoalCourse:
    return GoalCourse(ARM, LIMITS, READY)


def test_before_a_goal_it_stays_and_a_goal_is_reached_and_kept() -> None:
    way, goal = course(), READY + 0.1
    assert (way.at(5 * S) == READY).all()
    led = way.lead(named(goal), READY, 5 * S)
    assert led == pytest.approx(goal)
    assert way.at(5 * S) == pytest.approx(READY)
    assert way.at(50 * S) == pytest.approx(goal)


def test_goals_of_a_stream_are_gone_to_in_as_long_as_they_are_apart() -> None:
    """A line at constant speed, given thirty times a second, is followed a thirtieth later, without a stop."""
    way, speed, apart = course(), np.array([0.5, 0.0, 0.0, -0.3, 0.0, 0.0]), S // 30
    for n in range(1, 30):
        way.lead(named(READY + speed * n / 30), way.at(n * apart), n * apart)
        if n > 4:  # what is made up for after the first
            for part in (0.0, 0.3, 0.9):
                now = n * apart + part * apart
                assert way.at(round(now)) == pytest.approx(READY + speed * (now / S - 1 / 30), abs=1e-6)


@given(st.lists(st.floats(-4.0, 4.0), min_size=6, max_size=6), st.floats(0.0, 3.0))
def test_no_posture_on_the_way_is_outside_the_limits_or_meets_anything(goal: list[float], seconds: float) -> None:
    way = course()
    led = way.lead(named(np.array(goal)), READY, S)
    for posture in (way.at(S + round(seconds * S)), led):
        assert (posture >= np.array([joint.lowest for joint in LIMITS.joints]) - 1e-12).all()
        assert (posture <= np.array([joint.highest for joint in LIMITS.joints]) + 1e-12).all()
        assert ARM.clearance(posture) >= COURSE.clearance - 0.02  # between two that were looked at: 0.02 rad of 0.75 m


def test_a_way_that_is_not_free_ends_before() -> None:
    """Whatever the goal, it is on the straight way to it; and asking again leads no further."""
    rng, blocked = np.random.default_rng(1), 0
    for _ in range(200):
        goal = rng.uniform(ARM.packed.low, ARM.packed.high)
        way = course()
        led = way.lead(named(goal), READY, S)
        within = np.clip(goal, [j.lowest for j in LIMITS.joints], [j.highest for j in LIMITS.joints])
        share = float((led - READY) @ (within - READY)) / float((within - READY) @ (within - READY))
        assert led == pytest.approx(READY + share * (within - READY), abs=1e-9)
        assert ARM.clearance(led) >= COURSE.clearance
        if share < 1.0:
            blocked += 1
            again = way.lead(named(goal), led, 20 * S)
            assert np.abs(again - led).max() <= COURSE.step
            assert ARM.clearance(again) >= COURSE.clearance
    assert 20 < blocked < 180


def test_an_arm_that_rests_on_something_gets_away_and_no_nearer() -> None:
    """Goals that lead into the table, given a thousand times, do not push an arm into it bit by bit."""
    low = next(q for q in _postures() if 0.0 < ARM.clearance(q) < 0.5 * COURSE.clearance)
    nearer = next(q for q in _postures() if ARM.clearance(q) < -0.05)
    way, at = GoalCourse(ARM, LIMITS, low), low
    for n in range(1000):
        at = way.lead(named(nearer), at, n * S)
        assert ARM.clearance(at) >= ARM.clearance(low) - 1e-12
    assert ARM.clearance(way.lead(named(READY), at, 2000 * S)) >= ARM.clearance(low) - 1e-12


def _postures():
    rng = np.random.default_rng(0)
    while True:
        yield rng.uniform([joint.lowest for joint in LIMITS.joints], [joint.highest for joint in LIMITS.joints])


def test_a_joint_that_is_not_named_keeps_its_goal() -> None:
    way = course()
    way.lead({"elbow": READY[2] + 0.2}, READY, S)
    led = way.lead({"waist": READY[0] - 0.1}, READY, 2 * S)
    assert led == pytest.approx(READY + np.array([-0.1, 0.0, 0.2, 0.0, 0.0, 0.0]))


def test_from_where_it_is_when_it_was_held_back() -> None:
    """What slows the arm, a rule of the envelope, is not made up for in a jump."""
    way = course()
    way.lead(named(READY + 0.3), READY, S)
    held = READY + 0.05
    way.lead(named(READY + 0.4), held, 60 * S)
    assert way.at(60 * S) == pytest.approx(held)


@pytest.mark.parametrize(
    ("goals", "said"),
    [
        ({"gripper": 0.1}, "no joint gripper; there are waist, "),
        ({"waist": float("nan")}, "waist: nan is no angle"),
        ({"waist": float("inf")}, "no angle"),
        ({"waist": "0.1"}, "no angle"),
        ({"waist": True}, "no angle"),
        ({"waist": 0.1, "elbow": None}, "elbow: None"),
    ],
)
def test_what_is_no_goal_is_refused_and_leads_nowhere(goals: dict, said: str) -> None:
    way = course()
    with pytest.raises(HighFiveError, match=said):
        way.lead(goals, READY, S)
    assert (way.at(50 * S) == READY).all() and (way.goal == READY).all()


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name == DEFAULT_ARM else pytest.mark.slow) for name in shipped()]
)
def test_any_arm(name: str) -> None:
    arm = mounted(find_arm(name))
    ready = np.array(arm.folder.ready)
    way = GoalCourse(arm, limits_of(arm.folder), ready)
    led = way.lead({arm.folder.names[0]: float(ready[0]) + 0.1}, ready, S)
    assert led[0] == pytest.approx(ready[0] + 0.1) and led[1:] == pytest.approx(ready[1:])
