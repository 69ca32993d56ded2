"""The retargeting meets what can be met, breaks no limit whatever is requested, and says what it gave up."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from highfive.hil.arm.contact_goal import ContactGoalSettings, meeting, until_touch
from highfive.hil.arm.planner import Retarget
from highfive.hil.arm.planner_settings import PlanSettings, RetargetSettings
from highfive.hil.arm.planner_values import ExpectedContact, PalmGoal, RetargetState
from highfive.hil.arm.reachability import cell_point, facing
from highfive.hil.arm_model import dynamics
from highfive.hil.arm_model.servo_arm import ServoArm, default_arm, solve
from highfive.hil.safety.people import speed_near_face
from highfive.hil.session.reach import Phase, ReachTarget
from highfive.hil.session.reach_settings import ReachSettings
from highfive.hil.sim.people.grid import CELLS
from highfive.mocap_bridge.frames import PalmPose
from highfive.model.geometry.rotations import Array
from highfive.model.online.contact_forecast import ContactForecast

READY = default_arm().ready

TICK = 1.0 / 120.0
UP = np.array([0.0, 0.0, 1.0])
EXACT = 1e-6 * np.eye(3)


@pytest.fixture(scope="module")
def arm() -> ServoArm:
    return default_arm()


@pytest.fixture(scope="module")
def retarget(arm: ServoArm) -> Retarget:
    return Retarget(arm, READY, RetargetSettings(lag=0.0))


def palm(position: Array, normal: Array, velocity: Array | None = None) -> PalmPose:
    return PalmPose(position, normal, UP, np.zeros(3) if velocity is None else velocity)


def approach(
    point: Array, seconds: float, speed: float = 0.5, hand: Array | None = None, pace: float = TICK
) -> list[PalmGoal]:
    """A high five at ``point``: an avatar's palm that comes straight, a hand that moves with velocity ``hand``."""
    normal, hand = facing(), np.zeros(3) if hand is None else hand
    goals = []
    for tick in range(round(seconds / pace) + 8):
        left = max(seconds - tick * pace, 0.0)
        ours = palm(point - speed * left * normal, normal, speed * normal * (left > 0.0))
        theirs = palm(point - left * hand, -normal, hand)
        goals.append(PalmGoal(ours, theirs, None, ExpectedContact(point, EXACT, normal, left)))
    return goals


def played(
    retarget: Retarget, goals: list[PalmGoal], state: RetargetState | None = None, pace: float | None = None
) -> list[RetargetState]:
    states, state = [], state or retarget.start()
    for goal in goals:
        state, _ = retarget.step(state, goal, pace)
        states.append(state)
    return states


def plates(arm: ServoArm, states: list[RetargetState]) -> Array:
    return np.array([arm.plate_at(state.joints).position for state in states])


@pytest.mark.parametrize("cell", CELLS)
def test_every_cell_is_met_in_time_and_place(cell: str, arm: ServoArm, retarget: Retarget) -> None:
    point, seconds = cell_point(cell), 1.0
    states = played(retarget, approach(point, seconds))
    due = round(seconds / TICK) - 1
    plate = arm.plate_at(states[due].joints)
    # a still hand: the plate presses on, by what it closes in 30 ms
    assert np.linalg.norm(plate.position - point) < 0.012
    assert plate.normal @ facing() > math.cos(math.radians(20.0))
    assert states[-1].relaxation.delay < 0.06


@pytest.mark.parametrize("rate_hz", [90.0, 100.0, 140.0])
def test_ticks_of_another_pace_meet_in_time_and_place(rate_hz: float, arm: ServoArm, retarget: Retarget) -> None:
    """Live frames are not at 120 Hz: a plan that took each tick for its own would run slow, or ahead."""
    point, seconds, pace = cell_point("C2"), 0.8, 1.0 / rate_hz
    usual = plates(arm, played(retarget, approach(point, seconds)))
    places = plates(arm, played(retarget, approach(point, seconds, pace=pace), pace=pace))
    for share in (0.4, 0.7, 0.9, 1.0):
        at, there = round(share * seconds / pace) - 1, round(share * seconds / TICK) - 1
        assert np.linalg.norm(places[at] - usual[there]) < 0.02, share
    assert np.linalg.norm(places[round(seconds / pace) - 1] - point) < 0.012


