"""Qualisys' real-time (RT) protocol as bytes, both ways: messages, parameters, frames. Pure; no length is trusted.

A message is its size (u32, itself included), its kind (u32) and a body, all little-endian. Commands and answers are
text that ends with a zero byte. A frame is a time stamp (u64, µs), a number (u32) and components, each with its size.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from xml.etree import ElementTree
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.wire.errors import LinkError
from highfive.model.geometry.rotations import Array

MAX_MESSAGE = 4 << 20
"""A message that says it is longer is refused, bytes: a frame of 1,000 markers has 36,000."""

GREETING = "QTM RT Interface connected"
"""What a server says first."""

_HEADER = struct.Struct("<II")
_DATA = struct.Struct("<QII")
_POINTS = struct.Struct("<IHH")
_DEEPEST = 32  # elements within each other in the parameters
_PREFIXES = {"mm": 1e-3, "millimeters": 1e-3, "cm": 1e-2, "m": 1.0, "meters": 1.0}
# From the axis that points up to z up: which axis becomes x, y and z, and its sign. All are rotations, not mirrors.
_TURNS = {
    "+X": ((1, 2, 0), (1.0, 1.0, 1.0)),
    "-X": ((1, 2, 0), (1.0, -1.0, -1.0)),
    "+Y": ((0, 2, 1), (1.0, -1.0, 1.0)),
    "-Y": ((0, 2, 1), (1.0, 1.0, -1.0)),
    "+Z": ((0, 1, 2), (1.0, 1.0, 1.0)),
    "-Z": ((0, 1, 2), (1.0, -1.0, -1.0)),
}


class Kind(IntEnum):
    """What a message is."""

    ERROR = 0
    COMMAND = 1
    XML = 2
    DATA = 3
    NO_MORE_DATA = 4
    C3D_FILE = 5
    EVENT = 6
    DISCOVER = 7
    QTM_FILE = 8
    NONE = 9


class Event(IntEnum):
    """What happened; those that are used here."""

    CONNECTED = 1
    CAPTURE_STARTED = 3
    RT_FROM_FILE_STARTED = 8
    SETTINGS_CHANGED = 11
    SHUTTING_DOWN = 12


class Component(IntEnum):
    """A part of a frame that holds points."""

    LABELLED = 1
    UNLABELLED = 2
    LABELLED_RESIDUALS = 9
    UNLABELLED_RESIDUALS = 10


_WIDTHS = {
    Component.LABELLED: 12,
    Component.UNLABELLED: 16,
    Component.LABELLED_RESIDUALS: 16,
    Component.UNLABELLED_RESIDUALS: 20,
}  # bytes per point

COMPONENT_NAMES = {
    "3d": Component.LABELLED,
    "3dnolabels": Component.UNLABELLED,
    "3dres": Component.LABELLED_RESIDUALS,
    "3dnolabelsres": Component.UNLABELLED_RESIDUALS,
}
"""How a command names the components."""


@dataclass(frozen=True)
class Data:
    """A frame as it is on the wire.

    Attributes:
        time_us: time stamp, µs.
        number: frame number.
        labelled: (M, 3) in the wire's unit and axes, in the order of the parameters' labels, NaN where a marker is not
            seen; None if there is no such component.
        unlabelled: (U, 3).
    """

    time_us: int
    number: int
    labelled: NDArray[np.float32] | None
    unlabelled: NDArray[np.float32]


@dataclass(frozen=True)
class Parameters:
    """What the system says about its frames.

    Attributes:
        labels: M labels, in the order of the points.
        rate_hz: frames per second; 0 if it does not say.
        unit: of coordinates, m.
        up: the axis that points up: '+X', '-X', and so on.
    """

    labels: tuple[str, ...]
    rate_hz: float = 0.0
    unit: float = 1e-3
    up: str = "+Z"

    def metres(self, points: NDArray[np.floating]) -> Array:
        """Points (n, 3) of the wire in metres, z up."""
        axes, signs = _TURNS[self.up]
        turned = points if self.up == "+Z" else points[:, axes] * np.array(signs)
        return turned.astype(np.float64) * self.unit


def encode(kind: int, body: bytes) -> bytes:
    """A whole message."""
    return _HEADER.pack(_HEADER.size + len(body), kind) + body


def encode_text(kind: int, text: str) -> bytes:
    """A whole message of text: a command, an answer, an error or parameters."""
    return encode(kind, text.encode() + b"\0")


def decode_text(body: bytes) -> str:
    """The text of a message; bytes that are no text become marks."""
    return body.rstrip(b"\0").decode("utf-8", "replace")


def split(buffer: bytearray) -> list[tuple[int, bytes]]:
    """Takes the whole messages, as (kind, body), out of what has come; the rest stays in ``buffer``.

    Raises:
        LinkError: what comes next is no message of this protocol.
    """
    messages, start = [], 0
    while len(buffer) - start >= _HEADER.size:
        size, kind = _HEADER.unpack_from(buffer, start)
        if not _HEADER.size <= size <= MAX_MESSAGE or kind > Kind.NONE:
            raise LinkError(_stranger(bytes(buffer[start : start + 40])))
        if len(buffer) - start < size:
            break
        messages.append((kind, bytes(buffer[start + _HEADER.size : start + size])))
        start += size
    del buffer[:start]
    return messages


def _stranger(sample: bytes) -> str:
    size, kind = struct.unpack_from(">II", sample)
    if _HEADER.size <= size <= MAX_MESSAGE and kind <= Kind.NONE:
        return (
            "this is QTM's port for big-endian numbers; the one for little-endian is 22223 unless QTM's options differ"
        )
    return f"not QTM's real-time protocol: it sent {sample[:16]!r}…; correct the port or the protocol"


def decode_event(body: bytes) -> int:
    """Which event it is.

    Raises:
        LinkError: the message is empty.
    """
    if not body:
        raise LinkError("an event without a number")
    return body[0]


def decode_data(body: bytes) -> Data:
    """A frame.

    Raises:
        LinkError: its lengths contradict each other.
    """
    if len(body) < _DATA.size:
        raise LinkError(f"a frame of {len(body)} bytes; it takes at least {_DATA.size}")
    time_us, number, count = _DATA.unpack_from(body)
    at, found = _DATA.size, {}
    for _ in range(count):  # each takes 8 bytes or more, so that a wrong count ends with the bytes
        if at + _HEADER.size > len(body):
            raise LinkError(f"frame {number} says it has {count} components, and ends after {len(found)} known ones")
        size, kind = _HEADER.unpack_from(body, at)
        if size < _HEADER.size or at + size > len(body):
            raise LinkError(f"frame {number} has a component of {size} bytes where {len(body) - at} are left")
        if kind in _WIDTHS:
            found[kind] = _points(body, at + _HEADER.size, at + size, _WIDTHS[kind])
        at += size
    labelled = found.get(Component.LABELLED_RESIDUALS, found.get(Component.LABELLED))
    loose = found.get(Component.UNLABELLED_RESIDUALS, found.get(Component.UNLABELLED))
    return Data(time_us, number, labelled, np.zeros((0, 3), np.float32) if loose is None else loose)


def _points(body: bytes, start: int, end: int, width: int) -> NDArray[np.float32]:
    """Positions (n, 3) in a component whose body lies from ``start`` to ``end``."""
    if end - start < _POINTS.size:
        raise LinkError("a component of points without their count")
    count = _POINTS.unpack_from(body, start)[0]
    if count * width > end - start - _POINTS.size:
        raise LinkError(f"a component says it has {count} points, its {end - start} bytes cannot hold them")
    words = np.frombuffer(body, "<f4", count * width // 4, start + _POINTS.size)
    return words.reshape(count, width // 4)[:, :3]


def encode_data(
    time_us: int,
    number: int,
    labelled: NDArray[np.float32],
    unlabelled: NDArray[np.float32],
    components: Iterable[Component] = (Component.LABELLED_RESIDUALS, Component.UNLABELLED_RESIDUALS),
) -> bytes:
    """A frame as a whole message: points (M, 3) and (U, 3) in the wire's unit, NaN where a marker is not seen."""
    parts = []
    for component in components:
        points = labelled if component in (Component.LABELLED, Component.LABELLED_RESIDUALS) else unlabelled
        words = np.zeros((len(points), _WIDTHS[component] // 4), "<f4")
        words[:, :3] = points
        if component in (Component.UNLABELLED, Component.UNLABELLED_RESIDUALS):
            words[:, 3] = np.arange(1, len(points) + 1, dtype="<u4").view("<f4")  # each needs a number of its own
        body = _POINTS.pack(len(points), 0, 0) + words.tobytes()
        parts.append(_HEADER.pack(_HEADER.size + len(body), component) + body)
    return encode(Kind.DATA, _DATA.pack(time_us & (2**64 - 1), number & 0xFFFFFFFF, len(parts)) + b"".join(parts))


def encode_parameters(labels: Sequence[str], rate_hz: float, sections: Iterable[str] = ("3d", "general")) -> str:
    """Parameters as XML; ``sections`` as a command names them: '3d', 'general' or 'all', others stay out."""
    requested, parts = set(sections), []
    if requested & {"general", "all"}:
        parts.append(f"<General><Frequency>{rate_hz:g}</Frequency></General>")
    if requested & {"3d", "all"}:
        names = "".join(f"<Label><Name>{escape(name)}</Name><RGBColor>65535</RGBColor></Label>" for name in labels)
        parts.append(f"<The_3D><AxisUpwards>+Z</AxisUpwards><Labels>{len(labels)}</Labels>{names}</The_3D>")
    return f"<QTM_Parameters_Ver_1.25>{''.join(parts)}</QTM_Parameters_Ver_1.25>"


class _Reader:
    """Collects what is needed from the parameters as they are parsed: no tree is built, however deep they are."""

    def __init__(self) -> None:
        self.labels: list[str] = []
        self.values: dict[tuple[str, ...], str] = {}
        self._path: list[str] = []
        self._text: list[str] = []

    def start(self, tag: str, _: dict[str, str]) -> None:
        self._path.append(tag.lower())
        self._text = []
        if len(self._path) > _DEEPEST:
            raise LinkError("parameters with too many elements within each other")

    def data(self, text: str) -> None:
        self._text.append(text)

    def end(self, _: str) -> None:
        path, text = tuple(self._path[1:]), "".join(self._text)
        if path == ("the_3d", "label", "name"):
            self.labels.append(text)
        elif len(path) == 2 and path[0] in ("general", "the_3d"):
            self.values[path] = text.strip()
        self._path.pop()
        self._text = []

    def close(self) -> None:
        """What a parser asks for at the end."""


def decode_parameters(body: bytes) -> Parameters:
    """Parameters from XML; sections other than 3D and general are passed over.

    Raises:
        LinkError: it is not XML, declares entities, or gives a unit or an axis that there is not.
    """
    text, reader = decode_text(body), _Reader()
    if "<!doctype" in text.lower() or "<!entity" in text.lower():
        raise LinkError("parameters that declare entities, which QTM's never do")
    try:
        parser = ElementTree.XMLParser(target=reader)
        parser.feed(text)
        parser.close()
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise LinkError(f"parameters that are not XML ({error}): {text[:40]!r}") from None
    up = reader.values.get(("the_3d", "axisupwards"), "+Z").upper()
    unit = next(
        (reader.values[key] for key in (("the_3d", "unit_length"), ("the_3d", "unit")) if key in reader.values), "mm"
    )
    if up not in _TURNS or unit.lower() not in _PREFIXES:
        raise LinkError(
            f"parameters with the axis {up[:20]!r} up and the unit {unit[:20]!r}; neither other axes nor units than "
            f"{', '.join(_TURNS)} and {', '.join(_PREFIXES)} are known"
        )
    return Parameters(
        tuple(reader.labels), _rate(reader.values.get(("general", "frequency"), "")), _PREFIXES[unit.lower()], up
    )


def _rate(text: str) -> float:
    try:
        rate = float(text)
    except ValueError:
        return 0.0
    return rate if math.isfinite(rate) and 0.0 < rate < 1e5 else 0.0
