"""The tracker's beginning: a pose of the chain, and the body's size, from one frame."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.tracking.chain_kinematics import HINGE, SHIFT, Chain, Pose, kinematics, on_segments
from highfive.mocap_bridge.tracking.filter_settings import ALIKE, NEVER
from highfive.mocap_bridge.tracking.following import misfit_of
from highfive.mocap_bridge.tracking.marker_places import settled
from highfive.mocap_bridge.tracking.pose_filter import State, consider_covariance, corrected, expected
from highfive.model.geometry.rotations import Array

HEADINGS = np.radians([0.0, 90.0, 180.0, 270.0])
SIZES = (1.0, 0.92, 1.08, 0.85, 1.15)
"""Sizes of the body that are tried, relative to the one for which the marker set was written."""

ENOUGH = 4
"""Markers that a frame must show to begin with."""

OVERSTRETCHED = 0.3
"""No elbow bends backwards so far, rad."""

_BENDS = (0.0, -1.0, -2.0)  # rad, of the shoulders' first hinge beyond rest: arms hanging, forward, up
_SHIFT_SIGMA, _TURN_SIGMA = 1.0, 10.0  # m and rad, of a guess: it is where to begin, not what is known
_SPEEDS = (0.7, 3.0)  # m/s and rad/s, standard deviation of a speed that is not known
_ROUNDS, _SMALL = 30, 1e-6


def first_state(
    chain: Chain, shoulders: NDArray[np.intp], points: Array, seen: NDArray[np.bool_], noise: Array = ALIKE
) -> State | None:
    """The state that explains one frame best, from several guesses; None where the frame shows too little.

    Args:
        chain: the skeleton.
        shoulders: freedoms that lift the arms.
        points: (M, 3) m.
        seen: (M,).
        noise: (M, 3, 3) m², covariance of the points; without rows all have the settings'.
    """
    if seen.sum() < ENOUGH:
        return None
    lifting = np.zeros(len(chain.rest))
    lifting[shoulders] = 1.0
    guesses = [(heading, chain.rest + bend * lifting) for heading, bend in itertools.product(HEADINGS, _BENDS)]
    tried = [_fitted(chain, points, seen, noise, *guess, SIZES[0]) for guess in guesses]
    best = int(np.argmin([cost for _, cost in tried]))
    tried = [tried[best]] + [_fitted(chain, points, seen, noise, *guesses[best], size) for size in SIZES[1:]]
    state, cost = min(tried, key=lambda found: found[1])
    if not math.isfinite(cost):
        return None
    other = turned_back(chain, shoulders, state.pose.angles)
    if other is not None:
        size = float(np.linalg.norm(state.offsets) / np.linalg.norm(chain.offsets))
        headings = [_fitted(chain, points, seen, noise, heading, other, size) for heading in HEADINGS]
        found, worse = min(headings, key=lambda one: one[1])
        if math.isfinite(worse) and turned_back(chain, shoulders, found.pose.angles) is None:
            state = found
    return settled(chain, state, points, seen, noise, 0.0)


def turned_back(chain: Chain, shoulders: NDArray[np.intp], angles: Array) -> Array | None:
    """The hinges (n,), rad, with every elbow that bends the wrong way turned about; None where none does.

    An upper arm turned half about its length, an elbow that bends backwards and a forearm turned half back leave the
    hand where it is: without markers on the upper arm, only anatomy tells the two apart.
    """
    turned, changed = angles.copy(), False
    for shoulder in shoulders:
        for elbow in chain.first[chain.parents == chain.joint[shoulder]]:
            if chain.kind[elbow : elbow + 3].tolist() == [HINGE] * 3 and angles[elbow] > OVERSTRETCHED:
                turned[elbow : elbow + 2] *= -1.0
                for turn in (shoulder + 2, elbow + 2):
                    turned[turn] -= math.copysign(math.pi, angles[turn])
                changed = True
    return turned if changed else None


def welcomed(chain: Chain, state: State, points: Array, seen: NDArray[np.bool_], noise: Array = ALIKE) -> State:
    """The state after markers have come that were never seen before; where they are may be far from where they were
    expected.

    What moves them is fitted to this frame together with the markers beside them, as in the beginning: until now it was
    guessed, or known by few markers, whose places on the body are not known well.

    Args:
        chain: the skeleton.
        state: before the frame.
        points: (M, 3) m.
        seen: (M,) markers to go by, new ones and others.
        noise: (M, 3, 3) m², covariance of the points; without rows all have the settings'.
    """
    n = len(chain.kind)
    wide = state._replace(
        covariance=state.covariance + np.stack([consider_covariance(chain, state), *np.zeros((2, n, n))])
    )
    markers, covariances, _ = expected(chain, wide)
    gap = points - markers
    precisions = np.linalg.inv(covariances + (noise if len(noise) else chain.settings.marker_sigma**2 * np.eye(3)))
    away = np.einsum("mi,mij,mj->m", gap, precisions, gap)
    seen = seen & ((state.ages != NEVER) | (away < chain.settings.gate))  # the first sight may be of something else
    new = seen & (state.ages == NEVER)
    if not new.any():
        return state
    moving = np.zeros(len(chain.kind), dtype=bool)
    for carrier in np.unique(chain.carrier[new]):
        moving[chain.path[carrier, : chain.lengths[carrier]]] = True
    moving &= chain.kind == HINGE
    beside = np.array([moving[chain.path[j, : chain.lengths[j]]].any() for j in chain.carrier])
    covariance = state.covariance.copy()
    covariance[0] += np.where(np.outer(moving, moving), consider_covariance(chain, state), 0.0)
    fresh = state._replace(
        covariance=covariance,
        place_variance=np.where(beside, np.maximum(state.place_variance, chain.spreads**2), state.place_variance),
        ages=np.where(new, 0, state.ages),
        last=np.where(new[:, None], points, state.last),
    )
    found, worked = corrected(chain, fresh, points, seen, noise, np.zeros(len(seen)), 0.0, _ROUNDS, _SMALL)
    if not worked or not np.isfinite(found.pose.centres).all():
        return state
    return settled(chain, found, points, seen, noise, 0.0)


def standing(chain: Chain, heading: float = 0.0, angles: Array | None = None, size: float = 1.0) -> Pose:
    """The chain upright on the floor with the hinges at ``angles`` (n,), by default at rest; heading and angles in rad.

    Centres of segments that are not free are left to
    :func:`highfive.mocap_bridge.tracking.chain_kinematics.kinematics`.
    """
    cosine, sine = np.cos(heading), np.sin(heading)
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    frames = np.tile(turn, (len(chain.parents), 1, 1))
    return Pose(size * chain.offsets @ turn.T, frames, np.array(chain.rest if angles is None else angles))


def _fitted(
    chain: Chain, points: Array, seen: NDArray[np.bool_], noise: Array, heading: float, angles: Array, size: float
) -> tuple[State, float]:
    """The pose found from one guess, and how badly it explains the frame."""
    n, markers = len(chain.kind), len(chain.carrier)
    offsets, places = size * chain.offsets, size * chain.places
    pose, _ = kinematics(chain, offsets, standing(chain, heading, angles, size))
    away = (points - on_segments(chain, pose, places))[seen].mean(axis=0)
    pose = Pose(pose.centres + away, pose.frames, pose.angles)
    variance = np.where(chain.kind == SHIFT, _SHIFT_SIGMA, _TURN_SIGMA) ** 2
    speed = np.where(chain.kind == SHIFT, _SPEEDS[0], _SPEEDS[1]) ** 2
    covariance = np.stack([np.diag(variance), np.zeros((n, n)), np.diag(speed)])
    none, ages, later = np.zeros(markers), np.where(seen, 0, NEVER), np.zeros(markers, dtype=np.int64)
    state = State(
        pose, np.zeros(n), covariance, offsets, places, places, chain.spreads**2, none, np.zeros((markers, 3)),
        ages, later, points, np.full((markers, 3), np.nan), 0,
    )  # fmt: skip
    state, worked = corrected(chain, state, points, seen, noise, none, chain.settings.pull_s, _ROUNDS, _SMALL)
    if not worked or not np.isfinite(state.pose.centres).all():
        return state, math.inf
    return state, misfit_of(chain, state, points, seen, noise)
