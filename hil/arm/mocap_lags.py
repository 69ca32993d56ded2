"""How late a motion capture system shows a joint that its encoder tells of, and an arm that follows a marker.

Markers on the plate tell the angle of the joint that is moved: what of their motion goes the way that it turns them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from highfive.calibration.arm_file import ArmCalibration
from highfive.calibration.arm_kinematics import ArmShape, frames_of, joint_columns, marker_places, true_angles
from highfive.calibration.pose_check import calibrated
from highfive.calibration.servo_lag import ServoLag, servo_lag
from highfive.calibration.stream_delay import stream_delay
from highfive.hil.runtime.clock import Clock
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting

NS = 1e-9


@dataclass(frozen=True)
class MocapLagSettings(Settings):
    """When markers tell of a joint."""

    way: float = setting(0.01, "m", above=0.0)
    """Least standard deviation of a marker's way: noise of 0.5 mm is small beside it."""
    fewest: int = setting(3, least=1)
    """Joints that have to agree."""
    apart: float = setting(0.005, "s", above=0.0)
    """Most by which joints may differ in how late they are seen: beyond it a joint has play, or the stream changed.
    Each was up to 2 ms off where it is known (docs/calibration.md)."""


MOCAP_LAG = MocapLagSettings()


class Source(Protocol):
    """Frames, and when the cameras saw them: :class:`highfive.mocap_bridge.sources.live.LiveSource`."""

    def newest(self, now_ns: int) -> MarkerFrame | None:
        """The newest frame; None before the first."""
        ...

    def captured(self, frame: MarkerFrame) -> int:
        """When the cameras saw it, ns of this process's clock, as a session takes it."""
        ...


@dataclass
class SeenFrames:
    """Frames as they come, by the names of markers; each once. One owner, one thread.

    Attributes:
        source: of them.
        names: (M,) of the plate's markers, and of a wand's behind them.
        clock: of this process.
    """

    source: Source
    names: tuple[str, ...]
    clock: Clock
    _frames: list[MarkerFrame] = field(default_factory=list)
    _captured: list[int] = field(default_factory=list)

    def begin(self) -> None:
        """Forgets those before."""
        self._frames, self._captured = [], []

    def taken(self) -> SeenFrames:
        """What has come since it began, kept by itself."""
        return replace(self, _frames=list(self._frames), _captured=list(self._captured))

    def look(self) -> MarkerFrame | None:
        """The newest, if it is new."""
        frame = self.source.newest(self.clock.now())
        if frame is None or (self._frames and frame.number == self._frames[-1].number):
            return None
        self._frames.append(frame)
        self._captured.append(self.source.captured(frame))
        return frame

    @property
    def arrivals(self) -> NDArray[np.int64]:
        """(T,) ns, when they came."""
        return np.array([frame.arrival_time_ns for frame in self._frames], np.int64)

    @property
    def captured(self) -> NDArray[np.int64]:
        """(T,) ns, when the cameras saw them, as a session takes it."""
        return np.array(self._captured, np.int64)

    @property
    def stamps(self) -> NDArray[np.int64]:
        """(T,) ns of the system's own clock."""
        return np.array([frame.source_time_ns for frame in self._frames], np.int64)

    def markers(self) -> Array:
        """(T, M, 3) m; NaN where one was not seen."""
        return np.array([_placed(frame, self.names) for frame in self._frames]).reshape(-1, len(self.names), 3)


def _placed(frame: MarkerFrame, names: tuple[str, ...]) -> Array:
    column = {name: n for n, name in enumerate(frame.names) if frame.valid[n]}
    nowhere = np.full(3, np.nan)
    return np.array([frame.positions[column[name]] if name in column else nowhere for name in names])


def ways(shape: ArmShape, found: ArmCalibration, encoders: Array) -> Array:
    """(M, 3, J) m/rad: where joints move the plate's markers, in the motion capture's frame, at encoders (J,), rad."""
    errors, none = calibrated(shape, found), np.zeros((1, len(encoders)))
    frames = frames_of(shape, errors, true_angles(errors, encoders[None], none, none))
    columns = joint_columns(frames, marker_places(shape, errors, frames))[0]
    back = rotations.to_matrix(rotations.conjugate(found.registration.world_from_mocap))
    return np.einsum("ab,mbj->maj", back, columns)


