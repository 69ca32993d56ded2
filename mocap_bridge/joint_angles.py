"""Angles of the right arm's joints as the International Society of Biomechanics recommends, with their covariance.

Source: Wu et al. 2005, "ISB recommendation on definitions of joint coordinate systems of various joints for the
reporting of human joint motion, part II", J. Biomech. 38(5): 2.4.7 (thoracohumeral, Y–X–Y), 3.4.1 (elbow, Z–X–Y) and
4.4 (wrist, Z–X–Y). ISB axes are x forward, y up and z to the right; ours are x forward, y left and z up.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from mocap_bridge.pose_filter import Chain, State, kinematics, places_doubt
from model.compiled import compiled, compiled_entry
from model.rotations import Array

ANGLES = (
    "plane_of_elevation",
    "elevation",
    "axial_rotation",
    "elbow_flexion",
    "carrying_angle",
    "pronation",
    "wrist_flexion",
    "wrist_deviation",
)
"""Plane of elevation: 0 sideways, 90° forward. Elevation: 0 hanging, positive up (ISB counts it negative). Axial
rotation: positive inward. Pronation: 0 with the palm forward, 90° with the palm at the thigh. Wrist: positive to the
palm's side and to the little finger's."""

BASES = ("thoracic_8", "thoracic_12", "right_clavicle")
"""What the shoulder's angles are relative to: the first of these that a marker set has."""

_STEP = 1e-5  # rad


@dataclass(frozen=True)
class ArmAngles:
    """Angles of the right arm.

    Attributes:
        angles: (8,) rad, in the order of :data:`ANGLES`.
        covariance: (8, 8) rad².
    """

    angles: Float[np.ndarray, "8"]
    covariance: Float[np.ndarray, "8 8"]

    @property
    def deviations(self) -> Array:
        """(8,) rad, standard deviations."""
        return np.sqrt(np.diag(self.covariance))


def arm_segments(names: Sequence[str]) -> tuple[int, int, int, int] | None:
    """Base, upper arm, forearm and hand among the segments of a chain; None where one of them is not there."""
    base = next((name for name in BASES if name in names), None)
    wanted = (base, "right_shoulder", "right_elbow", "right_wrist")
    if any(name not in names for name in wanted):
        return None
    first, second, third, fourth = (names.index(str(name)) for name in wanted)
    return first, second, third, fourth


@compiled_entry
def angles_between(base: Array, upper_arm: Array, forearm: Array, hand: Array) -> Array:
    """Angles (8,), rad, from the segments' orientations (3, 3) in the world, each upright in the zero pose."""
    humerus = _isb(_relative(base, upper_arm))
    # A forearm that hangs with its palm at the thigh is turned inward by 90° from the anatomical position.
    elbow, wrist = _turned_in(_isb(_relative(upper_arm, forearm))), _isb(_relative(forearm, hand))
    result = np.empty(8)
    # Y–X–Y: R = Ry(plane) Rx(-elevation) Ry(axial)
    lift = math.acos(min(max(humerus[1, 1], -1.0), 1.0))
    result[1] = lift
    if math.sin(lift) > 1e-6:
        result[0] = math.atan2(-humerus[0, 1], -humerus[2, 1])
        result[2] = math.atan2(-humerus[1, 0], humerus[1, 2])
    else:  # hanging: only the sum of both turns is defined
        result[0], result[2] = 0.0, math.atan2(humerus[0, 2], humerus[0, 0])
    # Z–X–Y: R = Rz(flexion) Rx(carrying) Ry(pronation)
    result[3] = math.atan2(-elbow[0, 1], elbow[1, 1])
    result[4] = math.asin(min(max(elbow[2, 1], -1.0), 1.0))
    result[5] = math.atan2(-elbow[2, 0], elbow[2, 2])
    # The hand's own frame is the forearm's: flexion is about the axis across the palm, which points forward here.
    result[6] = math.atan2(wrist[2, 1], wrist[1, 1])
    result[7] = math.asin(min(max(wrist[0, 1], -1.0), 1.0))
    return result


@compiled
def _relative(base: Array, segment: Array) -> Array:
    result = np.zeros((3, 3))
    for i in range(3):
        for k in range(3):
            for n in range(3):
                result[i, k] += base[n, i] * segment[n, k]
    return result


@compiled
def _isb(turn: Array) -> Array:
    """A rotation (3, 3) in ISB axes: forward, up, right instead of forward, left, up."""
    axes, signs = (0, 2, 1), (1.0, 1.0, -1.0)
    result = np.empty((3, 3))
    for i in range(3):
        for k in range(3):
            result[i, k] = signs[i] * signs[k] * turn[axes[i], axes[k]]
    return result


@compiled
def _turned_in(turn: Array) -> Array:
    """A rotation (3, 3) after a turn by 90° about its second axis."""
    result = np.empty((3, 3))
    for i in range(3):
        result[i, 0], result[i, 1], result[i, 2] = -turn[i, 2], turn[i, 1], turn[i, 0]
    return result


def arm_angles_of(chain: Chain, state: State, segments: tuple[int, int, int, int]) -> ArmAngles:
    """Angles of the arm whose base, upper arm, forearm and hand are those segments of a chain."""
    pose, axes = kinematics(chain, state.offsets, state.pose)
    base, *_, hand = segments
    # What moves the base moves them all; each segment is moved by what moves the one before it, and more.
    path = chain.path[hand, chain.lengths[base] : chain.lengths[hand]]
    reach = chain.lengths[list(segments)] - chain.lengths[base]
    covariance = np.ascontiguousarray((state.covariance[0] + places_doubt(chain, state))[np.ix_(path, path)])
    return ArmAngles(*angles_with_doubt(pose.frames[list(segments)], axes[path], reach, covariance))


@compiled_entry
def angles_with_doubt(frames: Array, axes: Array, reach: NDArray[np.int64], covariance: Array) -> tuple[Array, Array]:
    """Angles (8,), rad, and their covariance (8, 8), linearised.

    Args:
        frames: (4, 3, 3) orientations of base, upper arm, forearm and hand in the world.
        axes: (K, 3) axes of the hinges beyond the base, in the world.
        reach: (4,) how many of them, from the first, move each segment.
        covariance: (K, K) rad², of the hinges.
    """
    angles = angles_between(frames[0], frames[1], frames[2], frames[3])
    count, moved = len(axes), np.empty((4, 3, 3))
    slopes = np.zeros((8, count))
    for a in range(count):
        for s in range(4):
            moved[s] = _slightly(frames[s], axes[a]) if a < reach[s] else frames[s]
        change = angles_between(moved[0], moved[1], moved[2], moved[3])
        for i in range(8):
            away = change[i] - angles[i]
            slopes[i, a] = (away - 2.0 * math.pi * math.floor(away / (2.0 * math.pi) + 0.5)) / _STEP
    result = np.zeros((8, 8))
    for i in range(8):
        for k in range(8):
            for a in range(count):
                for b in range(count):
                    result[i, k] += slopes[i, a] * covariance[a, b] * slopes[k, b]
    return angles, result


@compiled
def _slightly(frame: Array, axis: Array) -> Array:
    """A frame (3, 3) turned by a very small angle about an axis (3,) in the world."""
    result = np.empty((3, 3))
    for k in range(3):
        x, y, z = frame[0, k], frame[1, k], frame[2, k]
        result[0, k] = x + _STEP * (axis[1] * z - axis[2] * y)
        result[1, k] = y + _STEP * (axis[2] * x - axis[0] * z)
        result[2, k] = z + _STEP * (axis[0] * y - axis[1] * x)
    return result
