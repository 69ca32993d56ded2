"""What a tick of the session asks of the servo arm: the avatar's palm, and where and when the palms will meet.

The session aims the avatar's palm at the person's hand tick by tick; an arm that is late by its servos has to know
earlier. Two things say where the palms will meet: the hand, going on and braking, and the model's forecast. Both are
weighed by what they are worth, as in :mod:`hil.reach`, but the hand here by how fast it is.
"""

from __future__ import annotations

import numpy as np

from hil.reach import Phase
from hil.retarget import ExpectedContact, PalmGoal
from hil.session import UNFAMILIAR, Tick
from mocap_bridge.frames import PalmPose
from model.forecast import BEGIN, END, ContactForecast
from model.rotations import Array

SURE = 0.25
"""A forecast whose time is no surer than this, s, does not set the arm off before the session's own approach."""
EARLY = 0.9
"""Nor one of a contact later than this, s."""
HURRY = 0.8
"""The session's time to contact runs out by so much quicker than it says (36 simulated high fives: median 0.8)."""
BRAKING = 1.0
"""m/s² by which a hand brakes otherwise than it seems to, in each direction."""
UNSTEADY = 0.15
"""Share of the way that a hand goes at its present speed which is not to be relied on."""
SEEN = 0.002
"""m, deviation of a tracked palm."""


def palm_goal(tick: Tick) -> PalmGoal:
    """The goal of one tick."""
    person = tick.person.palm if tick.person.valid else None
    head = tick.person.head_position if tick.person.valid else None
    return PalmGoal(tick.palm, person, head, None if person is None else _contact(tick, person))


def _contact(tick: Tick, person: PalmPose) -> ExpectedContact | None:
    forecast, phase = _forecast(tick), tick.target.phase
    if phase is Phase.TOUCH:
        return ExpectedContact(person.position, SEEN**2 * np.eye(3), -person.normal, 0.0)
    if phase is Phase.APPROACH:
        time = HURRY * tick.target.remaining
    elif phase is Phase.IDLE and forecast and forecast.deviation < SURE and 0.0 < forecast.time < EARLY:
        time = HURRY * forecast.time
    else:
        return None
    point, covariance = meeting(person, time, forecast)
    return ExpectedContact(point, covariance, -person.normal, time)


def _forecast(tick: Tick) -> ContactForecast | None:
    """The model's word, where it knows such hands and one approaches."""
    familiar = float(np.trace(tick.response.latent_covariance)) < UNFAMILIAR**2
    return tick.response.contact if familiar and END < tick.response.time_to_contact < BEGIN else None


def meeting(person: PalmPose, time: float, forecast: ContactForecast | None) -> tuple[Array, Array]:
    """Where palms will meet in ``time`` s, (3,) m, and its covariance (3, 3), m²: the hand's word and the model's.

    A hand that is nearly there goes on as it goes; one that is far will have stopped: it covers half of what its speed
    says.
    """
    speed = float(np.linalg.norm(person.velocity))
    share = 1.0 - 0.5 * min(time / 0.2, 1.0)
    hand = person.position + share * time * person.velocity
    deviation = SEEN + 0.5 * BRAKING * time**2 + UNSTEADY * speed * time * min(time / 0.1, 1.0)
    doubt = deviation**2 * np.eye(3)
    if forecast is None:
        return hand, doubt
    trust = np.linalg.solve(doubt + forecast.covariance[:3, :3], doubt).T  # share of the forecast
    return hand + trust @ (forecast.point - hand), doubt - trust @ doubt
