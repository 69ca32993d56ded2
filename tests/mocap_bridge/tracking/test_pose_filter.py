"""The compiled filter against finite differences and the textbook's Kalman update."""

import numpy as np
import pytest
from scipy.linalg import block_diag

from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.tracking.chain import make_chain
from highfive.mocap_bridge.tracking.chain_kinematics import HINGE, Pose, kinematics, on_segments, shifted
from highfive.mocap_bridge.tracking.filter_settings import ALIKE, NEVER, FilterSettings
from highfive.mocap_bridge.tracking.first_pose import first_state, standing
from highfive.mocap_bridge.tracking.marker_places import settled
from highfive.mocap_bridge.tracking.pose_filter import State, corrected, expected, predicted

SETS = ("paper", "plug_in_gait", "full_body")


@pytest.fixture(params=SETS)
def chain(request):
    return make_chain(load_marker_set(request.param))


def random_state(chain, seed=0) -> State:
    """A state in a random pose with random speeds and a random, well-conditioned covariance."""
    rng = np.random.default_rng(seed)
    n, markers = len(chain.kind), len(chain.carrier)
    angles = np.where(chain.kind == HINGE, chain.rest + rng.normal(scale=0.4, size=n), 0.0)
    pose, _ = kinematics(chain, chain.offsets, standing(chain, 0.7, angles))
    root = rng.normal(size=(2 * n, 2 * n)) / np.sqrt(2 * n)
    whole = 1e-4 * (root @ root.T) + 1e-5 * np.eye(2 * n)
    covariance = np.stack([whole[:n, :n], whole[n:, :n], whole[n:, n:]])
    none = np.zeros(markers)
    ages = np.zeros(markers, dtype=np.int64)
    return State(
        pose, rng.normal(size=n), covariance, chain.offsets, chain.places, chain.places, none + 1e-6, none + 4e-6,
        np.zeros((markers, 3)), ages, ages.copy(), np.zeros((markers, 3)), np.full((markers, 3), np.nan), 0,
    )  # fmt: skip


def markers_of(chain, pose: Pose, step):
    moved, _ = kinematics(chain, chain.offsets, shifted(chain, pose, step))
    return on_segments(chain, moved, chain.places)


def slopes_of(chain, pose: Pose):
    """Derivative (3 M, n) of the markers by the freedoms, by central differences."""
    n, h = len(chain.kind), 1e-6
    columns = [
        (markers_of(chain, pose, h * unit) - markers_of(chain, pose, -h * unit)).reshape(-1) / (2 * h)
        for unit in np.eye(n)
    ]
    return np.array(columns).T


def test_velocities_and_covariances_are_those_of_the_finite_differences(chain):
    state = random_state(chain)
    slopes = slopes_of(chain, state.pose)
    markers, covariances, velocities = expected(chain, state)
    np.testing.assert_allclose(markers, markers_of(chain, state.pose, np.zeros(len(chain.kind))), atol=1e-12)
    np.testing.assert_allclose(velocities.reshape(-1), slopes @ state.speeds, atol=1e-6)
    whole = slopes @ state.covariance[0] @ slopes.T
    own = [
        whole[3 * m : 3 * m + 3, 3 * m : 3 * m + 3] + state.place_variance[m] * np.eye(3) for m in range(len(markers))
    ]
    np.testing.assert_allclose(covariances, own, atol=1e-9)


