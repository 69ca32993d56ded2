"""What a tick of the session asks of the servo arm: the avatar's palm, and where and when the palms will meet.

The session aims the avatar's palm at the person's hand tick by tick; an arm that is late by its servos has to know
earlier. Two things say where the palms will meet: the hand, going on and braking, and the model's forecast. Both are
weighed by what they are worth, as in :mod:`highfive.hil.session.reach`, but the hand here by how fast it is.
"""

from __future__ import annotations

import math

import numpy as np

from highfive.hil.arm.planner_values import ExpectedContact, PalmGoal
from highfive.hil.safety.people import Sighting
from highfive.hil.session.reach import Phase, ReachSettings, ReachTarget
from highfive.hil.session.session import RATE_HZ, Tick
from highfive.mocap_bridge.frames import PalmPose
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.contact_layer import BEGIN, END
from highfive.model.online.contact_forecast import ContactForecast

SURE = 0.25
"""A forecast whose time is no surer than this, s, does not set the arm off before the session's own approach."""
PLACED = 0.3
"""Unless its place is surer than this, m, in all directions together."""
EARLY = 0.9
"""Nor one of a contact later than this, s."""
LOST = 1.0
"""A clock with this standard deviation, s, says nothing."""
LONG = 0.6
"""s; forecasts of less are too long: by nothing here, by ..."""
TOO_LONG = 0.2
"""... this share at the end (72 simulated high fives)."""
BRAKING = 0.8
"""m/s² by which a hand brakes otherwise than it seems to, in each direction."""
UNSTEADY = 0.2
"""Share of the way that a hand goes at its present speed which is not to be relied on."""
SEEN = 0.002
"""m, deviation of a tracked palm."""
REACH = ReachSettings()
STEP, LATEST = 1.0 / RATE_HZ, 1.0
"""s; the session's clock is run forward in such steps, no further than this."""


def palm_goal(tick: Tick) -> PalmGoal:
    """The goal of one tick."""
    arm = tick.person
    person, head = (arm.palm, arm.head_position) if arm.valid else (None, None)
    return PalmGoal(
        tick.palm,
        person,
        head,
        None if person is None else _contact(tick, person),
        Sighting(arm.hand_unseen_ns, arm.hand_deviation),
        Sighting(arm.head_unseen_ns, arm.head_deviation),
    )


def _contact(tick: Tick, person: PalmPose) -> ExpectedContact | None:
    forecast, phase = _forecast(tick), tick.target.phase
    if phase is Phase.TOUCH:
        return ExpectedContact(person.position, SEEN**2 * np.eye(3), -person.normal, 0.0)
    if phase is Phase.APPROACH:
        time = until_touch(tick.target, forecast)
    elif phase is Phase.IDLE and forecast and 0.0 < forecast.time < EARLY and _says_enough(forecast):
        time = _corrected(forecast.time)
    else:
        return None
    point, covariance = meeting(person, time, forecast)
    return ExpectedContact(point, covariance, -person.normal, time)


def _says_enough(forecast: ContactForecast) -> bool:
    """Surely enough when, or where: who knows the place may go there and wait."""
    return forecast.deviation < SURE or float(np.trace(forecast.covariance[:3, :3])) < PLACED**2


def _forecast(tick: Tick) -> ContactForecast | None:
    """The model's word, where it knows such hands and the hand is not on its way back.

    The clock of the avatar's layer does not know hands that come up fast; the contact layer does.
    """
    r = tick.response
    coming = r.time_to_contact > END and (r.time_to_contact < BEGIN or r.time_to_contact_std > LOST)
    return r.contact if r.in_distribution and coming else None


def until_touch(target: ReachTarget, forecast: ContactForecast | None) -> float:
    """s until the session has the palms touch: its clock run forward, as it goes after the forecast's.

    What is left runs out at a rate of its own, which follows the difference between the two clocks: neither of them
    alone says when it will be over.
    """
    left, rate, time = target.remaining, target.rate, 0.0
    known = forecast is not None and forecast.deviation < SURE
    expected = _corrected(forecast.time) if forecast is not None and known else math.inf
    while time < LATEST:
        rate = REACH.next_rate(rate, REACH.wanted_rate(left, expected), STEP)
        if rate * STEP >= left:
            return time + STEP
        left, expected, time = left - rate * STEP, max(expected - STEP, 0.0), time + STEP
    return time


def _corrected(time: float) -> float:
    """A forecast time, s, less what forecasts are too long by."""
    return max(time, 0.0) * (1.0 - TOO_LONG * (1.0 - min(max(time, 0.0) / LONG, 1.0)))


def meeting(person: PalmPose, time: float, forecast: ContactForecast | None) -> tuple[Array, Array]:
    """Where palms will meet in ``time`` s, (3,) m, and its covariance (3, 3), m²: the hand's word and the model's.

    A hand brakes before it is met: of the way that its speed says it covers three quarters, or less if there is time.
    """
    speed = float(np.linalg.norm(person.velocity))
    share = max(0.75 - 3.0 * time, 0.45)
    hand = person.position + share * time * person.velocity
    deviation = SEEN + 0.5 * BRAKING * time**2 + UNSTEADY * speed * time
    doubt = deviation**2 * np.eye(3)
    if forecast is None:
        return hand, doubt
    trust = np.linalg.solve(doubt + forecast.covariance[:3, :3], doubt).T  # share of the forecast
    return hand + trust @ (forecast.point - hand), doubt - trust @ doubt
