"""One frame of the tracker: predict, gate, update, and what is reported of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.tracking.chain_kinematics import (
    Chain,
    kinematics,
    on_segments,
)
from highfive.mocap_bridge.tracking.filter_settings import NEVER
from highfive.mocap_bridge.tracking.label_gating import believed, taken_up
from highfive.mocap_bridge.tracking.marker_places import settled
from highfive.mocap_bridge.tracking.pose_filter import (
    State,
    corrected,
    expected,
    marker_covariance,
    predicted,
    with_pose,
)
from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry.rotations import Array
from highfive.model.linear_algebra import precision_of, squared_distance


class Followed(NamedTuple):
    """What one frame made of the markers.

    Attributes:
        positions: (M, 3) m.
        velocities: (M, 3) m/s.
        covariances: (M, 3, 3) m², of the positions.
        seen: (M,) a point was believed to be the marker.
        valid: (M,) the marker is known well enough to be used, if need be from the set and the markers beside it.
        rejected: (M,) the marker's label was at a point that was not believed to be it.
    """

    positions: Array
    velocities: Array
    covariances: Array
    seen: NDArray[np.bool_]
    valid: NDArray[np.bool_]
    rejected: NDArray[np.bool_]


@compiled_entry
def followed(
    chain: Chain, state: State, points: Array, labelled: NDArray[np.bool_], noise: Array, loose: Array, elapsed_ns: int
) -> tuple[State, Followed, bool]:
    """One frame: predict, tell points apart, correct, and say where every marker is; False where the filter failed.

    Args:
        chain: the skeleton.
        state: after the frame before.
        points: (M, 3) m, finite.
        labelled: (M,) the marker's label has a point.
        noise: (M, 3, 3) m², covariance of each point; no rows where the settings' holds for all.
        loose: (U, 3) m, points without a label.
        elapsed_ns: since the frame before.
    """
    count, seconds = len(points), 1e-9 * elapsed_ns
    state = predicted(chain, state, seconds)
    pose, axes = kinematics(chain, state.offsets, state.pose)
    markers = on_segments(chain, pose, state.places)
    precisions, jacobian = np.zeros((count, 3, 3)), np.empty((chain.path.shape[1], 3))
    slides, caution = np.full_like(markers, np.inf), np.zeros(count)
    for m in range(count):
        if state.ages[m] == NEVER:
            continue
        square = 0.0
        for i in range(3):
            square += (points[m, i] - markers[m, i]) ** 2
        # No variance is below the measurement's own, so that what is this near lies inside the gate.
        near = square <= chain.settings.gate * chain.settings.marker_sigma**2 and len(noise) == 0
        if not labelled[m] or not near or state.ages[m] > 0:
            # Only while its label is nowhere: one that is somewhere else is not believed for staying there.
            slack = chain.settings.drift * 1e-9 * (state.ages[m] - min(state.disbelieved[m], state.ages[m]))
            marker_covariance(chain, state, axes, m, markers[m], jacobian, precisions[m])
            if state.ages[m] > 0:
                for i in range(3):
                    caution[m] += chain.settings.caution * precisions[m, i, i] / 3.0
            _measured(chain, state, noise, m, slack, precisions[m])
        if state.ages[m] == 0:
            for i in range(3):
                slides[m, i] = markers[m, i]
                for k in range(3):
                    slides[m, i] += state.pose.frames[chain.carrier[m], i, k] * state.left[m, k]
    seen = believed(chain.settings, state, markers, precisions, slides, points, labelled)
    doubted, rejected, wanting = np.zeros(count, dtype=np.bool_), 0, False
    for m in range(count):
        known = state.ages[m] != NEVER
        doubted[m] = labelled[m] and known and not seen[m]
        rejected += 1 if doubted[m] else 0
        wanting = wanting or (known and not seen[m])
    if wanting and rejected + len(loose) > 0:
        points, noise = taken_up(chain.settings, state, markers, precisions, points, loose, seen, doubted, noise)
    state = without_speeds(chain, state, seen)
    state, worked = corrected(
        chain, state, points, seen, noise, caution, seconds, chain.settings.rounds, chain.settings.small
    )
    state = remembered(
        chain, settled(chain, state, points, seen, noise, seconds), points, labelled, seen, rejected, elapsed_ns
    )
    return state, shown(chain, state, points, seen, noise, doubted), worked


@compiled
def _measured(chain: Chain, state: State, noise: Array, m: int, slack: float, out: Array) -> None:
    """Makes of the covariance (3, 3) of where a marker is the precision of where it is measured, in place."""
    if len(noise) > 0:
        out += noise[m]
        precision_of(out, state.misfit[m] + slack * slack)
    else:
        precision_of(out, chain.settings.marker_sigma**2 + state.misfit[m] + slack * slack)


@compiled_entry
def forecast(chain: Chain, state: State, elapsed_ns: int) -> tuple[State, Followed]:
    """Where every marker will be ``elapsed_ns`` after the last frame, if nothing is seen until then."""
    count = len(state.ages)
    ages = state.ages.copy()
    for m in range(count):
        if ages[m] != NEVER:
            ages[m] += elapsed_ns
    ahead = predicted(chain, state, 1e-9 * elapsed_ns)
    none = np.zeros(count, dtype=np.bool_)
    return with_ages(ahead, ages), shown(chain, ahead, ahead.last, none, np.zeros((0, 3, 3)), none)


@compiled
def with_ages(state: State, ages: NDArray[np.int64]) -> State:
    """The state with other ages of its markers (M,), ns."""
    return State(
        state.pose, state.speeds, state.covariance, state.offsets, state.places, state.homes, state.place_variance,
        state.misfit, state.left, ages, state.disbelieved, state.last, state.pace, state.astray,
    )  # fmt: skip


@compiled
def without_speeds(chain: Chain, state: State, seen: NDArray[np.bool_]) -> State:
    """The state, without the speeds of parts of the body that were out of sight until now.

    What a hidden hand was off by came about during all the time that it was hidden: taken for its speed, it would
    throw the hand far beyond.
    """
    covariance, copied = state.covariance, False
    for m in range(len(seen)):
        if not seen[m] or state.ages[m] < chain.settings.return_ns or state.ages[m] == NEVER:
            continue
        j = chain.carrier[m]
        for a in range(chain.lengths[j]):
            d = chain.path[j, a]
            if chain.kind[d] == 0 or covariance[0, d, d] < chain.settings.unsure**2:
                continue
            if not copied:
                covariance, copied = covariance.copy(), True
            for i in range(len(state.speeds)):
                covariance[1, d, i] = covariance[2, d, i] = covariance[2, i, d] = 0.0
            covariance[2, d, d] = chain.settings.return_speed**2
    return with_pose(state, state.pose, state.speeds, covariance)


@compiled
def remembered(
    chain: Chain, state: State, points: Array, labelled: NDArray[np.bool_], seen: NDArray[np.bool_], rejected: int,
    elapsed_ns: int,
) -> State:  # fmt: skip
    """The state with the markers' ages; markers that appear, or have slipped, are put where they are, and are seen."""
    places, place_variance, left = state.places.copy(), state.place_variance.copy(), state.left.copy()
    homes = state.homes.copy()
    ages, disbelieved, shown = state.ages.copy(), state.disbelieved.copy(), 0
    last, pace = state.last.copy(), np.empty_like(state.pace)
    local = np.empty(3)
    for m in range(len(ages)):
        shown += 1 if labelled[m] and ages[m] != NEVER else 0
        disbelieved[m] = disbelieved[m] + elapsed_ns if labelled[m] and not seen[m] else 0
        if labelled[m] and not seen[m] and disbelieved[m] > chain.settings.reset_ns:
            square, j = 0.0, chain.carrier[m]
            for i in range(3):
                local[i] = 0.0
                for k in range(3):
                    local[i] += state.pose.frames[j, k, i] * (points[m, k] - state.pose.centres[j, k])
                square += (local[i] - chain.places[m, i]) ** 2
            if square < chain.settings.slipped**2:
                places[m], homes[m], left[m], place_variance[m], seen[m] = (
                    local,
                    local,
                    0.0,
                    chain.spreads[m] ** 2,
                    True,
                )
        for i in range(3):
            pace[m, i] = points[m, i] - last[m, i] if seen[m] and ages[m] == 0 else np.nan
            last[m, i] = points[m, i] if seen[m] else last[m, i]
        if seen[m]:
            ages[m] = 0
        elif ages[m] != NEVER:
            ages[m] += elapsed_ns
    astray = state.astray + 1 if shown > 0 and rejected > chain.settings.lost_share * shown else 0
    return State(
        state.pose, state.speeds, state.covariance, state.offsets, places, homes, place_variance, state.misfit, left,
        ages, disbelieved, last, pace, astray,
    )  # fmt: skip


