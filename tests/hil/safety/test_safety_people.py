"""Relative contact speed and face zone: held against positions differentiated by the test, not against the Jacobian."""

import math

import numpy as np
import pytest
from envelope_cases import FAR, LIMITS, READY_POSE, TICK_NS, Loop, kinematics, plate
from hypothesis import example, given, settings
from hypothesis import strategies as st

from highfive.hil.safety.limits_file import lowered
from highfive.hil.safety.people import ALONE, STRAIGHT, Human, Points, Remembered, allowed_speed, monitor_separation
from highfive.hil.safety.rules import Rule
from highfive.hil.safety.states import State
from highfive.model.geometry.rotations import Array

STRETCHED = np.array([0.0, 0.5, -0.3, 0.0, -0.2, 0.0])
"""The plate is 0.33 m further out than in the ready pose."""
SECONDS = TICK_NS * 1e-9


def reach(tick: int, seconds: float = 0.5) -> Array:
    """From the ready pose out to the stretched one, evenly."""
    share = min(1.0, tick * SECONDS / seconds)
    return READY_POSE + share * (STRETCHED - READY_POSE)


def plate_speed(loop: Loop) -> Array:
    """(T, 3) m/s, of the plate from command to command."""
    places = np.array([plate(commanded) for commanded in loop.commanded])
    return np.diff(places, axis=0) / (np.diff(loop.times)[:, None] * 1e-9)


def met(hand_velocity: Array, seconds: float = 0.35, ticks: int = 110) -> tuple[Loop, Array, Array]:
    """A reach out to a hand that comes with that velocity; the loop, gaps (T,), m, and closing speeds (T,), m/s."""
    loop = Loop(start=READY_POSE)
    end = plate(READY_POSE + 0.7 * (STRETCHED - READY_POSE)) + np.array([0.0, 0.0, 0.04])
    loop.human = Human(FAR.head, end - hand_velocity * 0.5, hand_velocity, 0)
    loop.tracking()
    gaps, closing = [], []
    for tick in range(ticks):
        palm = end + hand_velocity * (tick * SECONDS - 0.5)
        loop.human = Human(FAR.head, palm, hand_velocity, 0)
        before = plate(loop.commanded[-1])
        loop.tick(reach(tick, seconds))
        velocity = (plate(loop.commanded[-1]) - before) / SECONDS
        gap = np.linalg.norm(palm - before)
        gaps.append(gap)
        closing.append((velocity - hand_velocity) @ (palm - before) / gap)
    return loop, np.array(gaps), np.array(closing)


@pytest.mark.parametrize("hand_speed", [0.0, 0.2, 0.5, 0.7])
def test_plate_and_hand_do_not_meet_faster_than_the_limit(hand_speed: float) -> None:
    loop, gaps, closing = met(np.array([-hand_speed, 0.0, 0.0]))
    near = (gaps <= LIMITS.contact.near) & (gaps >= LIMITS.contact.touching)
    assert near.any()
    assert closing[near].max() <= LIMITS.contact.speed
    assert any(Rule.CONTACT_SPEED in report.acted for report in loop.reports)
    said = [r.closing_speed for r in loop.reports if r.gap is not None and r.gap <= LIMITS.contact.near]
    assert max(speed for speed in said if speed is not None) <= LIMITS.contact.speed


@pytest.mark.parametrize("hand", [(0.0, 0.0, 0.0), (-0.2, 0.0, 0.0), (-0.3, 0.0, 0.3)])
def test_a_step_is_taken_for_the_arc_that_it_is(hand: tuple[float, float, float]) -> None:
    """What is left of the speed is what was allowed: along the tangent at a step's beginning it is up to 1 % more."""
    loop, gaps, closing = met(np.array(hand))
    acted = np.array([Rule.CONTACT_SPEED in report.acted for report in loop.reports[-len(gaps) :]])
    near = acted & (gaps <= LIMITS.contact.near) & (gaps >= LIMITS.contact.touching)
    assert near.sum() >= 10
    assert closing[near].max() == pytest.approx(STRAIGHT * LIMITS.contact.speed, rel=1e-3)


