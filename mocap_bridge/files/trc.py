"""TRC (track row column): markers as OpenSim and Cortex write them.

Format: OpenSim documentation, "Marker (.trc) Files": three lines about the file, names of markers three columns apart,
a line of axes, then rows of frame number, time and coordinates; an empty cell is a marker that was not seen.
"""

from __future__ import annotations

from array import array

import numpy as np

from highfive.mocap_bridge.files.named_points import UNITS, NamedPoints, at_frames, frames_of, number, unique
from highfive.model.errors import HighFiveError

_UNITS = {"meters": "m", "metres": "m", "meter": "m", "millimeters": "mm", "millimetres": "mm", "centimeters": "cm"}
_RATE_OFF = 0.02
"""By which the time column and DataRate may differ."""


def parse_trc(text: str, source: str) -> NamedPoints:
    """Reads the text of a TRC file.

    Raises:
        HighFiveError: it is none, ends early, or says one count and holds another.
    """
    lines = text.splitlines()
    if not lines[0].startswith("PathFileType") or len(lines) < 6:
        raise HighFiveError(
            f"{source} is no TRC file, or cut off: its first line begins {lines[0][:20]!r}, expected PathFileType"
        )
    about = dict(zip(_cells(lines[1]), _cells(lines[2]), strict=False))
    missing = [key for key in ("DataRate", "NumFrames", "NumMarkers", "Units") if not about.get(key, "").strip()]
    if missing:
        raise HighFiveError(f"{source}: its header does not say {', '.join(missing)}")
    names = [cell.strip() for cell in _cells(lines[3])[2:] if cell.strip()]
    markers, frames = (_whole(about[key], f"{source}: {key}") for key in ("NumMarkers", "NumFrames"))
    if len(names) != markers:
        raise HighFiveError(f"{source}: NumMarkers is {markers}, but {len(names)} markers have names")
    rows = [(place, line) for place, line in enumerate(lines[5:], start=6) if line.strip()]
    if len(rows) != frames:
        raise HighFiveError(f"{source}: NumFrames is {frames}, but it holds {len(rows)}; is it cut off?")
    width = 2 + 3 * markers
    cells = array("d")  # a tenth of what lists of numbers take
    for place, line in rows:
        cells.extend(_row(line, width, f"{source}, line {place}"))
    values = np.array(cells).reshape(-1, width)
    rate, at = frames_of(values[:, 1], source)
    stated = number(about["DataRate"], f"{source}: DataRate")
    if not abs(stated - rate) <= _RATE_OFF * rate:
        raise HighFiveError(
            f"{source}: DataRate is {stated:g} Hz, but its times go on at {rate:g} Hz; correct one of them"
        )
    unit = about["Units"].strip().lower()
    unit = _UNITS.get(unit, unit)
    if unit not in UNITS:
        raise HighFiveError(f"{source}: Units is {unit!r}; expected one of {', '.join(UNITS)}")
    points = values[:, 2:].reshape(len(rows), markers, 3)
    return NamedPoints(source, rate, unique(names, source), at_frames(points, at), unit)


def _cells(line: str) -> list[str]:
    """Between tabs; some programs write spaces instead, and then nothing can be left out."""
    return line.split("\t") if "\t" in line else line.split()


def _row(line: str, width: int, where: str) -> list[float]:
    cells = _cells(line)
    while len(cells) > width and not cells[-1].strip():
        cells.pop()
    if len(cells) != width:
        raise HighFiveError(f"{where}: {len(cells)} values, expected {width}: frame, time and three a marker")
    values = [number(cell, where) for cell in cells]
    if not np.isfinite(values[1]):
        raise HighFiveError(f"{where}: the time is missing")
    return values


def _whole(text: str, what: str) -> int:
    value = number(text, what)
    if not (np.isfinite(value) and value >= 1 and value == int(value)):
        raise HighFiveError(f"{what} is {text.strip()!r}; expected a whole number from 1")
    return int(value)
