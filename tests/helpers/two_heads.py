"""A head that nods and turns, as a headset's messages and as a motion capture recording, with the truth beside."""

from dataclasses import dataclass

import numpy as np

from highfive.mocap_bridge.files.recording import Recording, make_recording
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.wire.headset import JOINTS, HeadsetPose, encode_headset
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

SPACE = rotations.from_rotation_vector([0.0, 0.0, 2.4]), np.array([0.8, -1.3, 0.02])
"""Truth: from the headset's space (z up) to the system's frame."""
EYES = rotations.from_rotation_vector([1.3, -0.4, 0.7]), np.array([0.09, 0.01, 0.08])
"""Truth: the eyes in the head's body."""
HAND = np.array([0.3, 0.4, 1.2])
"""(3,) m, in the headset's space: where it has to be right."""


@dataclass(frozen=True)
class Moves:
    """How far, rad, the head nods and turns."""

    nod: float = 0.35
    turn: float = 0.6


def head_at(t: Array, moves: Moves) -> tuple[Array, Array]:
    """The eyes (T, 4) and (T, 3), m, in the headset's space, at times (T,), s; periodic over 20 s."""
    w = 2.0 * np.pi / 20.0
    nod, turn = moves.nod * np.sin(7 * w * t), moves.turn * np.sin(4 * w * t + 0.4)
    tilt = 0.1 * min(moves.nod, moves.turn) * np.sin(2 * w * t)
    q = rotations.multiply(
        rotations.from_axis_angle("z", turn),
        rotations.multiply(rotations.from_axis_angle("x", nod + 0.5 * np.pi), rotations.from_axis_angle("z", tilt)),
    )
    neck = np.array([0.0, 0.0, 1.55]) + 0.02 * np.stack([np.sin(3 * w * t), np.sin(5 * w * t), np.sin(4 * w * t)], -1)
    return q, neck + rotations.rotate(q, [0.0, 0.09, -0.09])


def recording(marker_set: MarkerSet, moves: Moves, seed: int = 0, space=SPACE) -> Recording:
    """20 s at 120 Hz; what is not on the head stands still."""
    rng, t = np.random.default_rng(seed), np.arange(2400) / 120.0
    q, p = head_at(t, moves)
    body_q = rotations.multiply(rotations.multiply(space[0], q), rotations.conjugate(EYES[0]))
    body_p = rotations.rotate(space[0], p) + space[1] - rotations.rotate(body_q, EYES[1])
    local = marker_set.local_positions
    points = np.tile(local + np.array([1.0, 0.2, 1.0]), (len(t), 1, 1))
    for row in marker_set.indices(marker_set.arm.head):
        points[:, row] = body_p + rotations.rotate(body_q, local[row])
    points += rng.normal(0.0, 0.0004, points.shape)
    return make_recording(120.0, marker_set.names, points, np.ones(points.shape[:2], dtype=bool))


def messages(
    begins_ns: int, seconds: float, moves: Moves, *, late_s: float = 0.035, seed: int = 0, lost: float = 0.0,
    recentred_s: float = np.inf, space=None,
) -> list[tuple[int, bytes]]:  # fmt: skip
    """When each comes, ns, and what: 72 a second, of the motion that begins at ``begins_ns``; a share of them is lost.

    They hold ``late_s`` later than they say; ``space`` is where the headset's is drawn instead of its own.
    """
    rng, t = np.random.default_rng(seed), np.arange(0.0, seconds, 1.0 / 72.0)
    q, p = head_at(t, moves)
    if space is not None:
        q, p = rotations.multiply(space[0], q), rotations.rotate(space[0], p) + space[1]
    q = rotations.multiply(rotations.from_rotation_vector(rng.normal(0.0, 0.003, p.shape)), q)
    p = p + rng.normal(0.0, 0.0015, p.shape)
    found = []
    for number, time in enumerate(t):
        pose = HeadsetPose(
            number, int(time > recentred_s), 1e-6 * begins_ns + 1e3 * (time + late_s),
            np.concatenate([p[number], q[number]]), bool(rng.random() >= lost),
            np.zeros((2, JOINTS, 3)), np.zeros((2, JOINTS), dtype=bool), np.zeros((4, 3)), np.zeros(4, dtype=bool),
        )  # fmt: skip
        found.append((begins_ns + round(1e9 * (time + 0.005)), encode_headset(pose)))
    return found
