"""The adaptive choice of morphs: least expected entropy, the same twice, and what it is worth."""

import numpy as np
import pytest

from highfive.hil.experiments.analysis.adaptive import AdaptiveSettings, answered, begin_run, next_weight, so_far
from highfive.hil.experiments.analysis.psychometric import (
    Psychometric,
    PsychometricSettings,
    fit,
    grid_of,
    p_second,
)

COARSE = PsychometricSettings(pse_levels=15, width_levels=9, lapse_levels=3)
HARD = AdaptiveSettings(levels=11, easy=0.0)


def entropy(log_posterior: np.ndarray) -> float:
    p = np.exp(log_posterior - log_posterior.max())
    p = p.sum(axis=2) / p.sum()
    p = p[p > 0.0]
    return float(-np.sum(p * np.log(p)))


def test_it_chooses_what_the_slow_way_chooses() -> None:
    run = begin_run(0, COARSE, HARD)
    rng = np.random.default_rng(0)
    for _ in range(12):
        expected = []
        belief = np.exp(run.log_posterior) / np.exp(run.log_posterior).sum()
        for weight in np.linspace(0.0, 1.0, 11):
            after = [answered(run, weight, second).log_posterior for second in (False, True)]
            mass = [np.exp(log).sum() / np.exp(run.log_posterior).sum() for log in after]
            assert sum(mass) == pytest.approx(1.0) and belief.sum() == pytest.approx(1.0)
            expected.append(sum(m * entropy(log) for m, log in zip(mass, after, strict=True)))
        chosen = next_weight(run)
        assert expected[round(10 * chosen)] == pytest.approx(min(expected), abs=1e-9)
        run = answered(run, chosen, bool(rng.random() < p_second(chosen, 0.4, 0.1, 0.03)))


def simulated(
    seed: int, pse: float, width: float, trials: int, lapse: float = 0.03
) -> tuple[list[float], Psychometric]:
    """An observer's run: the weights shown, and what was found."""
    run, rng, shown = begin_run(seed), np.random.default_rng(1_000 + seed), []
    for _ in range(trials):
        shown.append(next_weight(run))
        run = answered(run, shown[-1], bool(rng.random() < p_second(shown[-1], pse, width, lapse)))
    return shown, so_far(run)


def test_the_same_seed_shows_the_same_and_a_tenth_is_easy() -> None:
    assert simulated(3, 0.45, 0.15, 15) == simulated(3, 0.45, 0.15, 15)
    runs = [begin_run(seed) for seed in range(300)]
    easy = sum(next_weight(run) in (0.0, 1.0) for run in runs)
    assert 15 <= easy <= 50  # 30 expected of 300


def test_a_run_says_what_a_fit_of_its_answers_says() -> None:
    run, rng, shown, said = begin_run(1), np.random.default_rng(1), [], []
    for _ in range(20):
        shown.append(next_weight(run))
        said.append(bool(rng.random() < p_second(shown[-1], 0.5, 0.15, 0.0)))
        run = answered(run, shown[-1], said[-1])
    one, other = so_far(run), fit(shown, said)
    assert one.pse.value == pytest.approx(other.pse.value) and one.jnd.value == pytest.approx(other.jnd.value)
    assert one.trials == other.trials == 20


def test_probabilities_looked_at_stay_few_enough_for_a_choice() -> None:
    observer, settings = PsychometricSettings(), AdaptiveSettings()
    grid = observer.pse_levels * observer.width_levels * observer.lapse_levels
    assert grid * settings.levels < 1_000_000


@pytest.mark.slow(40)
def test_40_trials_tell_the_pse_to_45_thousandths() -> None:
    rng = np.random.default_rng(7)
    truths = rng.normal(0.5, 0.1, 200)
    found = [simulated(seed, truth, 0.15, 40)[1] for seed, truth in enumerate(truths)]
    errors = np.array([one.pse.value for one in found]) - truths
    assert np.sqrt(np.mean(errors**2)) <= 0.045
    inside = [one.pse.interval[0] < truth < one.pse.interval[1] for one, truth in zip(found, truths, strict=True)]
    assert 0.90 <= np.mean(inside) <= 0.99


def test_questplus_chooses_the_same() -> None:
    """Of an observer without lapses, as theirs cannot be tied to both sides. Under the GPL: no dependency of ours."""
    questplus = pytest.importorskip("questplus", reason="questplus (GPL-3) is an oracle that is installed apart")
    observer = PsychometricSettings(pse_levels=15, width_levels=9, lapse=1e-9, lapse_levels=2)
    grid, none = grid_of(observer), np.array([0.0])
    priors = [np.exp(-0.5 * np.linspace(-most, most, levels) ** 2) for most, levels in ((2.0, 15), (2.5, 9))]
    widths = np.exp(grid.log_width)
    theirs = questplus.QuestPlus(
        stim_domain={"intensity": np.linspace(0.0, 1.0, 11)},
        param_domain={"mean": grid.pse, "sd": widths, "lower_asymptote": none, "lapse_rate": none},
        outcome_domain={"response": ["second", "first"]},
        func="norm_cdf",
        stim_scale="linear",
        stim_selection_method="min_entropy",
        param_estimation_method="mean",
        prior={"mean": priors[0] / priors[0].sum(), "sd": priors[1] / priors[1].sum()},
    )
    run, rng = begin_run(0, observer, HARD), np.random.default_rng(0)
    for _ in range(15):
        shown = next_weight(run)
        assert theirs.next_stim["intensity"] == pytest.approx(shown)
        second = bool(rng.random() < p_second(shown, 0.4, 0.1, 0.0))
        run = answered(run, shown, second)
        theirs.update(stim={"intensity": shown}, outcome={"response": "second" if second else "first"})
    assert theirs.param_estimate["mean"] == pytest.approx(so_far(run).pse.value, abs=1e-6)
