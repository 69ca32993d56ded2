"""Messages between host, server and page: poses in bytes, all else as JSON text.

A pose message is little endian: a head of 40 bytes (:data:`HEAD`), ``bodies`` × 7 floats (position, m, and quaternion
w, x, y, z, in the world, z up), ``markers`` × 3 floats (m), and a byte for each marker: 1 if it was measured. Floats
are of 32 bits.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from highfive.model.errors import HighFiveError

VERSION = 2
"""Of all messages. A page of another version is told to load itself again."""
POSES = 1
"""Kind of a message: the first byte. Text messages begin with ``{``."""
HEAD = struct.Struct("<BBBBIqqqff")
"""Kind, version, bodies, markers, number, holds_ns, captured_ns, sent_ns, rate, time_s."""
_SENT_AT = struct.calcsize("<BBBBIqq")
LONGEST = 60_000
"""Bytes of a message; longer ones are refused."""


@dataclass(frozen=True)
class PoseMessage:
    """Where everything that moves is at one time.

    Attributes:
        number: counts up by one a message; no two of a run have the same.
        holds_ns: for when it is, ns of the host's monotonic clock.
        captured_ns: when the newest frame of markers in it was captured, ns of the same clock; 0 where not known.
        sent_ns: when the server sent it, ns of the same clock; 0 before.
        rate: seconds of the session that pass in a second of the clock: below 1 in slow motion, 0 at a standstill.
        time_s: of the trial.
        bodies: (B, 7) position, m, and quaternion w, x, y, z, in the world.
        markers: (M, 3) m.
        seen: (M,) whether each was measured.
    """

    number: int
    holds_ns: int
    captured_ns: int
    sent_ns: int
    rate: float
    time_s: float
    bodies: Float[np.ndarray, "B 7"]
    markers: Float[np.ndarray, "M 3"]
    seen: Bool[np.ndarray, " M"]

    def numbered(self, number: int) -> PoseMessage:
        """The same with that number."""
        return replace(self, number=number)


def encode_poses(message: PoseMessage) -> bytes:
    """As bytes."""
    head = HEAD.pack(
        POSES, VERSION, len(message.bodies), len(message.markers), message.number & 0xFFFFFFFF,
        message.holds_ns, message.captured_ns, message.sent_ns, message.rate, message.time_s,
    )  # fmt: skip
    floats = np.concatenate([np.ravel(message.bodies), np.ravel(message.markers)]).astype("<f4")
    return head + floats.tobytes() + np.asarray(message.seen, dtype=np.uint8).tobytes()


def decode_poses(data: bytes) -> PoseMessage:
    """From bytes.

    Raises:
        HighFiveError: it is no such message, or one of another version.
    """
    if len(data) < HEAD.size:
        raise HighFiveError(f"a pose message of {len(data)} bytes; its head alone has {HEAD.size}")
    kind, version, bodies, markers, number, holds, captured, sent, rate, time_s = HEAD.unpack_from(data)
    if (kind, version) != (POSES, VERSION):
        raise HighFiveError(f"a message of kind {kind} and version {version}, expected {POSES} and {VERSION}")
    expected = HEAD.size + 28 * bodies + 13 * markers
    if len(data) != expected:
        raise HighFiveError(f"a pose message of {len(data)} bytes; its head says {expected}")
    floats = np.frombuffer(data, "<f4", 7 * bodies + 3 * markers, HEAD.size).astype(float)
    seen = np.frombuffer(data, np.uint8, markers, expected - markers) != 0
    split = 7 * bodies
    return PoseMessage(
        number, holds, captured, sent, rate, time_s,
        floats[:split].reshape(-1, 7), floats[split:].reshape(-1, 3), seen,
    )  # fmt: skip


def number_of(data: bytes) -> int:
    """Number of an encoded message."""
    return int.from_bytes(data[4:8], "little")


def stamped(data: bytes, sent_ns: int) -> bytes:
    """The same message, with the time at which it was sent."""
    return data[:_SENT_AT] + struct.pack("<q", sent_ns) + data[_SENT_AT + 8 :]


def encode_text(kind: str, **fields: Any) -> str:
    """A text message. Numbers that JSON cannot hold are null."""
    return json.dumps(_finite({"kind": kind, **fields}), separators=(",", ":"), allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(name): _finite(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    if isinstance(value, float | np.floating):
        return round(float(value), 6) if np.isfinite(value) else None
    if isinstance(value, np.ndarray):
        return _finite(value.tolist())
    return value.item() if isinstance(value, np.generic) else value
