"""Follows the skeleton of a person through labelled markers, most of the time some of them hidden.

The state is the pose of the marker set's segments with its speeds (:mod:`highfive.mocap_bridge.tracking.pose_filter`):
one visible marker of the forearm still says where the hand is. A measurement far outside its predicted covariance is
not believed (innovation gate), and points without a believed label are taken up where exactly one prediction fits.
Kalman 1960; gating and association: Bar-Shalom, Li & Kirubarajan 2001, ch. 3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.frames import MarkerFrame, TrackedMarkers
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.tracking.arm_look import arm_model
from highfive.mocap_bridge.tracking.chain import make_chain, segment_order
from highfive.mocap_bridge.tracking.chain_kinematics import kinematics, on_segments
from highfive.mocap_bridge.tracking.filter_settings import ALIKE, NEVER, FilterSettings
from highfive.mocap_bridge.tracking.first_pose import first_state, standing, welcomed
from highfive.mocap_bridge.tracking.following import Followed, followed, forecast
from highfive.mocap_bridge.tracking.joint_angles import ArmAngles, arm_angles_of, arm_segments
from highfive.mocap_bridge.tracking.pose_filter import State
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class RestartSettings(Settings):
    """When the tracker begins anew. Chosen on simulated motion and a part of a real recording (CMU 85, 12).

    What swapped labels do with them: docs/decisions/2026-11-21-skeleton-tracker.md.
    """

    longest_ns: int = setting(1_000_000_000, "ns", above=0)
    """After a longer pause the tracker begins anew: a convention."""
    patience: float = setting(4.0, above=0.0)
    """Labels that the tracker does not believe must stay where they are for so many times as long as it agreed with all
    before it asks whether it is wrong itself."""
    shortest_patience_ns: int = setting(40_000_000, "ns", least=0)
    longest_patience_ns: int = setting(5_000_000_000, "ns", least=0)
    """Shortest and longest such time."""
    elsewhere: float = setting(0.03, "m", above=0.0)
    """A label this far from its marker is not believed."""
    explained: float = setting(16.0, above=0.0)
    """Squared distance, over the variance of a coordinate, up to which a point is where the marker may sit on
    somebody: four standard deviations."""
    better: float = setting(0.5, above=0.0, most=1.0)
    """A new beginning must explain a frame so much better than the pose that has been followed."""
    lost_frames: int = setting(4, least=1)
    """After so many frames in a row of which most is not believed, the tracker begins anew: it must be wrong itself."""


def passing(stated: Array, most: float) -> tuple[Array, Array]:
    """Of covariances (M, 3, 3), m², what passes from frame to frame, up to ``most``, m, in any direction; and the rest.

    Without rows, both have none.
    """
    if not len(stated):
        return ALIKE, ALIKE
    variances, axes = np.linalg.eigh(stated)
    if variances.max() <= most**2:
        return stated, ALIKE
    rest = (axes * np.maximum(variances - most**2, 0.0)[:, None, :]) @ axes.swapaxes(1, 2)
    return stated - rest, rest


class Tracker:
    """Follows every marker of a set; one call per frame, each at the same cost but for beginnings (milliseconds)."""

    def __init__(
        self,
        marker_set: MarkerSet,
        rate_hz: float = 120.0,
        settings: FilterSettings | None = None,
        restart: RestartSettings | None = None,
    ):
        """Prepares the filter and compiles it.

        Args:
            marker_set: the markers, and the segments that they sit on.
            rate_hz: the nominal rate, used where two frames have the same time stamp.
            settings: of the filter.
            restart: when it begins anew.
        """
        self._set = marker_set
        self._period_ns = round(1e9 / rate_hz)
        self._restart = restart or RestartSettings()
        self._chain = make_chain(marker_set, settings or FilterSettings())
        order = segment_order(marker_set)
        lifting = [
            self._chain.first[j] for j, name in enumerate(order)
            if name.endswith("shoulder") and self._chain.parents[j] >= 0
        ]  # fmt: skip
        self._order, segments = tuple(order), arm_segments(order)
        self._arm = None if segments is None else arm_model(self._chain, marker_set, order, segments)
        self._shoulders = np.array(lifting, dtype=np.intp)
        self._names: tuple[str, ...] | None = None
        self._columns, self._there = np.zeros(0, dtype=np.intp), np.zeros(0, dtype=bool)
        self._compile()
        self.reset()

    def _compile(self) -> None:
        """Calls once what will be called: nothing is left to compile when a person is there."""
        self.reset()
        upright, _ = kinematics(self._chain, self._chain.offsets, standing(self._chain))
        points = on_segments(self._chain, upright, self._chain.places)
        seen = np.ones(len(points), dtype=bool)
        for number in range(2):
            self.update(MarkerFrame(self._set.names, points, seen, number, number * self._period_ns, 0, points[:1]))
        _ = self.arm_angles
        self.at(2 * self._period_ns)

    def reset(self) -> None:
        """Forgets everything that was seen."""
        self._state: State | None = None
        self._found: Followed | None = None
        self._noise = self._lasting = ALIKE
        self._agreed_ns = self._reconsidered_ns = 0
        self._doubted_ns = np.zeros(len(self._set), dtype=np.int64)  # how long each label has been somewhere else
        self._time_ns: int | None = None

    def update(self, frame: MarkerFrame) -> TrackedMarkers:
        """Takes in a frame and returns the state of all markers at its time.

        Time stamps that do not advance count as one period; a pause of more than a second starts anew.
        """
        points, labelled, stated = self._arranged(frame)
        noise, lasting = passing(stated, self._chain.settings.passing)
        elapsed = self._elapsed(frame.source_time_ns)
        if self._state is not None:
            self._state = self._reconsidered(self._state, points, labelled, noise, elapsed)
        if self._state is None:
            self._state = first_state(self._chain, self._shoulders, points, labelled, noise)
        if self._state is None:
            return self._nothing(frame.source_time_ns)
        self._state, found, worked = followed(
            self._chain, self._state, points, labelled, noise, frame.unlabelled, elapsed
        )
        self._found, self._noise = found, noise
        self._lasting = lasting
        self._doubted_ns = self._doubts(points, labelled, found, elapsed)
        if not worked or self._state.astray > self._restart.lost_frames:
            self.reset()  # the covariance is spoilt by rounding, or the tracker is wrong: start anew
            return self.update(frame) if worked else self._nothing(frame.source_time_ns)
        return self._tracked(found, self._state.ages, frame.source_time_ns)

    def at(self, time_ns: int) -> TrackedMarkers:
        """The markers as they will be at a time after the last frame, if nothing is seen until then.

        What was learned stays as it is; a time that is not after the last frame counts as its own.
        """
        if self._state is None or self._time_ns is None:
            return self._nothing(time_ns)
        state, found = forecast(self._chain, self._state, max(time_ns - self._time_ns, 0))
        return self._tracked(found, state.ages, time_ns)

    def _tracked(self, found: Followed, ages: NDArray[np.int64], time_ns: int) -> TrackedMarkers:
        return TrackedMarkers(
            names=self._set.names,
            positions=found.positions,
            velocities=found.velocities,
            covariances=found.covariances + self._lasting if len(self._lasting) else found.covariances,
            seen=found.seen,
            age_ns=ages,
            valid=found.valid,
            rejected=found.rejected,
            time_ns=time_ns,
        )

    def _reconsidered(
        self, state: State, points: Array, labelled: NDArray[np.bool_], noise: Array, elapsed: int
    ) -> State:
        """The state before a frame, changed where the frame says that it was wrong or knew too little."""
        if np.count_nonzero(labelled & (state.ages == NEVER)):
            state = welcomed(self._chain, state, points, labelled & (state.disbelieved == 0), noise)
        doubted = int(self._doubted_ns.max(initial=0))
        if not doubted:
            self._agreed_ns += elapsed
            self._reconsidered_ns = 0
            return state
        restart = self._restart
        patience = round(restart.patience * self._agreed_ns)
        patience = min(max(patience, restart.shortest_patience_ns), restart.longest_patience_ns)
        if doubted < patience + self._reconsidered_ns:
            return state
        self._reconsidered_ns = doubted  # should it have been right, it is not reconsidered again at once
        fresh = first_state(self._chain, self._shoulders, points, labelled, noise)
        if fresh is None:
            return state
        followed_so_far = self._cost(state, points, labelled, noise)
        if self._cost(fresh, points, labelled, noise) > self._restart.better * followed_so_far:
            return state
        self._agreed_ns = self._reconsidered_ns = 0
        return fresh

    def _doubts(self, points: Array, labelled: NDArray[np.bool_], found: Followed, elapsed: int) -> NDArray[np.int64]:
        """For how long, ns, each label has been at a point that is not its marker's."""
        if not np.count_nonzero(found.rejected):
            return np.zeros_like(self._doubted_ns)
        away = labelled & (np.square(points - found.positions).sum(axis=1) > self._restart.elsewhere**2)
        return np.where(away, self._doubted_ns + elapsed, np.where(labelled, 0, self._doubted_ns))

    def _cost(self, state: State, points: Array, labelled: NDArray[np.bool_], noise: Array) -> float:
        """How far labelled points are from where the set has the markers, against how people differ; none counts beyond
        ``RestartSettings.explained``. Of a point's noise its least sure coordinate counts."""
        pose, _ = kinematics(self._chain, state.offsets, state.pose)
        away = np.square(points - on_segments(self._chain, pose, state.homes)).sum(axis=1)
        own = noise.diagonal(axis1=1, axis2=2).max(axis=1) if len(noise) else self._chain.settings.marker_sigma**2
        return float(np.minimum(away / (own + self._chain.spreads**2), self._restart.explained)[labelled].sum())

    @property
    def arm_angles(self) -> ArmAngles | None:
        """Angles of the right arm after the last frame; None before the first pose, or without the arm's segments."""
        if self._state is None or self._found is None or self._arm is None:
            return None
        return arm_angles_of(self._chain, self._arm, self._state, self._found.positions, self._found.seen, self._noise)

    @property
    def pose(self) -> tuple[tuple[str, ...], Array, Array] | None:
        """The set's J segments after the last frame: names, joint centres (J, 3), m, and frames (J, 3, 3) in the world.

        A parent stands before its children. None before the first pose.
        """
        if self._state is None:
            return None
        return self._order, self._state.pose.centres, self._state.pose.frames

    @property
    def skeleton_markers(self) -> Array | None:
        """Where the skeleton alone has the set's M markers after the last frame, (M, 3) m; None before the first pose.

        Each sits where it has been found to sit on its segment: skin that slides, and segments that are not rigid, show
        in the distance from here to where it was measured.
        """
        if self._state is None:
            return None
        return on_segments(self._chain, self._state.pose, self._state.places)

    def _arranged(self, frame: MarkerFrame) -> tuple[Array, NDArray[np.bool_], Array]:
        """Positions (M, 3), validity (M,) and noise (M, 3, 3), or no rows of it, in the order of the set.

        Columns are looked up by name.
        """
        if frame.names is not self._names and frame.names != self._names:
            self._columns = self._set.match(frame.names)
            self._there = self._columns >= 0
        self._names = frame.names
        if not len(frame.names):
            return np.zeros((len(self._set), 3)), np.zeros(len(self._set), dtype=bool), ALIKE
        points = frame.positions.take(self._columns, axis=0, mode="wrap")
        labelled = self._there & frame.valid.take(self._columns, mode="wrap")
        if not math.isfinite(points.sum()):  # one test for all is quicker, and mostly enough
            finite = np.asarray(np.isfinite(points).all(axis=1))
            points, labelled = np.where(finite[:, None], points, 0.0), labelled & finite
        if frame.covariance is None:
            return points, labelled, ALIKE
        noise = frame.covariance.take(self._columns, axis=0, mode="wrap")
        with np.errstate(invalid="ignore"):  # a noise that is none, and a point that has none, count for nothing
            labelled = labelled & (np.linalg.det(noise) > 0.0) & (noise.diagonal(axis1=1, axis2=2) > 0.0).all(axis=1)
        return (
            points,
            labelled,
            np.where(labelled[:, None, None], noise, self._chain.settings.marker_sigma**2 * np.eye(3)),
        )

    def _elapsed(self, time_ns: int) -> int:
        before, self._time_ns = self._time_ns, time_ns
        if before is None:
            return self._period_ns
        elapsed = time_ns - before
        if abs(elapsed) > self._restart.longest_ns:
            self.reset()
            self._time_ns = time_ns
        return elapsed if 0 < elapsed <= self._restart.longest_ns else self._period_ns

    def _nothing(self, time_ns: int) -> TrackedMarkers:
        """What is known before enough was seen."""
        count = len(self._set)
        none = np.zeros(count, dtype=bool)
        return TrackedMarkers(
            names=self._set.names,
            positions=np.zeros((count, 3)),
            velocities=np.zeros((count, 3)),
            covariances=np.tile(np.eye(3), (count, 1, 1)),
            seen=none,
            age_ns=np.full(count, NEVER),
            valid=none,
            rejected=none,
            time_ns=time_ns,
        )
