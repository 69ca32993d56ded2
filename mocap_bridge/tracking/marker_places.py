"""Where markers sit on their segments, followed beside the pose by a small filter of its own for each marker.

A marker whose frame says how far its point is off, and in which direction, is followed with a gain that is a matrix;
where all are measured alike the gain is a number.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.tracking.chain_kinematics import Chain
from highfive.mocap_bridge.tracking.pose_filter import State, with_places
from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry.rotations import Array
from highfive.model.linear_algebra import precision_of, squared_distance


@compiled_entry
def settled(chain: Chain, state: State, points: Array, seen: NDArray[np.bool_], noise: Array, seconds: float) -> State:
    """The state after the markers' places on their segments have followed what was seen.

    Args:
        chain: the skeleton.
        state: after the pose was corrected.
        points: (M, 3) m.
        seen: (M,).
        noise: (M, 3, 3) m², covariance of the points; without rows all have the settings'.
        seconds: since the frame before.
    """
    places, place_variance, misfit, left = (
        state.places.copy(),
        state.place_variance.copy(),
        state.misfit.copy(),
        state.left.copy(),
    )
    share = min(seconds / chain.settings.misfit_s, 1.0)
    beside = np.empty(3)
    for m in range(len(places)):
        if not seen[m]:
            continue
        j = chain.carrier[m]
        if len(noise) > 0:
            _settle(chain, state, m, points[m], noise[m], seconds, places, place_variance, misfit, left)
            continue
        gain = place_variance[m] / (place_variance[m] + chain.settings.marker_sigma**2 + misfit[m])
        # A turn of a segment and a shift of all its markers look alike. In the long run it is the turn: markers wander
        # about their homes, at most as far as they lie apart from person to person.
        homing = seconds * chain.settings.slip**2 / chain.spreads[m] ** 2
        square = 0.0
        for i in range(3):
            local = 0.0
            for k in range(3):
                local += state.pose.frames[j, k, i] * (points[m, k] - state.pose.centres[j, k])
            beside[i] = local - places[m, i]
            places[m, i] += gain * beside[i] + homing * (state.homes[m, i] - places[m, i])
            left[m, i] = (1.0 - gain) * beside[i]
            square += left[m, i] * left[m, i] / 3.0
        place_variance[m] *= 1.0 - gain
        misfit[m] += share * (max(square - chain.settings.marker_sigma**2, 0.0) - misfit[m])
        misfit[m] = min(misfit[m], chain.settings.largest_misfit**2)
    return with_places(state, places, place_variance, misfit, left)


@compiled
def _settle(
    chain: Chain, state: State, m: int, point: Array, noise: Array, seconds: float, places: Array,
    place_variance: Array, misfit: Array, left: Array,
) -> None:  # fmt: skip
    """The same for one marker whose point (3,) has a covariance ``noise`` (3, 3) of its own, written into the arrays.

    The misfit is what the squares of the residuals exceed the noise by, each direction weighed by how surely it was
    measured: a distance from the camera that is known to 10 cm says nothing about millimetres of skin.
    """
    j = chain.carrier[m]
    frame = np.ascontiguousarray(state.pose.frames[j])
    local = frame.T @ noise @ frame
    beside = frame.T @ (point - state.pose.centres[j]) - places[m]
    weights = local.copy()
    precision_of(weights, place_variance[m] + misfit[m])
    homing = seconds * chain.settings.slip**2 / chain.spreads[m] ** 2
    followed = place_variance[m] * (weights @ beside)
    for i in range(3):
        left[m, i] = beside[i] - followed[i]
        places[m, i] += followed[i] + homing * (state.homes[m, i] - places[m, i])
    place_variance[m] *= 1.0 - place_variance[m] * (weights[0, 0] + weights[1, 1] + weights[2, 2]) / 3.0
    precision_of(local, 0.0)
    excess = (squared_distance(local, left[m]) - 3.0) / (local[0, 0] + local[1, 1] + local[2, 2])
    misfit[m] += min(seconds / chain.settings.misfit_s, 1.0) * (max(excess, 0.0) - misfit[m])
    misfit[m] = min(misfit[m], chain.settings.largest_misfit**2)
