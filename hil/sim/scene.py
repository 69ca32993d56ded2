"""The MuJoCo scene: avatar, person and room in one model, and how poses get in and out of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from highfive import scenes
from highfive.hil.sim import person
from highfive.hil.sim.avatar import Pose, avatar_skeleton
from highfive.hil.sim.body_geometry import ROOT_JOINTS, add_avatar, is_finger, shape_name
from highfive.hil.sim.dressing import dress
from highfive.mocap_bridge.frames import HumanArm, PalmPose
from highfive.model.errors import HighFiveError
from highfive.model.geometry.skeleton import Skeleton

Indices = NDArray[np.int64]

SUBSTEPS = 4
"""Physics steps per frame of 120 Hz."""
TIMESTEP = 1.0 / (120 * SUBSTEPS)
PALM_SOLREF = (0.03, 1.0)
"""Time constant, s, and damping ratio of a contact between two hands."""
PALM_IMPEDANCE = (0.3, 0.9, 0.02, 0.5, 2.0)
"""Flesh stiffens over 2 cm of overlap: palms that meet at 0.5–2 m/s peak at 18–65 N (rigid ones at up to 500 N)."""
NATURAL_FREQUENCY_HZ = 3.0
"""Stiffness of the avatar's joints in physics play-out, as the frequency of each joint's own oscillation.

Soft enough to give way to a hand; feed-forward, not stiffness, keeps the avatar on its trajectory.
"""
CORRECTED_JOINTS = ("thoracic_12", "thoracic_8", "right_clavicle", "right_shoulder", "right_elbow", "right_wrist")
_OWN_BODY = (
    "pelvis", "lumbar_5", "lumbar_3", "thoracic_12", "thoracic_8", "neck", "head",
    "left_shoulder", "left_elbow", "left_wrist", "left_hip", "left_knee", "right_hip", "right_knee",
)  # fmt: skip


@dataclass(frozen=True)
class Scene:
    """A compiled scene.

    Attributes:
        spec: the specification that the model was compiled from.
        model: the compiled model.
        skeleton: the avatar's skeleton.
        root_qpos, root_dofs: (3,) addresses of the root's slides.
        hinge_qpos, hinge_dofs: (53, 3) addresses of each joint's hinges, in the order of the skeleton.
        hinge_actuators: (53, 3) ids of the position actuators.
        arm_dofs: (18,) velocity addresses of the hinges that a contact correction may move: upper trunk, right
            clavicle, shoulder, elbow and wrist.
        arm_joints: (6,) indices into the skeleton of the same joints, in the same order.
        palm_site, left_palm_site, person_palm_site: ids of sites on a palm's surface; x to the fingers, z out of
            the palm.
        hand_geoms: ids of the contact shapes of the avatar's right hand, the palm first.
        person_hand_geoms: ids of the contact shapes of the person's hand, the palm first.
    """

    spec: mujoco.MjSpec
    model: mujoco.MjModel
    skeleton: Skeleton
    root_qpos: Indices
    root_dofs: Indices
    hinge_qpos: Indices
    hinge_dofs: Indices
    hinge_actuators: Indices
    arm_dofs: Indices
    arm_joints: Indices
    palm_site: int
    left_palm_site: int
    person_palm_site: int
    hand_geoms: Indices
    person_hand_geoms: Indices

    def make_data(self) -> mujoco.MjData:
        """State of the scene with the avatar in its rest pose."""
        data = mujoco.MjData(self.model)
        self.set_pose(data, rest_pose(self.skeleton))
        mujoco.mj_forward(self.model, data)
        return data

    def set_pose(self, data: mujoco.MjData, pose: Pose) -> None:
        """Writes the avatar's pose into ``data.qpos``; follow with ``mujoco.mj_kinematics`` or a forward call."""
        data.qpos[self.root_qpos] = pose.root_in_world
        data.qpos[self.hinge_qpos] = pose.hinges

    def get_pose(self, data: mujoco.MjData) -> Pose:
        """The avatar's pose in ``data.qpos``."""
        return Pose(data.qpos[self.root_qpos], data.qpos[self.hinge_qpos])

    def set_person(self, data: mujoco.MjData, arm: HumanArm, *, move_palm: bool = True) -> None:
        """Writes the person's bodies into ``data``; see :meth:`highfive.hil.sim.person.PersonBodies.put`."""
        self._person.put(data, arm, move_palm=move_palm)

    @cached_property
    def _person(self) -> person.PersonBodies:
        return person.PersonBodies(self.model, self.skeleton)

    @property
    def person_palm_qpos(self) -> int:
        """Address of the person's palm (position, quaternion) in ``qpos``."""
        return self._person.palm_qpos

    @cached_property
    def person_palm_dof(self) -> int:
        """Address of the person's palm (velocity, angular velocity) in ``qvel``."""
        return int(self.model.joint(person.PALM_BODY).dofadr[0])

    def avatar_palm(self, data: mujoco.MjData) -> PalmPose:
        """The avatar's right palm; its velocity rests on ``data.cvel`` (``mujoco.mj_comVel`` or a forward call)."""
        return self.palm(data, self.palm_site)

    def person_palm(self, data: mujoco.MjData) -> PalmPose:
        """The person's palm as it is in the scene; in physics it may be pushed off the live one."""
        return self.palm(data, self.person_palm_site)

    def palm(self, data: mujoco.MjData, site: int) -> PalmPose:
        """Pose of a palm site."""
        axes = data.site_xmat[site].reshape(3, 3)
        velocity = np.empty(6)
        mujoco.mj_objectVelocity(self.model, data, mujoco.mjtObj.mjOBJ_SITE, site, velocity, 0)
        return PalmPose(data.site_xpos[site].copy(), axes[:, 2].copy(), axes[:, 0].copy(), velocity[3:])

    def save_xml(self, path: Path) -> None:
        """Writes the scene as one MJCF file that the MuJoCo viewer opens."""
        path.write_text(self.spec.to_xml(), encoding="utf-8")