def test_without_the_rule_they_would() -> None:
    """The reach of the test above is one that the rule has to slow down."""
    fast = np.linalg.norm(plate(reach(20, 0.35)) - plate(reach(19, 0.35))) / SECONDS
    assert fast > LIMITS.contact.speed


def test_a_hand_that_is_too_fast_by_itself_finds_the_plate_standing() -> None:
    _, gaps, closing = met(np.array([-1.5, 0.0, 0.0]))
    near = (gaps <= LIMITS.contact.near) & (gaps >= LIMITS.contact.touching)
    assert near.any()
    assert closing[near].max() <= 1.5 + 1e-6  # nothing of it is the plate's


def test_a_plate_that_moves_away_from_the_hand_is_left_alone() -> None:
    loop = Loop(start=STRETCHED)
    palm = plate(STRETCHED) + np.array([0.05, 0.0, 0.0])
    loop.human = Human(FAR.head, palm, np.zeros(3), 0)
    loop.tracking()
    for tick in range(60):
        loop.tick(STRETCHED + min(1.0, tick / 60) * (READY_POSE - STRETCHED))
    assert not any(Rule.CONTACT_SPEED in report.acted for report in loop.reports)


def test_after_contact_the_line_is_the_last_one_known() -> None:
    """The plate is told to go through the palm: it is slow all the way, though the line between them turns round."""
    loop = Loop(start=READY_POSE)
    alone = Loop(start=READY_POSE).tracking()
    for tick in range(80):
        alone.tick(reach(tick, 0.35))
    way = [plate(commanded) for commanded in alone.commanded]
    palm = next(place for place in way if np.linalg.norm(place - way[0]) > 0.2)
    loop.human = Human(FAR.head, palm, np.zeros(3), 0)
    loop.tracking()
    for tick in range(80):
        loop.tick(reach(tick, 0.35))
    away = np.array([np.linalg.norm(plate(commanded) - palm) for commanded in loop.commanded[1:]])
    assert away.min() < LIMITS.contact.touching
    line = loop.before.seen.line
    assert line is not None
    speeds = plate_speed(loop) @ line
    assert speeds[away <= LIMITS.contact.touching].max() <= LIMITS.contact.speed


def test_a_hand_first_seen_at_the_plate_keeps_it_still() -> None:
    loop = Loop(start=READY_POSE)
    loop.human = Human(FAR.head, plate(READY_POSE) + 0.01, np.zeros(3), 0)
    loop.tracking()
    for tick in range(20):
        loop.tick(reach(tick))
    assert Rule.CONTACT_SPEED in loop.report.acted
    assert np.ptp(loop.commanded, axis=0).max() == 0.0


def test_a_hand_that_nobody_sees_may_be_anywhere() -> None:
    loop = Loop(start=READY_POSE, human=Human(FAR.head, None, None, 0)).tracking()
    for tick in range(80):
        loop.tick(reach(tick, 0.35))
    speeds = np.linalg.norm(plate_speed(loop), axis=1)
    assert speeds.max() <= LIMITS.contact.speed
    assert any(Rule.CONTACT_SPEED in report.acted for report in loop.reports)


def head_reach(offset: Array, head_velocity: Array, ticks: int = 120) -> tuple[Loop, Array, Array]:
    """A reach past a head; the loop, distances of the plate (T,), m, and its speeds (T,), m/s, from there on."""
    loop = Loop(start=READY_POSE)
    head = plate(STRETCHED) + offset
    loop.human = Human(head, FAR.palm, np.zeros(3), 0)
    loop.tracking()
    distances, speeds = [], []
    for tick in range(ticks):
        place = head + head_velocity * tick * SECONDS
        loop.human = Human(place, FAR.palm, np.zeros(3), 0)
        before = plate(loop.commanded[-1])
        loop.tick(reach(tick, 0.4))
        after = plate(loop.commanded[-1])
        distances.append(min(np.linalg.norm(before - place), np.linalg.norm(after - place)))
        speeds.append(np.linalg.norm(after - before) / SECONDS)
    return loop, np.array(distances), np.array(speeds)