def test_a_tick_is_of_the_plans_own_pace_by_default(retarget: Retarget) -> None:
    goals = approach(cell_point("B2"), 0.5)
    by_default, by_name = played(retarget, goals), played(retarget, goals, pace=TICK)
    for one, other in zip(by_default, by_name, strict=True):
        np.testing.assert_array_equal(one.joints, other.joints)


def test_the_plate_comes_along_the_avatars_way(arm: ServoArm, retarget: Retarget) -> None:
    point, normal = cell_point("B2"), facing()
    places = plates(arm, played(retarget, approach(point, 1.0)))
    late = places[round(0.8 / TICK)] - places[round(0.99 / TICK)]
    assert late @ -normal / np.linalg.norm(late) > 0.9


def test_a_contact_not_spoken_of_for_a_moment_is_still_met(arm: ServoArm, retarget: Retarget) -> None:
    point = cell_point("A2")
    goals = [
        PalmGoal(goal.palm, goal.person) if 0.3 < tick * TICK < 0.5 else goal
        for tick, goal in enumerate(approach(point, 1.0))
    ]
    due = round(1.0 / TICK) - 1
    assert np.linalg.norm(plates(arm, played(retarget, goals))[due] - point) < 0.012


@pytest.mark.parametrize("left", [0.05, 0.2, 0.5])
@pytest.mark.parametrize("rate", [0.3, 1.0, 1.8])
def test_the_sessions_clock_runs_out_when_it_is_said_to(left: float, rate: float) -> None:
    """Against the clock itself, stepped finely: at its own rate where nobody knows better."""
    target = ReachTarget(Phase.APPROACH, 0.5, left, np.zeros(3), facing(), rate)
    time, step, settings, remaining = 0.0, 1e-4, ReachSettings(), left
    while remaining > 0.0:
        rate += step / settings.smoothing * (1.0 - rate)
        remaining, time = remaining - rate * step, time + step
    assert until_touch(target, None) == pytest.approx(time, abs=0.012)


def test_settings_reach_the_goal() -> None:
    point, normal = cell_point("B2"), facing()
    theirs = palm(point, -normal, -0.5 * normal)
    forecast = ContactForecast(point + 0.1 * normal, 0.2, np.diag([1e-4, 1e-4, 1e-4, 1e-2]))
    trusting, usual = (
        meeting(theirs, 0.4, forecast, s)[0] for s in (ContactGoalSettings(unsteady=5.0), ContactGoalSettings())
    )
    assert np.linalg.norm(trusting - forecast.point) < np.linalg.norm(usual - forecast.point)
    target = ReachTarget(Phase.APPROACH, 0.5, 0.5, np.zeros(3), normal, 1.0)
    assert until_touch(target, forecast) < until_touch(target, forecast, ContactGoalSettings(sure=0.0)) - 0.05


def test_a_contact_too_soon_is_late_and_says_so(arm: ServoArm, retarget: Retarget) -> None:
    point = cell_point("C3")
    goals = approach(point, 0.2)
    goals += [goals[-1]] * 60
    states = played(retarget, goals)
    given_up = states[-1].relaxation
    assert np.linalg.norm(plates(arm, states)[round(0.2 / TICK) - 1] - point) > 0.03
    assert given_up.delay > 0.03 and given_up.time_scale > 1.1 and given_up.miss > 0.03
    assert set(given_up.limit_names) & {"speed", "torque", "acceleration"}
    assert np.linalg.norm(plates(arm, states)[-1] - point) < 0.03