def test_the_update_is_the_textbooks(chain):
    """One linearisation in information form is the Kalman update of pose and speeds by all seen markers at once."""
    state = random_state(chain, 1)
    rng, n, count = np.random.default_rng(2), len(chain.kind), len(chain.carrier)
    slopes = slopes_of(chain, state.pose)
    markers = expected(chain, state)[0]
    points = markers + rng.normal(scale=0.002, size=markers.shape)
    seen = rng.random(count) < 0.7
    caution = np.where(rng.random(count) < 0.3, 1e-5, 0.0)
    found, worked = corrected(chain, state, points, seen, ALIKE, caution, 0.0, 1, 1e-9)
    assert worked
    rows = np.repeat(seen, 3)
    h = np.hstack([slopes[rows], np.zeros((rows.sum(), n))])
    prior = np.block([[state.covariance[0], state.covariance[1].T], [state.covariance[1], state.covariance[2]]])
    noise = np.repeat(FilterSettings().marker_sigma ** 2 + state.place_variance + state.misfit + caution, 3)[rows]
    gain = prior @ h.T @ np.linalg.inv(h @ prior @ h.T + np.diag(noise))
    step = gain @ (points - markers).reshape(-1)[rows]
    posterior = prior - gain @ h @ prior
    np.testing.assert_allclose(found.covariance[0], posterior[:n, :n], atol=1e-10)
    np.testing.assert_allclose(found.covariance[1], posterior[n:, :n], atol=1e-10)
    np.testing.assert_allclose(found.covariance[2], posterior[n:, n:], atol=1e-10)
    np.testing.assert_allclose(found.speeds, state.speeds + step[n:], atol=1e-8)
    ours = on_segments(chain, found.pose, chain.places)
    np.testing.assert_allclose(ours, markers_of(chain, state.pose, step[:n]), atol=1e-8)


def test_time_passes_as_the_linear_model_says(chain):
    """Speeds fade and carry; the covariance goes through the same matrix, white accelerations on top."""
    state, seconds, n = random_state(chain, 3), 1.0 / 120.0, len(chain.kind)
    ahead = predicted(chain, state, seconds)
    keep = np.exp(-seconds / chain.coasting)
    carry = np.block([[np.eye(n), np.diag(chain.coasting * (1 - keep))], [np.zeros((n, n)), np.diag(keep)]])
    driven = np.kron([[seconds**3 / 3, seconds**2 / 2], [seconds**2 / 2, seconds]], np.diag(chain.power))
    prior = np.block([[state.covariance[0], state.covariance[1].T], [state.covariance[1], state.covariance[2]]])
    after = carry @ prior @ carry.T + driven
    np.testing.assert_allclose(ahead.covariance, [after[:n, :n], after[n:, :n], after[n:, n:]], atol=1e-12)
    np.testing.assert_allclose(ahead.speeds, keep * state.speeds)
    moved = markers_of(chain, state.pose, chain.coasting * (1 - keep) * state.speeds)
    np.testing.assert_allclose(on_segments(chain, ahead.pose, chain.places), moved, atol=1e-12)


def test_nothing_seen_for_long_keeps_the_covariance_positive(chain):
    state = random_state(chain, 4)
    nothing = np.zeros(len(chain.carrier), dtype=bool)
    for _ in range(600):
        state = predicted(chain, state, 1.0 / 120.0)
        state, worked = corrected(
            chain, state, np.zeros_like(chain.places), nothing, ALIKE, np.zeros(len(nothing)), 1 / 120, 1, 1e-3
        )
        assert worked
    whole = np.block([[state.covariance[0], state.covariance[1].T], [state.covariance[1], state.covariance[2]]])
    assert np.linalg.eigvalsh(whole).min() > 0.0
    assert (state.ages != NEVER).all()


@pytest.mark.parametrize("heading", [0.0, 1.0, 2.5, -2.0])
@pytest.mark.parametrize("size", [0.9, 1.0, 1.12])
def test_the_first_pose_is_found_wherever_somebody_looks_and_however_tall(chain, heading, size):
    rng = np.random.default_rng(5)
    angles = np.where(chain.kind == HINGE, chain.rest + rng.normal(scale=0.25, size=len(chain.kind)), 0.0)
    pose, _ = kinematics(chain, size * chain.offsets, standing(chain, heading, angles, size))
    points = on_segments(chain, pose, size * chain.places) + np.array([1.0, -2.0, 0.0])
    state = first_state(chain, np.zeros(0, dtype=np.intp), points, np.ones(len(points), dtype=bool))
    assert state is not None
    error = np.linalg.norm(expected(chain, state)[0] - points, axis=1)
    assert np.sqrt((error**2).mean()) < 0.004


