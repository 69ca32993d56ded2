"""What a headset's page sends of the person: where head and hands are, and for when.

A message is little endian, :data:`LENGTH` bytes: a head of 24 bytes (:data:`HEAD`); the viewer's position, m, and
quaternion x, y, z, w, in the world (z up); two hands, left and right, of 25 joints × 3 floats, m, in the order of
WebXR's ``XRHand``; and shoulder and elbow of the left and of the right arm, where the browser tracks bodies, 4 × 3
floats, m. Floats are of 32 bits. What no bit of the head says is seen is zero.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from highfive.mocap_bridge.wire.errors import LinkError

KIND, VERSION = 2, 1
"""First and second byte of a message."""
JOINTS = 25
"""Of a hand: the wrist, four of the thumb, five of each finger."""
SIDES = ("left", "right")
LIMBS = ("left_shoulder", "left_elbow", "right_shoulder", "right_elbow")
HEAD = struct.Struct("<BBBBIdII")
"""Kind, version, what is seen (bit 0 the head, bits 1 to 4 :data:`LIMBS`), place, number, holds_ms, and a mask of
joints for each hand."""
_FLOATS = 7 + 2 * JOINTS * 3 + len(LIMBS) * 3
LENGTH = HEAD.size + 4 * _FLOATS

FARTHEST = 20.0
"""m: nothing is further from the origin along an axis."""
LONGEST_ARM = 1.5
"""m: no wrist is further from the eyes."""
LARGEST_HAND = 0.35
"""m: no joint of a hand is further from its wrist."""
_UNIT = 0.01  # a quaternion's length may differ from 1 by so much


@dataclass(frozen=True)
class HeadsetPose:
    """A person who wears a headset, at one time, in the world.

    Attributes:
        number: counts up by one a message.
        place: counts up (modulo 256) as the person is placed in the world anew: what was before lies elsewhere.
        holds_ms: for when it all holds, ms of the host's monotonic clock.
        viewer: (7,) position, m, and quaternion w, x, y, z of the eyes (x right, y up, z backward).
        viewer_seen: the head is tracked.
        hands: (2, 25, 3) m, left and right.
        hands_seen: (2, 25) bool.
        limbs: (4, 3) m, see :data:`LIMBS`.
        limbs_seen: (4,) bool.
    """

    number: int
    place: int
    holds_ms: float
    viewer: Float[np.ndarray, "7"]
    viewer_seen: bool
    hands: Float[np.ndarray, "2 25 3"]
    hands_seen: Bool[np.ndarray, "2 25"]
    limbs: Float[np.ndarray, "4 3"]
    limbs_seen: Bool[np.ndarray, "4"]


def encode_headset(pose: HeadsetPose) -> bytes:
    """As bytes."""
    flags = pose.viewer_seen | sum(2 << i for i in range(len(LIMBS)) if pose.limbs_seen[i])
    masks = [sum(1 << j for j in range(JOINTS) if seen[j]) for seen in pose.hands_seen]
    head = HEAD.pack(
        KIND, VERSION, flags, pose.place % 256, pose.number & 0xFFFFFFFF, pose.holds_ms, masks[0], masks[1]
    )
    viewer = np.concatenate([pose.viewer[:3], pose.viewer[4:], pose.viewer[3:4]])
    floats = np.concatenate([viewer, np.ravel(pose.hands), np.ravel(pose.limbs)])
    return head + floats.astype("<f4").tobytes()


def decode_headset(data: bytes) -> HeadsetPose:
    """From bytes, with everything that is seen where a person can have it.

    Raises:
        LinkError: it is no such message, one of another version, or what it says cannot be.
    """
    if len(data) != LENGTH:
        raise LinkError(f"a headset's message of {len(data)} bytes, expected {LENGTH}")
    kind, version, flags, place, number, holds, *masks = HEAD.unpack_from(data)
    if (kind, version) != (KIND, VERSION):
        raise LinkError(f"a headset's message of kind {kind} and version {version}, expected {KIND} and {VERSION}")
    with np.errstate(invalid="ignore"):  # what is no number is found below
        floats = np.frombuffer(data, "<f4", _FLOATS, HEAD.size).astype(float)
    joints = np.array(masks, dtype=np.uint32)[:, None] >> np.arange(JOINTS, dtype=np.uint32) & 1 == 1
    limbs_seen = np.array([flags >> i + 1 & 1 for i in range(len(LIMBS))], dtype=bool)
    end = 7 + 2 * JOINTS * 3
    hands, limbs = floats[7:end].reshape(2, JOINTS, 3), floats[end:].reshape(-1, 3)
    viewer = floats[[0, 1, 2, 6, 3, 4, 5]]
    _check(holds, viewer, bool(flags & 1), hands, joints, limbs[limbs_seen])
    return HeadsetPose(
        number, place, holds,
        np.where(flags & 1, viewer, [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]), bool(flags & 1),
        np.where(joints[..., None], hands, 0.0), joints, np.where(limbs_seen[:, None], limbs, 0.0), limbs_seen,
    )  # fmt: skip


def _check(
    holds: float, viewer: np.ndarray, viewer_seen: bool, hands: np.ndarray, seen: np.ndarray, limbs: np.ndarray
) -> None:
    if not np.isfinite(holds):
        raise LinkError(f"a headset's pose for {holds} ms, expected a time")
    points = np.concatenate([hands[seen], limbs, viewer[None, :3] if viewer_seen else np.zeros((0, 3))])
    if not (np.abs(points) <= FARTHEST).all():  # NaN is not less than anything
        raise LinkError(f"a headset's point is no number, or further than {FARTHEST:g} m away")
    length = float(np.linalg.norm(viewer[3:]))
    if viewer_seen and not abs(length - 1.0) <= _UNIT:
        raise LinkError(f"the head's quaternion has the length {length:.3g}, expected 1")
    for hand, there in zip(hands, seen, strict=True):
        if there.any() and not there[0]:
            raise LinkError("a hand comes without its wrist")
        if (np.linalg.norm(hand[there] - hand[0], axis=1) > LARGEST_HAND).any():
            raise LinkError(f"a hand has a joint further than {LARGEST_HAND:g} m from its wrist")
        if viewer_seen and there[0] and np.linalg.norm(hand[0] - viewer[:3]) > LONGEST_ARM:
            raise LinkError(f"a wrist is further than {LONGEST_ARM:g} m from the eyes")