def rest_pose(skeleton: Skeleton) -> Pose:
    """The avatar standing, its right forearm half raised."""
    return Pose.from_quaternions(skeleton.offsets[0].copy(), skeleton.rest)


def build_scene(skeleton: Skeleton | None = None, *, visible: bool = False) -> Scene:
    """Builds and compiles the scene.

    Args:
        skeleton: the avatar's, by default :func:`highfive.hil.sim.avatar.avatar_skeleton`.
        visible: also sculpts what the eye sees (some 2 s); needed for pictures and for the viewer, not for play-out.

    Raises:
        HighFiveError: the room's file is missing or MuJoCo refuses it.
    """
    skeleton = skeleton or avatar_skeleton()
    spec = room()
    spec.option.timestep = TIMESTEP
    add_avatar(spec, skeleton)
    person.add_person(spec, skeleton)
    _add_contact_pairs(spec, skeleton)
    _add_actuators(spec, skeleton)
    if visible:
        dress(spec, skeleton)
    return _scene(spec, spec.compile(), skeleton)


def room() -> mujoco.MjSpec:
    """The empty room."""
    path = Path(scenes.__file__).parent / "room.xml"
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise HighFiveError(f"{path} is not a scene that MuJoCo reads: {str(error).splitlines()[0]}") from None


def hand_shapes(skeleton: Skeleton, owner: str) -> list[str]:
    """Contact shapes of the right hand of the ``'right'`` (avatar) or ``'person'``, the palm first."""
    fingers = [n for n in skeleton.names if n.startswith("right") and is_finger(n)]
    return [f"{owner}_palm"] + [n.replace("right", owner) for n in fingers]


