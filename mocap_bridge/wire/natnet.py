"""OptiTrack's NatNet protocol 3.0 to 4.x as datagrams, both ways. Pure; no length and no count is trusted.

A datagram is what it is (u16), the size of its body (u16) and the body, little-endian. From 4.1 on each section of a
frame and each description says its size, by which later versions' additions are passed over.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.wire.errors import LinkError
from highfive.model.geometry.rotations import Array

MAX_DATAGRAM = 65_507
"""What UDP can carry at most, bytes."""

OLDEST = (3, 0)
"""Versions before are not read; they have no residuals and other rigid bodies."""

NEWEST_MAJOR = 4
"""Main versions after are not read."""

SIZED = (4, 1)
"""From this version on sections say their size."""

Version = tuple[int, int]


class Kind(IntEnum):
    """What a datagram is."""

    CONNECT = 0
    SERVER_INFO = 1
    REQUEST = 2
    RESPONSE = 3
    REQUEST_MODEL = 4
    MODEL = 5
    REQUEST_FRAME = 6
    FRAME = 7
    MESSAGE = 8
    DISCONNECT = 9
    KEEP_ALIVE = 10
    UNRECOGNISED = 100


OCCLUDED, MEASURED, FILLED, HAS_MODEL, UNLABELLED = 0x01, 0x02, 0x04, 0x08, 0x10
"""Bits of a labelled marker: not seen; from the cameras; from the asset's shape; belongs to an asset; without label."""

MODELS_CHANGED = 0x02
"""Bit of a frame: ask for the descriptions again."""

_HEADER = struct.Struct("<HH")
_U32, _COUNT_AND_SIZE = struct.Struct("<I"), struct.Struct("<II")
_INFO = struct.Struct("<256s4B4B")
_INFO_MORE = struct.Struct("<QH?4B")
_TIMES = struct.Struct("<IIdQQQ")
_RIGID_BODY = 38  # bytes in a frame
_ASSET_MARKER = 26
_LABELLED = np.dtype([("id", "<u4"), ("point", "<f4", 3), ("size", "<f4"), ("flags", "<u2"), ("residual", "<f4")])
_SUFFIX = 42  # bytes without the precision time stamp and the end mark


@dataclass(frozen=True)
class ServerInfo:
    """Who serves: ``version`` of NatNet; ``group`` is the multicast address that frames go to, '' if none is said."""

    name: str
    version: Version
    group: str = ""
    data_port: int = 0


@dataclass(frozen=True)
class MarkerSet:
    """Description of a set: its markers' names, in the order of the points."""

    name: str
    markers: tuple[str, ...]


