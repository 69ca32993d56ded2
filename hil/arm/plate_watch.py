"""What a motion capture system sees of the arm's plate while the arm stands, and who is near it while it moves."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from highfive.calibration.plate_template import PlateTemplate, swapped_markers
from highfive.hil.runtime.clock import Clock
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class WatchSettings(Settings):
    """When a plate is seen well enough."""

    frames: int = setting(60, least=10)
    drift: float = setting(0.0003, "m", above=0.0)
    """Of the markers' middle from the first half of the frames to the second, at most: else the arm still moves."""
    seen: float = setting(0.8, above=0.0, most=1.0)
    """Share of the frames in which a marker has to be there."""
    stale: float = setting(0.1, "s", above=0.0)
    """Older frames say nothing of who is near."""
    near: float = setting(1.0, "m", above=0.0)
    """From the plate's middle to a marker that is not the plate's: somebody whom the arm could reach."""
    hidden: float = setting(1.0, "s", above=0.0)
    """So long the plate may be hidden from all cameras while it moves: what hides it may be a person."""
    speed: float = setting(0.25, "m/s", above=0.0)
    """Most that a hidden plate moves at (:class:`highfive.hil.arm.posture_drive.DriveSettings`): so much nearer it may
    be to somebody."""
    own: float = setting(0.12, "m", least=0.0)
    """Points without a label that are nearer than this are taken for the plate's own, whose labels were lost."""


WATCH = WatchSettings()

FEWEST = 3
"""Markers that tell where a plate is, and how it is turned."""


class StillMoves(HighFiveError):
    """The plate does not stand."""


class Frames(Protocol):
    """Where the newest frame is: :class:`highfive.mocap_bridge.sources.live.LiveSource`."""

    def newest(self, now_ns: int) -> MarkerFrame | None:
        """It; None before the first."""
        ...


@dataclass
class PlateWatch:
    """Frames of a live system, and the plate in them. One owner, one thread."""

    frames: Frames
    template: PlateTemplate
    clock: Clock
    settings: WatchSettings = WATCH
    _number: int = -1
    _middle: Array | None = None
    _seen_ns: int = 0
    _labels: set[str] = field(default_factory=set)
    _places: list[Array] = field(default_factory=list)
    _seen: list[NDArray[np.bool_]] = field(default_factory=list)

    def in_the_way(self) -> str:
        """Why the arm must not move now; '' where it may."""
        now = self.clock.now()
        frame = self.frames.newest(now)
        if frame is None or now - frame.arrival_time_ns > 1e9 * self.settings.stale:
            return "no frames come from the motion capture"
        places, seen = self._plate(frame)
        if seen.any():
            self._middle, self._seen_ns = np.mean(places[seen], axis=0), now
        if self._middle is None:
            return "no marker of the plate is seen"
        hidden = 1e-9 * (now - self._seen_ns)
        if hidden > self.settings.hidden:
            return f"no marker of the plate has been seen for {hidden:.0f} s; clear the cameras' view of it"
        within = self.settings.near + self.settings.speed * hidden
        strange = np.array([name not in self.template.names for name in frame.names], bool) & frame.valid
        near = strange & (np.linalg.norm(frame.positions - self._middle, axis=1) < within)
        away = np.linalg.norm(frame.unlabelled - self._middle, axis=1)
        if near.any() or ((away > self.settings.own) & (away < within)).any():
            who = ", ".join(name for name, one in zip(frame.names, near, strict=True) if one)
            return f"somebody is in the arm's way ({who or 'markers without a label'})"
        return ""

    def begin(self) -> None:
        """Forgets what was seen."""
        self._places, self._seen = [], []

    def look(self) -> None:
        """Takes the newest frame, if it is new."""
        frame = self.frames.newest(self.clock.now())
        if frame is None or frame.number == self._number:
            return
        self._number = frame.number
        self._labels.update(frame.names)
        places, seen = self._plate(frame)
        self._places.append(places)
        self._seen.append(seen)

    @property
    def full(self) -> bool:
        """Enough frames were seen."""
        return len(self._places) >= self.settings.frames

    def pose(self) -> tuple[Array, NDArray[np.bool_]]:
        """Markers (M, 3), m, and which were seen (M,): medians, which labels swapped now and then do not move.

        Raises:
            HighFiveError: markers are missing, or swapped all the time; one line says which.
        StillMoves: the plate does not stand.
        """
        names = self.template.names
        places, seen = np.array(self._places), np.array(self._seen)
        if places.size == 0:
            raise HighFiveError("no frames come from the motion capture; is it streaming?")
        shares = seen.mean(axis=0)
        good = shares >= self.settings.seen
        if unknown := [name for name in names if name not in self._labels]:
            sent = ", ".join(sorted(self._labels))
            raise HighFiveError(f"the plate's markers {', '.join(unknown)} are missing; the system sends {sent}")
        if good.sum() < FEWEST:
            hidden = ", ".join(name for name, one in zip(names, good, strict=True) if not one)
            raise HighFiveError(f"the plate's markers {hidden} were hardly seen; clear the cameras' view")
        half = len(places) // 2
        middles = [
            np.mean([np.median(part[own[:, m], m], axis=0) for m in np.flatnonzero(good) if own[:, m].any()], axis=0)
            for part, own in ((places[:half], seen[:half]), (places[half:], seen[half:]))
        ]
        drift = float(np.linalg.norm(middles[1] - middles[0]))
        if drift > self.settings.drift:
            raise StillMoves(f"the plate still moves, {1e3 * drift:.2f} mm within {len(places)} frames")
        found = np.array(
            [np.median(places[seen[:, m], m], axis=0) if good[m] else np.zeros(3) for m in range(len(names))]
        )
        if good.all() and (pair := swapped_markers(self.template, found)) is not None:
            raise HighFiveError(f"the plate's markers {pair[0]} and {pair[1]} are swapped; label them anew")
        return found, good

    def _plate(self, frame: MarkerFrame) -> tuple[Array, NDArray[np.bool_]]:
        column = {name: n for n, name in enumerate(frame.names)}
        at = [column.get(name, -1) for name in self.template.names]
        seen = np.array([n >= 0 and bool(frame.valid[n]) for n in at])
        places = np.array([frame.positions[n] if n >= 0 else np.zeros(3) for n in at])
        return places, seen
