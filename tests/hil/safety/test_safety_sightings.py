"""The age of a person is the age of a measurement: of head and hand each, whatever an estimate believes."""

from dataclasses import replace

import numpy as np
import pytest
from envelope_cases import FAR, LIMITS, READY_POSE, TICK_NS, Loop, kinematics, plate

from highfive.hil.safety.limits_file import lowered
from highfive.hil.safety.people import MEASURED, WIDENING, Human, Points, Remembered, Sighting, monitor_separation
from highfive.hil.safety.rules import Rule
from highfive.hil.safety.states import State
from highfive.hil.safety.wire import within_rules
from highfive.model.geometry.rotations import Array

STRETCHED = np.array([0.0, 0.5, -0.3, 0.0, -0.2, 0.0])
MS = 1_000_000


@pytest.mark.parametrize("part", ["head_seen", "palm_seen"])
def test_an_estimate_that_is_carried_on_is_held_for_and_retracted_from(part: str) -> None:
    """The estimate is of this very tick; head or hand were measured longer and longer ago."""
    loop = Loop(start=READY_POSE).tracking()
    ages: dict[State, int] = {}
    for tick in range(90):
        age = tick * TICK_NS
        loop.human = replace(FAR, **{part: Sighting(age, 0.001)})
        loop.tick(READY_POSE)
        ages.setdefault(loop.state, age)
    assert 50 * MS < ages[State.HOLDING] <= 100 * MS
    assert 450 * MS < ages[State.RETRACTING] <= 500 * MS
    assert {Rule.STALE_HOLD, Rule.STALE_RETRACT} <= {rule for report in loop.reports for rule in report.acted}


@pytest.mark.parametrize("part", ["head_seen", "palm_seen"])
def test_a_measurement_ends_the_hold(part: str) -> None:
    loop = Loop(start=READY_POSE).tracking()
    loop.human = replace(FAR, **{part: Sighting(150 * MS)})
    loop.tick(READY_POSE)
    assert loop.state is State.HOLDING
    loop.human = FAR
    loop.tick(READY_POSE)
    assert loop.state is State.TRACKING


def reached(palm_seen: Sighting) -> float:
    """How far, m, from a palm in its way the plate is when it has become as slow as the limit."""
    limits = lowered(LIMITS, {"contact.speed": 0.2})
    loop, palm = (
        Loop(limits, start=READY_POSE),
        plate(READY_POSE + 0.7 * (STRETCHED - READY_POSE)) + np.array([0.0, 0.0, 0.04]),
    )
    loop.human = Human(FAR.head, palm, np.zeros(3), 0, palm_seen=palm_seen)
    loop.tracking()
    for tick in range(60):
        loop.tick(READY_POSE + min(1.0, tick * TICK_NS * 1e-9 / 0.35) * (STRETCHED - READY_POSE))
    gaps = np.linalg.norm(np.array([plate(commanded) for commanded in loop.commanded]) - palm, axis=1)
    closing = -np.diff(gaps) / (TICK_NS * 1e-9)
    fast = np.flatnonzero(closing > 1.05 * limits.contact.speed)
    return float(gaps[fast[-1] + 1])


def test_the_distance_kept_grows_with_the_uncertainty() -> None:
    sure, unsure = reached(Sighting(0, MEASURED)), reached(Sighting(90 * MS, MEASURED + 0.02))
    assert reached(Sighting()) == sure  # what is measured is as sure as the limits allow for
    assert unsure - sure == pytest.approx(WIDENING * 0.02, abs=0.02)  # two ticks' way


def test_the_zone_about_an_unsure_head_is_wider() -> None:
    speeds = {}
    for deviation in (0.0, MEASURED + 0.03):
        head = plate(READY_POSE) + np.array([0.0, 0.0, LIMITS.face.radius + 0.05])
        loop = Loop(
            start=READY_POSE, human=Human(head, FAR.palm, np.zeros(3), 0, Sighting(90 * MS, deviation))
        ).tracking()
        loop.follow(READY_POSE + np.array([0.3, 0, 0, 0, 0, 0]), 30)
        places = np.array([plate(commanded) for commanded in loop.commanded])
        speeds[deviation] = np.linalg.norm(np.diff(places, axis=0), axis=1).max() / (TICK_NS * 1e-9)
    assert max(speeds.values()) > LIMITS.face.speed >= min(speeds.values())