def contact_pairs(skeleton: Skeleton) -> tuple[list[tuple[str, str]], list[tuple[str, str]]]:
    """Pairs of contact shapes: those that a high five is made of, and those that are findings."""
    hand = hand_shapes(skeleton, "right")
    expected = [(a, b) for a in hand for b in hand_shapes(skeleton, "person")]
    unwanted = [(a, "person_head") for a in [*hand, "right_elbow", "left_palm", "left_elbow"]]
    return expected, unwanted + own_pairs(skeleton)


def own_pairs(skeleton: Skeleton) -> list[tuple[str, str]]:
    """Every contact shape of the avatar's right hand and forearm with every one of its own body."""
    arm = [*hand_shapes(skeleton, "right"), "right_elbow"]
    return [(a, shape_name(b)) for a in arm for b in _OWN_BODY]


def _add_contact_pairs(spec: mujoco.MjSpec, skeleton: Skeleton) -> None:
    expected, unwanted = contact_pairs(skeleton)
    for first, second in expected + unwanted:
        spec.add_pair(geomname1=first, geomname2=second, solref=PALM_SOLREF, solimp=PALM_IMPEDANCE, condim=3)


def _add_actuators(spec: mujoco.MjSpec, skeleton: Skeleton) -> None:
    """One position actuator per coordinate, stiff in proportion to the inertia that it moves; critically damped."""
    inertia = _rest_inertia(spec.compile(), skeleton)
    frequency = 2.0 * np.pi * NATURAL_FREQUENCY_HZ
    names = [f"{n}_{axis}" for n, order in zip(skeleton.names, skeleton.hinge_orders, strict=True) for axis in order]
    for name in [*ROOT_JOINTS, *names]:
        moved = inertia[name]
        actuator = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.set_to_position(kp=moved * frequency**2, kv=2.0 * moved * frequency)


def _rest_inertia(model: mujoco.MjModel, skeleton: Skeleton) -> dict[str, float]:
    """Inertia, kg or kg·m², that each coordinate moves while the avatar is in its rest pose, by the joint's name.

    In the zero pose a straight arm has almost none about its own axis, and a bent one would turn too slowly.
    """
    data = mujoco.MjData(model)
    angles = skeleton.to_hinges(skeleton.rest)
    for i, (joint, order) in enumerate(zip(skeleton.names, skeleton.hinge_orders, strict=True)):
        for axis, angle in zip(order, angles[i], strict=True):
            data.joint(f"{joint}_{axis}").qpos = angle
    mujoco.mj_forward(model, data)
    matrix = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, matrix)
    joints = [model.joint(i) for i in range(model.njnt)]
    return {joint.name: float(matrix[joint.dofadr[0], joint.dofadr[0]]) for joint in joints}


def _scene(spec: mujoco.MjSpec, model: mujoco.MjModel, skeleton: Skeleton) -> Scene:
    hinges = [[f"{n}_{a}" for a in order] for n, order in zip(skeleton.names, skeleton.hinge_orders, strict=True)]
    hinge_dofs = np.array([[model.joint(n).dofadr[0] for n in row] for row in hinges])
    arm_joints = np.array([skeleton.index(n) for n in CORRECTED_JOINTS])
    return Scene(
        spec=spec,
        model=model,
        skeleton=skeleton,
        root_qpos=np.array([model.joint(n).qposadr[0] for n in ROOT_JOINTS]),
        root_dofs=np.array([model.joint(n).dofadr[0] for n in ROOT_JOINTS]),
        hinge_qpos=np.array([[model.joint(n).qposadr[0] for n in row] for row in hinges]),
        hinge_dofs=hinge_dofs,
        hinge_actuators=np.array([[model.actuator(n).id for n in row] for row in hinges]),
        arm_dofs=hinge_dofs[arm_joints].ravel(),
        arm_joints=arm_joints,
        palm_site=model.site("right_palm").id,
        left_palm_site=model.site("left_palm").id,
        person_palm_site=model.site(person.PALM_BODY).id,
        hand_geoms=np.array([model.geom(n).id for n in hand_shapes(skeleton, "right")]),
        person_hand_geoms=np.array([model.geom(n).id for n in hand_shapes(skeleton, "person")]),
    )
