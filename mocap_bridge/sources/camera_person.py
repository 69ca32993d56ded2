"""One person before a webcam, picture by picture: landmarks in, frames of joint centres with their covariance out."""

from __future__ import annotations

import math

import numpy as np

from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.camera_filter import (
    COUNT,
    CameraState,
    corrected,
    first_camera_state,
    hidden,
    predicted,
    stated,
)
from highfive.mocap_bridge.sources.camera_look import Look, in_mirror, look
from highfive.mocap_bridge.sources.camera_settings import (
    HEAD,
    HEAD_UP,
    LEFT_SHOULDER,
    MARKERS,
    NECK_ABOVE,
    SHOULDER,
    Camera,
    CameraSettings,
)
from highfive.mocap_bridge.wire.landmarks import Landmarks
from highfive.model.geometry.rotations import Array

TO_ROOM = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""From the camera's axes (right, down, away) to those of a room that it looks into: away, left, up. It looks level."""


def looking_up(degrees: float) -> Array:
    """(3, 3): from the axes of a camera that looks up by so much to those of one that looks level."""
    angle = math.radians(degrees)
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])


_SETTLED = 20
"""Pictures from which the camera's height is found: she stands, and her head is where heads of her height are."""
_OPEN = Camera(1.0, np.zeros(2))
_NEW = 0.1  # s, between the first picture and one that there was not


class CameraPerson:
    """Follows a person; begins anew when she was not seen for a while.

    Attributes:
        look: what the newest picture said; None where nobody was in it.
        camera_in_room: (3,) m, where the camera is in the room of the frames: over the origin, and it looks along +x.
    """

    def __init__(self, settings: CameraSettings | None = None, *, left: bool = False) -> None:
        """Of a person and a camera as the settings say; who gives the ``left`` hand is followed in a mirror."""
        self.settings, self._left = settings or CameraSettings(), left
        self.look: Look | None = None
        self._camera = _OPEN
        self._state: CameraState | None = None
        self._time_ms = -np.inf
        self._ages_s, self._across = np.zeros(COUNT), np.array(self.settings.across)
        self._heights: list[float] = []

    @property
    def camera_in_room(self) -> Array:
        """(3,) m; on the floor as long as nobody was seen."""
        return np.array([0.0, 0.0, float(np.median(self._heights)) if self._heights else 0.0])

    def take(self, found: Landmarks) -> MarkerFrame:
        """The frame of a picture. Joints that it, and those shortly before, do not show are not valid."""
        found = in_mirror(found) if self._left else found
        self._camera = Camera.of(found.size, self.settings.field_of_view)
        seconds = 1e-3 * (found.captured_ms - self._time_ms)
        if not 0.0 < seconds < self.settings.lost_s:
            self._state, seconds = None, _NEW  # the first, or one after a pause, or of another clock
        self._time_ms = found.captured_ms
        if self._state is not None:
            self._state = predicted(self._state, seconds, self.settings)
        expected = None if self._state is None else self._camera.pixels(self._state.points)
        self.look = look(found, self._camera, self.settings, expected)
        self._follow(seconds)
        return self._frame(found)

    def _follow(self, seconds: float) -> None:
        seen, settings = self.look, self.settings
        if seen is None:
            self._ages_s += seconds
            if self._ages_s.min() > settings.lost_s:
                self._state = None
            return
        if self._state is None:
            self._state = first_camera_state(seen, self._camera, settings)
            self._ages_s[:] = np.inf
        if self._state is None:
            return
        self._state = corrected(self._state, seen, seconds, self._camera, settings)
        self._ages_s = np.where(seen.seen, 0.0, self._ages_s + seconds)
        self._across = np.where(seen.seen, seen.across, self._across)
        if not np.isfinite(self._state.mean).all():
            self._state = None
        elif len(self._heights) < _SETTLED:
            self._heights.append(HEAD_UP * settings.height + float(self._state.points[HEAD, 1]))

    def _frame(self, found: Landmarks) -> MarkerFrame:
        count = len(MARKERS)
        points, covariance = np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1))
        valid = np.zeros(count, dtype=bool)
        if self._state is not None:
            points[:COUNT] = self._state.points
            covariance[:COUNT] = stated(self._state, self._across, self.settings)
            valid[:COUNT] = ~hidden(self._ages_s, self.settings)
            points[COUNT], covariance[COUNT] = self._neck(points, covariance)
            valid[COUNT] = valid[[SHOULDER, LEFT_SHOULDER, HEAD]].all()
        room = points @ TO_ROOM.T + np.where(valid[:, None], self.camera_in_room, 0.0)
        captured_ns = round(1e6 * found.captured_ms)
        return MarkerFrame(
            MARKERS,
            np.where(valid[:, None], room, 0.0),
            valid,
            found.number,
            captured_ns,
            captured_ns + round(1e6 * found.took_ms),
            np.zeros((0, 3)),
            covariance=TO_ROOM @ covariance @ TO_ROOM.T,
            own_clock=True,  # the page knows the host's
        )

    def _neck(self, points: Array, covariance: Array) -> tuple[Array, Array]:
        """Over the shoulders' middle towards the head: neither net shows it."""
        middle = 0.5 * (points[SHOULDER] + points[LEFT_SHOULDER])
        up = points[HEAD] - middle
        length = max(float(np.linalg.norm(up)), 1e-6)
        own = 0.5 * (covariance[SHOULDER] + covariance[LEFT_SHOULDER])
        return middle + NECK_ABOVE * self.settings.height * up / length, own