@compiled
def shown(
    chain: Chain, state: State, points: Array, seen: NDArray[np.bool_], noise: Array, doubted: NDArray[np.bool_]
) -> Followed:
    """Where every marker is, seen or not."""
    markers, covariances, velocities = expected(chain, state)
    valid, weights, gap = np.empty(len(markers), dtype=np.bool_), np.empty((3, 3)), np.empty(3)
    for m in range(len(markers)):
        j, own = chain.carrier[m], 0.0
        if seen[m] and len(noise) > 0:  # the same with matrices: the share is misfit · (misfit + noise)⁻¹
            misfit = state.misfit[m]
            for i in range(3):
                gap[i] = points[m, i] - markers[m, i]
                for k in range(3):
                    weights[i, k] = noise[m, i, k]
            precision_of(weights, misfit)
            for i in range(3):
                covariances[m, i, i] += misfit
                for k in range(3):
                    markers[m, i] += misfit * weights[i, k] * gap[k]
                    covariances[m, i, k] -= misfit * misfit * weights[i, k]
        elif seen[m]:  # what chain and place do not explain is the skin's own motion, for the most part
            share = state.misfit[m] / (state.misfit[m] + chain.settings.marker_sigma**2)
            own = share * chain.settings.marker_sigma**2
            for i in range(3):
                markers[m, i] += share * (points[m, i] - markers[m, i])
        else:
            own = state.misfit[m]
            for i in range(3):
                for k in range(3):
                    markers[m, i] += state.pose.frames[j, i, k] * state.left[m, k]
        variance = 3.0 * own
        for i in range(3):
            variance += covariances[m, i, i]
            covariances[m, i, i] += own
        valid[m] = variance < 3.0 * chain.settings.usable_sigma**2
    return Followed(markers, velocities, covariances, seen, valid, doubted)


@compiled_entry
def misfit_of(chain: Chain, state: State, points: Array, seen: NDArray[np.bool_], noise: Array) -> float:
    """How badly a pose explains points (M, 3): squares of residuals and displacements from rest, by deviations."""
    pose, _ = kinematics(chain, state.offsets, state.pose)
    markers = on_segments(chain, pose, state.places)
    total, weights = 0.0, np.empty((3, 3))
    for m in range(len(markers)):
        if seen[m] and len(noise) > 0:
            for i in range(3):
                for k in range(3):
                    weights[i, k] = noise[m, i, k]
            precision_of(weights, state.place_variance[m])
            total += squared_distance(weights, points[m] - markers[m])
        elif seen[m]:
            square = 0.0
            for i in range(3):
                square += (points[m, i] - markers[m, i]) ** 2
            total += square / (chain.settings.marker_sigma**2 + state.place_variance[m])
    for d in range(len(chain.kind)):
        if chain.kind[d] == 2:
            total += chain.stiffness[d] * (pose.angles[d] - chain.rest[d]) ** 2
    return total
