"""Laws of the wire on motions whose speeds are known: a plate that is led straight, rounded to counts of the servos."""

from collections.abc import Callable

import numpy as np
import pytest

from highfive.hil.arm.arm_trial import ArmTrial
from highfive.hil.arm.contact_outcome import ContactOutcome
from highfive.hil.arm.loop import ArmTick
from highfive.hil.arm.planner_values import ConstraintRelaxation, PalmGoal
from highfive.hil.bench.laws import COUNT, Laws
from highfive.hil.bench.motion_laws import judge_wire_motion
from highfive.hil.bench.virtual_play import default_planner
from highfive.hil.drivers.bus.cycle_ring import Cycle, Mode
from highfive.hil.drivers.values import JointCommand, JointHealth, JointState
from highfive.hil.safety.limits_file import load_limits
from highfive.hil.safety.states import State
from highfive.hil.safety.values import Report
from highfive.hil.session.session import RATE_HZ
from highfive.mocap_bridge.frames import PalmPose
from highfive.model.geometry.rotations import Array

HAND, HEAD = "wire: closing speed near the hand, m/s", "wire: speed near the head, m/s"
READY = np.array([0.0, -0.6, 0.9, 0.0, -0.3, 0.0])
ALONG, ACROSS = np.array([0.6, 0.64, 0.48]), np.array([0.8, -0.48, -0.36])
NOWHERE = np.full(3, 9.0)
FRAMES = 36
AHEAD_NS = 2_000_000  # a tick begins so long before its cycle
STEP_NS = round(1e9 / RATE_HZ)


def led(speed: float, counts: bool) -> list[Array]:
    """Goals that lead the plate straight along ALONG at ``speed``, m/s, by the inverse of its Jacobian, corrected each
    step; rounded to counts, as a servo takes them."""
    arm = default_planner().arm
    start, goal, goals = arm.points(READY)[0][0], READY, list[Array]()
    for frame in range(FRAMES):
        for _ in range(4):
            places, jacobians = arm.points(goal)
            goal = goal + np.linalg.pinv(jacobians[0]) @ (start + ALONG * speed * frame / RATE_HZ - places[0])
        goals.append(COUNT * np.round(goal / COUNT) if counts else goal)
    return goals


def trial(goals: list[Array], hand: Callable[[float], Array], velocity: Array, head: Array) -> ArmTrial:
    """A tick and a cycle for each of ``goals``; servos are where they were led; the hand is where ``hand``, of s, has
    it."""
    still, none = np.zeros(6), np.zeros(6, dtype=np.int64)
    ticks, cycles = list[ArmTick](), list[Cycle]()
    for number, goal in enumerate(goals):
        now = 1_000_000_000 + number * STEP_NS
        sent = JointCommand(goal, np.ones(6))
        palm = PalmPose(hand(number / RATE_HZ), -ALONG, ACROSS, velocity)
        report = Report(now, State.TRACKING, None, "", goal, goal, sent, frozenset(), 1.0, None, None)
        ticks.append(ArmTick(now, PalmGoal(palm, palm, head), goal, report, 0.0, 0.0))
        begun = now + AHEAD_NS
        before = goals[max(number - 1, 0)]
        state = JointState(begun + 1_000_000, before, still, still, none, none == 0, none != 0, still)
        health = JointHealth(now, still + 30.0, still + 12.0)
        cycles.append(Cycle(number, Mode.DRIVING, begun, begun, 1_000_000, sent, state, health))
    unmet = ContactOutcome("neutral", "", 0.0, False, 0.0, 0.0, 0.0, None, ConstraintRelaxation())
    return ArmTrial(tuple(ticks), tuple(cycles), (), unmet, FRAMES, False)


def judged(played: ArmTrial) -> dict[str, float]:
    laws = Laws()
    judge_wire_motion(laws, played, load_limits(), default_planner().arm)
    return laws.worst


def start() -> Array:
    return default_planner().arm.points(READY)[0][0]


@pytest.mark.parametrize("counts", [False, True], ids=["exact", "counts"])
@pytest.mark.parametrize("plate, hand", [(0.5, 0.0), (0.3, 0.4), (0.7, -0.3), (0.9, 0.0), (0.1, 1.5)])
def test_plate_and_hand_close_in_as_fast_as_they_were_moved(plate: float, hand: float, counts: bool) -> None:
    # The hand ends 5 cm beyond where the plate does: near, and not yet touching. It comes towards the plate at `hand`.
    last = (FRAMES - 1) / RATE_HZ
    meet = start() + ALONG * (plate * last + 0.05)
    found = judged(trial(led(plate, counts), lambda at: meet + ALONG * hand * (last - at), -hand * ALONG, NOWHERE))
    limit = load_limits().contact.speed
    truth = plate + min(hand, limit)
    assert found.keys() >= {HAND} and HEAD not in found
    # What rounding can have added is taken off: the law never says more than there was, and misses only that much.
    reach = 0.5 * COUNT * np.abs(np.einsum("i,ij->j", ALONG, default_planner().arm.points(READY)[1][0])).sum()
    assert truth - (4.2 if counts else 2.1) * reach * RATE_HZ / 4 <= found[HAND] <= truth + 0.012 * truth


