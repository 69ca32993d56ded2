"""How a high five is judged, on a hand that comes straight at a plate at rest."""

from dataclasses import replace

import numpy as np
import pytest

from highfive.hil.arm.contact_outcome import (
    ContactOutcome,
    OutcomeSettings,
    ReferenceTrajectory,
    judged,
    with_known_contact,
)
from highfive.hil.arm.planner_values import ConstraintRelaxation, ExpectedContact, PalmGoal
from highfive.hil.session.session import RATE_HZ
from highfive.mocap_bridge.frames import PalmPose

TICKS, DUE, SPEED = 121, 60, 0.6
NORMAL = np.array([1.0, 0.0, 0.0])
MISSED = 0.004  # m, by which the hand goes back before it is there
BESIDE = 0.03  # m, of the plate's middle


def reference() -> ReferenceTrajectory:
    """A hand along x at ``SPEED``, back from ``DUE`` on; it is forecast 10 cm off."""
    away = MISSED + SPEED * np.abs(np.arange(TICKS) - DUE) / RATE_HZ
    person = np.stack([away, np.full(TICKS, BESIDE), np.zeros(TICKS)], axis=1)
    palm = PalmPose(np.zeros(3), NORMAL, np.array([0.0, 0.0, 1.0]), np.zeros(3))
    forecast = [ExpectedContact(person[DUE] + 0.1, np.eye(3), NORMAL, (DUE - i) / RATE_HZ) for i in range(TICKS)]
    goals = tuple(PalmGoal(palm, contact=contact) for contact in forecast)
    return ReferenceTrajectory(
        "neutral", "B2", goals, person, np.zeros((TICKS, 3)), np.tile(NORMAL, (TICKS, 1)), DUE, DUE
    )


def outcome(settings: OutcomeSettings, one: ReferenceTrajectory | None = None) -> ContactOutcome:
    one = one or reference()
    return judged(one, one.avatar, one.avatar_normals, None, ConstraintRelaxation(), settings)


def test_a_hand_that_turns_back_before_the_plate_is_missed_by_what_is_between() -> None:
    usual = outcome(OutcomeSettings())
    assert not usual.touched
    assert usual.error == pytest.approx(np.hypot(MISSED, BESIDE))


def test_settings_say_what_counts_as_a_touch() -> None:
    near = outcome(OutcomeSettings(skin=2 * MISSED))
    assert near.touched
    assert near.speed == pytest.approx(SPEED)
    assert -2 / RATE_HZ <= near.late <= 0.0
    assert not outcome(OutcomeSettings(skin=2 * MISSED, astray=0.9 * BESIDE)).touched
    later = replace(reference(), due=DUE - round(0.2 * RATE_HZ))
    assert outcome(OutcomeSettings(skin=2 * MISSED), later).touched
    assert not outcome(OutcomeSettings(skin=2 * MISSED, earliest=0.1), later).touched


def test_a_known_contact_is_as_exact_as_set() -> None:
    contact = with_known_contact(reference(), OutcomeSettings(exact=0.02)).goals[0].contact
    assert contact is not None
    np.testing.assert_allclose(contact.covariance, 0.02**2 * np.eye(3))
