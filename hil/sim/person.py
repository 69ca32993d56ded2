"""The person in the scene: what is known of a live person (head, right arm, palm) and a body to go with it.

Head, arm and trunk are mocap bodies that follow the person. The palm is a free body welded to a mocap body, because a
contact does not see the velocity of a mocap body and would have the wrong force.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled bindings ship no type stubs.)

from __future__ import annotations

import mujoco
import numpy as np

from hil.avatar import PALM_IN_RIGHT_WRIST
from hil.sim.body_geometry import Shape, add_palm_site, add_shape, is_finger, shape_of
from mocap_bridge.frames import HumanArm, PalmPose
from model import rotations
from model.rotations import Array
from model.skeleton import Skeleton
from scenes import body_shapes

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


def hand_quaternion(palm: PalmPose) -> Array:
    """(4,) orientation of a right hand (wrist frame: z against the fingers, y out of the palm) with that palm."""
    return rotations.multiply(
        rotations.frame_from(palm.fingers, palm.normal),
        rotations.conjugate(rotations.frame_from([0.0, 0.0, -1.0], [0.0, 1.0, 0.0])),
    )


def hand_position(palm: PalmPose, quaternion: Array) -> Array:
    """(3,) m, wrist of a right hand of the avatar's size whose palm is there."""
    return palm.position - rotations.rotate(quaternion, PALM_IN_RIGHT_WRIST)


def _limb(direction: Array, across: Array) -> Array:
    """Orientation (4,) of a limb whose bone runs along ``direction`` (-z) with its y axis near ``across``."""
    z = -direction / np.linalg.norm(direction)
    y = across - (across @ z) * z
    y = y / np.linalg.norm(y)
    return rotations.from_matrix(np.stack([np.cross(y, z), y, z], axis=-1))


def body_poses(arm: HumanArm, skeleton: Skeleton, stance: Array) -> dict[str, tuple[Array, Array]]:
    """Position (3,) and orientation (4,) of the person's mocap bodies.

    Args:
        arm: the person.
        skeleton: gives the measures of a body whose trunk is not measured.
        stance: (2,) m, where the person stands; followed on a leash, so that leaning does not slide the feet.
    """
    hand = hand_quaternion(arm.palm)
    upper, lower = arm.elbow - arm.shoulder, arm.wrist - arm.elbow
    left = rotations.rotate(arm.head_orientation, [0.0, 1.0, 0.0])
    # The elbow's axis; a straight arm has none, so the body's left side decides.
    across = np.cross(lower, upper) / max(np.linalg.norm(lower) * np.linalg.norm(upper), 1e-9) + 0.05 * left
    upper_q = _limb(upper, across)
    # Half of the hand's turn about the forearm, as radius and ulna share it out.
    lower_q = _limb(lower, rotations.rotate(upper_q, [0, 1, 0]) + rotations.rotate(hand, [0, 1, 0]))
    head = arm.head_position - rotations.rotate(arm.head_orientation, body_shapes.HEAD_CENTRE)
    trunk_position, trunk_q = _trunk(arm, head, skeleton)
    hip_height = skeleton.offsets[skeleton.index("pelvis")][2]
    away = trunk_position[:2] - stance
    distance = float(np.linalg.norm(away))
    feet = stance if distance <= LEASH else stance + away * (1.0 - LEASH / distance)
    if distance > STRIDE:
        feet = trunk_position[:2]
    forward = rotations.rotate(trunk_q, [1.0, 0.0, 0.0]) * [1.0, 1.0, 0.0]
    return {
        "person_head": (head, arm.head_orientation),
        "person_upper_arm": (arm.shoulder, upper_q),
        "person_forearm": (arm.elbow, lower_q),
        "person_trunk": (trunk_position, trunk_q),
        "person_pelvis": (np.array([feet[0], feet[1], hip_height]), rotations.frame_from(forward, [0.0, 0.0, 1.0])),
        PALM_TARGET: (hand_position(arm.palm, hand), hand),
    }


def _trunk(arm: HumanArm, head: Array, skeleton: Skeleton) -> tuple[Array, Array]:
    """Position and orientation of the joint thoracic_8 of a trunk that hangs between head and right shoulder."""
    centres, _ = skeleton.forward_kinematics(np.zeros(3), np.tile(rotations.IDENTITY, (len(skeleton), 1)))
    chest, shoulder, skull = (centres[skeleton.index(n)] for n in ("thoracic_8", "right_shoulder", "head"))
    facing = rotations.rotate(arm.head_orientation, [1.0, 0.0, 0.0]) * [1.0, 1.0, 0.0]
    # Looking left or right turns the trunk less than the shoulder's place does: take the frame from head to shoulder.
    right = (arm.shoulder - head) * [1.0, 1.0, 0.0]
    reach = np.array([-right[1], right[0], 0.0])
    forward = reach / max(np.linalg.norm(reach), 1e-6) + facing / max(np.linalg.norm(facing), 1e-6)
    upright = rotations.frame_from(forward, [0.0, 0.0, 1.0])
    middle_here = 0.5 * (head + arm.shoulder)
    middle_there = 0.5 * (skull + shoulder)
    return middle_here - rotations.rotate(upright, middle_there - chest), upright
