"""The right arm of whoever is seen live, for the screen: angles and hand, where a marker set fits."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from highfive.mocap_bridge.frames import HumanArm, MarkerFrame
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.markers.recognise import find_marker_set
from highfive.mocap_bridge.sources.scheduler import THREADS, Scheduler
from highfive.mocap_bridge.tracking.human_arm import HumanArmEstimator
from highfive.mocap_bridge.tracking.tracker import Tracker
from highfive.model.compiled import when_compiling
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array


@dataclass(frozen=True)
class ArmView:
    """What is shown of an arm.

    Attributes:
        elbow_flexion: rad, 0 with a straight arm.
        shoulder_elevation: rad, of the upper arm from hanging straight down.
        hand: (3,) m, centre of the palm.
        valid: it rests on usable markers.
        rejected: labels in the frame that were not believed.
    """

    elbow_flexion: float
    shoulder_elevation: float
    hand: Array
    valid: bool
    rejected: tuple[str, ...]


def arm_view(arm: HumanArm, rejected: tuple[str, ...] = ()) -> ArmView:
    """Angles from the joint centres; the world's z axis is up."""
    upper, fore = arm.elbow - arm.shoulder, arm.wrist - arm.elbow
    lifted = _angle(upper, np.array([0.0, 0.0, -1.0]))
    return ArmView(_angle(upper, fore), lifted, arm.palm.position, arm.valid, rejected)


def _angle(one: Array, other: Array) -> float:
    """Angle between two vectors, rad."""
    return math.atan2(float(np.linalg.norm(np.cross(one, other))), float(one @ other))


def choose_marker_set(labels: Sequence[str], requested: str | None) -> MarkerSet | None:
    """The set that was requested, or the shipped one that fits; None where none does.

    Raises:
        HighFiveError: the set that was requested does not exist, or needs markers that are not there.
    """
    if requested is None:
        try:
            return find_marker_set(labels)
        except HighFiveError:
            return None
    marker_set = load_marker_set(requested)
    nothing = np.zeros((len(labels), 3)), np.zeros(len(labels), dtype=bool)
    marker_set.arrange(labels, *nothing, required=marker_set.arm.markers)
    return marker_set


def arm_follower(marker_set: MarkerSet, rate_hz: float) -> Callable[[MarkerFrame], ArmView]:
    """What gives the arm, frame by frame. The one place where the tracker is used."""
    tracker, estimator = Tracker(marker_set, rate_hz), HumanArmEstimator(marker_set)

    def follow(frame: MarkerFrame) -> ArmView:
        tracked = tracker.update(frame)
        rejected = tuple(name for name, no in zip(tracked.names, tracked.rejected.tolist(), strict=True) if no)
        return arm_view(estimator(tracked), rejected)

    return follow


def prepare_tracker(say: Callable[[str], None]) -> None:
    """Has the tracker loaded; a line says so where it has to be compiled first."""
    with when_compiling(lambda: say("compiling the tracker, once after installing: this takes a minute or two")):
        Tracker(load_marker_set("paper"), 120.0)


class ArmThread:
    """Follows the arm beside whoever receives, so that neither waits for the other."""

    def __init__(self, follow: Callable[[MarkerFrame], ArmView], scheduler: Scheduler = THREADS):
        """Args: ``follow`` gives the arm in a frame; ``scheduler`` starts the thread."""
        self._follow = follow
        self.newest: ArmView | None = None
        self.rejected = Counter[str]()  # frames so far in which a label was not believed
        self.trouble = ""
        self._changed = scheduler.condition()
        self._frame: MarkerFrame | None = None
        self._closing = False
        self._task = scheduler.start("arm", self._run)

    def offer(self, frame: MarkerFrame) -> None:
        """The newest frame; takes the place of one that was not looked at yet."""
        with self._changed:
            self._frame = frame
            self._changed.notify_all()

    def close(self) -> None:
        """Ends the thread."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._task.join(timeout=5.0)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closing or self._frame is not None)
                frame, self._frame = self._frame, None
            if self._closing or frame is None:
                return
            try:
                self.newest = self._follow(frame)
                self.rejected.update(self.newest.rejected)
            except HighFiveError as error:
                self.newest, self.trouble = None, str(error)
                return
