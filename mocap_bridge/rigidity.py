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
        beyond = np.zeros((len(segments), len(marker_set)), dtype=bool)
        for m, joint in enumerate(marker_set.joints):
            at: str | None = joint
            while at is not None:
                beyond[list(segments).index(at), m] = True
                at = segments[at].parent
        # The centre as a mean of the markers nearest to it, which moves with them.
        distance = np.linalg.norm(centres[:, None] - zero[None], axis=-1)
        weight = np.exp(-distance / 0.05 + (distance / 0.05).min(axis=1, keepdims=True))
        weight /= weight.sum(axis=1, keepdims=True)
        names = list(segments)
        self._wrists = [
            (names.index(name), weight[names.index(name)] - weight[names.index(segment.parent)])
            for name, segment in segments.items()
            if name.endswith("_wrist") and segment.parent is not None
        ]
        self._prepare_levers(beyond, weight)

    def _prepare_levers(self, beyond: NDArray[np.bool_], weight: Array) -> None:
        """Makes of a pose (M, 3) to the modes one product and one look-up.

        Args:
            beyond: (J, M), the marker moves when the joint turns.
            weight: (J, M), each joint's centre as a weighted mean of the markers.
        """
        joints, count = beyond.shape
        joint, marker = np.nonzero(beyond)
        lever = np.sqrt(JOINT_POWER) * (np.eye(count)[marker] - weight[joint])
        self._to_levers = np.concatenate([lever, -lever])
        # Two numbers that do not depend on the pose: 0, and the shift of the trunk, which has three modes of its own.
        self._levers = np.zeros((2 * len(lever) + 1, 3))
        self._levers[-1, 1] = np.sqrt(TRUNK_POWER)
        x = 3 * np.arange(len(lever))
        y, z, opposite, nothing = x + 1, x + 2, 3 * len(lever), 6 * len(lever)
        entries = np.full((count, 3, joints + 1, 3), nothing)  # d position / d angle: a × lever for a = x, y, z
        entries[marker, 1, joint, 0], entries[marker, 2, joint, 0] = z + opposite, y
        entries[marker, 0, joint, 1], entries[marker, 2, joint, 1] = z, x + opposite
        entries[marker, 0, joint, 2], entries[marker, 1, joint, 2] = y + opposite, x
        for axis in range(3):
            entries[:, axis, joints, axis] = nothing + 1
        self._entries = entries.reshape(3 * count, 3 * joints + 3)

    def power(self, positions: Array, out: Array | None = None) -> Array:
        """Power (3 M, 3 M), m²/s³, of the markers' accelerations in a pose (M, 3), written to ``out`` if given."""
        np.matmul(self._to_levers, positions, out=self._levers[:-1])
        modes = self._levers.reshape(-1).take(self._entries)
        for wrist, forearm in self._wrists:
            along = forearm @ positions
            turn = modes[:, 3 * wrist : 3 * wrist + 3]
            share = (1.0 - _WRIST_TWIST) / max(float(along @ along), 1e-9)
            turn -= (turn @ along)[:, None] * (share * along)
        power = np.matmul(modes, modes.T, out=out)
        power.reshape(-1)[:: len(power) + 1] += SKIN_POWER
        return power


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
        sigma = np.full((count, len(rows)), np.inf)
        for m, joint in enumerate(marker_set.joints):
            for k, owners in enumerate(belongs):
                if self.weights[k, m]:
                    continue
                if joint in owners:
                    sigma[m, k] = _OWN_SIGMA
                elif any(segments[joint].parent == o or segments[o].parent == joint for o in owners):
                    sigma[m, k] = _NEXT_SIGMA
        # Pairs of a marker and a point, sorted by marker.
        self._marker, self._point = np.nonzero(np.isfinite(sigma))
        self._variance = sigma[self._marker, self._point] ** 2
        self._first = np.searchsorted(self._marker, np.arange(count + 1)).tolist()
        self._needs = self.weights > 0.0
        self._mean, self._square, self._seen = (np.zeros(len(self._marker)) for _ in range(3))

    def learn(self, positions: Array, seen: NDArray[np.bool_]) -> None:
        """Takes in a frame's measured positions (M, 3) where ``seen`` (M,)."""
        gap = positions.take(self._marker, axis=0) - (self.weights @ positions).take(self._point, axis=0)
        square = np.einsum("pi,pi->p", gap, gap)
        count = np.minimum(self._seen + 1.0, _MEMORY)
        share = 1.0 / count
        if not seen.all():
            there = ~(self._needs @ ~seen)
            both = seen[self._marker] & there[self._point]
            count, share = np.where(both, count, self._seen), np.where(both, share, 0.0)
        self._seen = count
        self._mean += (np.sqrt(square) - self._mean) * share
        self._square += (square - self._square) * share

    def of(self, marker: int) -> tuple[NDArray[np.intp], Array, Array]:
        """Points (K,) near a marker, their distance (K,) and its standard deviation (K,), m; the steadiest ones."""
        pairs = slice(self._first[marker], self._first[marker + 1])
        mean = self._mean[pairs]
        # A distance that is off stays off for the whole gap: its errors do not average out from frame to frame.
        variance = _PERSISTENCE * np.maximum(self._square[pairs] - mean * mean, 0.0) + self._variance[pairs]
        variance[self._seen[pairs] < 10] = np.inf
        best = variance.argsort()[:_NEIGHBOURS]
        best = best[(variance[best] < np.inf) & (mean[best] > 0.01)]
        return self._point[pairs][best], mean[best], np.sqrt(variance[best])