def fast_past(deviation: float) -> tuple[Remembered, Human, Points, Array, Array]:
    """A plate that goes past a head at 1 m/s, 50 mm outside the zone about its place: joints turn, and its Jacobian."""
    places, jacobians = kinematics(READY_POSE)
    head = places[0] + np.array([0.0, 0.0, LIMITS.face.radius + 0.05])
    human = Human(head, FAR.palm, np.zeros(3), 0, Sighting(90 * MS, deviation))
    turning = np.array([1.0, 0, 0, 0, 0, 0]) / np.linalg.norm(jacobians[0, :, 0])
    seen = Remembered(head, np.zeros(3), 0, np.array([1.0, 0.0, 0.0]))
    return seen, human, Points(places, jacobians, places), turning, jacobians[0]


@pytest.mark.parametrize("deviation", [0.0, MEASURED + 0.03])
def test_the_body_by_itself_keeps_out_of_the_wider_zone(deviation: float) -> None:
    """The reference, before anybody looks at what goals lead by."""
    seen, human, points, velocities, jacobian = fast_past(deviation)
    kept, _, acted = monitor_separation(LIMITS, seen, human, points, velocities, 1e-9 * TICK_NS)
    slow = float(np.linalg.norm(jacobian @ kept)) <= LIMITS.face.speed
    assert slow is (deviation > 0.0)
    assert (Rule.FACE_ZONE in acted) is slow


@pytest.mark.parametrize("deviation", [0.0, MEASURED + 0.03])
def test_goals_by_themselves_keep_out_of_the_wider_zone(deviation: float) -> None:
    """The body stands; only what goals lead by would move."""
    seen, human, points, velocities, jacobian = fast_past(deviation)
    bounds = np.full(6, -10.0), np.full(6, 10.0)
    rates, acted = within_rules(LIMITS, seen, human, points, np.zeros(6), velocities, bounds, 1e-9 * TICK_NS)
    slow = float(np.linalg.norm(jacobian @ (rates.reference + rates.offset))) <= LIMITS.face.speed
    assert slow is (deviation > 0.0)
    assert (Rule.FEED_FORWARD in acted) is slow


@pytest.mark.parametrize(("beyond", "low"), [(-0.01, True), (0.01, False)])
def test_current_is_low_where_only_the_goal_is_near_the_hand(beyond: float, low: bool) -> None:
    """The goal leads the body by more than a centimetre, towards a hand that the body is not near."""
    loop = Loop(start=READY_POSE).tracking()
    lead = np.full(6, 0.04)
    loop.follow(READY_POSE, 60, feed_forward=lead)
    body, goal = plate(loop.measured), plate(loop.commanded[-1])
    ahead = float(np.linalg.norm(goal - body))
    palm = goal + (LIMITS.contact.near + beyond) * (goal - body) / ahead
    assert np.linalg.norm(palm - body) > LIMITS.contact.near + 0.005
    loop.human = Human(FAR.head, palm, np.zeros(3), 0)
    command = loop.tick(READY_POSE, feed_forward=lead)
    assert command is not None
    assert np.array_equal(command.currents, LIMITS.contact_current if low else LIMITS.current)
    assert loop.report.gap == pytest.approx(LIMITS.contact.near + beyond, abs=1e-6)


def test_current_is_low_where_the_hand_may_be_near() -> None:
    loop = Loop(start=READY_POSE).tracking()
    away = plate(READY_POSE) + np.array([LIMITS.contact.near + 0.05, 0, 0])
    for deviation, low in ((0.0, False), (MEASURED + 0.03, True)):
        loop.human = Human(FAR.head, away, np.zeros(3), 0, palm_seen=Sighting(90 * MS, deviation))
        loop.tick(READY_POSE)
        assert (Rule.CURRENT in loop.report.acted) is low


def test_an_uncertainty_that_is_no_number_stops_the_arm() -> None:
    loop = Loop(start=READY_POSE).tracking()
    loop.human = replace(FAR, palm_seen=Sighting(0, float("nan")))
    loop.tick(READY_POSE)
    assert loop.state is State.STOPPING
    assert Rule.NOT_FINITE in loop.report.acted