def test_the_lag_is_made_up_for(arm: ServoArm) -> None:
    lag, hand = 0.06, np.array([-0.25, 0.0, 0.0])
    point = cell_point("B2")
    late = Retarget(arm, READY, RetargetSettings(lag=lag, press=0.0))
    states = played(late, approach(point, 1.0, hand=hand))
    due = round(1.0 / TICK) - 1 - round(lag / TICK)
    assert np.linalg.norm(plates(arm, states)[due] - point) < 0.006


@pytest.mark.parametrize("speed", [-0.7, -0.3, 0.0])
def test_the_hand_is_met_no_faster_than_allowed(speed: float, arm: ServoArm, retarget: Retarget) -> None:
    hand = speed * facing()
    states = played(retarget, approach(cell_point("B2"), 1.0, speed=2.0, hand=hand))
    for state in states[round(1.0 / TICK) - 2 : round(1.0 / TICK) + 1]:
        plate = arm.plate_at(state.joints)
        assert np.linalg.norm(plate.jacobian @ state.speeds - hand) < max(0.78, abs(speed)) + 0.01


def test_near_a_face_the_hand_is_met_gently(arm: ServoArm, retarget: Retarget) -> None:
    point = cell_point("C2")
    goals = [
        PalmGoal(goal.palm, goal.person, point + np.array([0.22, 0.0, 0.08]), goal.contact)
        for goal in approach(point, 1.5, speed=2.0)
    ]
    for state in played(retarget, goals)[round(1.5 / TICK) - 2 : round(1.5 / TICK) + 1]:
        plate = arm.plate_at(state.joints)
        assert np.linalg.norm(plate.jacobian @ state.speeds) < 0.22


def test_the_plan_slows_down_before_a_face_by_itself(arm: ServoArm, retarget: Retarget) -> None:
    """As the envelope would make it, which then has little left to do; who does not know of the face is too fast."""
    settings = retarget.settings

    def excess(goals: list[PalmGoal], head: Array) -> float:
        most = 0.0
        for state in played(retarget, goals):
            plate = arm.plate_at(state.joints)
            velocity, away = plate.jacobian @ state.speeds, head - plate.position
            speed, distance = float(np.linalg.norm(velocity)), float(np.linalg.norm(away))
            way, straight = distance - settings.face_radius, float(away @ velocity) / max(distance * speed, 1e-9)
            allowed = speed_near_face(settings.face_speed, 0.0, way, settings.face_braking, straight)
            most = max(most, speed - allowed)
        return most

    knowing, unknowing = list[float](), list[float]()
    for cell in ("C2", "B2", "A1"):
        head, goals = cell_point(cell) + 0.25 * facing(), approach(cell_point(cell), 1.0)
        knowing.append(excess([PalmGoal(goal.palm, goal.person, head, goal.contact) for goal in goals], head))
        unknowing.append(excess(goals, head))
    assert max(knowing) < 0.12
    assert np.median(unknowing) > 3.0 * np.median(knowing), (knowing, unknowing)


def test_a_head_is_gone_round(arm: ServoArm, retarget: Retarget) -> None:
    point = cell_point("B3")
    ready = arm.plate_at(READY).position
    head = 0.5 * (ready + point) + [0.0, 0.0, 0.06]
    goals = [PalmGoal(g.palm, g.person, head, g.contact) for g in approach(point, 1.2)]
    radius = retarget.settings.head_radius
    start = arm.clearance(READY, head, radius)
    for state in played(retarget, goals):
        assert arm.clearance(state.joints, head, radius) > min(start, PlanSettings().hard_gap) - 1e-3


def test_between_high_fives_it_goes_back_to_rest(retarget: Retarget) -> None:
    away = approach(cell_point("A1"), 0.6)
    states = played(retarget, [*away, *[PalmGoal(away[-1].palm)] * 300])
    assert states[-1].joints == pytest.approx(READY, abs=0.12)
    assert np.abs(states[-1].speeds).max() < 0.05


