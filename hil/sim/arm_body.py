"""The servo arm in MuJoCo: alone on its column, or in the scene beside or instead of the avatar."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from highfive.hil.arm_model.arm_folder import ArmFolder, find_arm
from highfive.hil.arm_model.from_mujoco import load_spec
from highfive.hil.arm_model.mount import Mount
from highfive.hil.sim import person
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.hil.sim.scene import PALM_IMPEDANCE, PALM_SOLREF, build_scene, hand_shapes, room
from highfive.mocap_bridge.frames import PalmPose
from highfive.model.geometry.rotations import Array

PREFIX = "arm_"
"""Of the arm's names in a scene."""
FINE_STEP = 0.0005
"""s of a physics step of the arm alone: the servos' damping is stiff."""


@dataclass(frozen=True)
class ArmTwin:
    """A compiled model with the arm in it.

    Attributes:
        spec: what it was compiled from.
        model: the compiled model.
        qpos, dofs: (J,) addresses of the joints.
        actuators: (J,) ids of the torque motors.
        plate_site: on the plate's surface; x as fingers would point, z out of the plate.
        plate_geom: the plate's shape.
    """

    spec: mujoco.MjSpec
    model: mujoco.MjModel
    qpos: NDArray[np.int64]
    dofs: NDArray[np.int64]
    actuators: NDArray[np.int64]
    plate_site: int
    plate_geom: int

    def plate(self, data: mujoco.MjData) -> PalmPose:
        """The plate as a palm; its velocity rests on ``data.cvel`` (``mujoco.mj_comVel`` or a forward call)."""
        axes, velocity = data.site_xmat[self.plate_site].reshape(3, 3), np.empty(6)
        mujoco.mj_objectVelocity(self.model, data, mujoco.mjtObj.mjOBJ_SITE, self.plate_site, velocity, 0)
        return PalmPose(data.site_xpos[self.plate_site].copy(), axes[:, 2].copy(), axes[:, 0].copy(), velocity[3:])

    def jacobian(self, data: mujoco.MjData) -> Array:
        """(3, J) of the plate's place, after ``mujoco.mj_kinematics`` and ``mujoco.mj_comPos``."""
        whole = np.empty((3, self.model.nv))
        mujoco.mj_jacSite(self.model, data, whole, None, self.plate_site)
        return whole[:, self.dofs]

    def gravity(self, joints: Array) -> Array:
        """Torques (J,), N·m, that hold the arm still."""
        data = mujoco.MjData(self.model)
        data.qpos[self.qpos] = joints
        mujoco.mj_forward(self.model, data)
        return data.qfrc_bias[self.dofs]


def arm_alone(mount: Mount, folder: ArmFolder | None = None) -> ArmTwin:
    """An arm (the default one) on its column and nothing else."""
    folder = folder or find_arm()
    spec = mujoco.MjSpec()
    spec.option.timestep = FINE_STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    _mounted(spec, mount, folder)
    return _twin(spec, folder)


def arm_in_scene(mount: Mount, *, avatar: bool, visible: bool = False, folder: ArmFolder | None = None) -> ArmTwin:
    """The arm in the room with the person, beside the avatar or instead of it.

    Args:
        mount: where it stands.
        avatar: the avatar is there, too.
        visible: also sculpts avatar and person for pictures.
        folder: which arm; None for the default one.

    Raises:
        HighFiveError: the room's file is missing or MuJoCo refuses it.
    """
    skeleton, folder = avatar_skeleton(), folder or find_arm()
    if avatar or visible:
        spec = build_scene(skeleton, visible=visible).spec
        if not avatar:
            for skin in [skin for skin in spec.skins if skin.name.startswith("avatar")]:
                spec.delete(skin)
            spec.delete(spec.body("pelvis"))
    else:
        spec = room()
        person.add_person(spec, skeleton)
    _mounted(spec, mount, folder)
    for shape in hand_shapes(skeleton, "person"):
        spec.add_pair(geomname1=f"{PREFIX}plate", geomname2=shape, solref=PALM_SOLREF, solimp=PALM_IMPEDANCE, condim=3)
    for shape in folder.near:
        spec.add_pair(geomname1=PREFIX + shape, geomname2="person_head", condim=3)
    return _twin(spec, folder)


def _mounted(spec: mujoco.MjSpec, mount: Mount, folder: ArmFolder) -> None:
    arm, column = load_spec(folder), folder.posts[2]
    frame = spec.worldbody.add_frame(pos=list(mount.position), quat=mount.quaternion.tolist())
    spec.attach(arm, prefix=PREFIX, frame=frame)
    x, y, height = mount.position
    spec.worldbody.add_geom(
        name=f"{PREFIX}column", type=mujoco.mjtGeom.mjGEOM_CYLINDER, pos=[x, y, 0.5 * height],
        size=[column, 0.5 * height, 0.0], contype=0, conaffinity=0, rgba=[0.55, 0.56, 0.58, 1.0],
    )  # fmt: skip


def _twin(spec: mujoco.MjSpec, folder: ArmFolder) -> ArmTwin:
    model = spec.compile()
    joints = [model.joint(PREFIX + name) for name in folder.names]
    return ArmTwin(
        spec=spec,
        model=model,
        qpos=np.array([joint.qposadr[0] for joint in joints]),
        dofs=np.array([joint.dofadr[0] for joint in joints]),
        actuators=np.array([model.actuator(PREFIX + name).id for name in folder.names]),
        plate_site=model.site(f"{PREFIX}plate").id,
        plate_geom=model.geom(f"{PREFIX}plate").id,
    )