@pytest.mark.parametrize("offset", [(0.25, 0.0, 0.1), (0.1, 0.2, 0.0), (0.1, -0.2, 0.0), (0.0, 0.0, 0.0)])
def test_the_plate_is_slow_in_the_face_zone(offset: tuple[float, float, float]) -> None:
    loop, distances, speeds = head_reach(np.array(offset), np.zeros(3))
    inside = distances <= LIMITS.face.radius
    assert inside.any()
    assert speeds[inside].max() <= LIMITS.face.speed
    assert speeds[~inside].max() > LIMITS.face.speed
    assert any(Rule.FACE_ZONE in report.acted for report in loop.reports)


@pytest.mark.parametrize("near", [True, False, None])
def test_joints_that_cancel_each_other_are_slow_near_a_head_or_an_unseen_person(near: bool | None) -> None:
    """The plate would stand if the servos followed in step, which they do not."""
    places, jacobians = kinematics(READY_POSE)
    still = np.linalg.svd(jacobians[0])[2][-1]
    still /= np.linalg.norm(jacobians[0] * still, axis=0).max()  # m/s, of the joint that moves the plate most
    human = Human(places[0] + (0.1 if near else 2.0), FAR.palm, np.zeros(3), 0)
    seen = Remembered(human.head, np.zeros(3), 0, np.array([1.0, 0.0, 0.0]))
    only = Points(places[:1], jacobians[:1], places[:1])
    kept, _, acted = monitor_separation(LIMITS, seen, None if near is None else human, only, still, SECONDS)
    alone = np.linalg.norm(jacobians[0] * kept, axis=0).max()
    assert np.linalg.norm(jacobians[0] @ kept) < 1e-9
    assert alone == pytest.approx(1.0 if near is False else ALONE * STRAIGHT * LIMITS.face.speed)
    assert acted == ({Rule.UNSEEN_PERSON} if near is None else {Rule.FACE_ZONE} if near else set())


def test_it_slows_down_before_the_zone_and_not_in_it() -> None:
    """The plate brakes as gently as the limits say, give or take a tick: no jump at the border."""
    _, _, speeds = head_reach(np.array([0.25, 0.0, 0.1]), np.zeros(3))
    assert speeds.max() > 2 * LIMITS.face.speed
    assert np.diff(speeds).min() >= -2.0 * LIMITS.face.braking * SECONDS


