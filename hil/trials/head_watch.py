"""One head seen by two: a headset's messages beside a motion capture system's frames, on one clock."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

from highfive.calibration.head_tracks import body_track, check_head, eyes_track, head_markers
from highfive.calibration.headset_fit import HeadsetRegistration, Track, has_drifted, register_headset
from highfive.hil.session.reach import Phase
from highfive.hil.session.session import Tick
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.mocap_bridge.wire.errors import LinkError
from highfive.mocap_bridge.wire.headset import HeadsetPose, decode_headset
from highfive.model.geometry.rotations import Array

IN_TIME_MS = 1000.0
"""A message that holds for another time than so about now is not meant."""
WINDOW_S, EVERY_S = 3.0, 1.0
"""Over how long a drift is judged, and how often."""
MOST_A_LOOK = 32
"""Older messages than the newest so many have waited for too long to lie beside a frame that is still there."""
FEWEST = 60
"""Poses of either in that time without which nothing is said."""


class HeadWatch:
    """Keeps what both systems saw of the head, ``keep_s`` back at most.

    Attributes:
        poses: the headset's, with those in which it had lost its place.
        frames: of the system that came, with or without the head's markers.
    """

    def __init__(
        self,
        source: LiveSource,
        marker_set: MarkerSet,
        take: Callable[[float], Sequence[bytes]],
        now: Callable[[], int],
        keep_s: float = float("inf"),
        placed: Callable[[Array], Array] = lambda points: points,
    ) -> None:
        """Starts with nothing seen.

        Args:
            source: of the system's frames.
            marker_set: the person's.
            take: waits so many s at most for the page's messages.
            now: the clock of both, ns.
            keep_s: how far back is kept, s.
            placed: brings points (..., 3), m, from the system's frame to where the body is wanted.

        Raises:
            HighFiveError: the set has too few markers on the head.
        """
        self._source, self._set, self._take, self._now, self._keep_s = source, marker_set, take, now, keep_s
        self._placed = placed
        self._rows = head_markers(marker_set)
        self._before: MarkerFrame | None = None
        self.forget()

    def forget(self) -> None:
        """Begins anew."""
        self.poses = deque[HeadsetPose]()
        self.frames = deque[tuple[float, Array | None]]()

    def look(self, timeout_s: float = 0.0) -> None:
        """Takes in what has come; waits so long at most for a message."""
        for data in self._take(timeout_s)[-MOST_A_LOOK:]:
            try:
                pose = decode_headset(data)
            except LinkError:
                continue
            if abs(pose.holds_ms - 1e-6 * self._now()) < IN_TIME_MS:
                self.poses.append(pose)
        frame = self._source.newest(self._now())
        if frame is not None and frame is not self._before:
            self._before = frame
            points, seen = self._set.arrange(frame.names, frame.positions, frame.valid)
            time = 1e-9 * self._source.captured(frame)
            if not self.frames or time > self.frames[-1][0]:
                self.frames.append((time, points[self._rows] if seen[self._rows].all() else None))
        begin = 1e-9 * self._now() - self._keep_s
        while self.poses and 1e-3 * self.poses[0].holds_ms < begin:
            self.poses.popleft()
        while self.frames and self.frames[0][0] < begin:
            self.frames.popleft()

    def tracks(self) -> tuple[Track, Track]:
        """The eyes in the headset's space, and the head's body in the system's frame."""
        seen: list[HeadsetPose] = []
        for pose in self.poses:
            if pose.viewer_seen and (not seen or pose.holds_ms > seen[-1].holds_ms):
                seen.append(pose)
        shown = [(time, points) for time, points in self.frames if points is not None]
        times, points = [time for time, _ in shown], [self._placed(points) for _, points in shown]
        return eyes_track(seen), body_track(self._set, times, points)

    def registration(self) -> HeadsetRegistration:
        """Fitted to all that is kept.

        Raises:
            HighFiveError: that is too little, or shows too little motion.
        """
        shown = sum(points is not None for _, points in self.frames)
        check_head(list(self.poses), shown, len(self.frames))
        return register_headset(*self.tracks())


class DriftWatch:
    """Says once that a registration no longer holds, and again where it has held in between."""

    def __init__(
        self, head: HeadWatch, registration: HeadsetRegistration, now: Callable[[], int], say: Callable[[str], None]
    ) -> None:
        """Of a ``head`` of which :data:`WINDOW_S` are kept; ``say`` is given the line."""
        self._head, self._registration, self._now, self._say = head, registration, now, say
        self._judged_ns, self._off = now(), False

    def watch(self, tick: Tick) -> None:
        """Takes in what has come; judges it while no hand is reached for, once a second: that takes milliseconds."""
        self.look(judge=tick.target.phase is Phase.IDLE)

    def look(self, *, judge: bool = True) -> None:
        """Takes in what has come, and judges it if it may and it is time."""
        self._head.look()
        if not judge or self._now() - self._judged_ns < 1e9 * EVERY_S:
            return
        self._judged_ns = self._now()
        eyes, body = self._head.tracks()
        if min(len(eyes.times), len(body.times)) < FEWEST:
            return
        inside = (eyes.times > body.times[0] + 0.1) & (eyes.times < body.times[-1] - 0.1)
        if inside.sum() < FEWEST:
            return
        eyes = Track(eyes.times[inside], eyes.quaternions[inside], eyes.positions[inside])
        trouble = has_drifted(self._registration, eyes, body)
        if trouble and not self._off:
            self._say(f"{trouble} (highfive calibrate headset)")
        self._off = bool(trouble)
