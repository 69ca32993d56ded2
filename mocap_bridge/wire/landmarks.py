"""What a page that watches its camera sends: landmarks of a person and her hands in one picture. Little endian.

A head of 28 bytes (:data:`HEAD`), then, if a person was found, :data:`POSE` × 6 floats (x and y as shares of width and
height, how sure it is that it can be seen, and x, y, z in metres about the hips, as the net says), then for each hand
its score and :data:`HAND` × 5 floats (x, y, and metres about the hand's middle). Floats are of 32 bits. The picture is
as the camera has it, not mirrored. Names and order of the landmarks: MediaPipe, BlazePose and Hands.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from highfive.mocap_bridge.wire.errors import LinkError

KIND, VERSION = 3, 1
"""First bytes of the message; other kinds are other messages."""
HEAD = struct.Struct("<BBBBIdHHd")
"""Kind, version, persons (0, 1, or 2 where another one is in view), hands, number, captured_ms, width, height, and
milliseconds from capture to sending."""
POSE, HAND, MOST_HANDS = 25, 21, 4
_FAR = (3.0, 10.0)
"""Largest share of a picture and largest length, m, that can be meant."""
_SIZES = 16, 8192  # pixels of a side


@dataclass(frozen=True)
class HandLandmarks:
    """One hand.

    Attributes:
        score: how sure it is that this is a hand, 0 to 1.
        picture: (21, 2) shares of width and height.
        world: (21, 3) m, x to the right, y down, z away from the camera, about the hand's middle.
    """

    score: float
    picture: Float[np.ndarray, "21 2"]
    world: Float[np.ndarray, "21 3"]


@dataclass(frozen=True)
class Landmarks:
    """What was found in one picture.

    Attributes:
        number: of the picture, counting up.
        captured_ms: when it was taken, ms of the host's monotonic clock as the page knows it.
        took_ms: from then until it was sent.
        size: width and height, pixels.
        persons: in view: 0, 1, or 2 for several.
        picture: (25, 2) shares of width and height; None without a person.
        visibility: (25,) how sure each is in view, 0 to 1; None likewise.
        world: (25, 3) m, x to the right, y down, z away from the camera, about the hips; None likewise.
        hands: whoever's they are.
    """

    number: int
    captured_ms: float
    took_ms: float
    size: tuple[int, int]
    persons: int
    picture: Float[np.ndarray, "25 2"] | None
    visibility: Float[np.ndarray, " 25"] | None
    world: Float[np.ndarray, "25 3"] | None
    hands: tuple[HandLandmarks, ...] = ()


def encode_landmarks(found: Landmarks) -> bytes:
    """As bytes."""
    there = found.picture is not None
    head = HEAD.pack(
        KIND, VERSION, max(found.persons, 1) if there else 0, len(found.hands), found.number & 0xFFFFFFFF,
        found.captured_ms, *found.size, found.took_ms,
    )  # fmt: skip
    parts = [head]
    if found.picture is not None and found.visibility is not None and found.world is not None:
        rows = np.hstack([found.picture, found.visibility[:, None], found.world])
        parts.append(rows.astype("<f4").tobytes())
    for hand in found.hands:
        parts.append(struct.pack("<f", hand.score))
        parts.append(np.hstack([hand.picture, hand.world]).astype("<f4").tobytes())
    return b"".join(parts)


def decode_landmarks(data: bytes) -> Landmarks:
    """From bytes.

    Raises:
        LinkError: it is no such message, one of another version, or its numbers cannot be meant.
    """
    if len(data) < HEAD.size:
        raise LinkError(f"landmarks of {len(data)} bytes; their head alone has {HEAD.size}")
    kind, version, persons, hands, number, captured_ms, width, height, took_ms = HEAD.unpack_from(data)
    if kind != KIND or version != VERSION:
        raise LinkError(f"landmarks of kind {kind}, version {version}; expected {KIND} and {VERSION}: reload the page")
    if persons > 2 or hands > MOST_HANDS:
        raise LinkError(f"landmarks of {persons} persons and {hands} hands; expected up to 2 and {MOST_HANDS}")
    length = HEAD.size + 4 * (6 * POSE * (persons > 0) + hands * (1 + 5 * HAND))
    if len(data) != length:
        raise LinkError(f"landmarks of {len(data)} bytes; expected {length}")
    if not all(_SIZES[0] <= side <= _SIZES[1] for side in (width, height)):
        raise LinkError(f"landmarks in a picture of {width} × {height} pixels")
    if not (0.0 <= captured_ms < 1e15 and 0.0 <= took_ms < 1e5):
        raise LinkError(f"landmarks captured at {captured_ms} ms, sent {took_ms} ms later")
    raw = np.frombuffer(data, "<f4", offset=HEAD.size)
    if not np.isfinite(raw).all():  # before they are made longer: a signalling NaN would warn
        raise LinkError("landmarks that are no numbers")
    values = raw.astype(float)
    picture = visibility = world = None
    if persons:
        rows = values[: 6 * POSE].reshape(POSE, 6)
        picture, visibility, world = rows[:, :2], rows[:, 2], rows[:, 3:]
        _check(picture, world, visibility)
    found = []
    for block in values[6 * POSE * (persons > 0) :].reshape(hands, 1 + 5 * HAND):
        rows = block[1:].reshape(HAND, 5)
        _check(rows[:, :2], rows[:, 2:], block[:1])
        found.append(HandLandmarks(float(block[0]), rows[:, :2], rows[:, 2:]))
    return Landmarks(
        number, captured_ms, took_ms, (width, height), persons, picture, visibility, world, tuple(found)
    )  # fmt: skip


def _check(picture: np.ndarray, world: np.ndarray, sure: np.ndarray) -> None:
    if np.abs(picture).max() > _FAR[0] or np.abs(world).max() > _FAR[1] or sure.min() < 0.0 or sure.max() > 1.001:
        raise LinkError("landmarks too far away, or surer than sure")