def test_a_plate_that_passes_by_at_a_distance_is_left_alone() -> None:
    """Beside its way, where it is nearest, the head is further off than the zone reaches: nothing to brake for."""
    clear = LIMITS.face.radius + 0.1
    free = Loop(start=READY_POSE).tracking()
    for tick in range(60):
        free.tick(reach(tick, 0.4))
    path = np.array([plate(commanded) for commanded in free.commanded])
    way = path[-1] - path[0]
    across = np.cross(way, [0.0, 0.0, 1.0])
    offset = clear * across / np.linalg.norm(across)
    _, distances, speeds = head_reach(path[len(path) // 2] - plate(STRETCHED) + offset, np.zeros(3), 60)
    near = distances < clear + 0.02
    assert near.any()
    assert speeds[near].max() > 4 * LIMITS.face.speed


def test_the_zone_moves_with_the_head() -> None:
    """The head comes at the plate: it counts, and inside the zone the plate stands, or almost."""
    velocity = np.array([-0.5, 0.0, 0.0])
    _, distances, speeds = head_reach(np.array([0.6, 0.0, 0.05]), velocity)
    inside = distances <= LIMITS.face.radius
    assert inside.sum() > 10
    assert speeds[inside].max() <= 0.02
    _, distances, speeds = head_reach(np.array([0.2, 0.0, 0.05]), np.array([1.0, 0.0, 0.0]))  # it makes way
    assert speeds.max() > LIMITS.face.speed


def test_a_trembling_tracker_does_not_stop_the_arm() -> None:
    """A millimetre of jitter is no head that comes nearer."""
    chance = np.random.default_rng(1)
    loop = Loop(start=READY_POSE)
    head = plate(READY_POSE) + np.array([0.2, 0.0, 0.0])
    shares = []
    loop.human = Human(head, FAR.palm, np.zeros(3), 0)
    loop.tracking()
    for tick in range(120):
        loop.human = Human(head + chance.normal(0.0, 1e-3, 3), FAR.palm, np.zeros(3), 0)
        loop.tick(READY_POSE + np.array([0.0, 0.0, -0.1 * tick * SECONDS, 0.0, 0.0, 0.0]))
        shares.append(loop.report.fraction)
    assert min(shares[20:]) > 0.5


def test_other_points_of_the_arm_are_held_to_the_zone_too() -> None:
    """The wrist is near a head that the plate is not near."""
    limits = lowered(LIMITS, {"face.speed": 0.1})
    loop = Loop(limits, start=READY_POSE)
    wrist = kinematics(READY_POSE)[0][1]
    loop.human = Human(wrist + np.array([-0.08, 0.0, -0.06]), FAR.palm, np.zeros(3), 0)
    loop.tracking()
    for tick in range(120):
        loop.tick(reach(tick, 0.4))
    places = np.array([kinematics(commanded)[0][1] for commanded in loop.commanded])
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / SECONDS
    inside = np.linalg.norm(places[1:] - loop.human.head, axis=1) <= LIMITS.face.radius
    assert inside.any()
    assert speeds[inside].max() <= limits.face.speed
    plates = np.array([plate(commanded) for commanded in loop.commanded])
    assert np.linalg.norm(plates - loop.human.head, axis=1).min() > limits.face.radius


def test_it_is_slow_while_nobody_knows_where_the_person_is() -> None:
    limits = lowered(LIMITS, {"face.speed": 0.1})
    loop = Loop(limits, start=STRETCHED).tracking()
    loop.human = None
    acted = set()
    for _ in range(900):
        loop.tick(STRETCHED)
        acted |= loop.report.acted
    assert Rule.UNSEEN_PERSON in acted
    assert loop.state is State.READY
    assert np.linalg.norm(plate_speed(loop), axis=1).max() <= limits.face.speed


def whole(low: float, high: float, unit: float) -> st.SearchStrategy[float]:
    """Numbers of so many units: what is less is rounding."""
    return st.integers(round(low / unit), round(high / unit)).map(lambda count: count * unit)


@given(
    limit=st.floats(0.05, 0.78),
    hand=whole(-3.0, 1.0, 1e-3),
    way=whole(0.0, 1.5, 1e-5),
    braking=st.floats(0.5, 10.0),
    straight=whole(0.0, 1.0, 1e-3) | st.just(1.0),
)
@example(limit=0.5, hand=1.0, way=0.0, braking=1.0, straight=0.5)
@settings(deadline=None)
def test_a_plate_at_the_allowed_speed_can_still_brake(
    limit: float, hand: float, way: float, braking: float, straight: float
) -> None:
    """The law, followed in small steps against a hand of constant velocity, never brakes harder than it says."""
    dt, speed = 1e-4, allowed_speed(limit, hand, way, braking, straight)
    assert speed >= max(0.0, limit + hand) - 1e-9
    if not math.isfinite(speed):
        assert straight < 1e-8
        return
    for _ in range(4000):
        way -= (straight * speed - hand) * dt
        if way <= 0.0 or straight * speed - hand <= 0.0:
            break
        slower = allowed_speed(limit, hand, way, braking, straight)
        assert speed - slower <= 1.05 * braking * dt + 1e-9
        speed = min(speed, slower)
    else:
        return
    closing = straight * speed - hand
    if way <= 0.0 and closing > 1e-9:  # slower ones do not arrive, but for rounding
        assert speed <= max(0.0, limit + hand) + 0.02 + 2 * np.sqrt(braking * dt * closing / max(straight, 0.05))
