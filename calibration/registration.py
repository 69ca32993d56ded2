"""Where the arm stands in the motion capture's room: what its calibration's file says of that, and what is relied on.

A live person's hand and head are where the motion capture says; the arm is where its mount says. Without this file
they are in two worlds, and no distance between them means anything: a real arm does not move near a live person then.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import Any

from highfive.calibration.placement import Placement
from highfive.calibration.placement_file import check_frame, vector
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting
from highfive.model.toml_file import table, typed

FORMAT = 1
"""Version of the file's format."""


@dataclass(frozen=True)
class RegistrationSettings(Settings):
    """What a registration has to be for a real arm to rely on it."""

    longest_age: float = setting(30.0, "days", above=0.0)
    """An older registration is not relied on: tripods and tables are moved."""
    worst: float = setting(0.004, "m", above=0.0)
    """Most that the plate was off in 95 of 100 poses that were held out of the fit."""
    fewest_poses: int = setting(10, least=1)
    """Of the arm, that the fit rests on: with fewer the worst of 100 places is further off than ``worst``."""


REGISTRATION = RegistrationSettings()


@dataclass(frozen=True)
class Registration:
    """One rig and room.

    Attributes:
        path: of the file.
        date: when it was measured, UTC.
        arm: fingerprint of the arm that was measured: servos, directions, zeros, lengths and mount.
        system: the motion capture, as in its address: ``vicon``, ``qtm``, ``natnet``, ``lsl``.
        world_from_mocap: (4,) quaternion and ...
        translation: ... (3,) m, added after the rotation: from the motion capture's frame to the world in which the
            arm's mount is given.
        poses: of the arm, that the fit rests on.
        held_out_p95: m, distance of the plate from where it was seen, in 95 of 100 poses that were held out of the fit.
    """

    path: Path
    date: datetime
    arm: str
    system: str
    world_from_mocap: Array
    translation: Array
    poses: int
    held_out_p95: float

    @property
    def placement(self) -> Placement:
        """From the motion capture's frame to the world."""
        return Placement(
            self.world_from_mocap, self.translation, (f"the room is registered with the arm, {self.path.name}",)
        )

    def mismatches(
        self, arm: str, system: str, now: datetime, settings: RegistrationSettings = REGISTRATION
    ) -> tuple[str, ...]:
        """Why this does not say where this arm stands in this room now, a line each; nothing where it does.

        Args:
            arm: fingerprint of the arm that is to move.
            system: of the live person's address; capitals do not matter.
            now: UTC.
            settings: what it has to be.
        """
        found, age = [], now - self.date
        if self.arm != arm:
            found.append(f"it is of another arm ({self.arm}; this one is {arm})")
        if self.system.lower() != system.lower():
            found.append(f"it is of a {self.system} system; the person comes from {system}")
        if age > timedelta(days=settings.longest_age):
            found.append(f"it is {age.days} days old, at most {settings.longest_age:g} are relied on")
        if age < timedelta(days=-1):
            found.append(f"it is from {self.date:%Y-%m-%d}, which is to come; set this computer's clock")
        if self.poses < settings.fewest_poses:
            found.append(f"it rests on {self.poses} poses, at least {settings.fewest_poses} are needed")
        if self.held_out_p95 > settings.worst:
            off = f"the plate was {1e3 * self.held_out_p95:.1f} mm off (95 %)"
            found.append(f"{off}, at most {1e3 * settings.worst:.0f} are safe")
        return tuple(f"registration {self.path}: {line}; measure it again" for line in found)


def registration_of(path: Path, data: Mapping[str, Any]) -> Registration:
    """The registration in a file's content.

    Raises:
        HighFiveError: there is none.
    """
    meta, arm, world, quality = (table(data, name) for name in ("meta", "arm", "world", "quality"))
    if (version := typed(meta, "meta.", "format", int)) != FORMAT:
        raise HighFiveError(f"meta.format is {version}, this program reads {FORMAT}")
    measured = aware(meta, "meta.", "date")
    rotation, translation = vector(world, "world.", "rotation", 4), vector(world, "world.", "translation_m", 3)
    check_frame(rotation, translation)
    p95 = typed(quality, "quality.", "held_out_p95_m", float)
    if not 0.0 < p95 < math.inf:
        raise HighFiveError(f"quality.held_out_p95_m is {p95}, expected a distance in m")
    return Registration(
        path=path,
        date=measured,
        arm=typed(arm, "arm.", "fingerprint", str),
        system=typed(world, "world.", "system", str),
        world_from_mocap=rotation,
        translation=translation,
        poses=typed(quality, "quality.", "poses", int),
        held_out_p95=p95,
    )


def aware(entry: Mapping[str, Any], where: str, name: str) -> datetime:
    """A time with its zone, in UTC.

    Raises:
        HighFiveError: it is not there, or no such time.
    """
    if type(day := entry.get(name)) is date:
        raise HighFiveError(f"{where}{name} is a date without a time; write {day}T10:00:00+01:00")
    measured = typed(entry, where, name, datetime)
    if measured.tzinfo is None:
        raise HighFiveError(f"{where}{name} has no time zone; write it in UTC, such as 2026-11-23T09:30:00Z")
    return measured.astimezone(UTC)
