"""Psychometric functions: laws, another way to the same posterior, observers whose truth is known, and psignifit."""

import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.stats import norm

from highfive.hil.experiments.analysis.psychometric import (
    JND_OF_WIDTH,
    Psychometric,
    PsychometricSettings,
    fit,
    p_second,
    pooled_log_jnd,
    pooled_pse,
    pse_shift,
)
from highfive.model.errors import HighFiveError

WEIGHTS = np.repeat(np.linspace(0.0, 1.0, 7), 8)


def answers(rng: np.random.Generator, pse: float, width: float, lapse: float = 0.03, weights=WEIGHTS):
    return rng.random(len(weights)) < p_second(weights, pse, width, lapse)


def test_function_is_what_it_is_called() -> None:
    assert p_second(0.4, 0.4, 0.1, 0.02) == 0.5
    assert p_second(0.4 + JND_OF_WIDTH * 0.1, 0.4, 0.1, 0.0) == pytest.approx(0.75)
    assert p_second(-9.0, 0.4, 0.1, 0.02) == pytest.approx(0.02) and p_second(9.0, 0.4, 0.1, 0.02) == pytest.approx(
        0.98
    )


def test_nothing_known_is_what_was_believed_and_styles_changed_over_mirror_it() -> None:
    few = fit([0.5, 0.5], [True, False])
    assert few.pse.value == pytest.approx(0.5) and few.pse.sd < PsychometricSettings().pse_spread
    said = answers(np.random.default_rng(0), 0.42, 0.15)
    one, other = fit(WEIGHTS, said), fit(1.0 - WEIGHTS, ~said)
    assert other.pse.value == pytest.approx(1.0 - one.pse.value, abs=1e-9)
    assert other.jnd.value == pytest.approx(one.jnd.value) and other.lapse.value == pytest.approx(one.lapse.value)


def test_order_is_nothing_and_a_finer_grid_changes_hardly_anything() -> None:
    rng = np.random.default_rng(1)
    said = answers(rng, 0.55, 0.12)
    turned = rng.permutation(len(said))
    assert fit(WEIGHTS[turned], said[turned]) == fit(WEIGHTS, said)
    finer = PsychometricSettings(pse_levels=211, width_levels=121, lapse_levels=25)
    one, other = fit(WEIGHTS, said), fit(WEIGHTS, said, finer)
    assert one.pse.value == pytest.approx(other.pse.value, abs=0.002)
    assert one.jnd.value == pytest.approx(other.jnd.value, rel=0.03)
    assert one.pse.interval == pytest.approx(other.pse.interval, abs=0.01)


def test_posterior_of_the_pse_is_what_integrating_by_hand_gives() -> None:
    said = answers(np.random.default_rng(2), 0.5, 0.2, 0.0)
    settings = PsychometricSettings(lapse=1e-6)  # none, so that two parameters are left
    m, log_s = np.linspace(-0.2, 1.2, 301), np.linspace(np.log(0.15) - 2, np.log(0.15) + 2, 301)
    p = norm.cdf((WEIGHTS[:, None, None] - m[:, None]) / np.exp(log_s))
    log = np.log(np.where(said[:, None, None], p, 1 - p) + 1e-12).sum(axis=0)
    density = np.exp(log - log.max()) * norm.pdf(m, 0.5, 0.35)[:, None] * norm.pdf(log_s, np.log(0.15), 0.8)
    of_m = simpson(density, x=log_s, axis=1)
    expected = simpson(of_m * m, x=m) / simpson(of_m, x=m)
    assert fit(WEIGHTS, said, settings).pse.value == pytest.approx(expected, abs=0.001)


def observers(rng: np.random.Generator, count: int, pse: float, between: float, width: float = 0.15):
    truths = pse + between * rng.standard_normal(count)
    return truths, [fit(WEIGHTS, answers(rng, truth, width)) for truth in truths]


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    rng = np.random.default_rng(4)
    truths, found = observers(rng, 300, 0.5, 0.1)
    inside = [f.pse.interval[0] < truth < f.pse.interval[1] for truth, f in zip(truths, found, strict=True)]
    of_jnd = [f.jnd.interval[0] < JND_OF_WIDTH * 0.15 < f.jnd.interval[1] for f in found]
    assert 0.91 <= np.mean(inside) <= 0.99 and 0.91 <= np.mean(of_jnd) <= 1.0
    assert np.sqrt(np.mean([(f.pse.value - t) ** 2 for t, f in zip(truths, found, strict=True)])) < 0.056


def test_a_smaller_level_has_a_smaller_interval_that_holds_so_much_less() -> None:
    said = answers(np.random.default_rng(5), 0.5, 0.15)
    narrow, wide = fit(WEIGHTS, said, level=0.5).pse, fit(WEIGHTS, said).pse
    assert narrow.value == wide.value
    # of a nearly normal posterior: 0.674 and 1.96 standard deviations to either side
    for found, deviations in ((narrow, 0.674), (wide, 1.96)):
        assert found.interval[1] - found.interval[0] == pytest.approx(2.0 * deviations * found.sd, rel=0.06)


def test_people_together() -> None:
    rng = np.random.default_rng(5)
    _, interactive = observers(rng, 30, 0.45, 0.05)
    _, replay = observers(rng, 30, 0.55, 0.05)
    together = pooled_pse(interactive)
    assert together.interval[0] < 0.45 < together.interval[1] and together.sd < 0.02
    shift = pse_shift(interactive, replay)
    assert shift.interval[0] < -0.1 < shift.interval[1] < 0.0 and shift.p_positive < 0.01
    low, high = pooled_log_jnd(interactive).interval
    assert low - 0.1 < np.log(JND_OF_WIDTH * 0.15) < high + 0.1


def test_what_is_no_data_is_refused() -> None:
    with pytest.raises(HighFiveError, match="no answer to fit"):
        fit([], [])
    with pytest.raises(HighFiveError, match="expected one finite weight an answer"):
        fit([0.1, 0.2], [True])
    with pytest.raises(HighFiveError, match="expected one finite weight an answer"):
        fit([float("nan")], [True])


@pytest.mark.slow
def test_psignifit_finds_the_same() -> None:
    """Psignifit 4 is under the GPL: it is no dependency of the project, and compared with where somebody has it."""
    psignifit = pytest.importorskip("psignifit", reason="psignifit (GPL-3) is an oracle that is installed apart")
    rng = np.random.default_rng(6)
    weights = np.repeat(np.linspace(0.0, 1.0, 9), 40)
    for pse, width in ((0.4, 0.1), (0.6, 0.2)):
        said = answers(rng, pse, width, weights=weights)
        levels = np.unique(weights)
        data = np.array([[level, said[weights == level].sum(), (weights == level).sum()] for level in levels])
        theirs = psignifit.psignifit(data, experiment_type="equal asymptote", sigmoid="norm")
        ours: Psychometric = fit(weights, said)
        parameters = theirs.get_parameter_estimate()
        assert ours.pse.value == pytest.approx(parameters["threshold"], abs=0.006)
        # Their width runs from 5 to 95 %: 2 · 1.645 s.
        assert ours.jnd.value == pytest.approx(JND_OF_WIDTH * parameters["width"] / (2 * norm.ppf(0.95)), rel=0.12)
