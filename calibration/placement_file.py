"""A placement kept in a file: the next session in the same room need not watch the person first."""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

import numpy as np

from highfive.calibration.placement import Placement
from highfive.model.errors import HighFiveError
from highfive.model.files import write_whole
from highfive.model.geometry.rotations import Array
from highfive.model.toml_file import as_float, read_toml, table, typed

FORMAT = 1
"""Version of the file's format."""

FURTHEST = 50.0
"""m, from the motion capture's origin to the avatar's: further off, the unit is wrong."""

UNIT_NORM = 1e-6
"""By how much the norm of a unit quaternion may be off."""


def save_placement(path: Path, placement: Placement, system: str, now: datetime, *, replace: bool = False) -> None:
    """Writes a placement in one piece; a file that is there is left as it is, unless it is to be replaced.

    Args:
        path: of the file.
        placement: from the motion capture's frame to the world.
        system: the motion capture, as in its address: ``vicon``, ``qtm``, ``natnet``, ``lsl``.
        now: UTC.

    Raises:
        HighFiveError: it cannot be written, or there is such a file.
    """
    rotation, translation = (
        ", ".join(f"{value:.12f}" for value in values) for values in (placement.rotation, placement.translation)
    )
    notes = "\n".join(f"# {line}" for line in placement.notes)
    content = (
        f"# Where the avatar stands in the motion capture's room. Delete this file to place it anew.\n{notes}\n"
        f'[meta]\nformat = {FORMAT}\ndate = {now:%Y-%m-%dT%H:%M:%SZ}\n\n[world]\nsystem = "{system}"\n'
        f"rotation = [{rotation}]  # w, x, y, z: from the motion capture's frame to the world\n"
        f"translation_m = [{translation}]  # added after the rotation\n"
    )
    try:
        write_whole(path, content.encode(), replace=replace)
    except OSError as error:
        raise HighFiveError(f"cannot write the placement {path}: {error.strerror or error}") from None


def load_placement(path: Path, system: str) -> Placement:
    """Reads a placement that was kept.

    Raises:
        HighFiveError: it cannot be read, is no placement, or is of another system; one line says what.
    """
    data = read_toml(path, "the placement")
    try:
        measured, found, rotation, translation = _placement(data)
    except HighFiveError as error:
        raise HighFiveError(f"{path} is no placement: {error}; delete it, and the person is watched again") from None
    if found.lower() != system.lower():
        raise HighFiveError(
            f"{path} is of a {found} system, the person comes from {system}; keep a placement for each system"
        )
    return Placement(rotation, translation, (f"placed as in {path.name}, of {measured:%Y-%m-%d %H:%M} UTC",))


def _placement(data: Mapping[str, Any]) -> tuple[datetime, str, Array, Array]:
    meta, world = table(data, "meta"), table(data, "world")
    if (version := typed(meta, "meta.", "format", int)) != FORMAT:
        raise HighFiveError(f"meta.format is {version}, this program reads {FORMAT}")
    if type(day := meta.get("date")) is date:
        raise HighFiveError(f"meta.date is a date without a time; write {day}T10:00:00Z")
    measured = typed(meta, "meta.", "date", datetime)
    rotation, translation = vector(world, "world.", "rotation", 4), vector(world, "world.", "translation_m", 3)
    check_frame(rotation, translation)
    try:
        measured = measured.astimezone(UTC)
    except (OverflowError, ValueError):  # at either end of the calendar
        raise HighFiveError(f"meta.date is {measured}, expected a date of our time") from None
    return measured, typed(world, "world.", "system", str), rotation, translation


def check_frame(rotation: Array, translation: Array, where: str = "world.", name: str = "translation_m") -> None:
    """A quaternion (4,) and a translation (3,), m, which is called ``name``, are ones that a room can have.

    Raises:
        HighFiveError: they are not; the message says which entry of ``where``.
    """
    if not abs(math.hypot(*rotation) - 1.0) <= UNIT_NORM:
        raise HighFiveError(f"{where}rotation is no unit quaternion (w, x, y, z)")
    if not math.hypot(*translation) <= FURTHEST:
        raise HighFiveError(f"{where}{name} is further than {FURTHEST:g} m; is it in millimetres?")


def vector(entry: Mapping[str, Any], where: str, name: str, length: int) -> Array:
    """A list of numbers of a TOML table.

    Raises:
        HighFiveError: it has another length, or holds something else.
    """
    values = typed(entry, where, name, list)
    if len(values) != length or not all(isinstance(v, int | float) and not isinstance(v, bool) for v in values):
        raise HighFiveError(f"{where}{name} is {values!r}, expected {length} numbers")
    numbers = [as_float(v) for v in values]
    if not all(map(math.isfinite, numbers)):
        raise HighFiveError(f"{where}{name} has {numbers!r}, which are not all numbers")
    return np.array(numbers)
