"""NatNet's frames, both ways, and its axes."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.wire.errors import LinkError
from highfive.mocap_bridge.wire.natnet import SIZED, Kind, Version, encode
from highfive.mocap_bridge.wire.natnet_bytes import COUNT_AND_SIZE, BodyReader
from highfive.model.geometry.rotations import Array

OCCLUDED, MEASURED, FILLED, HAS_MODEL, UNLABELLED = 0x01, 0x02, 0x04, 0x08, 0x10
"""Bits of a labelled marker: not seen; from the cameras; from the asset's shape; belongs to an asset; without label."""

MODELS_CHANGED = 0x02
"""Bit of a frame: ask for the descriptions again."""
_TIMES = struct.Struct("<IIdQQQ")
_RIGID_BODY = 38  # bytes in a frame
_ASSET_MARKER = 26
_LABELLED = np.dtype([("id", "<u4"), ("point", "<f4", 3), ("size", "<f4"), ("flags", "<u2"), ("residual", "<f4")])
_SUFFIX = 42  # bytes without the precision time stamp and the end mark


@dataclass(frozen=True)
class Frame:
    """A frame as it is on the wire.

    Attributes:
        number: frame number.
        sets: (name, points (n, 3) m) of each marker set.
        others: (U, 3) m, markers that belong to no set (older versions: all markers).
        labelled: every marker with a number: fields ``id`` (asset in the upper 16 bits, marker, counted from 1, in the
            lower), ``point`` m, ``size`` m, ``flags``, ``residual``.
        time: s on the system's clock.
        models_changed: the descriptions are out of date.
        exposed, sent: middle of the cameras' exposure and transmission, ticks of the server's finer clock; 0 for none.
    """

    number: int
    sets: tuple[tuple[str, NDArray[np.float32]], ...]
    others: NDArray[np.float32]
    labelled: NDArray[np.void]
    time: float
    models_changed: bool = False
    exposed: int = 0
    sent: int = 0


def encode_frame(frame: Frame, version: Version) -> bytes:
    """A frame as a whole datagram."""
    sets = b"".join(
        name.encode() + b"\0" + struct.pack("<I", len(points)) + points.astype("<f4").tobytes()
        for name, points in frame.sets
    )
    sections = [(len(frame.sets), sets), (len(frame.others), frame.others.astype("<f4").tobytes()), (0, b""), (0, b"")]
    sections += [(0, b"")] if version >= SIZED else []  # assets
    sections += [(len(frame.labelled), frame.labelled.tobytes()), (0, b""), (0, b"")]
    parts = [struct.pack("<I", frame.number & 0xFFFFFFFF)]
    for count, body in sections:
        parts += [struct.pack("<I", count), struct.pack("<I", len(body)) if version >= SIZED else b"", body]
    ticks = max(0, round(frame.time * 1e9)) & (2**64 - 1)
    parts.append(_TIMES.pack(0, 0, frame.time, frame.exposed or ticks, ticks, frame.sent or ticks))
    parts.append(bytes(8) if version >= SIZED else b"")  # precision time stamp: none
    parts.append(struct.pack("<HI", MODELS_CHANGED if frame.models_changed else 0, 0))
    return encode(Kind.FRAME, b"".join(parts))


def labelled_markers(
    ids: NDArray[np.integer], points: NDArray[np.floating], flags: NDArray[np.integer]
) -> NDArray[np.void]:
    """Markers (n,) for :class:`Frame` from their ``ids`` (n,), ``points`` (n, 3) m and ``flags`` (n,)."""
    markers = np.zeros(len(ids), _LABELLED)
    markers["id"], markers["point"], markers["flags"], markers["size"] = ids, points, flags, 0.014
    return markers


