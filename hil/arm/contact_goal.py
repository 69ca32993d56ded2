"""What a tick of the session asks of the servo arm: the avatar's palm, and where and when the palms will meet.

The session aims the avatar's palm at the person's hand tick by tick; an arm that is late by its servos has to know
earlier. Two things say where the palms will meet: the hand, going on and braking, and the model's forecast. Both are
weighed by what they are worth, as in :mod:`highfive.hil.session.reach`, but the hand here by how fast it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from highfive.hil.arm.planner_values import ExpectedContact, PalmGoal
from highfive.hil.safety.people import Sighting
from highfive.hil.session.reach import Phase, ReachTarget
from highfive.hil.session.reach_settings import ReachSettings
from highfive.hil.session.session import RATE_HZ, Tick
from highfive.mocap_bridge.frames import PalmPose
from highfive.model.geometry.rotations import Array
from highfive.model.gp.mixture import GaussianMixture
from highfive.model.hgpdm.contact_layer import BEGIN, END
from highfive.model.online.contact_forecast import ContactForecast
from highfive.model.online.reaction import hypotheses_of_contact
from highfive.model.settings import Settings, setting

STEP, LATEST = 1.0 / RATE_HZ, 1.0
"""s; the session's clock is run forward in such steps, no further than this."""


@dataclass(frozen=True)
class ContactGoalSettings(Settings):
    """How the hand and the model's forecast are weighed. Set by hand, unless a field says on what it was chosen."""

    sure: float = setting(0.25, "s", least=0.0)
    """A forecast whose time is no surer than this does not set the arm off before the session's own approach."""
    placed: float = setting(0.3, "m", least=0.0)
    """Unless its place is surer than this, in all directions together."""
    decided: float = setting(0.15, "m", least=0.0)
    """While the place, or which of the learned ones it is, is less sure than this, in all directions together, the arm
    goes where it can meet most of them: simulated happy and angry high fives of seeds 1 to 6."""
    early: float = setting(0.9, "s", least=0.0)
    """Nor one of a contact later than this."""
    lost: float = setting(1.0, "s", least=0.0)
    """A clock with this standard deviation says nothing."""
    long: float = setting(0.6, "s", above=0.0)
    """Forecasts of less are too long: by nothing here, by ..."""
    too_long: float = setting(0.2, least=0.0, most=1.0)
    """... this share at the end: 72 simulated high fives, of which seeds was not noted."""
    braking: float = setting(0.8, "m/s²", least=0.0)
    """By so much a hand brakes otherwise than it seems to, in each direction: simulated high fives of seeds 1 to 3."""
    unsteady: float = setting(0.2, least=0.0)
    """Share of the distance covered at the present speed that is not to be relied on: the same high fives."""
    palm_deviation: float = setting(0.002, "m", above=0.0)
    """Of a tracked palm."""


SETTINGS, REACH = ContactGoalSettings(), ReachSettings()


def palm_goal(tick: Tick, settings: ContactGoalSettings = SETTINGS) -> PalmGoal:
    """The goal of one tick."""
    arm = tick.person
    person, head = (tick.calm.palm, arm.head_position) if arm.valid else (None, None)
    contact = None if person is None else _contact(tick, person, settings)
    hypotheses = None if contact is None else _undecided(tick, settings)
    return PalmGoal(
        _calm_palm(tick),
        person,
        head,
        contact if hypotheses is None else None,
        hypotheses,
        Sighting(arm.hand_unseen_ns, arm.hand_deviation),
        Sighting(arm.head_unseen_ns, arm.head_deviation),
    )


def _calm_palm(tick: Tick) -> PalmPose:
    """The avatar's palm, aimed at where the calm goal is."""
    shift = tick.calm.target.weight * (tick.calm.target.position - tick.target.position)
    return replace(tick.palm, position=tick.palm.position + shift)


