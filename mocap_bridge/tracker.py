"""A Kalman filter over all markers of a set at once, which carries hidden markers along with the visible ones.

State: position and velocity of every marker. The accelerations that drive it are those of a body: turns of the segments
about their joints and shifts of the trunk, so that a hidden hand follows from a visible forearm. Distances on and
across segments, learned while they are seen, hold hidden markers in place (extended Kalman update). A measurement far
outside its predicted covariance is not believed (innovation gate), and points without a believed label are taken up
where exactly one prediction fits. Kalman 1960; gating and association: Bar-Shalom, Li & Kirubarajan 2001, ch. 3.
"""

from __future__ import annotations

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

_potrf, _trtrs = get_lapack_funcs(("potrf", "trtrs"), (np.zeros((1, 1)),))


class Tracker:
    """Follows every marker of a set; one call a frame, at a cost that does not depend on what happened before."""

    def __init__(self, marker_set: MarkerSet, rate_hz: float = 120.0):
        """Args: ``rate_hz`` is the nominal rate, used where two frames have the same time stamp."""
        self._set = marker_set
        self._period = 1.0 / rate_hz
        self._modes = MotionModes(marker_set)
        self._noise = MARKER_SIGMA**2 * np.eye(3 * len(marker_set))
        self._names: tuple[str, ...] | None = None
        self._columns = np.zeros(0, dtype=np.intp)
        self.reset()

    def reset(self) -> None:
        """Forgets everything that was seen."""
        count = len(self._set)
        self._position, self._velocity = np.zeros(3 * count), np.zeros(3 * count)
        # Covariance of the positions, of positions with velocities, and of the velocities.
        self._place, self._cross, self._speed = np.eye(3 * count), np.zeros((3 * count, 3 * count)), np.eye(3 * count)
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
        points, believed = self._take_up(frame, points, labelled, believed)
        self._disbelieved = np.where(labelled & ~believed & self._known, self._disbelieved + elapsed, 0.0)
        appearing = labelled & ~believed & (~self._known | (self._disbelieved > _RESET_S))
        self._measure(points, np.flatnonzero(believed))
        self._hold(np.flatnonzero(self._known & ~believed & ~appearing))
        self._appear(points, appearing)
        seen = believed | appearing
        self._last_seen[seen] = frame.source_time_ns
        self._frames += 1
        if self._frames % _LEARN_EVERY == 1:
            self._distances.learn(points, seen)
        return self._output(seen, rejected, frame)

    def _arranged(self, frame: MarkerFrame) -> tuple[Array, NDArray[np.bool_]]:
        """Positions (M, 3) and validity (M,) in the order of the set; columns are looked up by name."""
        if frame.names is not self._names and frame.names != self._names:
            self._columns = self._set.match(frame.names)
        self._names = frame.names
        there = self._columns >= 0
        points = frame.positions[self._columns]
        return points, there & frame.valid[self._columns] & np.isfinite(points).all(axis=1)

    def _elapsed(self, time_ns: int) -> float:
        before, self._time_ns = self._time_ns, time_ns
        if before is None:
            return self._period
        elapsed = (time_ns - before) * 1e-9
        if elapsed > 1.0 or elapsed < -1.0:
            self.reset()
            self._time_ns = time_ns
        return elapsed if 0.0 < elapsed <= 1.0 else self._period

    def _predict(self, dt: float) -> None:
        power = self._modes.power(self._position.reshape(-1, 3))
        # No one keeps a speed for long: what is not seen comes to rest.
        keep = float(np.exp(-dt / COASTING_S))
        shift = dt * self._cross
        self._place += shift + shift.T + dt * dt * self._speed + (dt**3 / 3.0) * power
        self._cross = keep * (self._cross + dt * self._speed + (dt * dt / 2.0) * power)
        self._speed = (keep * keep) * (self._speed + dt * power)
        self._position += dt * self._velocity
        self._velocity *= keep

    def _blocks(self) -> Array:
        """Covariance (M, 3, 3) of each marker's position."""
        count = len(self._set)
        return np.einsum("aiaj->aij", self._place.reshape(count, 3, count, 3))

    def _gate(self, points: Array, labelled: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], int]:
        """Which labelled points (M,) are believed, and how many known markers' points are not."""
        hidden_s = np.where(self._last_seen >= 0, (self._time_ns or 0) - self._last_seen, 0) * 1e-9
        slack = MARKER_SIGMA**2 + (DRIFT * np.maximum(hidden_s - self._period, 0.0)) ** 2
        self._inverse = np.linalg.inv(self._blocks() + slack[:, None, None] * np.eye(3))
        innovation = points - self._position.reshape(-1, 3)
        distance = np.einsum("mi,mij,mj->m", innovation, self._inverse, innovation)
        believed = labelled & self._known & (distance < GATE)
        return believed, int((labelled & self._known & ~believed).sum())

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
        distance = np.einsum("wli,wij,wlj->wl", gap, self._inverse[wanting], gap)
        fits = (distance < TAKE_UP_GATE) & (np.linalg.norm(gap, axis=-1) < _REACH)
        alone = fits & (fits.sum(axis=0) == 1)[None] & (fits.sum(axis=1) == 1)[:, None]
        points, believed = points.copy(), believed.copy()
        for row, point in np.argwhere(alone):
            points[wanting[row]] = loose[point]
            believed[wanting[row]] = True
        return points, believed

    def _measure(self, points: Array, markers: NDArray[np.intp]) -> None:
        if len(markers) == len(self._set):
            self._correct(self._place + self._noise, self._place, self._cross, points.reshape(-1) - self._position)
        elif len(markers):
            rows = (3 * markers[:, None] + np.arange(3)).reshape(-1)
            place = self._place[rows]
            noise = place[:, rows] + self._noise[: len(rows), : len(rows)]
            self._correct(noise, place, self._cross[rows], points[markers].reshape(-1) - self._position[rows])

    def _hold(self, hidden: NDArray[np.intp]) -> None:
        """Keeps hidden markers at the learned distances from their neighbours, one marker at a time."""
        for marker in hidden:
            near, distance, sigma = self._distances.of(int(marker))
            points = self._distances.weights[near]
            known = points[:, ~self._known].sum(axis=1) == 0.0
            points, distance, sigma = points[known], distance[known], sigma[known]
            if not len(points):
                continue
            between = -points
            between[:, marker] += 1.0
            gap = between @ self._position.reshape(-1, 3)
            length = np.linalg.norm(gap, axis=1)
            direction = gap / np.maximum(length, 1e-6)[:, None]
            slopes = between[:, :, None] * direction[:, None, :]
            slopes = slopes.reshape(len(points), -1)
            place = slopes @ self._place
            noise = place @ slopes.T + np.diag(sigma**2)
            # A distance that is far off says that the pose is not what was learned, not that the marker jumped.
            most = 3.0 * np.sqrt(np.diag(noise))
            self._correct(noise, place, slopes @ self._cross, np.clip(distance - length, -most, most))

    def _correct(self, noise: Array, place: Array, speed: Array, innovation: Array) -> None:
        """Kalman update.

        Args:
            noise: (k, k) covariance of the innovation.
            place, speed: (k, 3 M) covariance of the measured quantities with positions and with velocities.
            innovation: (k,) measured minus predicted.
        """
        factor, failed = _potrf(noise, lower=1)
        if failed:  # only if rounding has spoilt the covariance: start anew rather than go on wrongly
            self.reset()
            return
        n = place.shape[1]
        whitened, _ = _trtrs(factor, np.column_stack([place, speed, innovation]), lower=1)
        by_place, by_speed, residual = whitened[:, :n], whitened[:, n:-1], whitened[:, -1]
        self._position += residual @ by_place
        self._velocity += residual @ by_speed
        self._place -= by_place.T @ by_place
        self._cross -= by_place.T @ by_speed
        self._speed -= by_speed.T @ by_speed

    def _appear(self, points: Array, markers: NDArray[np.bool_]) -> None:
        """(Re)starts markers where they are measured."""
        for marker in np.flatnonzero(markers):
            own = slice(3 * marker, 3 * marker + 3)
            for covariance in (self._place, self._cross, self._speed):
                covariance[own, :] = 0.0
                covariance[:, own] = 0.0
            self._place[own, own] = MARKER_SIGMA**2 * np.eye(3)
            self._speed[own, own] = _START_SPEED**2 * np.eye(3)
            self._position[own], self._velocity[own] = points[marker], 0.0
            self._known[marker] = True
            self._disbelieved[marker] = 0.0

    def _output(self, seen: NDArray[np.bool_], rejected: int, frame: MarkerFrame) -> TrackedMarkers:
        covariances = self._blocks().copy()
        variance = np.einsum("mii->m", covariances) / 3.0
        return TrackedMarkers(
            names=self._set.names,
            positions=self._position.reshape(-1, 3).copy(),
            velocities=self._velocity.reshape(-1, 3).copy(),
            covariances=covariances,
            seen=seen,
            age_ns=np.where(self._last_seen >= 0, frame.source_time_ns - self._last_seen, np.iinfo(np.int64).max),
            valid=self._known & (variance < USABLE_SIGMA**2),
            rejected=rejected,
            time_ns=frame.source_time_ns,
        )
