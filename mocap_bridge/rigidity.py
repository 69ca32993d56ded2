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

_PERSISTENCE = 100.0  # frames for which a learned distance is off in the same way
_WRIST_TWIST = 0.03  # a hand turns about the forearm's axis with the forearm, hardly against it
_NEIGHBOURS = 6  # points whose distance to a hidden marker is used
_MEMORY = 100  # learned frames over which distances are averaged
_OWN_SIGMA, _NEXT_SIGMA = 0.0015, 0.02  # m; how constant a distance is on one segment and across a joint


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
        names = list(segments)
        self._wrists = [
            (names.index(name), names.index(segment.parent))
            for name, segment in segments.items()
            if name.endswith("_wrist") and segment.parent is not None
        ]
        self._skin = SKIN_POWER * np.eye(3 * len(marker_set))
        self._skin += TRUNK_POWER * np.kron(np.ones((len(marker_set), len(marker_set))), np.eye(3))
        self._turn = np.sqrt(JOINT_POWER)

    def power(self, positions: Array) -> Array:
        """Power (3 M, 3 M), m²/s³, of the markers' accelerations in a pose (M, 3)."""
        centres = self._weight @ positions
        lever = (positions[None] - centres[:, None]) * self._beyond[..., None] * self._turn
        joints, count = self._beyond.shape
        modes = np.zeros((count, 3, joints, 3))  # d position / d angle: a × lever for a = x, y, z
        x, y, z = lever[..., 0].T, lever[..., 1].T, lever[..., 2].T
        modes[:, 1, :, 0], modes[:, 2, :, 0] = -z, y
        modes[:, 0, :, 1], modes[:, 2, :, 1] = z, -x
        modes[:, 0, :, 2], modes[:, 1, :, 2] = -y, x
        for wrist, elbow in self._wrists:
            along = centres[wrist] - centres[elbow]
            twist = np.outer(along, along) / max(float(along @ along), 1e-9)
            modes[:, :, wrist] -= (1.0 - _WRIST_TWIST) * modes[:, :, wrist] @ twist
        modes = modes.reshape(3 * count, 3 * joints)
        return modes @ modes.T + self._skin


class Distances:
    """Distances of markers on one segment or on neighbouring ones, learned while they are seen.

    Beside the markers themselves stand the centres of elbow and wrist, as the mean of the markers that the arm recipe
    names: a centre belongs to both of its segments, so that a hand keeps its distance from it however the wrist bends.

    Attributes:
        weights: (K, M), each point as a weighted mean of the markers; the first M are the markers.
    """

    def __init__(self, marker_set: MarkerSet):
        """Nothing is known yet but which points could keep their distance."""
        segments, count = marker_set.segments, len(marker_set)
        belongs = [{joint} for joint in marker_set.joints]
        rows = list(np.eye(count))
        for names, joint in ((marker_set.arm.elbow, "right_elbow"), (marker_set.arm.wrist, "right_wrist")):
            if len(names) > 1 and joint in segments:
                rows.append(np.isin(np.arange(count), marker_set.indices(names)) / len(names))
                belongs.append({joint, segments[joint].parent or joint})
        self.weights: Array = np.array(rows)
        self._sigma = np.full((count, len(rows)), np.inf)
        for m, joint in enumerate(marker_set.joints):
            for k, owners in enumerate(belongs):
                if self.weights[k, m]:
                    continue
                if joint in owners:
                    self._sigma[m, k] = _OWN_SIGMA
                elif any(segments[joint].parent == o or segments[o].parent == joint for o in owners):
                    self._sigma[m, k] = _NEXT_SIGMA
        self._first, self._second = np.nonzero(np.isfinite(self._sigma))
        self._mean, self._square, self._seen = (np.zeros(self._sigma.shape) for _ in range(3))

    def learn(self, positions: Array, seen: NDArray[np.bool_]) -> None:
        """Takes in a frame's measured positions (M, 3) where ``seen`` (M,)."""
        there = (self.weights > 0.0) @ ~seen == 0
        points = self.weights @ positions
        a, b = self._first, self._second
        both = seen[a] & there[b]
        a, b = a[both], b[both]
        distance = np.linalg.norm(positions[a] - points[b], axis=-1)
        count = np.minimum(self._seen[a, b] + 1.0, _MEMORY)
        self._seen[a, b] = count
        self._mean[a, b] += (distance - self._mean[a, b]) / count
        self._square[a, b] += (distance**2 - self._square[a, b]) / count

    def of(self, marker: int) -> tuple[NDArray[np.intp], Array, Array]:
        """Points (K,) near a marker, their distance (K,) and its standard deviation (K,), m; the steadiest ones."""
        mean, square = self._mean[marker], self._square[marker]
        own = np.where(self._seen[marker] >= 10, self._sigma[marker], np.inf)
        # A distance that is off stays off for the whole gap: its errors do not average out from frame to frame.
        spread = np.sqrt(_PERSISTENCE * np.maximum(square - mean**2, 0.0) + own**2)
        best = np.argsort(spread)[:_NEIGHBOURS]
        best = best[np.isfinite(spread[best]) & (mean[best] > 0.01)]
        return best, mean[best], spread[best]