def test_the_same_in_gives_the_same_out(retarget: Retarget) -> None:
    one, other = (played(retarget, approach(cell_point("A3"), 0.6)) for _ in range(2))
    for a, b in zip(one, other, strict=True):
        assert np.array_equal(a.joints, b.joints) and np.array_equal(a.accelerations, b.accelerations)


number = st.floats(-3.0, 3.0)
wild = st.tuples(number, number, number).map(np.array)


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.tuples(wild, wild, wild, st.floats(0.0, 2.0), st.booleans()), min_size=3, max_size=8),
    st.integers(0, 99),
)
def test_no_limit_is_broken_whatever_is_requested(arm: ServoArm, retarget: Retarget, requests: list, seed: int) -> None:
    packed = arm.packed
    rng = np.random.default_rng(seed)
    state = retarget.start(rng.uniform(packed.low, packed.high) * 0.6)
    clear = arm.clearance(state.joints)
    for point, velocity, head, time, known in requests:
        normal = facing() if np.linalg.norm(head) < 0.1 else head / np.linalg.norm(head)
        contact = ExpectedContact(point, EXACT, normal, time) if known else None
        goal = PalmGoal(palm(point, normal, velocity), palm(point, -normal, velocity), head, contact)
        for _ in range(12):
            before = state
            state, step = retarget.step(state, goal)
            assert np.all(np.isfinite(step.positions)) and np.all(np.isfinite(step.torques))
            assert np.all(state.joints >= packed.low - 1e-9) and np.all(state.joints <= packed.high + 1e-9)
            assert np.all(np.abs(state.speeds) <= packed.speeds + 1e-9)
            assert np.all(np.abs(state.speeds - before.speeds) <= packed.accelerations * TICK + 1e-9)
            clear, was = arm.clearance(state.joints), clear
            assert clear > min(was - 1e-9, 0.0)


def test_numbers_that_are_none_bring_the_arm_to_rest(retarget: Retarget) -> None:
    states = played(retarget, approach(cell_point("B1"), 0.6)[:30])
    bad = np.full(3, np.nan)
    goal = PalmGoal(
        palm(bad, bad, bad), palm(bad, bad, bad), bad, ExpectedContact(bad, np.full((3, 3), np.nan), bad, 0.1)
    )
    state = states[-1]
    for _ in range(240):
        state, step = retarget.step(state, goal)
        assert np.all(np.isfinite(step.positions))
    assert np.abs(state.speeds).max() < 0.05


def test_torques_stay_inside_the_torque_speed_line(arm: ServoArm, retarget: Retarget) -> None:
    packed, state = arm.packed, retarget.start()
    for goal in approach(cell_point("C1"), 0.4):
        before = state
        state, step = retarget.step(state, goal)
        push = (state.speeds - before.speeds) / TICK
        mass, bias = dynamics.dynamics(packed, before.joints, before.speeds)
        rub = packed.damping * before.speeds + packed.friction * np.tanh(before.speeds / 0.05)
        torque = mass @ push + bias + rub
        assert step.torques == pytest.approx(torque, abs=1e-6)
        line = packed.stall * np.minimum(1.0, 1.0 - np.sign(torque) * before.speeds / packed.no_load)
        # a joint that even braking asks too much of brakes
        over = np.abs(torque) > line + 1e-6
        assert np.all(np.abs(state.speeds[over]) <= np.abs(before.speeds[over]) + 1e-9)


def test_a_posture_found_is_where_it_was_asked(arm: ServoArm) -> None:
    for cell in CELLS:
        joints, miss = solve(arm, cell_point(cell), facing(), READY)
        plate = arm.plate_at(joints)
        assert miss < 1e-4
        assert plate.position == pytest.approx(cell_point(cell), abs=1e-4)
        assert plate.normal == pytest.approx(facing(), abs=1e-3)
