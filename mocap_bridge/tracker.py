"""A Kalman filter over all markers of a set at once, which carries hidden markers along with the visible ones.

State: position and velocity of every marker. The accelerations that drive it are those of a body: turns of the segments
about their joints and shifts of the trunk, so that a hidden hand follows from a visible forearm. Distances on and
across segments, learned while they are seen, hold hidden markers in place (extended Kalman update). A measurement far
outside its predicted covariance is not believed (innovation gate), and points without a believed label are taken up
where exactly one prediction fits. Kalman 1960; gating and association: Bar-Shalom, Li & Kirubarajan 2001, ch. 3.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs

from mocap_bridge.frames import MarkerFrame, TrackedMarkers
from mocap_bridge.marker_sets import MarkerSet
from mocap_bridge.rigidity import Distances, MotionModes
from model.rotations import Array

MARKER_SIGMA = 0.0012
"""Standard deviation of a measured marker, m."""

GATE = 25.0
"""Squared Mahalanobis distance, three degrees of freedom, beyond which a point is not believed (15 in a million)."""

TAKE_UP_GATE = 11.3
"""The same within which a point without a label may be taken for a marker (1 in 100 missed)."""

DRIFT = 0.15
"""How much further off a marker may reappear than its covariance says, m per second hidden: no model is right."""

COASTING_S = 0.2
"""Time in which the speed of a hidden marker falls to a third, s."""

USABLE_SIGMA = 0.06
"""An estimate is valid up to this standard deviation a coordinate, m."""

_RESET_S = 0.25  # a marker that was not believed for so long is believed: the tracker, not the system, must be wrong
_START_SPEED = 1.5  # m/s, standard deviation of the speed of a marker that appears
_LEARN_EVERY = 4  # frames; distances change slowly
_REACH = 0.10  # m; a point without a label is never taken up from further off

_ONES = np.ones(3)

_potrf, _trtrs = get_lapack_funcs(("potrf", "trtrs"), (np.zeros((1, 1)),))


class Tracker:
    """Follows every marker of a set; one call a frame, at a cost that does not depend on what happened before."""

    def __init__(self, marker_set: MarkerSet, rate_hz: float = 120.0):
        """Args: ``rate_hz`` is the nominal rate, used where two frames have the same time stamp."""
        self._set = marker_set
        self._period = 1.0 / rate_hz
        self._modes = MotionModes(marker_set)
        count = len(marker_set)
        row = 3 * np.arange(count)[:, None, None] + np.arange(3)[:, None]
        self._own = row * 3 * count + np.swapaxes(row, 1, 2)  # where each marker's covariance (M, 3, 3) lies
        self._names: tuple[str, ...] | None = None
        self._columns, self._there = np.zeros(0, dtype=np.intp), np.zeros(0, dtype=bool)
        self.reset()

    def reset(self) -> None:
        """Forgets everything that was seen."""
        count = len(self._set)
        self._state = np.zeros(6 * count)  # positions, then velocities
        # Covariance of the positions, of velocities (rows) with positions, of the velocities; acceleration's power.
        self._terms, self._spare = np.zeros((4, 3 * count, 3 * count)), np.zeros((4, 3 * count, 3 * count))
        self._terms[0] = self._terms[2] = np.eye(3 * count)
        self._known = np.zeros(count, dtype=bool)  # seen at least once
        self._last_seen = np.full(count, -1, dtype=np.int64)
        self._disbelieved = np.zeros(count)  # s, for how long measurements were rejected
        self._time_ns: int | None = None
        self._frames = 0
        self._distances = Distances(self._set)

    def update(self, frame: MarkerFrame) -> TrackedMarkers:
        """Takes in a frame and returns the state of all markers at its time.

        Time stamps that do not advance count as one period; a pause of more than a second starts anew.
        """
        points, labelled = self._arranged(frame)
        elapsed = self._elapsed(frame.source_time_ns)
        self._predict(elapsed)
        believed, rejected = self._gate(points, labelled)
        if believed.all():
            self._disbelieved[:] = 0.0
            self._measure(points, None)
            seen = believed
        else:
            points, seen = self._take_in_part(frame, points, labelled, believed, elapsed)
        self._last_seen[seen] = frame.source_time_ns
        self._frames += 1
        if self._frames % _LEARN_EVERY == 1:
            self._distances.learn(points, seen)
        return self._output(seen, rejected, frame)

    def _take_in_part(
        self,
        frame: MarkerFrame,
        points: Array,
        labelled: NDArray[np.bool_],
        believed: NDArray[np.bool_],
        elapsed: float,
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Takes in a frame of which not all is believed: its points as used (M, 3), and which were seen (M,)."""
        points, believed = self._take_up(frame, points, labelled, believed)
        self._disbelieved = np.where(labelled & ~believed & self._known, self._disbelieved + elapsed, 0.0)
        appearing = labelled & ~believed & (~self._known | (self._disbelieved > _RESET_S))
        self._measure(points, np.flatnonzero(believed))
        self._hold(np.flatnonzero(self._known & ~believed & ~appearing))
        self._appear(points, appearing)
        return points, believed | appearing

    def _arranged(self, frame: MarkerFrame) -> tuple[Array, NDArray[np.bool_]]:
        """Positions (M, 3) and validity (M,) in the order of the set; columns are looked up by name."""
        if frame.names is not self._names and frame.names != self._names:
            self._columns = self._set.match(frame.names)
            self._there = self._columns >= 0
        self._names = frame.names
        points = frame.positions.take(self._columns, axis=0, mode="wrap")
        labelled = self._there & frame.valid.take(self._columns, mode="wrap")
        if not math.isfinite(points.sum()):  # one test for all is quicker, and mostly enough
            labelled &= np.isfinite(points).all(axis=1)
        return points, labelled

    def _elapsed(self, time_ns: int) -> float:
        before, self._time_ns = self._time_ns, time_ns
        if before is None:
            return self._period
        elapsed = (time_ns - before) * 1e-9
        if elapsed > 1.0 or elapsed < -1.0:
            self.reset()
            self._time_ns = time_ns
        return elapsed if 0.0 < elapsed <= 1.0 else self._period

    @property
    def _position(self) -> Array:
        return self._state[: 3 * len(self._set)]

    def _predict(self, dt: float) -> None:
        count = 3 * len(self._set)
        old, new = self._terms, self._spare
        self._modes.power(self._position.reshape(-1, 3), out=old[3])
        # No one keeps a speed for long: what is not seen comes to rest.
        keep = math.exp(-dt / COASTING_S)
        step = np.array(
            [
                [1.0, dt, dt * dt, dt**3 / 3.0],
                [0.0, keep, keep * dt, keep * dt * dt / 2.0],
                [0.0, 0.0, keep * keep, keep * keep * dt],
            ]
        )
        np.matmul(step, old.reshape(4, -1), out=new[:3].reshape(3, -1))
        new[0] += (dt * old[1]).T
        self._terms, self._spare = new, old
        self._state[:count] += dt * self._state[count:]
        self._state[count:] *= keep

    def _gate(self, points: Array, labelled: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], int]:
        """Which labelled points (M,) are believed, and how many known markers' points are not."""
        innovation = points - self._position.reshape(-1, 3)
        candidates = labelled & self._known
        # No variance is below the measurement's own, so that what is this near lies inside the gate.
        believed = candidates & ((innovation * innovation) @ _ONES < GATE * MARKER_SIGMA**2)
        if believed.all():
            return believed, 0
        doubtful = np.flatnonzero(candidates & ~believed)
        if not len(doubtful):
            return believed, 0
        gap = innovation[doubtful]
        inside = np.einsum("mi,mij,mj->m", gap, self._precision(doubtful), gap) < GATE
        believed[doubtful] = inside
        return believed, len(doubtful) - int(inside.sum())

    def _precision(self, markers: NDArray[np.intp]) -> Array:
        """Inverse covariance (k, 3, 3) of where some markers may be measured."""
        hidden_s = np.where(self._last_seen >= 0, (self._time_ns or 0) - self._last_seen, 0)[markers] * 1e-9
        slack = MARKER_SIGMA**2 + (DRIFT * np.maximum(hidden_s - self._period, 0.0)) ** 2
        return np.linalg.inv(self._terms[0].reshape(-1)[self._own[markers]] + slack[:, None, None] * np.eye(3))

    def _take_up(
        self, frame: MarkerFrame, points: Array, labelled: NDArray[np.bool_], believed: NDArray[np.bool_]
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Gives points without a believed label to hidden markers, where marker and point fit each other and no other.

        Points whose label was not believed count too: that undoes two labels that were swapped.
        """
        wanting = np.flatnonzero(self._known & ~believed)
        if not len(wanting):
            return points, believed
        loose = np.concatenate([points[labelled & ~believed], frame.unlabelled.reshape(-1, 3)])
        if not len(loose):
            return points, believed
        gap = loose[None] - self._position.reshape(-1, 3)[wanting][:, None]
        distance = np.einsum("wli,wij,wlj->wl", gap, self._precision(wanting), gap)
        fits = (distance < TAKE_UP_GATE) & (np.linalg.norm(gap, axis=-1) < _REACH)
        alone = fits & (fits.sum(axis=0) == 1)[None] & (fits.sum(axis=1) == 1)[:, None]
        points, believed = points.copy(), believed.copy()
        for row, point in np.argwhere(alone):
            points[wanting[row]] = loose[point]
            believed[wanting[row]] = True
        return points, believed

    def _measure(self, points: Array, markers: NDArray[np.intp] | None) -> None:
        """Takes in the points (M, 3) of some markers, or of all (None)."""
        with_state = self._terms[:2].reshape(-1, 3 * len(self._set))
        innovation = points.reshape(-1) - self._position
        if markers is None:
            noise = self._terms[0].copy()
        elif len(markers):
            rows = (3 * markers[:, None] + np.arange(3)).reshape(-1)
            with_state, innovation = with_state.take(rows, axis=1), innovation[rows]
            noise = with_state.take(rows, axis=0)
        else:
            return
        noise.reshape(-1)[:: len(noise) + 1] += MARKER_SIGMA**2
        self._correct(noise, with_state, innovation)

    def _hold(self, hidden: NDArray[np.intp]) -> None:
        """Keeps hidden markers at the learned distances from their neighbours, one marker at a time."""
        all_known = self._known.all()
        for marker in hidden.tolist():
            near, distance, sigma = self._distances.of(marker)
            points = self._distances.weights[near]
            if not all_known:
                known = points[:, ~self._known].sum(axis=1) == 0.0
                points, distance, sigma = points[known], distance[known], sigma[known]
            if not len(points):
                continue
            between = -points
            between[:, marker] += 1.0
            gap = between @ self._position.reshape(-1, 3)
            length = np.sqrt(np.einsum("ki,ki->k", gap, gap))
            direction = gap / np.maximum(length, 1e-6)[:, None]
            slopes = (between[:, :, None] * direction[:, None, :]).reshape(len(points), -1)
            with_state = self._terms[:2].reshape(-1, slopes.shape[1]) @ slopes.T
            noise = slopes @ with_state[: slopes.shape[1]]
            variance = noise.reshape(-1)[:: len(noise) + 1]
            variance += sigma**2
            # A distance that is far off says that the pose is not what was learned, not that the marker jumped.
            most = 3.0 * np.sqrt(variance)
            self._correct(noise, with_state, np.minimum(np.maximum(distance - length, -most), most))

    def _correct(self, noise: Array, with_state: Array, innovation: Array) -> None:
        """Kalman update.

        Args:
            noise: (k, k) covariance of the innovation; overwritten.
            with_state: (6 M, k) covariance of positions and velocities with the measured quantities.
            innovation: (k,) measured minus predicted.
        """
        # Transposed, because LAPACK's arrays are stored column by column: nothing has to be copied but the result.
        factor, failed = _potrf(noise.T, lower=1, clean=0, overwrite_a=1)
        if failed:  # only if rounding has spoilt the covariance: start anew rather than go on wrongly
            self.reset()
            return
        whitened = _trtrs(factor, with_state.T, lower=1)[0].T
        residual = _trtrs(factor, innovation, lower=1)[0]
        count = len(self._terms[0])
        by_place, by_speed = whitened[:count], whitened[count:]
        self._state += whitened @ residual
        self._terms[0] -= by_place @ by_place.T
        self._terms[1] -= by_speed @ by_place.T
        self._terms[2] -= by_speed @ by_speed.T

    def _appear(self, points: Array, markers: NDArray[np.bool_]) -> None:
        """(Re)starts markers where they are measured."""
        for marker in np.flatnonzero(markers):
            own = slice(3 * marker, 3 * marker + 3)
            self._terms[:3, own, :] = 0.0
            self._terms[:3, :, own] = 0.0
            self._terms[0, own, own] = MARKER_SIGMA**2 * np.eye(3)
            self._terms[2, own, own] = _START_SPEED**2 * np.eye(3)
            self._state.reshape(2, -1)[:, own] = points[marker], np.zeros(3)
            self._known[marker] = True
            self._disbelieved[marker] = 0.0

    def _output(self, seen: NDArray[np.bool_], rejected: int, frame: MarkerFrame) -> TrackedMarkers:
        covariances = self._terms[0].reshape(-1).take(self._own)
        variances = self._terms[0].reshape(-1)[:: len(self._terms[0]) + 1]
        age_ns = frame.source_time_ns - self._last_seen
        age_ns[self._last_seen < 0] = np.iinfo(np.int64).max
        positions, velocities = self._state.copy().reshape(2, -1, 3)
        return TrackedMarkers(
            names=self._set.names,
            positions=positions,
            velocities=velocities,
            covariances=covariances,
            seen=seen,
            age_ns=age_ns,
            valid=self._known & (variances.reshape(-1, 3) @ _ONES < 3.0 * USABLE_SIGMA**2),
            rejected=rejected,
            time_ns=frame.source_time_ns,
        )
