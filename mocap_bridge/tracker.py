"""Follows the skeleton of a person through labelled markers, most of the time some of them hidden.

The state is the pose of the marker set's segments with its speeds (:mod:`mocap_bridge.pose_filter`): one visible marker
of the forearm still says where the hand is. A measurement far outside its predicted covariance is not believed
(innovation gate), and points without a believed label are taken up where exactly one prediction fits. Kalman 1960;
gating and association: Bar-Shalom, Li & Kirubarajan 2001, ch. 3.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mocap_bridge.chain import make_chain, segment_order
from mocap_bridge.first_pose import first_state, standing
from mocap_bridge.frames import MarkerFrame, TrackedMarkers
from mocap_bridge.joint_angles import ArmAngles, arm_angles_of, arm_segments
from mocap_bridge.marker_sets import MarkerSet
from mocap_bridge.pose_filter import NEVER, State, followed, kinematics, on_segments
from model.rotations import Array

LONGEST_NS = 1_000_000_000
"""After a longer pause the tracker begins anew."""

LOST_FRAMES = 4
"""After so many frames in a row of which most is not believed, the tracker begins anew: it must be wrong itself."""


class Tracker:
    """Follows every marker of a set; one call a frame, at a cost that does not depend on what happened before."""

    def __init__(self, marker_set: MarkerSet, rate_hz: float = 120.0):
        """Args: ``rate_hz`` is the nominal rate, used where two frames have the same time stamp."""
        self._set = marker_set
        self._period_ns = round(1e9 / rate_hz)
        self._chain = make_chain(marker_set)
        order = segment_order(marker_set)
        lifting = [
            self._chain.first[j] for j, name in enumerate(order)
            if name.endswith("shoulder") and self._chain.parents[j] >= 0
        ]  # fmt: skip
        self._order, self._segments = tuple(order), arm_segments(order)
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

    def reset(self) -> None:
        """Forgets everything that was seen."""
        self._state: State | None = None
        self._time_ns: int | None = None

    def update(self, frame: MarkerFrame) -> TrackedMarkers:
        """Takes in a frame and returns the state of all markers at its time.

        Time stamps that do not advance count as one period; a pause of more than a second starts anew.
        """
        points, labelled = self._arranged(frame)
        elapsed = self._elapsed(frame.source_time_ns)
        if self._state is None:
            self._state = first_state(self._chain, self._shoulders, points, labelled)
        if self._state is None:
            return self._nothing(frame)
        self._state, found, worked = followed(self._chain, self._state, points, labelled, frame.unlabelled, elapsed)
        if not worked or self._state.astray > LOST_FRAMES:
            self.reset()  # the covariance is spoilt by rounding, or the tracker is wrong: start anew
            return self.update(frame) if worked else self._nothing(frame)
        return TrackedMarkers(
            names=self._set.names,
            positions=found.positions,
            velocities=found.velocities,
            covariances=found.covariances,
            seen=found.seen,
            age_ns=self._state.ages,
            valid=found.valid,
            rejected=found.rejected,
            time_ns=frame.source_time_ns,
        )

    @property
    def arm_angles(self) -> ArmAngles | None:
        """Angles of the right arm after the last frame; None before the first pose, or without the arm's segments."""
        if self._state is None or self._segments is None:
            return None
        return arm_angles_of(self._chain, self._state, self._segments)

    @property
    def pose(self) -> tuple[tuple[str, ...], Array, Array] | None:
        """The set's J segments after the last frame: names, joint centres (J, 3), m, and frames (J, 3, 3) in the world.

        A parent stands before its children. None before the first pose.
        """
        if self._state is None:
            return None
        return self._order, self._state.pose.centres, self._state.pose.frames

    def _arranged(self, frame: MarkerFrame) -> tuple[Array, NDArray[np.bool_]]:
        """Positions (M, 3) and validity (M,) in the order of the set; columns are looked up by name."""
        if frame.names is not self._names and frame.names != self._names:
            self._columns = self._set.match(frame.names)
            self._there = self._columns >= 0
        self._names = frame.names
        points = frame.positions.take(self._columns, axis=0, mode="wrap")
        labelled = self._there & frame.valid.take(self._columns, mode="wrap")
        if not math.isfinite(points.sum()):  # one test for all is quicker, and mostly enough
            finite = np.asarray(np.isfinite(points).all(axis=1))
            points, labelled = np.where(finite[:, None], points, 0.0), labelled & finite
        return points, labelled

    def _elapsed(self, time_ns: int) -> int:
        before, self._time_ns = self._time_ns, time_ns
        if before is None:
            return self._period_ns
        elapsed = time_ns - before
        if abs(elapsed) > LONGEST_NS:
            self.reset()
            self._time_ns = time_ns
        return elapsed if 0 < elapsed <= LONGEST_NS else self._period_ns

    def _nothing(self, frame: MarkerFrame) -> TrackedMarkers:
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
            rejected=0,
            time_ns=frame.source_time_ns,
        )
