"""The pool of the hierarchy, a regression and the nearest training points against its formulas."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from highfive.model.gp import sparse
from highfive.model.hgpdm.dataset import training_set
from highfive.model.hgpdm.hierarchy import problem
from highfive.model.hgpdm.pose_ensemble import HIERARCHY, NEIGHBOURS, REGRESSION
from highfive.model.hgpdm.pose_ensemble_training import local_average
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Trial
from highfive.model.online.belief import Filter
from highfive.model.online.belief_settings import BELIEF
from highfive.model.online.tick_values import Generated

RATE, VARIANCE = 60.0, np.full(6, 1e-6)


def answers(model: HGPDM, hands: list[np.ndarray | None], style: np.ndarray) -> list[Generated]:
    moving = Filter(model, RATE)
    belief, given = moving.initial(style), []
    for hand in hands:
        belief, answer = moving.step(belief, None if hand is None else hand.reshape(6), VARIANCE, style)
        given.append(answer)
    return given


def direct(model: HGPDM, trials: list[Trial], features: np.ndarray, style: np.ndarray) -> tuple[np.ndarray, float]:
    """The direct answers' part of the pool (1, channels) at one input, and how far it is trusted, by batch formulas."""
    assert model.ensemble is not None
    data = training_set(trials, model.preset, model.emotions)
    task = problem(data, model.preset)
    regression = sparse.with_kernel(model.ensemble.regression)
    total, furthest = REGRESSION * np.asarray(sparse.means(regression, features, style[None])), []
    for k in np.flatnonzero(style):
        rows = data.styles[:, k] > 0.5
        average, distance = local_average(task.features[rows], data.outputs[rows], features)
        total += NEIGHBOURS * style[k] * average
        furthest.append(distance[0])
    beyond = np.clip(min(furthest) / model.ensemble.neighbours.usual - 1.0, 0.0, 1.0)
    return total, 1.0 - beyond**2 * (3.0 - 2.0 * beyond)


@pytest.mark.parametrize("style", [np.array([1.0, 0.0]), np.array([0.3, 0.7])], ids=["one", "mixed"])
def test_a_still_hand_is_answered_by_the_weighted_mean_of_the_three(
    model: HGPDM, trials: list[Trial], style: np.ndarray
):
    hand = trials[0].hand_points[-1]  # a hand that came to rest, as many do
    [*_, alone] = answers(replace(model, ensemble=None), [hand] * 60, style)
    [*_, pool] = answers(model, [hand] * 60, style)
    history = np.tile(hand.reshape(6), (1, len(model.preset.history) + 1, 1))
    beside, trust = direct(model, trials, model.feature_map(history), style)
    expected = alone.avatar + trust * (beside[0] - (1.0 - HIERARCHY) * alone.avatar)
    assert trust > 0.1
    off, moved = (np.abs(pool.avatar - other) / np.asarray(model.avatar.scale) for other in (expected, alone.avatar))
    assert off.max() < 0.006  # the points' channels are compressed
    assert moved.max() > 3 * off.max()  # there is something to pool
    np.testing.assert_allclose(pool.avatar_deviations, model.ensemble.spread * alone.avatar_deviations)
    part = slice(2, 5)
    factors = model.ensemble.spread[part]
    np.testing.assert_allclose(pool.covariance(part), alone.covariance(part) * np.outer(factors, factors))


def test_what_the_pool_has_beyond_the_hierarchy_dies_away_while_the_hand_is_hidden(model: HGPDM, trials: list[Trial]):
    hands = [*trials[0].hand_points[10:40], *[None] * 60]
    style = np.array([1.0, 0.0])
    pairs = zip(answers(model, hands, style), answers(replace(model, ensemble=None), hands, style), strict=True)
    beyond = [pool.avatar - alone.avatar for pool, alone in pairs]
    left = np.exp(-1.0 / RATE / BELIEF.residual_time)
    for before, after in pairwise(beyond[30:]):
        np.testing.assert_allclose(after, left * before, rtol=1e-6, atol=1e-12)


def test_a_hand_far_from_all_of_training_is_answered_by_the_hierarchy_alone(model: HGPDM, trials: list[Trial]):
    hands, style = [trials[0].hand_points[40] + 10.0] * 5, np.array([0.5, 0.5])
    [*_, alone], [*_, pool] = answers(replace(model, ensemble=None), hands, style), answers(model, hands, style)
    np.testing.assert_allclose(pool.avatar, alone.avatar)


def test_the_answer_does_not_jump_where_the_nearest_points_change(model: HGPDM, trials: list[Trial]):
    """A hand that creeps by 20 µm a tick moves each channel by so much less than the pool's whole range."""
    start, end = trials[0].hand_points[20], trials[0].hand_points[60]
    way = np.linalg.norm(end - start)
    hands = [start + share * (end - start) for share in np.linspace(0.0, 1.0, int(way / 2e-5))[:4000]]
    moves = np.diff([answer.avatar for answer in answers(model, hands, np.array([1.0, 0.0]))][20:], axis=0)
    assert np.abs(moves / np.asarray(model.avatar.scale)).max() < 0.01