def random_noise(count, seed, least=0.001, most=0.03):
    """Covariances (M, 3, 3), each with its own axes and deviations."""
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    return np.einsum("mik,mk,mjk->mij", axes, rng.uniform(least, most, (count, 3)) ** 2, axes)


def test_the_update_with_a_covariance_of_each_point_is_the_textbooks(chain):
    """Kalman's update with correlated coordinates: a point that is well measured in one direction says so in that."""
    state = random_state(chain, 1)
    rng, n, count = np.random.default_rng(2), len(chain.kind), len(chain.carrier)
    slopes, markers = slopes_of(chain, state.pose), expected(chain, state)[0]
    points, seen = markers + rng.normal(scale=0.002, size=markers.shape), rng.random(count) < 0.7
    noise, caution = random_noise(count, 3), np.where(rng.random(count) < 0.3, 1e-5, 0.0)
    found, worked = corrected(chain, state, points, seen, noise, caution, 0.0, 1, 1e-9)
    assert worked
    rows = np.repeat(seen, 3)
    h = np.hstack([slopes[rows], np.zeros((rows.sum(), n))])
    prior = np.block([[state.covariance[0], state.covariance[1].T], [state.covariance[1], state.covariance[2]]])
    whole = block_diag(*(noise + (state.place_variance + state.misfit + caution)[:, None, None] * np.eye(3)))
    gain = prior @ h.T @ np.linalg.inv(h @ prior @ h.T + whole[np.ix_(rows, rows)])
    step, posterior = gain @ (points - markers).reshape(-1)[rows], prior - gain @ h @ prior
    np.testing.assert_allclose(found.covariance[0], posterior[:n, :n], atol=1e-10)
    np.testing.assert_allclose(found.covariance[1], posterior[n:, :n], atol=1e-10)
    np.testing.assert_allclose(found.covariance[2], posterior[n:, n:], atol=1e-10)
    np.testing.assert_allclose(found.speeds, state.speeds + step[n:], atol=1e-8)
    np.testing.assert_allclose(
        on_segments(chain, found.pose, chain.places), markers_of(chain, state.pose, step[:n]), atol=1e-8
    )


def test_places_follow_with_the_gain_of_a_kalman_filter_in_each_direction(chain):
    """A marker's place on its segment: the textbook's gain, and a misfit that asks the sure directions."""
    state = random_state(chain, 6)
    count = len(chain.carrier)
    points = expected(chain, state)[0] + np.random.default_rng(7).normal(scale=0.02, size=(count, 3))
    noise, seconds = random_noise(count, 8), 1.0 / 60.0
    after = settled(chain, state, points, np.ones(count, dtype=bool), noise, seconds)
    for m in range(count):
        turn, spread = state.pose.frames[chain.carrier[m]], chain.spreads[m]
        local = turn.T @ noise[m] @ turn
        beside = turn.T @ (points[m] - state.pose.centres[chain.carrier[m]]) - state.places[m]
        variance, misfit = state.place_variance[m], state.misfit[m]
        gain = variance * np.linalg.inv(local + (variance + misfit) * np.eye(3))
        home = seconds * chain.settings.slip**2 / spread**2 * (state.homes[m] - state.places[m])
        np.testing.assert_allclose(after.places[m], state.places[m] + gain @ beside + home, atol=1e-12)
        assert after.place_variance[m] == pytest.approx(np.trace((np.eye(3) - gain) * variance) / 3.0)
        left, sure = beside - gain @ beside, np.linalg.inv(local)
        excess = max((left @ sure @ left - np.trace(sure @ local)) / np.trace(sure), 0.0)
        share = seconds / chain.settings.misfit_s
        assert after.misfit[m] == pytest.approx(min(misfit + share * (excess - misfit), 0.02**2))
