"""A C3D file written frame by frame: memory does not grow with its length.

Format: the C3D file format user guide, www.c3d.org (Motion Lab Systems): Intel byte order, floating point, millimetres.
The whole-recording writer of :mod:`highfive.mocap_bridge.files.c3d` (ezc3d's) is the simpler one where everything is
in memory.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.files.c3d import BLOCK
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

MAX_POINTS = 1000
"""Points a frame: what surely fits into the 255 blocks that a parameter section may have."""

_A_LIST = 255  # entries a parameter can have; more go on in LABELS2, …
_WIDTH = 100  # characters of a label that are kept
_INTEL = 84


def write_frames(
    path: Path,
    rate_hz: float,
    names: Sequence[str],
    count: int,
    frames: Iterable[tuple[Array, NDArray[np.bool_]]],
) -> None:
    """Writes ``count`` frames, each of points (M, 3), m, and whether they were seen (M,), under M ``names``.

    Raises:
        HighFiveError: there is nothing to write, or more points than fit.
        OSError: the disk is full, or there is no permission.
    """
    if not names or count < 1 or not 1.0 <= rate_hz <= 10_000.0:
        raise HighFiveError(f"cannot write {path} with {count} frames of {len(names)} markers at {rate_hz:g} Hz")
    if len(names) > MAX_POINTS:
        raise HighFiveError(f"cannot write {path}: {len(names)} points per frame, at most {MAX_POINTS} fit")
    parameters = _parameters(rate_hz, names, count, 0)
    blocks = -(-len(parameters) // BLOCK)
    parameters = _parameters(rate_hz, names, count, 2 + blocks)
    section = bytes([1, 0x50, blocks, _INTEL]) + parameters[4:]
    with path.open("wb") as file:
        file.write(_header(rate_hz, len(names), count, 2 + blocks))
        file.write(section.ljust(blocks * BLOCK, b"\0"))
        words, written = np.zeros((len(names), 4), dtype="<f4"), 0
        before, data = None, b""
        for frame in frames:
            if frame is not before:  # in a gap it is the same one for long
                points, seen = before = frame
                words[:, :3] = np.where(seen[:, None], points * 1e3, 0.0)
                words[:, 3] = np.where(seen, 0.0, -1.0)
                data = words.tobytes()
            file.write(data)
            written += 1
        if written != count:
            raise HighFiveError(f"cannot write {path}: {written} frames came, {count} were announced")
        if count <= 0xFFFF:  # of a longer file other readers go on to its end
            file.write(b"\0" * (-file.tell() % BLOCK))


def _header(rate_hz: float, points: int, count: int, data_block: int) -> bytes:
    last = min(count, 0xFFFF)
    head = struct.pack("<BBHHHHHfHHf", 2, 0x50, points, 0, 1, last, 0, -1.0, data_block, 0, rate_hz)
    return head.ljust(BLOCK, b"\0")


def _parameters(rate_hz: float, names: Sequence[str], count: int, data_block: int) -> bytes:
    """The parameter section with four bytes before it."""
    labels = [name.encode("latin-1", "replace")[:_WIDTH] for name in names]
    most = ((255 * BLOCK - 2000) // len(labels)) - 2  # what is left to each where there are very many
    labels = [label[:most] for label in labels]
    records = [_group(1, "POINT"), _group(2, "TRIAL"), _group(3, "ANALOG")]
    records += [
        _numbers(1, "USED", 2, struct.pack("<H", len(labels))),
        _numbers(1, "SCALE", 4, struct.pack("<f", -1.0)),
        _numbers(1, "RATE", 4, struct.pack("<f", rate_hz)),
        _numbers(1, "DATA_START", 2, struct.pack("<H", data_block)),
        _numbers(1, "FRAMES", 2, struct.pack("<H", min(count, 0xFFFF))),
        _texts(1, "UNITS", [b"mm"]),
    ]
    for number in range(0, len(labels), _A_LIST):
        part = "" if number == 0 else str(number // _A_LIST + 1)
        records.append(_texts(1, f"LABELS{part}", labels[number : number + _A_LIST]))
    records += [
        _numbers(2, "ACTUAL_START_FIELD", 2, struct.pack("<HH", 1, 0)),
        _numbers(2, "ACTUAL_END_FIELD", 2, struct.pack("<HH", count & 0xFFFF, count >> 16)),
        _numbers(3, "USED", 2, struct.pack("<H", 0)),
        _numbers(3, "SCALE", 4, b"", ()),
        _numbers(3, "GEN_SCALE", 4, struct.pack("<f", 1.0)),
        _numbers(3, "OFFSET", 2, b"", ()),
        _numbers(3, "RATE", 4, struct.pack("<f", 0.0)),
    ]
    return b"\0" * 4 + b"".join(records) + b"\0\0"


def _group(number: int, name: str) -> bytes:
    return struct.pack("<bb", len(name), -number) + name.encode() + struct.pack("<hB", 3, 0)


def _numbers(group: int, name: str, size: int, data: bytes, shape: tuple[int, ...] | None = None) -> bytes:
    """A parameter of numbers: one is a scalar, several are a list; none at all is an empty list."""
    items = len(data) // size
    dimensions = bytes([1, items]) if shape is not None or items != 1 else bytes([0])
    return _record(group, name, bytes([size]) + dimensions + data)


def _texts(group: int, name: str, texts: Sequence[bytes]) -> bytes:
    width = max(len(text) for text in texts)
    data = b"".join(text.ljust(width) for text in texts)
    return _record(group, name, b"\xff" + bytes([2, width, len(texts)]) + data)


def _record(group: int, name: str, body: bytes) -> bytes:
    head = struct.pack("<bb", len(name), group) + name.encode()
    return head + struct.pack("<h", 2 + len(body) + 1) + body + b"\0"
