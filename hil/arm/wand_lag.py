"""From a marker that somebody moves to the plate that follows it, within one motion capture stream: one clock for both.

The joint that moves the plate furthest follows the wand's way along the plate's: 1 : 1, within five degrees.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from highfive.calibration.servo_lag import ServoLag
from highfive.hil.arm.mocap_lags import SeenFrames, angles_seen, whole_lag
from highfive.hil.arm.posture_drive import PostureDrive
from highfive.hil.arm.servo_lags import NS, PlateSeen, lag_of, slow_enough
from highfive.hil.arm_model.servo_arm import ServoArm
from highfive.hil.drivers.bus.cycle_ring import Cycle
from highfive.hil.safety.limits import Limits
from highfive.model.errors import HighFiveError
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class WandSettings(Settings):
    """How a wand is followed."""

    seconds: float = setting(15.0, "s", least=5.0)
    amplitude: float = setting(0.087, "rad", above=0.0)
    """To either side: five degrees."""
    share: float = setting(0.7, above=0.0, most=1.0)
    """Of the joint's speed."""
    limited: float = setting(0.05, above=0.0, most=1.0)
    """Most of the frames in which the wand may be too fast, or too far: an answer to those is no linear system's."""
    least: float = setting(0.015, "m", above=0.0)
    """Standard deviation of the wand's way."""


WAND = WandSettings()

_NOISE = 0.005
"""rad, by which the wand's place may be off by noise."""


@dataclass(frozen=True)
class Followed:
    """How late a plate is that follows a wand.

    Attributes:
        whole: from the wand to the plate, in the motion capture's own time.
        servo: from command to encoder meanwhile: a chirp's differs, for friction is more beside slower motion.
        host: s from a frame's arrival to the bus's cycle that has its command, mean.
        joint: name of the joint that followed.
    """

    whole: ServoLag
    servo: ServoLag
    host: float
    joint: str


class _Leader:
    """Makes a joint's angle of the wand's newest place. One owner, one thread."""

    def __init__(self, plate: PlateSeen, arm: ServoArm, joint: int, speed: float, settings: WandSettings) -> None:
        self.plate, self.arm, self.joint, self._speed, self._s = plate, arm, joint, speed, settings
        way = plate.ways(arm.ready)[..., joint].mean(axis=0)
        self._size = float(np.linalg.norm(way))
        self._along = way / self._size
        self._origin: float | None = None
        self._last, self._at = 0.0, 0.0
        self.stamps: list[int] = []
        self.told: list[float] = []
        self.wanted: list[float] = []
        self.arrivals: list[int] = []
        self.sent: list[int] = []

    def __call__(self, seconds: float) -> np.ndarray:
        """(J,) rad at s from the beginning."""
        frame = self.plate.frames.look()
        wand = self.plate.frames.names[-1]
        if frame is not None and wand in frame.names and frame.valid[n := frame.names.index(wand)]:
            place = float(self._along @ frame.positions[n])
            self._origin = place if self._origin is None else self._origin
            wanted = (place - self._origin) / self._size
            step = self._s.share * self._speed * (seconds - self._at)
            told = float(np.clip(wanted, -self._s.amplitude, self._s.amplitude))
            self._last, self._at = float(np.clip(told, self._last - step, self._last + step)), seconds
            self.stamps.append(frame.source_time_ns)
            self.wanted.append(wanted)
            self.told.append(self._last)
            self.arrivals.append(frame.arrival_time_ns)
            self.sent.append(self.plate.frames.clock.now())
        return self.arm.ready + self._last * np.eye(len(self.arm.ready))[self.joint]


@dataclass(frozen=True)
class WandSeen:
    """What was seen and sent while the arm followed a wand; what it tells, :func:`followed_wand` finds afterwards."""

    lead: _Leader
    cycles: list[Cycle]
    frames: SeenFrames
    settings: WandSettings


def follow_wand(
    drive: PostureDrive,
    arm: ServoArm,
    limits: Limits,
    plate: PlateSeen,
    say: Callable[[str], object],
    settings: WandSettings = WAND,
) -> WandSeen:
    """Has the arm follow the wand, which is the last of the markers that are looked at.

    Raises:
        HighFiveError: the arm was stopped.
    """
    drive.go(arm.ready)
    sizes = np.linalg.norm(plate.ways(arm.ready).mean(axis=0), axis=0)
    joint, wand = int(np.argmax(sizes)), plate.frames.names[-1]
    lead = _Leader(plate, arm, joint, slow_enough(drive, arm, limits, joint), settings)
    furthest = 0.8 * settings.amplitude * float(sizes[joint])
    say(
        f"move {wand} to and fro now, the way the plate goes, {100.0 * furthest:.0f} cm to either side of where it is, "
        f"about once in three seconds, for {settings.seconds:.0f} s; the arm follows"
    )
    plate.frames.begin()
    cycles = drive.follow(lead, settings.seconds)
    frames = plate.frames.taken()
    drive.go(arm.ready)
    return WandSeen(lead, cycles, frames, settings)


def followed_wand(seen: WandSeen) -> Followed:
    """How late the plate followed.

    Raises:
        HighFiveError: the wand was not seen, or was not moved as it has to be.
    """
    lead, settings = seen.lead, seen.settings
    plate, joint, wand = lead.plate, lead.joint, seen.frames.names[-1]
    way = plate.ways(lead.arm.ready)[..., joint]
    wanted, told = np.array(lead.wanted), np.array(lead.told)
    if len(told) < 60:
        raise HighFiveError(f"the wand {wand} was seen in {len(told)} frames; clear the cameras' view of it")
    if (limited := float(np.mean(np.abs(wanted - told) > _NOISE))) > settings.limited:
        raise HighFiveError(
            f"the wand was too fast, or too far, in {limited:.0%} of the frames; move it more slowly, and less far"
        )
    if (moved := float(np.std(wanted) * np.linalg.norm(way.mean(axis=0)))) < settings.least:
        raise HighFiveError(f"the wand moved by {1e3 * moved:.0f} mm (standard deviation); it has to go to and fro")
    shown = angles_seen(seen.frames.markers()[:, :-1], way)
    return Followed(
        whole=whole_lag(np.array(lead.stamps, np.int64), told, seen.frames.stamps, shown),
        servo=lag_of([cycle for cycle in seen.cycles if cycle.sent is not None], joint, plate.reply),
        host=_host(seen.cycles, lead),
        joint=plate.shape.names[joint],
    )


def _host(cycles: Sequence[Cycle], lead: _Leader) -> float:
    """s, mean, from the arrival of a frame to the cycle that took its command."""
    begun = np.array([cycle.begun_ns for cycle in cycles if cycle.sent is not None], np.int64)
    at = np.searchsorted(begun, np.array(lead.sent, np.int64))
    there = at < len(begun)
    return NS * float(np.mean(begun[at[there]] - np.array(lead.arrivals, np.int64)[there]))
