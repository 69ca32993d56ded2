"""The age of a person is the age of a measurement: of head and hand each, whatever an estimate believes."""

from dataclasses import replace

import numpy as np
import pytest
from envelope_cases import FAR, LIMITS, READY_POSE, TICK_NS, Loop, plate

from highfive.hil.safety.limits import lowered
from highfive.hil.safety.people import MEASURED, WIDENING, Human, Sighting
from highfive.hil.safety.rules import Rule
from highfive.hil.safety.states import State

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
    gaps = np.linalg.norm(np.array([plate(told) for told in loop.told]) - palm, axis=1)
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
        places = np.array([plate(told) for told in loop.told])
        speeds[deviation] = np.linalg.norm(np.diff(places, axis=0), axis=1).max() / (TICK_NS * 1e-9)
    assert max(speeds.values()) > LIMITS.face.speed >= min(speeds.values())


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