def decode_frame(body: bytes, version: Version) -> Frame:
    """A frame.

    Raises:
        LinkError: its lengths contradict each other.
    """
    data = BodyReader(body)
    number = data.u32("frame number")
    sized = version >= SIZED

    end = _section(data, sized, 5, "marker set")
    sets = tuple((data.text("name of a marker set"), data.points("marker")) for _ in range(end[0]))
    _leave(data, end)
    end = _section(data, sized, 12, "marker")
    others = np.frombuffer(body, "<f4", 3 * end[0], data.skip(12 * end[0], "marker")).reshape(-1, 3)
    _leave(data, end)
    end = _section(data, sized, _RIGID_BODY, "rigid body")
    data.skip(_RIGID_BODY * end[0], "rigid body")
    _leave(data, end)
    end = _section(data, sized, 8, "skeleton")
    for _ in range(0 if end[1] else end[0]):
        data.skip(4, "number of a skeleton")
        data.skip(_RIGID_BODY * data.u32("number of rigid bodies"), "skeleton")
    _leave(data, end)
    if sized:
        end = _section(data, sized, 12, "asset")
        for _ in range(0 if end[1] else end[0]):
            data.skip(4, "number of an asset")
            data.skip(_RIGID_BODY * data.u32("number of rigid bodies"), "asset")
            data.skip(_ASSET_MARKER * data.u32("number of markers"), "asset")
        _leave(data, end)
    labelled = _labelled(data, sized)
    for what in ("force plate", "device"):
        end = _section(data, sized, 8, what)
        for _ in range(0 if end[1] else end[0]):
            data.skip(4, f"number of a {what}")
            for _ in range(data.count(4, "channel")):
                data.skip(4 * data.u32("number of samples"), "channel")
        _leave(data, end)
    return Frame(number, sets, others, labelled, *_suffix(data, version))


def _section(data: BodyReader, sized: bool, least: int, what: str) -> tuple[int, int]:
    """How many there are in a section, and where it ends (0 if it does not say)."""
    if not sized:
        return data.count(least, what), 0
    count, size = COUNT_AND_SIZE.unpack_from(data.data, data.skip(8, what))
    if size > data.left or count * least > (size or data.left):  # some servers write 0 for a size
        raise LinkError(f"{count} x {what} in {size} bytes where {data.left} are left")
    return count, data.at + size if size else 0


def _leave(data: BodyReader, section: tuple[int, int]) -> None:
    """Goes to the end of a section."""
    if section[1]:
        if data.at > section[1]:
            raise LinkError("a section is longer than it says")
        data.at = section[1]


def _labelled(data: BodyReader, sized: bool) -> NDArray[np.void]:
    """Labelled markers; of a later version, which may say more about each, what is known."""
    count, end = _section(data, sized, _LABELLED.itemsize, "labelled marker")
    start, stride = data.at, (end - data.at) // count if end and count else _LABELLED.itemsize
    data.skip(count * stride, "labelled marker")
    _leave(data, (count, end))
    if stride == _LABELLED.itemsize:
        return np.frombuffer(data.data, _LABELLED, count, start)
    rows = np.frombuffer(data.data, np.uint8, count * stride, start).reshape(count, stride)
    return np.ascontiguousarray(rows[:, : _LABELLED.itemsize]).view(_LABELLED)[:, 0]


def _suffix(data: BodyReader, version: Version) -> tuple[float, bool, int, int]:
    """Times and flags at the end of a frame."""
    # Whether 4.0 has a precision time stamp the maker's own clients disagree about: what is left tells.
    precise = version >= (4, 0) and data.left >= _SUFFIX + 8
    _, _, time, exposed, _, sent = _TIMES.unpack_from(data.data, data.skip(_TIMES.size, "time stamps"))
    data.skip(8 if precise else 0, "precision time stamp")
    flags = struct.unpack_from("<H", data.data, data.skip(2, "flags"))[0]
    if not (math.isfinite(time) and abs(time) < 1e10):
        raise LinkError("a frame without a time")
    return time, bool(flags & MODELS_CHANGED), exposed, sent


def z_up(points: NDArray[np.floating]) -> Array:
    """Points (n, 3) with y up as points with z up: (x, y, z) becomes (x, -z, y)."""
    turned = np.empty((len(points), 3))
    turned[:, 0], turned[:, 1], turned[:, 2] = points[:, 0], -points[:, 2], points[:, 1]
    return turned


def y_up(points: NDArray[np.floating]) -> NDArray[np.floating]:
    """The inverse of :func:`z_up`."""
    return np.stack([points[:, 0], points[:, 2], -points[:, 1]], axis=1)
