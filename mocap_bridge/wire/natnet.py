"""OptiTrack's NatNet protocol 3.0 to 4.x as datagrams, both ways. Pure; no length and no count is trusted.

A datagram is what it is (u16), the size of its body (u16) and the body, little-endian. From 4.1 on each section of a
frame (:mod:`highfive.mocap_bridge.wire.natnet_frame`) and each description
(:mod:`highfive.mocap_bridge.wire.natnet_model`) says its size, by which later versions' additions are passed over.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

from highfive.mocap_bridge.wire.errors import LinkError

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


_HEADER = struct.Struct("<HH")
_INFO = struct.Struct("<256s4B4B")
_INFO_MORE = struct.Struct("<QH?4B")


@dataclass(frozen=True)
class ServerInfo:
    """Who serves: ``version`` of NatNet; ``group`` is the multicast address that frames go to, '' if none is said.

    ``clock_hz`` is the unit of the finer time stamps.
    """

    name: str
    version: Version
    group: str = ""
    data_port: int = 0
    clock_hz: int = 1_000_000_000


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


def encode_server_info(info: ServerInfo) -> bytes:
    """A whole datagram."""
    group = [int(part) for part in info.group.split(".")] if info.group else [0] * 4
    name = info.name.encode()[:255]
    body = _INFO.pack(name, 1, 0, 0, 0, *info.version, 0, 0)
    return encode(Kind.SERVER_INFO, body + _INFO_MORE.pack(info.clock_hz, info.data_port, bool(info.group), *group))


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
    group, data_port, clock_hz = "", 0, 0
    if len(body) >= _INFO.size + _INFO_MORE.size:
        clock_hz, data_port, multicast, *address = _INFO_MORE.unpack_from(body, _INFO.size)
        group = ".".join(map(str, address)) if multicast else ""
    return ServerInfo(name.partition(b"\0")[0].decode("utf-8", "replace"), version, group, data_port, clock_hz)