def test_a_plate_that_is_far_from_the_hand_is_not_judged() -> None:
    away = start() + ALONG
    assert HAND not in judged(trial(led(0.5, False), lambda _: away, np.zeros(3), NOWHERE))


def test_a_plate_that_leaves_the_hand_does_not_close_in() -> None:
    behind = start() - 0.05 * ALONG
    assert HAND not in judged(trial(led(0.5, False), lambda _: behind, np.zeros(3), NOWHERE))


@pytest.mark.parametrize("counts", [False, True], ids=["exact", "counts"])
def test_the_plate_beside_a_head_is_as_fast_as_it_was_moved(counts: bool) -> None:
    head = start() + 0.2 * ACROSS
    found = judged(trial(led(0.4, counts), lambda _: NOWHERE, np.zeros(3), head))
    arm = default_planner().arm
    speeds = np.abs(np.diff([arm.points(goal)[0] for goal in led(0.4, False)], axis=0))
    fastest = np.linalg.norm(speeds, axis=2).max() * RATE_HZ  # of all points near it, not the plate alone
    assert 0.4 * 0.75 <= found[HEAD] <= fastest * 1.01


@pytest.mark.parametrize("counts", [False, True], ids=["exact", "counts"])
@pytest.mark.parametrize("aside", [0.03, 0.06])
def test_a_plate_that_passes_a_hand_closes_in_along_the_line_to_it(aside: float, counts: bool) -> None:
    # The line to the hand turns while the plate goes by: of its speed only the part along the line counts.
    speed, limits = 0.6, load_limits().contact
    last = (FRAMES - 1) / RATE_HZ
    hand = start() + ALONG * speed * last + ACROSS * aside
    goals = led(speed, counts)
    found = judged(trial(goals, lambda _: hand, np.zeros(3), NOWHERE))[HAND]
    times = np.arange(FRAMES) / RATE_HZ
    apart = hand - (start() + ALONG * speed * np.maximum(times - 2.0 / RATE_HZ, 0.0)[:, None])  # as was known
    distance = np.linalg.norm(apart, axis=1)
    along = speed * (apart @ ALONG) / distance
    means = np.convolve(along[1:], np.ones(4) / 4, "valid")  # over the cycles of a window
    near = np.linalg.norm(hand - (start() + ALONG * speed * times[:, None]), axis=1)[4:] <= limits.near
    apart_enough = np.array([distance[n + 1 : n + 5].min() >= limits.touching for n in range(len(means))])
    truth = means[near & apart_enough].max()
    assert 0.3 < truth < 0.99 * speed or aside < 0.05
    reach = 0.5 * COUNT * np.abs(default_planner().arm.points(READY)[1][0]).sum()
    assert truth - (4.2 if counts else 2.1) * reach * RATE_HZ / 4 <= found <= truth + 0.01


def test_a_plate_that_touches_the_hand_already_is_not_judged() -> None:
    limits = load_limits().contact
    for gap, is_judged in ((0.2 * limits.touching, False), (1.5 * limits.touching, True)):
        lead = [start() + ALONG * (1.0 * frame / RATE_HZ + gap) for frame in range(FRAMES)]
        # It is pushed: plate and hand go on together, and the hand was not expected to.
        laws = judged(trial(led(1.0, False), lambda at, lead=lead: lead[round(at * RATE_HZ)], np.zeros(3), NOWHERE))
        assert (laws.get(HAND, 0.0) > limits.speed) == is_judged


@pytest.mark.parametrize("counts", [False, True], ids=["exact", "counts"])
@pytest.mark.parametrize("share", [0.5, 1.0, 1.6])
def test_goals_are_as_sudden_as_they_were_moved(share: float, counts: bool) -> None:
    limits = load_limits()
    joint = int(np.argmax(limits.acceleration))
    times = np.arange(FRAMES) / RATE_HZ
    half = times[FRAMES // 2]
    # Sped up for half of the time, and slowed down as hard: the corner between is twice as sudden for an instant only.
    way = np.where(times < half, 0.5 * times**2, half**2 - 0.5 * (2.0 * half - times) ** 2)
    goals = [READY + share * limits.acceleration[joint] * at * np.eye(6)[joint] for at in way]
    goals = [COUNT * np.round(goal / COUNT) if counts else goal for goal in goals]
    found = judged(trial(goals, lambda _: NOWHERE, np.zeros(3), NOWHERE))["wire: acceleration, of what is allowed"]
    step = 4.0 / RATE_HZ
    rounding = 2.0 * COUNT / step**2 / limits.acceleration[joint]
    assert share - (2.0 if counts else 1.0) * rounding - 0.01 <= found <= share + 0.01
