"""Mixtures against their parts, their own draws, and Bayes' rule worked out on a grid."""

import warnings

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from highfive.model.gp.mixture import GaussianMixture, fitted


def two() -> GaussianMixture:
    points = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 1.2]])
    return GaussianMixture(np.array([0.25, 0.75]), points, np.array([0.01 * np.eye(3), np.diag([0.02, 0.01, 0.005])]))


def test_density_is_that_of_the_normal_parts() -> None:
    mixture, points = two(), np.random.default_rng(0).normal(size=(20, 3))
    parts = [multivariate_normal(p, c).pdf(points) for p, c in zip(mixture.points, mixture.covariances, strict=True)]
    np.testing.assert_allclose(mixture.log_density(points), np.log(0.25 * parts[0] + 0.75 * parts[1]), rtol=1e-9)
    assert mixture.number == np.exp(-0.25 * np.log(0.25) - 0.75 * np.log(0.75))
    np.testing.assert_allclose(mixture.mean, [0.45, 0.0, 1.15])


def test_of_its_own_draws_nine_of_ten_are_in_the_region() -> None:
    mixture, rng = two(), np.random.default_rng(1)
    which = rng.choice(2, 400, p=mixture.weights)
    drawn = [rng.multivariate_normal(mixture.points[k], mixture.covariances[k]) for k in which]
    inside = np.mean([mixture.level(point, rng, 400) < 0.9 for point in drawn])
    assert 0.85 < inside < 0.95


def test_its_covariance_is_that_of_its_draws() -> None:
    mixture, rng = two(), np.random.default_rng(2)
    which = rng.choice(2, 40_000, p=mixture.weights)
    drawn = np.array([rng.multivariate_normal(mixture.points[k], mixture.covariances[k]) for k in which])
    np.testing.assert_allclose(mixture.covariance, np.cov(drawn.T), atol=2e-3)


def test_a_word_weighs_hypotheses_by_bayes_rule() -> None:
    """Against a sum over a grid: each hypothesis' density times that of the word."""
    mixture, word, doubt = two(), np.array([0.2, 0.05, 1.1]), np.diag([0.04, 0.02, 0.03])
    axes = [np.linspace(-0.9, 1.5, 61), np.linspace(-0.7, 0.7, 41), np.linspace(0.3, 1.9, 45)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    likely = multivariate_normal(word, doubt).pdf(grid)
    parts = zip(mixture.weights, mixture.points, mixture.covariances, strict=True)
    masses = np.array([w * np.sum(multivariate_normal(p, c).pdf(grid) * likely) for w, p, c in parts])
    told = mixture.told(word, doubt)
    np.testing.assert_allclose(told.weights, masses / masses.sum(), atol=2e-3)
    assert told.points is mixture.points


@pytest.mark.parametrize("probability", [0.0, 0.3, 1.0])
def test_a_word_that_may_be_of_something_else_counts_so_much_the_less(probability: float) -> None:
    mixture, word, doubt = two(), np.array([0.0, 0.0, 1.0]), 0.01 * np.eye(3)
    expected = probability * mixture.told(word, doubt).weights + (1.0 - probability) * mixture.weights
    np.testing.assert_allclose(mixture.told(word, doubt, probability).weights, expected)


def test_a_word_from_far_away_leaves_weights_that_are_shares() -> None:
    weights = two().told(np.array([1e5, -1e5, 1e5]), 1e-6 * np.eye(3)).weights
    assert np.isfinite(weights).all() and weights.sum() == pytest.approx(1.0)


@pytest.mark.slow
def test_places_are_found_and_one_cloud_is_one_place() -> None:
    rng = np.random.default_rng(3)
    centres = np.array([[x, y, z] for x in (0.0, 0.3) for y in (0.0, 0.3) for z in (0.0, 0.3)])
    points = np.repeat(centres, 12, axis=0) + 0.02 * rng.normal(size=(96, 3))
    found = fitted(points, range(1, 13), 0, 1e-4, 5, tied=True)
    assert len(found.weights) == 8
    nearest = np.linalg.norm(found.points[:, None] - centres, axis=2).min(axis=0)
    assert nearest.max() < 0.02
    np.testing.assert_allclose(found.weights, 1.0 / 8.0, atol=1e-3)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # nobody is told of groups that k-means left empty
        for seed in range(20):
            fitted(rng.normal(size=(24, 3)), range(1, 9), seed, 1e-4, 5, tied=True)
    cloud = fitted(0.1 * rng.normal(size=(96, 3)), range(1, 13), 0, 1e-4, 5, tied=True)
    assert len(cloud.weights) == 1