def _contact(tick: Tick, person: PalmPose, settings: ContactGoalSettings) -> ExpectedContact | None:
    forecast, phase = _forecast(tick, settings), tick.calm.target.phase
    if phase is Phase.TOUCH:
        return ExpectedContact(person.position, settings.palm_deviation**2 * np.eye(3), -person.normal, 0.0)
    if phase is Phase.APPROACH:
        time = until_touch(tick.calm.target, forecast, settings)
    elif phase is Phase.IDLE and forecast and 0.0 < forecast.time < settings.early and _says_enough(forecast, settings):
        time = _corrected(forecast.time, settings)
    else:
        return None
    point, covariance = meeting(person, time, forecast, settings)
    return ExpectedContact(point, covariance, -person.normal, time)


def _says_enough(forecast: ContactForecast, settings: ContactGoalSettings) -> bool:
    """Surely enough when, or where: who knows the place may go there and wait."""
    return forecast.deviation < settings.sure or float(np.trace(forecast.covariance[:3, :3])) < settings.placed**2


def _undecided(tick: Tick, settings: ContactGoalSettings) -> GaussianMixture | None:
    """Where it may be, while a contact is coming that may still be in one of several places."""
    forecast = tick.response.contact
    if forecast is None or tick.calm.target.phase is not Phase.IDLE:
        return None
    hypotheses = hypotheses_of_contact(tick.response)
    if hypotheses is None:
        return None
    spreads = np.trace(forecast.covariance[:3, :3]), np.trace(hypotheses.covariance)
    return hypotheses if max(spreads) > settings.decided**2 else None


def _forecast(tick: Tick, settings: ContactGoalSettings) -> ContactForecast | None:
    """The model's word, where it knows such hands and the hand is not on its way back.

    The clock of the avatar's layer does not know hands that come up fast; the contact layer does.
    """
    r = tick.response
    coming = r.time_to_contact > END and (r.time_to_contact < BEGIN or r.time_to_contact_std > settings.lost)
    return r.contact if r.in_distribution and coming else None


def until_touch(
    target: ReachTarget, forecast: ContactForecast | None, settings: ContactGoalSettings = SETTINGS
) -> float:
    """s until the session has the palms touch: its clock run forward, as it goes after the forecast's.

    What is left runs out at a rate of its own, which follows the difference between the two clocks: neither of them
    alone says when it will be over.
    """
    left, rate, time = target.remaining, target.rate, 0.0
    known = forecast is not None and forecast.deviation < settings.sure
    expected = _corrected(forecast.time, settings) if forecast is not None and known else math.inf
    while time < LATEST:
        rate = REACH.next_rate(rate, REACH.target_rate(left, expected), STEP)
        if rate * STEP >= left:
            return time + STEP
        left, expected, time = left - rate * STEP, max(expected - STEP, 0.0), time + STEP
    return time


def _corrected(time: float, settings: ContactGoalSettings) -> float:
    """A forecast time, s, less what forecasts are too long by."""
    return max(time, 0.0) * (1.0 - settings.too_long * (1.0 - min(max(time, 0.0) / settings.long, 1.0)))


def meeting(
    person: PalmPose, time: float, forecast: ContactForecast | None, settings: ContactGoalSettings = SETTINGS
) -> tuple[Array, Array]:
    """Where palms will meet in ``time`` s, (3,) m, and its covariance (3, 3), m²: the hand's word and the model's.

    A hand brakes before it is met: of the way that its speed says it covers three quarters, or less if there is time.
    """
    speed = float(np.linalg.norm(person.velocity))
    share = max(0.75 - 3.0 * time, 0.45)
    hand = person.position + share * time * person.velocity
    deviation = settings.palm_deviation + 0.5 * settings.braking * time**2 + settings.unsteady * speed * time
    variance = deviation**2 * np.eye(3)
    if forecast is None:
        return hand, variance
    trust = np.linalg.solve(variance + forecast.covariance[:3, :3], variance).T  # share of the forecast
    return hand + trust @ (forecast.point - hand), variance - trust @ variance
