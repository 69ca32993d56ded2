"""How a high five is judged, on a hand that comes straight at a plate at rest."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from highfive.hil.arm.contact_outcome import (
    ContactOutcome,
    OutcomeSettings,
    ReferenceTrajectory,
    judged,
    notice,
    reference_in,
    with_known_contact,
)
from highfive.hil.arm.planner_values import ConstraintRelaxation, ExpectedContact, PalmGoal
from highfive.hil.bench.virtual_play import default_planner
from highfive.hil.session.session import RATE_HZ, Session
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.partners import simulated_partners
from highfive.mocap_bridge.frames import PalmPose
from highfive.mocap_bridge.sources.source import C3DSource
from highfive.model import DEFAULT_MODEL
from highfive.model.hgpdm.store import load_model

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


def test_a_high_five_that_ends_before_its_contact_is_judged_at_its_end() -> None:
    """A session that was cut: its contact would have been long after the last tick."""
    partner = simulated_partners(1, ("happy",), ("B2",), 3)[0]
    session = Session(load_model(DEFAULT_MODEL), {"happy": 1.0}, partner.marker_set, build_scene())
    frames = itertools.islice(C3DSource(partner.recording, RATE_HZ), 20)
    reference = reference_in([session.step(frame) for frame in frames], "happy", "B2", partner.contact_frame)
    assert partner.contact_frame > 20 == len(reference.goals)
    assert reference.due == 19
    assert not notice(reference, default_planner()).possible
