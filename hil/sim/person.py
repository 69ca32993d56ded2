"""The person in the scene: what is known of a live person (head, right arm, palm) and a body to go with it.

Head, arm and trunk are mocap bodies that follow the person. The palm is a free body welded to a mocap body, because a
contact does not see the velocity of a mocap body and would have the wrong force.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from highfive.hil.sim.avatar import PALM_IN_RIGHT_WRIST
from highfive.hil.sim.body_geometry import Shape, add_palm_site, add_shape, is_finger, shape_of
from highfive.mocap_bridge.frames import HumanArm, PalmPose
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.geometry.skeleton import Skeleton
from highfive.scenes import body_shapes

PALM_BODY, PALM_TARGET = "person_palm", "person_palm_target"
MOCAP_BODIES = ("person_head", "person_upper_arm", "person_forearm", "person_trunk", "person_pelvis", PALM_TARGET)
WELD_SOLREF = (0.008, 1.0)
"""Time constant, s, and damping ratio of the weld that carries the person's palm."""
WELD_IMPEDANCE = 0.95
WELD_LEAD = 2.0 * WELD_IMPEDANCE * WELD_SOLREF[0] * WELD_SOLREF[1] ** 2
"""s by which a mocap target must run ahead so that the welded palm does not lag at constant speed.

MuJoCo's reference acceleration is -b v - k r with b = 2 / (d t) and k = 1 / (d² t² ζ²) (manual, "Solver parameters");
at constant speed b v + k r = 0, so r = -2 d t ζ² v.
"""
LEASH = 0.12
"""m that the trunk may lean away from over the feet before the feet follow."""
STRIDE = 0.4
"""m from which on the feet are put under the trunk at once: the person is somewhere else, not leaning."""


BodyPose = tuple[Array, Array]
"""Position (3,), m, and orientation (4,) in the world."""
UP = np.array([0.0, 0.0, 1.0])
HEAD_CENTRE = np.array(body_shapes.HEAD_CENTRE)


@dataclass(frozen=True)
class Figure:
    """What is not measured of a person.

    Attributes:
        hip_height: m, of the pelvis above the floor.
        neck_from_chest: (3,) m, the middle between head and right shoulder from the joint thoracic_8, upright.
    """

    hip_height: float
    neck_from_chest: Array

    @classmethod
    def of(cls, skeleton: Skeleton) -> Figure:
        """The figure of a person built like ``skeleton``."""
        upright = np.tile(rotations.IDENTITY, (len(skeleton), 1))
        centres, _ = skeleton.forward_kinematics(skeleton.offsets[0], upright)
        chest, shoulder, skull = (centres[skeleton.index(n)] for n in ("thoracic_8", "right_shoulder", "head"))
        return cls(float(centres[0, 2]), 0.5 * (skull + shoulder) - chest)


def person_hand_pose(skeleton: Skeleton) -> tuple[Array, Array]:
    """Positions (J, 3) and orientations (J, 4) of the skeleton with the right wrist at the origin and an open hand."""
    angles = np.zeros((len(skeleton), 3))
    bend = np.radians(body_shapes.PERSON_FINGER_BEND_DEGREES)
    for i, joint in enumerate(skeleton.names):
        if is_finger(joint) and "thumb" not in joint:
            # The right hand's mirrored x hinge: closing the hand is a positive turn.
            angles[i, skeleton.hinge_orders[i].index("x")] = bend
    positions, orientations = skeleton.forward_kinematics(np.zeros(3), skeleton.from_hinges(angles))
    return positions - positions[skeleton.index("right_wrist")], orientations


def add_person(spec: mujoco.MjSpec, skeleton: Skeleton) -> None:
    """Adds the person's bodies, contact shapes and palm site to ``spec``."""
    head = spec.worldbody.add_body(name="person_head", mocap=True)
    add_shape(head, "person_head", shape_of(skeleton, "head"), 0.0)
    for name, joint in (("person_upper_arm", "right_shoulder"), ("person_forearm", "right_elbow")):
        add_shape(spec.worldbody.add_body(name=name, mocap=True), name, shape_of(skeleton, joint), 0.0)
    for name in ("person_trunk", "person_pelvis", PALM_TARGET):
        spec.worldbody.add_body(name=name, mocap=True)

    palm = spec.worldbody.add_body(name=PALM_BODY, gravcomp=1.0)
    palm.add_freejoint(name=PALM_BODY)
    add_shape(palm, PALM_BODY, shape_of(skeleton, "right_wrist"), body_shapes.PERSON_HAND_MASS)
    positions, orientations = person_hand_pose(skeleton)
    for i, joint in enumerate(skeleton.names):
        if joint.startswith("right") and is_finger(joint):
            end = positions[i] + rotations.rotate(orientations[i], shape_of(skeleton, joint).end)
            _add_finger(palm, joint.replace("right", "person"), shape_of(skeleton, joint), positions[i], end)
    add_palm_site(palm, PALM_BODY, "right")
    weld = spec.add_equality(name=PALM_BODY, type=mujoco.mjtEq.mjEQ_WELD, name1=PALM_TARGET, name2=PALM_BODY)
    weld.objtype = mujoco.mjtObj.mjOBJ_BODY
    weld.data[:11] = [0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1]
    weld.solref = WELD_SOLREF
    weld.solimp = [WELD_IMPEDANCE, WELD_IMPEDANCE, 0.001, 0.5, 2]