def angles_seen(markers: Array, way: Array) -> Array:
    """(T,) rad, of the joint that moves markers (T, M, 3), m, along ``way`` (M, 3), m/rad; NaN where none was seen."""
    away = markers - np.nanmedian(markers, axis=0)
    seen = np.isfinite(away).all(axis=-1)
    along = np.sum(np.where(seen, np.sum(np.nan_to_num(away) * way, axis=-1), 0.0), axis=1)
    size = np.sum(np.where(seen, np.sum(way**2, axis=-1), 0.0), axis=1)
    return np.where(size > 0.0, along / np.maximum(size, 1e-12), np.nan)


@dataclass(frozen=True)
class MocapDelay:
    """From a joint's encoder to its markers.

    Attributes:
        age: s, until a frame is here.
        late: s, by which it is late at the time at which a session takes the cameras to have seen it.
        error: s, of both, 95 %.
    """

    age: float
    late: float
    error: float


def mocap_delay(
    read_ns: NDArray[np.int64], angles: Array, seen: SeenFrames, way: Array, settings: MocapLagSettings = MOCAP_LAG
) -> MocapDelay | None:
    """How late the markers are of a joint that was moved; None where it moves them by too little to tell.

    Args:
        read_ns, angles: (T,) when its encoder was read, and rad.
        seen: what came meanwhile.
        way: (M, 3) m/rad, along which it moves them.
        settings: when they tell.

    Raises:
        HighFiveError: frames are missing, or the markers do not move as the joint does.
    """
    if float(np.std(angles)) * float(np.linalg.norm(way, axis=1).max()) < settings.way:
        return None
    shown = angles_seen(seen.markers()[:, : len(way)], way)
    begun, good = read_ns[0], np.isfinite(shown)
    by = [
        stream_delay(NS * (read_ns - begun), angles, NS * (times[good] - begun), shown[good])
        for times in (seen.arrivals, seen.captured)
    ]
    return MocapDelay(by[0].delay, by[1].delay, max(one.error for one in by))


def together(delays: list[MocapDelay], settings: MocapLagSettings = MOCAP_LAG) -> MocapDelay:
    """What all joints say of the motion capture: the mean of all, by how sure each is.

    Raises:
        HighFiveError: too few of them tell, or they do not agree.
    """
    if len(delays) < settings.fewest:
        raise HighFiveError(
            f"{len(delays)} joints move the plate far enough to see how late it is seen, expected {settings.fewest}"
        )
    share = np.array([one.error for one in delays]) ** -2.0
    share /= share.sum()
    ages, lates = (np.array([getattr(one, name) for one in delays]) for name in ("age", "late"))
    if (apart := float(np.ptp(ages))) > settings.apart:
        raise HighFiveError(
            f"the motion capture is later for one joint than for another by {1e3 * apart:.1f} ms, at most "
            f"{1e3 * settings.apart:g} are noise: is its rate steady, and the plate fixed?"
        )
    spread = 1.96 * float(np.sqrt(np.sum(share * (ages - share @ ages) ** 2) / (len(delays) - 1)))
    sure = float(np.sum(np.array([one.error for one in delays]) ** -2.0)) ** -0.5
    return MocapDelay(float(share @ ages), float(share @ lates), max(spread, sure))


def whole_lag(told_ns: NDArray[np.int64], told: Array, seen_ns: NDArray[np.int64], shown: Array) -> ServoLag:
    """From a wand to a plate that follows it, both by the motion capture's stamps.

    Args:
        told_ns, told: (T,) stamps of the frames that the arm was led by, and rad that it was told for each.
        seen_ns, shown: (N,) stamps of frames, and rad that the plate was seen at; NaN where not.
    """
    good, begun = np.isfinite(shown), told_ns[0]
    return servo_lag(NS * (told_ns - begun), told, NS * (seen_ns[good] - begun), shown[good])