@dataclass(frozen=True)
class Model:
    """Descriptions of what is tracked.

    Attributes:
        sets: marker sets; a set named 'all' holds the markers of every asset.
        ids: the number of each rigid body, skeleton and asset, by name; its marker set has the same name.
    """

    sets: tuple[MarkerSet, ...]
    ids: dict[str, int] = field(default_factory=dict)


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
    """

    number: int
    sets: tuple[tuple[str, NDArray[np.float32]], ...]
    others: NDArray[np.float32]
    labelled: NDArray[np.void]
    time: float
    models_changed: bool = False


class _Bytes:
    """Reads a body from front to back; what is not there is an error before anything is made of it."""

    def __init__(self, data: bytes):
        self.data, self.at, self.end = data, 0, len(data)

    @property
    def left(self) -> int:
        return self.end - self.at

    def skip(self, count: int, what: str) -> int:
        """Goes on by ``count`` bytes; where it was."""
        start = self.at
        if not 0 <= count <= self.end - start:
            raise LinkError(f"{what} takes {count} bytes where {self.left} are left")
        self.at = start + count
        return start

    def count(self, size: int, what: str) -> int:
        """A number of things of at least ``size`` bytes each."""
        count = self.u32(what)
        if count * size > self.left:
            raise LinkError(f"{count} x {what} take at least {count * size} bytes where {self.left} are left")
        return count

    def u32(self, what: str) -> int:
        return _U32.unpack_from(self.data, self.skip(4, what))[0]

    def text(self, what: str) -> str:
        stop = self.data.find(b"\0", self.at, self.end)
        if stop < 0:
            raise LinkError(f"{what} without an end")
        text = self.data[self.at : stop].decode("utf-8", "replace")
        self.at = stop + 1
        return text

    def points(self, what: str) -> NDArray[np.float32]:
        """A count, and so many positions (n, 3)."""
        count = self.count(12, what)
        return np.frombuffer(self.data, "<f4", 3 * count, self.skip(12 * count, what)).reshape(count, 3)


def encode(kind: int, body: bytes = b"") -> bytes:
    """A whole datagram.

    Raises:
        LinkError: it is longer than a datagram can be.
    """
    if len(body) + _HEADER.size > MAX_DATAGRAM:
        raise LinkError(f"{len(body)} bytes are more than a datagram holds; stream fewer markers")
    return _HEADER.pack(kind, len(body)) + body


def encode_request(kind: Kind, text: str = "") -> bytes:
    """What a client sends."""
    return encode(kind, text.encode() + b"\0")


def decode(datagram: bytes) -> tuple[int, bytes]:
    """What a datagram is, and its body.

    Raises:
        LinkError: it is no NatNet, or cut short.
    """
    if len(datagram) < _HEADER.size:
        raise LinkError(f"not NatNet: it sent {datagram!r}")
    kind, size = _HEADER.unpack_from(datagram)
    if (kind > Kind.KEEP_ALIVE and kind != Kind.UNRECOGNISED) or size > len(datagram) - _HEADER.size:
        raise LinkError(f"not NatNet, or cut short: it sent {datagram[:40]!r}")
    return kind, datagram[_HEADER.size : _HEADER.size + size]


def encode_server_info(info: ServerInfo, clock_hz: int = 1_000_000_000) -> bytes:
    """A whole datagram; ``clock_hz`` is the unit of the finer time stamps."""
    group = [int(part) for part in info.group.split(".")] if info.group else [0] * 4
    name = info.name.encode()[:255]
    body = _INFO.pack(name, 1, 0, 0, 0, *info.version, 0, 0)
    return encode(Kind.SERVER_INFO, body + _INFO_MORE.pack(clock_hz, info.data_port, bool(info.group), *group))


def decode_server_info(body: bytes) -> ServerInfo:
    """Who serves.

    Raises:
        LinkError: it is too short, or of a version that is not read.
    """
    if len(body) < _INFO.size:
        raise LinkError(f"a server's description of {len(body)} bytes; it takes at least {_INFO.size}")
    name, *numbers = _INFO.unpack_from(body)
    version = (numbers[4], numbers[5])
    if not (version >= OLDEST and version[0] <= NEWEST_MAJOR):
        raise LinkError(
            f"it speaks NatNet {version[0]}.{version[1]}; {OLDEST[0]}.{OLDEST[1]} to {NEWEST_MAJOR}.x are read here: "
            "choose another version in Motive, or another Motive"
        )
    group, data_port = "", 0
    if len(body) >= _INFO.size + _INFO_MORE.size:
        _, data_port, multicast, *address = _INFO_MORE.unpack_from(body, _INFO.size)
        group = ".".join(map(str, address)) if multicast else ""
    return ServerInfo(name.partition(b"\0")[0].decode("utf-8", "replace"), version, group, data_port)


def encode_model(sets: Sequence[MarkerSet], version: Version) -> bytes:
    """Descriptions of marker sets as a whole datagram."""
    parts = [struct.pack("<I", len(sets))]
    for one in sets:
        body = one.name.encode() + b"\0" + struct.pack("<I", len(one.markers))
        body += b"".join(name.encode() + b"\0" for name in one.markers)
        parts.append(struct.pack("<I", 0) + (struct.pack("<I", len(body)) if version >= SIZED else b"") + body)
    return encode(Kind.MODEL, b"".join(parts))


def decode_model(body: bytes, version: Version) -> Model:
    """Descriptions of what is tracked; those of devices and the like are passed over.

    Raises:
        LinkError: its lengths contradict each other, or it has a description that says neither what nor how long it is.
    """
    data, sets, ids = _Bytes(body), [], {}
    for _ in range(data.count(4, "description")):
        kind = data.u32("kind of a description")
        size = data.u32("size of a description") if version >= SIZED else 0
        start = data.at
        if size > data.left:
            raise LinkError(f"a description takes {size} bytes where {data.left} are left")
        data.end = start + size if size else len(body)
        if kind == 0:
            sets.append(_marker_set(data))
        elif kind in (1, 2, 6):
            name = data.text("name")
            data.skip(4 if kind == 6 else 0, "kind of an asset")
            ids[name] = data.u32("number")
            if not size:
                _skip_rest(data, kind, version)
        elif not size:
            _skip_other(data, kind)
        data.end = len(body)
        data.at = start + size if size else data.at
    return Model(tuple(sets), ids)


def _marker_set(data: _Bytes) -> MarkerSet:
    name = data.text("name of a marker set")
    count = data.count(1, "marker")
    return MarkerSet(name, tuple(data.text("name of a marker") for _ in range(count)))


def _skip_rest(data: _Bytes, kind: int, version: Version) -> None:
    """Passes over what follows name and number of a rigid body, a skeleton or an asset that has no size."""
    if kind == 1:
        _skip_rigid_body(data, version)
        return
    for _ in range(data.count(25, "rigid body")):
        data.text("name")
        data.skip(4, "number")
        _skip_rigid_body(data, version)
    if kind == 6:
        for _ in range(data.count(23, "marker")):
            data.text("name")
            data.skip(22, "marker of an asset")


def _skip_rigid_body(data: _Bytes, version: Version) -> None:
    data.skip(16 + (16 if version >= (4, 2) else 0), "pose of a rigid body")
    count = data.count(16, "marker of a rigid body")
    data.skip(16 * count, "marker of a rigid body")
    if version >= (4, 0):
        for _ in range(count):
            data.text("name of a marker")


def _skip_other(data: _Bytes, kind: int) -> None:
    """Passes over a force plate, a device or a camera that has no size."""
    if kind == 3:
        data.skip(4, "number of a force plate")
        data.text("serial number")
        data.skip(20 + 4 * 144 + 4 * 12 + 8, "shape of a force plate")
    elif kind == 4:
        data.skip(4, "number of a device")
        data.text("name")
        data.text("serial number")
        data.skip(8, "kind of a device")
    elif kind == 5:
        data.text("name")
        data.skip(28, "pose of a camera")
        return
    else:
        raise LinkError(f"a description of kind {kind}, which is not known and has no size")
    for _ in range(data.count(1, "channel")):
        data.text("name of a channel")


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
    parts.append(_TIMES.pack(0, 0, frame.time, ticks, ticks, ticks))
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
    data = _Bytes(body)
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


def _section(data: _Bytes, sized: bool, least: int, what: str) -> tuple[int, int]:
    """How many there are in a section, and where it ends (0 if it does not say)."""
    if not sized:
        return data.count(least, what), 0
    count, size = _COUNT_AND_SIZE.unpack_from(data.data, data.skip(8, what))
    if size > data.left or count * least > (size or data.left):  # some servers write 0 for a size
        raise LinkError(f"{count} x {what} in {size} bytes where {data.left} are left")
    return count, data.at + size if size else 0


def _leave(data: _Bytes, section: tuple[int, int]) -> None:
    """Goes to the end of a section."""
    if section[1]:
        if data.at > section[1]:
            raise LinkError("a section is longer than it says")
        data.at = section[1]


def _labelled(data: _Bytes, sized: bool) -> NDArray[np.void]:
    """Labelled markers; of a later version, which may say more about each, what is known."""
    count, end = _section(data, sized, _LABELLED.itemsize, "labelled marker")
    start, stride = data.at, (end - data.at) // count if end and count else _LABELLED.itemsize
    data.skip(count * stride, "labelled marker")
    _leave(data, (count, end))
    if stride == _LABELLED.itemsize:
        return np.frombuffer(data.data, _LABELLED, count, start)
    rows = np.frombuffer(data.data, np.uint8, count * stride, start).reshape(count, stride)
    return np.ascontiguousarray(rows[:, : _LABELLED.itemsize]).view(_LABELLED)[:, 0]


def _suffix(data: _Bytes, version: Version) -> tuple[float, bool]:
    """Time and flags at the end of a frame."""
    # Whether 4.0 has a precision time stamp the maker's own clients disagree about: what is left tells.
    precise = version >= (4, 0) and data.left >= _SUFFIX + 8
    _, _, time, *_ = _TIMES.unpack_from(data.data, data.skip(_TIMES.size, "time stamps"))
    data.skip(8 if precise else 0, "precision time stamp")
    flags = struct.unpack_from("<H", data.data, data.skip(2, "flags"))[0]
    if not (math.isfinite(time) and abs(time) < 1e10):
        raise LinkError("a frame without a time")
    return time, bool(flags & MODELS_CHANGED)


def z_up(points: NDArray[np.floating]) -> Array:
    """Points (n, 3) with y up as points with z up: (x, y, z) becomes (x, -z, y)."""
    turned = np.empty((len(points), 3))
    turned[:, 0], turned[:, 1], turned[:, 2] = points[:, 0], -points[:, 2], points[:, 1]
    return turned


def y_up(points: NDArray[np.floating]) -> NDArray[np.floating]:
    """The inverse of :func:`z_up`."""
    return np.stack([points[:, 0], points[:, 2], -points[:, 1]], axis=1)