def _add_finger(palm: mujoco.MjsBody, name: str, shape: Shape, start: Array, end: Array) -> None:
    add_shape(palm, name, shape, 0.0)
    geom = palm.geoms[-1]
    geom.fromto = np.concatenate([start, end])


class PersonBodies:
    """Puts the person of :func:`add_person` into the states of a compiled model."""

    def __init__(self, model: mujoco.MjModel, skeleton: Skeleton) -> None:
        """Of a model with a person built like ``skeleton``."""
        self._figure = Figure.of(skeleton)
        self._mocap = {name: int(model.body(name).mocapid[0]) for name in MOCAP_BODIES}
        self.palm_qpos = int(model.joint(PALM_BODY).qposadr[0])
        """Address of the palm (position, quaternion) in ``qpos``."""

    def put(self, data: mujoco.MjData, arm: HumanArm, *, move_palm: bool = True) -> None:
        """Writes the bodies into ``data``.

        Args:
            data: the state to change.
            arm: where the person is.
            move_palm: also puts the palm itself there; False leaves that to the weld, as in physics.
        """
        poses = body_poses(arm, self._figure, data.mocap_pos[self._mocap["person_pelvis"], :2])
        for name, (position, quaternion) in poses.items():
            data.mocap_pos[self._mocap[name]] = position
            data.mocap_quat[self._mocap[name]] = quaternion
        if move_palm:
            start = self.palm_qpos
            data.qpos[start : start + 3], data.qpos[start + 3 : start + 7] = poses[PALM_TARGET]


def hand_pose(palm: PalmPose) -> BodyPose:
    """Wrist and orientation of a right hand of the avatar's size that has its palm there."""
    # In the hand's frame the fingers point to -z and the palm to +y.
    axes = _frame(-palm.fingers, palm.normal)
    return palm.position - axes @ PALM_IN_RIGHT_WRIST, _quaternion(axes)


def body_poses(arm: HumanArm, figure: Figure, stance: Array) -> dict[str, BodyPose]:
    """Position (3,) and orientation (4,) of the person's mocap bodies.

    Args:
        arm: the person.
        figure: measures of what is not measured.
        stance: (2,) m, where the person stands; followed on a leash, so that leaning does not slide the feet.
    """
    head_axes = _matrix(arm.head_orientation)
    hand = hand_pose(arm.palm)
    upper, lower = arm.elbow - arm.shoulder, arm.wrist - arm.elbow
    # The elbow's axis; a straight arm has none, so the body's left side decides.
    across = _cross(lower, upper) / max(_norm(lower) * _norm(upper), 1e-9) + 0.05 * head_axes[:, 1]
    upper_axes = _frame(-upper, across)
    # Half of the hand's turn about the forearm, as radius and ulna share it out.
    lower_axes = _frame(-lower, upper_axes[:, 1] + arm.palm.normal)
    head = arm.head_position - head_axes @ HEAD_CENTRE
    trunk, trunk_axes = _trunk(arm, head, head_axes[:, 0], figure)
    away = trunk[:2] - stance
    distance = _norm(away)
    feet = stance if distance <= LEASH else stance + away * (1.0 - LEASH / distance)
    if distance > STRIDE:
        feet = trunk[:2]
    return {
        "person_head": (head, arm.head_orientation),
        "person_upper_arm": (arm.shoulder, _quaternion(upper_axes)),
        "person_forearm": (arm.elbow, _quaternion(lower_axes)),
        "person_trunk": (trunk, _quaternion(trunk_axes)),
        "person_pelvis": (np.array([feet[0], feet[1], figure.hip_height]), _quaternion(trunk_axes)),
        PALM_TARGET: hand,
    }


def _trunk(arm: HumanArm, head: Array, facing: Array, figure: Figure) -> tuple[Array, Array]:
    """Position and axes of the joint thoracic_8 of an upright trunk that hangs between head and right shoulder."""
    # The head may look aside and the shoulder may reach: the trunk faces half way between what the two say.
    right = arm.shoulder - head
    across = np.array([-right[1], right[0], 0.0])
    forward = across / max(_norm(across), 1e-6) + facing * [1.0, 1.0, 0.0]
    if _norm(forward) < 1e-3:
        forward = across
    axes = _frame(UP, _cross(UP, forward))
    return 0.5 * (head + arm.shoulder) - axes @ figure.neck_from_chest, axes


def _frame(z: Array, y: Array) -> Array:
    """Axes (3, 3), in columns, of the frame whose z axis is along ``z`` and whose y axis is as near ``y`` as can be.

    A limb without length points down, and one along ``y`` turns any way: a picture needs a frame in any case.
    """
    length = _norm(z)
    z = z / length if length > 1e-6 else UP
    x = _cross(y, z)
    if _norm(x) < 1e-6:
        x = _cross(np.array([0.6, 0.8, 0.0]) if abs(z[2]) > 0.5 else UP, z)
    x = x / _norm(x)
    return np.array([x, _cross(z, x), z]).T


# Plain functions for single vectors: this runs in the tick, where a call of np.cross alone takes 30 µs.
def _norm(vector: Array) -> float:
    return math.sqrt(vector @ vector)


def _cross(a: Array, b: Array) -> Array:
    result = np.empty(3)
    mujoco.mju_cross(result, a, b)
    return result


def _quaternion(axes: Array) -> Array:
    result = np.empty(4)
    mujoco.mju_mat2Quat(result, axes.ravel())
    return result


def _matrix(quaternion: Array) -> Array:
    result = np.empty(9)
    mujoco.mju_quat2Mat(result, quaternion)
    return result.reshape(3, 3)
