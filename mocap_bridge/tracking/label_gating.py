"""Which measurements are believed to be of the marker that they are labelled as, and whose an unlabelled point is."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.tracking.filter_settings import NEVER, FilterSettings
from highfive.mocap_bridge.tracking.pose_filter import State
from highfive.model.compiled import compiled
from highfive.model.geometry.rotations import Array
from highfive.model.linear_algebra import determinant, squared_distance


@compiled
def believed(
    settings: FilterSettings,
    state: State,
    markers: Array,
    precisions: Array,
    slides: Array,
    points: Array,
    labelled: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Which labelled points (M, 3) of known markers are believed.

    Far outside its expected place a point is not, unless it is near where the marker would be if it sat on its segment
    as in the last frame, ``slides`` (M, 3), or goes on as it went: skin slides and models err, but labels jump.
    """
    seen, gap = np.zeros(len(markers), dtype=np.bool_), np.empty(3)
    for m in range(len(markers)):
        if not labelled[m] or state.ages[m] == NEVER:
            continue
        slid, went = 0.0, 0.0
        paced = math.isfinite(state.pace[m, 0])
        for i in range(3):
            gap[i] = points[m, i] - markers[m, i]
            slid += (points[m, i] - slides[m, i]) ** 2
            went += (points[m, i] - state.last[m, i] - (state.pace[m, i] if paced else 0.0)) ** 2
        far = 0.0 if state.ages[m] > 0 else settings.slide if paced else settings.first_step
        seen[m] = slid < settings.slide**2 or went < far**2 or squared_distance(precisions[m], gap) < settings.gate
    return seen


@compiled
def taken_up(
    settings: FilterSettings, state: State, markers: Array, precisions: Array, points: Array,
    loose: Array, seen: NDArray[np.bool_],
    doubted: NDArray[np.bool_], noise: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """Gives loose points (U, 3), and labelled ones that are ``doubted`` (M,), to markers that are not ``seen`` (M,).

    Only where point and marker fit each other and no other. Returns the points as used (M, 3), with their noise, of
    which there are M or no rows; marks markers as seen. A point takes the noise of its label along; where it has no
    label, it has the settings'.
    """
    count, used, gap = len(markers), points.copy(), np.empty(3)
    noises = noise.copy()
    owner = np.full(count + len(loose), -1)  # the marker that a point fits: -1 for none, -2 for several
    choice = np.full(count, -1)  # the point that fits a marker, likewise
    for p in range(len(owner)):
        if p < count and not doubted[p]:
            continue
        point = points[p] if p < count else loose[p - count]
        for m in range(count):
            if seen[m] or state.ages[m] == NEVER:
                continue
            square = 0.0
            for i in range(3):
                gap[i] = point[i] - markers[m, i]
                square += gap[i] * gap[i]
            away = squared_distance(precisions[m], gap)
            # Odds that it is the marker and not one of the ghosts in the space where the marker may be.
            odds = (
                settings.taken
                * math.sqrt(determinant(precisions[m]))
                * math.exp(-0.5 * away)
                / (settings.ghosts * 15.75)
            )
            if square < settings.reach * settings.reach and away < settings.take_up_gate and odds > 1.0:
                owner[p] = m if owner[p] == -1 else -2
                choice[m] = p if choice[m] == -1 else -2
    for m in range(count):
        p = choice[m]
        if p >= 0 and owner[p] == m:
            used[m] = points[p] if p < count else loose[p - count]
            seen[m] = True
            if len(noise) > 0:
                for i in range(3):
                    for k in range(3):
                        noises[m, i, k] = noise[p, i, k] if p < count else 0.0
                    noises[m, i, i] = noise[p, i, i] if p < count else settings.marker_sigma**2
    return used, noises
