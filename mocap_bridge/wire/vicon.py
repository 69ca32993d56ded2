"""The Vicon DataStream protocol in bytes, both ways: pure, and shared by the client and the server.

A message is one outer block that holds inner blocks; a block is its kind and its length (both u32, little-endian), then
its body. Lengths and counts are held against the bytes that are there before anything is made of them. On the wire
positions are in mm; here they are in m.

The layout is that of the maker's SDK (MIT), read from its headers:
a segment gives its parent first, and poses are one block a subject.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.wire.errors import LinkError
from highfive.model.geometry.rotations import Array

PORT = 801
"""Where a Vicon system listens."""

TICKS_HZ = 135_000_000
"""Of the clock that frame periods are counted in, Hz."""

LONGEST = 2 * 1024 * 1024
"""Bytes of the longest message that is taken; one of 100 markers has 12 000."""

MOST_BLOCKS = 10_000
"""Blocks of a message that are taken, and names of a list in it."""


class Kind(IntEnum):
    """What a block holds."""

    OBJECTS = 0x1A2B0001
    """The outer block: a message."""
    OBJECT_ENUMS = 100001
    """Kinds that the server offers, or that the client wants."""
    REQUEST_FRAME = 100002
    """The client wants all frames from now on, or one."""
    CONTENTS = 100004
    """What the message holds, and what is as it was."""
    REQUEST_NEXT_FRAME = 100008
    """The client wants so many more frames."""
    STREAM_INFO = 1
    SUBJECT_INFO = 2
    FRAME_INFO = 5
    LABELED_RECONS = 6
    UNLABELED_RECONS = 7
    LOCAL_SEGMENTS = 8
    GLOBAL_SEGMENTS = 9
    LATENCY_INFO = 26
    SUBJECT_TOPOLOGY = 28
    APPLICATION_INFO = 37
    """Which axis points up."""
    FRAME_RATE_INFO = 39
    PING = 42


STATIC = frozenset({Kind.STREAM_INFO, Kind.SUBJECT_INFO, Kind.SUBJECT_TOPOLOGY, Kind.APPLICATION_INFO})
"""Kinds that are sent once, and again when they change."""

HEADER = struct.Struct("<II")
"""Of a block: kind and length of the body."""

_U32, _U64, _F64 = struct.Struct("<I"), struct.Struct("<Q"), struct.Struct("<d")
_PERIOD = struct.Struct("<q")
_SEGMENT = struct.Struct("<II6f")
_POSE = struct.Struct("<II I12d")
_LABELLED = np.dtype(
    [("id", "<u4", 2), ("radius", "<f8"), ("position", "<f8", 3), ("covariance", "<f8", 9), ("trajectory", "<u4")]
)
_UNLABELLED = np.dtype([("radius", "<f8"), ("position", "<f8", 3), ("covariance", "<f8", 9), ("trajectory", "<u4")])
_RADIUS = 7.0  # mm, of a marker that is sent
_ROOT = 1  # number of the one segment that is sent of a subject; 0 stands for no parent


class ViconWireError(LinkError):
    """Bytes that are not of the DataStream protocol."""


@dataclass(frozen=True)
class Subject:
    """A person or an object: its number, its name, and number and name of each of its markers."""

    number: int
    name: str
    markers: tuple[tuple[int, str], ...]


@dataclass(frozen=True)
class Labelled:
    """N points that have a label.

    Attributes:
        ids: (N, 2) uint32, number of the subject, number of the marker.
        points: (N, 3) m, as they came: perhaps not finite.
    """

    ids: NDArray[np.uint32]
    points: Array


@dataclass
class Packet:
    """What one message holds; None, 0 or empty for what it does not.

    Attributes:
        enums: kinds offered by the server, or requested by the client.
        stream: the client wants all frames from now on (True) or one (False).
        more: the client wants so many frames more.
        ping: a number that the server sends back.
        unchanged: kinds that are as they were in the message before.
        period: of a frame, in ticks of :data:`TICKS_HZ`.
        y_up: positions have y up, not z.
        subjects: every subject there is.
        number: of the frame.
        labelled: points with a label; a marker that is not seen is not among them.
        unlabelled: (U, 3) m, points without a label.
        latencies: name and duration, s, of each stage from the cameras to the wire.
        rates: name and frames per second of each stage.
        posed: numbers of the subjects whose root segment is sent, at the origin (written only, not read).
    """

    enums: frozenset[int] | None = None
    stream: bool | None = None
    more: int = 0
    ping: int | None = None
    unchanged: frozenset[int] = frozenset()
    period: int | None = None
    y_up: bool | None = None
    subjects: tuple[Subject, ...] = ()
    number: int | None = None
    labelled: Labelled | None = None
    unlabelled: Array | None = None
    latencies: tuple[tuple[str, float], ...] = ()
    rates: tuple[tuple[str, float], ...] = ()
    posed: tuple[int, ...] = field(default=(), compare=False)


def rate_of(packet: Packet) -> float:
    """Frames a second that a message tells, Hz; 0 where it tells none that makes sense."""
    announced = [TICKS_HZ / packet.period] if packet.period else [rate for _, rate in packet.rates]
    return next((rate for rate in announced if math.isfinite(rate) and 0.1 <= rate <= 1e5), 0.0)


def body_length(header: bytes | bytearray) -> int:
    """Length of the body of the message that starts with ``header`` (8 bytes or more).

    Raises:
        ViconWireError: it is no message of this protocol, or too long a one.
    """
    kind, length = HEADER.unpack_from(header)
    if kind != Kind.OBJECTS:
        raise ViconWireError(
            f"another protocol is spoken there: {bytes(header[:16])!r} came, a DataStream message begins with "
            f"{_U32.pack(Kind.OBJECTS)!r}; correct the port or the protocol"
        )
    if length > LONGEST:
        raise ViconWireError(f"a message of {length} bytes was announced, more than {LONGEST} make no sense")
    return length


def decode(body: bytes) -> Packet:
    """Reads a message, its outer header taken off; blocks of another kind are passed over.

    Raises:
        ViconWireError: lengths or counts contradict each other.
    """
    packet, subjects = Packet(), []
    for kind, start, end in _blocks(body):
        if kind == Kind.SUBJECT_INFO:
            subjects.append(_Reader(body, start, end).subject())
        elif kind in _FIELDS:
            name, read = _FIELDS[kind]
            setattr(packet, name, read(_Reader(body, start, end)))
    packet.subjects = tuple(subjects)
    return packet


def encode(packet: Packet, requested: Iterable[int] | None = None) -> bytes:
    """Writes a message with its outer header; of a frame only the kinds that are ``requested`` (None: all)."""
    blocks = [(kind, body) for kind, body in _bodies(packet) if requested is None or kind in requested]
    if packet.number is not None and (requested is None or Kind.CONTENTS in requested):
        counts: dict[int, int] = {}
        for kind, _ in blocks:
            counts[kind] = counts.get(kind, 0) + 1
        unchanged = packet.unchanged if requested is None else packet.unchanged.intersection(requested)
        table = b"".join(HEADER.pack(kind, counts[kind]) for kind in sorted(counts))
        blocks.insert(0, (Kind.CONTENTS, _U32.pack(len(counts)) + table + _list_of_kinds(unchanged)))
    blocks += _requests(packet)
    body = b"".join(HEADER.pack(kind, len(block)) + block for kind, block in blocks)
    return HEADER.pack(Kind.OBJECTS, len(body)) + body


def _requests(packet: Packet) -> Iterator[tuple[int, bytes]]:
    """Kind and body of each block that belongs to the talk about frames."""
    if packet.enums is not None:
        yield Kind.OBJECT_ENUMS, _list_of_kinds(packet.enums)
    if packet.stream is not None:
        yield Kind.REQUEST_FRAME, bytes([packet.stream])
    if packet.more:
        yield Kind.REQUEST_NEXT_FRAME, _U32.pack(packet.more)
    if packet.ping is not None:
        yield Kind.PING, _U64.pack(packet.ping)


def _bodies(packet: Packet) -> Iterator[tuple[int, bytes]]:
    """Kind and body of each block that belongs to a frame."""
    if packet.period is not None:
        yield Kind.STREAM_INFO, _PERIOD.pack(packet.period)
    if packet.y_up is not None:
        yield Kind.APPLICATION_INFO, bytes([packet.y_up])
    for subject in packet.subjects:
        yield Kind.SUBJECT_INFO, _subject(subject)
    for subject in packet.subjects:
        yield Kind.SUBJECT_TOPOLOGY, _root_pose(subject.number)
    if packet.number is not None:
        yield Kind.FRAME_INFO, _U32.pack(packet.number)
    if packet.latencies:
        yield Kind.LATENCY_INFO, _amounts(packet.latencies)
    if packet.rates:
        yield Kind.FRAME_RATE_INFO, _amounts(packet.rates)
    if packet.labelled is not None:
        items = np.zeros(len(packet.labelled.ids), dtype=_LABELLED)
        items["id"] = packet.labelled.ids
        yield Kind.LABELED_RECONS, _recons(items, packet.labelled.points)
    if packet.unlabelled is not None:
        yield Kind.UNLABELED_RECONS, _recons(np.zeros(len(packet.unlabelled), dtype=_UNLABELLED), packet.unlabelled)
    for number in packet.posed:
        yield Kind.LOCAL_SEGMENTS, _root_pose(number)
    for number in packet.posed:
        yield Kind.GLOBAL_SEGMENTS, _root_pose(number)


def _recons(items: NDArray[np.void], points: Array) -> bytes:
    """A list of points (N, 3), m, each with a trajectory of its own."""
    items["radius"], items["position"], items["trajectory"] = _RADIUS, points * 1e3, np.arange(1, len(items) + 1)
    return _U32.pack(len(items)) + items.tobytes()


def _metres(items: NDArray[np.void]) -> Array:
    """Positions (N, 3) of a list of points, m."""
    if not len(items):
        return np.zeros((0, 3))
    with np.errstate(invalid="ignore"):  # bytes can make a number that stands for an error
        return items["position"] * 1e-3


def _list_of_kinds(kinds: Iterable[int]) -> bytes:
    numbers = sorted(kinds)
    return struct.pack(f"<{len(numbers) + 1}I", len(numbers), *numbers)


def _text(text: str) -> bytes:
    raw = text.encode("utf-8", "replace")
    return _U32.pack(len(raw)) + raw


def _amounts(pairs: tuple[tuple[str, float], ...]) -> bytes:
    return _U32.pack(len(pairs)) + b"".join(_text(name) + _F64.pack(amount) for name, amount in pairs)


def _subject(subject: Subject) -> bytes:
    """A subject with one segment, which all its markers are linked to."""
    segment = _SEGMENT.pack(0, _ROOT, *[0.0] * 6) + _text("root")
    count = _U32.pack(len(subject.markers))
    markers = b"".join(_U32.pack(number) + _text(name) for number, name in subject.markers)
    links = b"".join(HEADER.pack(number, _ROOT) for number, _ in subject.markers)
    return _U32.pack(subject.number) + _text(subject.name) + _U32.pack(1) + segment + count + markers + count + links


def _root_pose(subject: int) -> bytes:
    """The root segment of a subject at the origin, not turned."""
    return _POSE.pack(subject, 1, _ROOT, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def _blocks(body: bytes) -> Iterator[tuple[int, int, int]]:
    """Kind of each block of a message, and where its body begins and ends."""
    at, end = 0, len(body)
    for _ in range(MOST_BLOCKS):
        if at == end:
            return
        if end - at < HEADER.size:
            raise ViconWireError(f"{end - at} bytes are left over at the end of a message")
        kind, length = HEADER.unpack_from(body, at)
        at += HEADER.size
        if length > end - at:
            raise ViconWireError(f"block {kind} says it has {length} bytes, {end - at} are there")
        yield kind, at, at + length
        at += length
    if at != end:
        raise ViconWireError(f"a message has more than {MOST_BLOCKS} blocks")


class _Reader:
    """Values of a block, one after the other; never past its end."""

    __slots__ = ("_at", "_body", "_end")

    def __init__(self, body: bytes, start: int, end: int):
        self._body, self._at, self._end = body, start, end

    def skip(self, length: int) -> int:
        """Passes over some bytes; where they began."""
        if length > self._end - self._at:
            raise ViconWireError(f"a block ends {length - (self._end - self._at)} bytes too early")
        self._at += length
        return self._at - length

    def take(self, length: int) -> bytes:
        """Some bytes."""
        start = self.skip(length)
        return self._body[start : self._at]

    def unpack(self, layout: struct.Struct) -> tuple:
        """Values in a layout."""
        return layout.unpack_from(self._body, self.skip(layout.size))

    def count(self, least: int) -> int:
        """Number of items of a list, each of at least so many bytes."""
        (count,) = self.unpack(_U32)
        if count * least > self._end - self._at:
            raise ViconWireError(f"a list says it has {count} items, {self._end - self._at} bytes cannot hold them")
        return count

    def items(self, layout: np.dtype) -> NDArray[np.void]:
        """A list of records, a view of the message."""
        count = self.count(layout.itemsize)
        return np.frombuffer(self._body, layout, count, self.skip(count * layout.itemsize))

    def labelled(self) -> Labelled:
        """Points with a label."""
        items = self.items(_LABELLED)
        return Labelled(items["id"].copy(), _metres(items))

    def unlabelled(self) -> Array:
        """Points (U, 3) without one, m."""
        return _metres(self.items(_UNLABELLED))

    def unchanged(self) -> frozenset[int]:
        """Of the contents, what is as it was."""
        self.skip(self.count(HEADER.size) * HEADER.size)
        return self.kinds()

    def more(self) -> int:
        """How many frames are requested; old clients do not say, and want one."""
        return self.unpack(_U32)[0] if self._end - self._at >= _U32.size else 1

    def named(self, least: int) -> int:
        """Number of items of a list of names, each with ``least`` bytes beside it."""
        count = self.count(least + _U32.size)
        if count > MOST_BLOCKS:
            raise ViconWireError(f"a list says it has {count} names, more than {MOST_BLOCKS} make no sense")
        return count

    def text(self) -> str:
        """A string; what is not UTF-8 in it is replaced."""
        return self.take(self.count(1)).decode("utf-8", "replace")

    def kinds(self) -> frozenset[int]:
        """A list of kinds."""
        count = self.count(_U32.size)
        return frozenset(np.frombuffer(self._body, "<u4", count, self.skip(count * _U32.size)).tolist())

    def amounts(self) -> tuple[tuple[str, float], ...]:
        """A list of names with a number each."""
        return tuple((self.text(), self.unpack(_F64)[0]) for _ in range(self.named(_F64.size)))

    def subject(self) -> Subject:
        """A subject; its segments are passed over, and what comes after its markers."""
        (number,), name = self.unpack(_U32), self.text()
        for _ in range(self.named(_SEGMENT.size)):
            self.skip(_SEGMENT.size)
            self.text()
        markers = tuple((self.unpack(_U32)[0], self.text()) for _ in range(self.named(_U32.size)))
        return Subject(number, name, markers)


_FIELDS: dict[int, tuple[str, Callable[[_Reader], object]]] = {
    Kind.OBJECT_ENUMS: ("enums", _Reader.kinds),
    Kind.REQUEST_FRAME: ("stream", lambda block: block.take(1) != b"\x00"),
    Kind.REQUEST_NEXT_FRAME: ("more", _Reader.more),
    Kind.PING: ("ping", lambda block: block.unpack(_U64)[0]),
    Kind.CONTENTS: ("unchanged", _Reader.unchanged),
    Kind.STREAM_INFO: ("period", lambda block: block.unpack(_PERIOD)[0]),
    Kind.APPLICATION_INFO: ("y_up", lambda block: block.take(1) == b"\x01"),
    Kind.FRAME_INFO: ("number", lambda block: block.unpack(_U32)[0]),
    Kind.LABELED_RECONS: ("labelled", _Reader.labelled),
    Kind.UNLABELED_RECONS: ("unlabelled", _Reader.unlabelled),
    Kind.LATENCY_INFO: ("latencies", _Reader.amounts),
    Kind.FRAME_RATE_INFO: ("rates", _Reader.amounts),
}
"""Where in a :class:`Packet` a block goes, and how it is read."""
