"""How errors grow with the time looked ahead, against errors that are known."""

from dataclasses import replace

import numpy as np
import pytest
from made_up import made_up_trial

from highfive.model.evaluation.forecast_errors import (
    BEFORE,
    contact_point_coverage,
    contact_point_errors,
    contact_time_errors,
    known_since,
)
from highfive.model.evaluation.predictions import Prediction, Uncertainty
from highfive.model.hgpdm.dataset import CLOCK_SCALE, Channels
from highfive.model.hgpdm.trials import Trial

RATE = 60.0


@pytest.fixture(scope="module")
def trial() -> Trial:
    """Contact is 0.4 s after the beginning: nothing is known of longer before."""
    made = made_up_trial(0.5, "neutral", RATE, np.random.default_rng(0))
    return replace(made, contact_frame=round(0.4 * RATE))


def answered(trial: Trial, rng: np.random.Generator, exaggeration: float = 1.0) -> Prediction:
    """Contact points whose errors grow with the time before contact; uncertainty is ``exaggeration`` times right."""
    frames, where = np.arange(len(trial.joints)), Channels(trial.joints.shape[1])
    deviation = 0.01 + 0.05 * np.abs(trial.contact_frame - frames)[:, None] / trial.rate_hz
    outputs = np.zeros((len(frames), where.size))
    outputs[:, where.contact] = trial.palm[trial.contact_frame] + deviation * rng.normal(size=(len(frames), 3))
    contact = (exaggeration * deviation[:, :, None]) ** 2 * np.eye(3)
    return Prediction(frames, outputs, trial.palm, Uncertainty(np.ones_like(outputs), contact, contact))


def test_medians_are_those_of_the_errors_that_were_made(trial: Trial):
    rng = np.random.default_rng(1)
    answers = {"right": [answered(trial, rng) for _ in range(1500)]}
    errors = contact_point_errors([trial] * 1500, answers)["right"]
    chi3_median = 1.538  # of the length of a standard normal vector in space
    known = BEFORE < 0.4 + 1e-9
    np.testing.assert_allclose(errors[known], chi3_median * (0.01 + 0.05 * BEFORE[known]), rtol=0.1)
    assert np.all(np.isnan(errors[~known]))


@pytest.mark.parametrize(("exaggeration", "share"), [(1.0, 0.9), (0.5, 0.333), (3.0, 1.0)])
def test_regions_hold_the_share_that_the_doubt_is_worth(trial: Trial, exaggeration: float, share: float):
    rng = np.random.default_rng(2)
    answers = {"gp": [answered(trial, rng, exaggeration) for _ in range(1000)]}
    answers["plain"] = [replace(answer, uncertainty=None) for answer in answers["gp"]]
    coverage = contact_point_coverage([trial] * 1000, answers)
    assert list(coverage) == ["gp"]
    known = BEFORE < 0.4 + 1e-9
    np.testing.assert_allclose(coverage["gp"][known], share, atol=0.05)
    assert np.all(np.isnan(coverage["gp"][~known]))


def test_a_point_is_known_since_it_stays_near(trial: Trial):
    """Off by 10 cm until so many frames before contact, and once more in between; after contact it does not matter."""
    frames, where = np.arange(len(trial.joints)), Channels(trial.joints.shape[1])
    given = []
    for off in ([*range(9)], [*range(9), 12], [], [*range(trial.contact_frame + 1)], [trial.contact_frame + 1]):
        outputs = np.zeros((len(frames), where.size))
        outputs[:, where.contact] = trial.palm[trial.contact_frame] + [0.0, 0.03, 0.0]
        outputs[off, where.contact] += [0.0, 0.07, 0.0]
        given.append(Prediction(frames, outputs, trial.palm, None))
    since = known_since([trial] * len(given), given, 0.05)
    contact = trial.contact_frame
    np.testing.assert_allclose(since * RATE, [contact - 9, contact - 13, contact, 0, contact])


def test_the_time_left_is_read_from_the_clock(trial: Trial):
    """A clock that goes 0.05 s ahead errs by that at each horizon; the made-up reach is one of least jerk."""
    frames, where = np.arange(len(trial.joints)), Channels(trial.joints.shape[1])
    outputs = np.zeros((len(frames), where.size))
    outputs[:, where.clock] = np.tanh(((trial.contact_frame - frames) / RATE - 0.05) / CLOCK_SCALE)
    errors = contact_time_errors([trial], {"ahead": [Prediction(frames, outputs, trial.palm, None)]})
    known = BEFORE < 0.4 + 1e-9
    np.testing.assert_allclose(errors["ahead"][known], 0.05, atol=1e-9)
    assert np.all(np.isnan(errors["ahead"][~known])) and set(errors) == {"ahead", "minimum_jerk"}
