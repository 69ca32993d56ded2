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

from highfive.mocap_bridge.tracking.arm_look import ArmModel, base_covariance, looked, sharpened, tracking_covariance
from highfive.mocap_bridge.tracking.chain_kinematics import Chain, kinematics
from highfive.mocap_bridge.tracking.filter_settings import ALIKE, NEVER
from highfive.mocap_bridge.tracking.pose_filter import State, consider_covariance
from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry.rotations import Array

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

USUAL = tuple(math.radians(degrees) for degrees in (70.0, 50.0, 57.0, 57.0, 8.0, 46.0, 40.0, 29.0))
"""Standard deviation of each angle over people and poses, rad: what is known of it before looking."""

ENOUGH_BITS = 1.0
"""What looking must tell of an angle at least: a bit is half of the standard deviation that it has before."""

_STEP = 1e-5  # rad
_CARRYING, _FLEXION = ANGLES.index("carrying_angle"), ANGLES.index("elbow_flexion")
_BY_MARKERS = np.arange(len(ANGLES)) != _CARRYING  # what is known before looking is not in their deviations

_DECIDES = [ANGLES.index(name) for name in ("elevation",) * 3 + ("elbow_flexion",) * 3 + ("wrist_flexion",) * 2]
"""The angle of the same joint without which each of them says no more than what people are like."""


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

    @property
    def bits(self) -> Array:
        """(8,) what looking tells of each angle: how often its standard deviation has been halved."""
        ratio = np.square(np.array(USUAL) / self.deviations)
        return 0.5 * np.log2(np.where(_BY_MARKERS, 1.0 + ratio, ratio))

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(8,) the angle is observable from the markers, and not by what people are like."""
        observable = self.bits >= ENOUGH_BITS
        return observable & observable[_DECIDES]


def arm_segments(names: Sequence[str]) -> tuple[int, int, int, int] | None:
    """Base, upper arm, forearm and hand among the segments of a chain; None where one of them is not there."""
    base = next((name for name in BASES if name in names), None)
    required = (base, "right_shoulder", "right_elbow", "right_wrist")
    if any(name not in names for name in required):
        return None
    first, second, third, fourth = (names.index(str(name)) for name in required)
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


def arm_angles_of(
    chain: Chain, arm: ArmModel, state: State, tracked: Array, seen: NDArray[np.bool_], noise: Array = ALIKE
) -> ArmAngles:
    """Angles of the right arm of a chain.

    Args:
        chain: the skeleton.
        arm: its right arm.
        state: after a frame.
        tracked: (M, 3) m, the markers in that frame.
        seen: (M,) those that were measured, and believed.
        noise: (M, 3, 3) m², covariance of the measured points; without rows all have the settings'.
    """
    pose, axes = kinematics(chain, state.offsets, state.pose)
    base, limb, markers = int(arm.segments[0]), arm.segments[1:], arm.markers
    deviations = np.full(len(markers), chain.settings.marker_sigma)
    if len(noise):
        deviations = np.sqrt(noise[markers].diagonal(axis1=1, axis2=2).max(axis=1))
    look = looked(
        arm, pose.centres[limb[0]], pose.frames[limb], state.offsets[limb[1:]], state.homes[markers],
        sharpened(deviations, tracked[markers], state.last[markers], seen[markers]),
        state.ages[markers] != NEVER,
        tracking_covariance(chain, arm, axes, state.covariance[0]),
    )  # fmt: skip
    frames = np.concatenate([pose.frames[base : base + 1], look.frames])
    turned = np.zeros((11, 11))
    turned[:3, :3], turned[3:, 3:] = (
        base_covariance(chain, arm, axes, consider_covariance(chain, state)),
        look.covariance,
    )
    angles, covariance = angles_with_covariance(frames, turned)
    # Beyond the first order: a carrying angle that is not known takes from the flexion, whichever way it goes.
    bend, aside = angles[_FLEXION], math.sqrt(covariance[_CARRYING, _CARRYING])
    taken = abs(bend) - math.acos(min(math.cos(bend) / max(math.cos(aside), 1e-6), 1.0))
    covariance[_FLEXION, _FLEXION] += taken**2
    return ArmAngles(angles, covariance)


@compiled_entry
def angles_with_covariance(frames: Array, covariance: Array) -> tuple[Array, Array]:
    """Angles (8,), rad, and their covariance (8, 8), linearised.

    Args:
        frames: (4, 3, 3) orientations of base, upper arm, forearm and hand in the world.
        covariance: (11, 11) rad², of rotation vectors in the world of the base, of the upper arm, and of the forearm
            with the hand, and of the wrist's two hinges.
    """
    angles = angles_between(frames[0], frames[1], frames[2], frames[3])
    jacobian, axis = np.zeros((8, 11)), np.empty(3)
    for a in range(11):
        for k in range(3):
            axis[k] = frames[2, k, 0] if a == 9 else frames[3, k, 1] if a == 10 else 1.0 if k == a % 3 else 0.0
        base = _slightly(frames[0], axis) if a < 3 else frames[0]
        upper = _slightly(frames[1], axis) if 3 <= a < 6 else frames[1]
        fore = _slightly(frames[2], axis) if 6 <= a < 9 else frames[2]
        hand = _slightly(frames[3], axis) if a >= 6 else frames[3]
        change = angles_between(base, upper, fore, hand)
        for i in range(8):
            away = change[i] - angles[i]
            jacobian[i, a] = (away - 2.0 * math.pi * math.floor(away / (2.0 * math.pi) + 0.5)) / _STEP
    return angles, jacobian @ covariance @ jacobian.T


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
