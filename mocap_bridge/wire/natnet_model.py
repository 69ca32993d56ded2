"""NatNet's descriptions of what is tracked, both ways: marker sets, and the numbers of assets."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field

from highfive.mocap_bridge.wire.errors import LinkError
from highfive.mocap_bridge.wire.natnet import SIZED, Kind, Version, encode
from highfive.mocap_bridge.wire.natnet_bytes import BodyReader


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
    data, sets, ids = BodyReader(body), [], {}
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


def _marker_set(data: BodyReader) -> MarkerSet:
    name = data.text("name of a marker set")
    count = data.count(1, "marker")
    return MarkerSet(name, tuple(data.text("name of a marker") for _ in range(count)))


def _skip_rest(data: BodyReader, kind: int, version: Version) -> None:
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


def _skip_rigid_body(data: BodyReader, version: Version) -> None:
    data.skip(16 + (16 if version >= (4, 2) else 0), "pose of a rigid body")
    count = data.count(16, "marker of a rigid body")
    data.skip(16 * count, "marker of a rigid body")
    if version >= (4, 0):
        for _ in range(count):
            data.text("name of a marker")


def _skip_other(data: BodyReader, kind: int) -> None:
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
