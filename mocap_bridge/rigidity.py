"""What the tracker knows of the body: which markers move together, and how far apart they stay."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mocap_bridge.marker_sets import MarkerSet
from model.rotations import Array

# Power of the white accelerations that drive the motion: angular of every joint (rad²/s³), of the body as a whole and
# of each marker on its skin (m²/s³). An arm that is raised fast reaches 300 rad/s² for about 0.1 s.
JOINT_POWER = 10_000.0
TRUNK_POWER = 10.0
SKIN_POWER = 0.1

_NEIGHBOURS = 5  # markers whose distance to a hidden one is used
_MEMORY = 100  # learned frames over which distances are averaged
_OWN_SIGMA, _NEXT_SIGMA = 0.0015, 0.005  # m; how constant a distance is on one segment and across a joint


class MotionModes:
    """The directions in which the markers of a set move together: the segments' turning and the trunk's shift.

    Each joint turns all markers beyond it about its centre, which is taken to lie at the mean of the markers next to
    it: an error of some centimetres changes the modes little.
    """

    def __init__(self, marker_set: MarkerSet):
        """Prepares the modes of ``marker_set``."""
        segments = marker_set.segments
        zero = np.array([segments[j].centre for j in marker_set.joints]) + marker_set.local_positions
        centres = np.array([segment.centre for segment in segments.values()])
        self._beyond = np.zeros((len(segments), len(marker_set)))
        for m, joint in enumerate(marker_set.joints):
            at: str | None = joint
            while at is not None:
                self._beyond[list(segments).index(at), m] = 1.0
                at = segments[at].parent
        # The centre as a mean of the markers nearest to it, which moves with them.
        distance = np.linalg.norm(centres[:, None] - zero[None], axis=-1)
        weight = np.exp(-distance / 0.05 + (distance / 0.05).min(axis=1, keepdims=True))
        self._weight = weight / weight.sum(axis=1, keepdims=True)
        self._skin = SKIN_POWER * np.eye(3 * len(marker_set))
        self._skin += TRUNK_POWER * np.kron(np.ones((len(marker_set), len(marker_set))), np.eye(3))
        self._turn = np.sqrt(JOINT_POWER)

    def power(self, positions: Array) -> Array:
        """Power (3 M, 3 M), m²/s³, of the markers' accelerations in a pose (M, 3)."""
        lever = (positions[None] - (self._weight @ positions)[:, None]) * self._beyond[..., None] * self._turn
        joints, count = self._beyond.shape
        modes = np.zeros((count, 3, joints, 3))  # d position / d angle: a × lever for a = x, y, z
        x, y, z = lever[..., 0].T, lever[..., 1].T, lever[..., 2].T
        modes[:, 1, :, 0], modes[:, 2, :, 0] = -z, y
        modes[:, 0, :, 1], modes[:, 2, :, 1] = z, -x
        modes[:, 0, :, 2], modes[:, 1, :, 2] = -y, x
        modes = modes.reshape(3 * count, 3 * joints)
        return modes @ modes.T + self._skin


class Distances:
    """Distances between markers of one segment or of neighbouring ones, learned while both are seen."""

    def __init__(self, marker_set: MarkerSet):
        """Nothing is known yet but which markers could keep their distance."""
        joints, segments = marker_set.joints, marker_set.segments
        count = len(marker_set)
        sigma = np.full((count, count), np.inf)
        for a in range(count):
            for b in range(count):
                if a != b and joints[a] == joints[b]:
                    sigma[a, b] = _OWN_SIGMA
                elif joints[a] != joints[b] and joints[b] in (segments[joints[a]].parent,):
                    sigma[a, b] = sigma[b, a] = _NEXT_SIGMA
        self._sigma = sigma
        self._first, self._second = np.nonzero(np.triu(np.isfinite(sigma)))
        self._mean, self._square = np.zeros((count, count)), np.zeros((count, count))
        self._seen = np.zeros((count, count))

    def learn(self, positions: Array, seen: NDArray[np.bool_]) -> None:
        """Takes in a frame's measured positions (M, 3) where ``seen`` (M,)."""
        a, b = self._first, self._second
        both = seen[a] & seen[b]
        if not both.all():
            a, b = a[both], b[both]
        gap = positions[a] - positions[b]
        distance = np.sqrt(np.einsum("pi,pi->p", gap, gap))
        count = np.minimum(self._seen[a, b] + 1.0, _MEMORY)
        self._seen[a, b] = count
        self._mean[a, b] += (distance - self._mean[a, b]) / count
        self._square[a, b] += (distance**2 - self._square[a, b]) / count

    def of(self, marker: int) -> tuple[NDArray[np.intp], Array, Array]:
        """Neighbours (K,) of a marker, their distance (K,) and its standard deviation (K,), m; the steadiest ones."""
        mean = np.maximum(self._mean[marker], self._mean[:, marker])
        square = np.maximum(self._square[marker], self._square[:, marker])
        known = np.maximum(self._seen[marker], self._seen[:, marker]) >= 10
        spread = np.sqrt(np.maximum(square - mean**2, 0.0) + np.where(known, self._sigma[marker], np.inf) ** 2)
        best = np.argsort(spread)[:_NEIGHBOURS]
        best = best[np.isfinite(spread[best]) & (mean[best] > 0.01)]
        return best, mean[best], spread[best]
