"""Plays the avatar's poses in the scene: as they are (kinematic), or through actuators against contacts (physics)."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import mujoco
import numpy as np

from highfive.hil.sim import person
from highfive.hil.sim.avatar import Pose
from highfive.hil.sim.scene import SUBSTEPS, Scene
from highfive.hil.sim.touch import Touch, TouchReader
from highfive.mocap_bridge.frames import HumanArm, PalmPose
from highfive.model.geometry.rotations import Array

FRAME_SECONDS = 1.0 / 120.0
_MAX_FRAMES = 12
"""A gap in time longer than this many frames is played in this many: a lost link is no reason to stall the tick."""


@dataclass(frozen=True)
class PlayState:
    """What the scene shows after a step.

    Attributes:
        time_ns: time of the step, ns.
        pose: pose of the avatar as it was played; in physics it differs a little from the one that was requested.
        palm: the avatar's right palm.
        person_palm: the person's palm in the scene.
        touches: contacts in this step; in physics the most forceful of all its substeps.
        hand_force: N, largest sum in a substep of the normal forces between the hands; 0 in kinematic play-out.
    """

    time_ns: int
    pose: Pose
    palm: PalmPose
    person_palm: PalmPose
    touches: tuple[Touch, ...]
    hand_force: float


@runtime_checkable
class PlayOut(Protocol):
    """Plays poses, one per tick; ``data`` is the MuJoCo state to draw from."""

    data: mujoco.MjData

    def reset(self, pose: Pose, arm: HumanArm, time_ns: int = 0) -> PlayState:
        """Puts avatar and person there at rest."""
        ...

    def step(self, pose: Pose, arm: HumanArm, time_ns: int) -> PlayState:
        """Plays the next pose."""
        ...


class KinematicPlayOut:
    """Shows each pose exactly; contacts are seen but have no force."""

    def __init__(self, scene: Scene) -> None:
        """Makes a state of its own in ``scene``."""
        self._scene, self.data = scene, scene.make_data()
        self._touches = TouchReader(scene)
        self._last: tuple[int, Array] | None = None

    def reset(self, pose: Pose, arm: HumanArm, time_ns: int = 0) -> PlayState:
        """Puts avatar and person there at rest."""
        self._last = None
        return self.step(pose, arm, time_ns)

    def step(self, pose: Pose, arm: HumanArm, time_ns: int) -> PlayState:
        """Shows the next pose; the palm's velocity is its displacement since the last step over the time between."""
        model, data = self._scene.model, self.data
        self._scene.set_pose(data, pose)
        self._scene.set_person(data, arm)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        palm = self._scene.avatar_palm(data)
        if self._last is not None and time_ns > self._last[0]:
            seconds = 1e-9 * (time_ns - self._last[0])
            palm = replace(palm, velocity=(palm.position - self._last[1]) / seconds)
        self._last = time_ns, palm.position
        return PlayState(time_ns, pose, palm, arm.palm, tuple(self._touches.read(data, forces=False)), 0.0)


class PhysicsPlayOut:
    """Drives the avatar along the poses by position actuators with velocity and inverse-dynamics feed-forward.

    The joints are soft and the feed-forward carries the motion: in free space the palm stays within millimetres, and a
    person's hand can still push the avatar's away. Without feed-forward the same joints would lag by centimetres.
    """

    def __init__(self, scene: Scene) -> None:
        """Makes a state of its own in ``scene``."""
        self._scene, self.data = scene, scene.make_data()
        self._touches = TouchReader(scene)
        # The feed-forward is for free motion: a copy of the model without contacts, limits and welds.
        self._free_model = copy.copy(scene.model)
        self._free_model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self._free = mujoco.MjData(self._free_model)
        model = scene.model
        self._dofs = model.jnt_dofadr[model.actuator_trnid[:, 0]]
        self._qpos = model.jnt_qposadr[model.actuator_trnid[:, 0]]
        self._stiffness = model.actuator_gainprm[:, 0]
        self._damping = -model.actuator_biasprm[:, 2]
        self._target = model.body(person.PALM_TARGET).mocapid[0]
        self._time_ns = 0
        self._coordinates = np.zeros(model.nu)
        self._velocities = np.zeros(model.nu)
        self._hand = self._hand_target()

    def reset(self, pose: Pose, arm: HumanArm, time_ns: int = 0) -> PlayState:
        """Puts avatar and person there at rest."""
        data = self.data
        mujoco.mj_resetData(self._scene.model, data)
        self._scene.set_pose(data, pose)
        self._scene.set_person(data, arm)
        self._time_ns = time_ns
        self._coordinates, self._hand = data.qpos[self._qpos].copy(), self._hand_target()
        self._velocities = np.zeros_like(self._velocities)
        data.ctrl[:] = self._coordinates
        mujoco.mj_forward(self._scene.model, data)
        return self._state(time_ns, {}, 0.0)

    def step(self, pose: Pose, arm: HumanArm, time_ns: int) -> PlayState:
        """Plays up to ``time_ns`` towards the next pose; the time since the last step is rounded to whole substeps."""
        model, data = self._scene.model, self.data
        frames = np.clip(1e-9 * (time_ns - self._time_ns) / FRAME_SECONDS, 1.0 / SUBSTEPS, _MAX_FRAMES)
        substeps = max(1, round(float(frames) * SUBSTEPS))
        seconds = substeps * model.opt.timestep
        start = self._coordinates
        goal = self._reference(pose)
        velocities = (goal - start) / seconds
        torques = self._feed_forward(goal, velocities, (velocities - self._velocities) / seconds)
        lead = (self._damping * velocities + torques) / self._stiffness
        self._scene.set_person(data, arm, move_palm=False)
        hand_start, hand_goal = self._hand, self._hand_target()
        touches: dict[tuple[str, str], Touch] = {}
        hand_force = 0.0
        for substep in range(substeps):
            part = substep / substeps
            data.ctrl[:] = start + part * (goal - start) + lead
            self._lead_hand(hand_start, hand_goal, part + person.WELD_LEAD / seconds)
            mujoco.mj_step(model, data)
            now = self._touches.read(data, forces=True)
            hand_force = max(hand_force, sum(touch.force for touch in now if touch.expected))
            for touch in now:
                known = touches.get((touch.first, touch.second))
                if known is None or touch.force > known.force:
                    touches[touch.first, touch.second] = touch
        self._time_ns, self._coordinates, self._velocities, self._hand = time_ns, goal, velocities, hand_goal
        return self._state(time_ns, touches, hand_force)

    def _reference(self, pose: Pose) -> Array:
        self._scene.set_pose(self._free, pose)
        return self._free.qpos[self._qpos].copy()

    def _feed_forward(self, coordinates: Array, velocities: Array, accelerations: Array) -> Array:
        """Forces, N or N·m, that free motion needs (Newton–Euler; ``mj_inverse``)."""
        free = self._free
        free.qpos[self._qpos], free.qvel[self._dofs], free.qacc[self._dofs] = coordinates, velocities, accelerations
        mujoco.mj_inverse(self._free_model, free)
        return free.qfrc_inverse[self._dofs]

    def _hand_target(self) -> tuple[Array, Array]:
        return self.data.mocap_pos[self._target].copy(), self.data.mocap_quat[self._target].copy()

    def _lead_hand(self, start: tuple[Array, Array], goal: tuple[Array, Array], part: float) -> None:
        """Puts the target of the person's palm a part of the way along, beyond the goal by what the weld lags."""
        self.data.mocap_pos[self._target] = start[0] + part * (goal[0] - start[0])
        turn, quaternion = np.empty(3), start[1].copy()
        mujoco.mju_subQuat(turn, goal[1], start[1])
        mujoco.mju_quatIntegrate(quaternion, turn, part)
        self.data.mocap_quat[self._target] = quaternion

    def _state(self, time_ns: int, touches: dict[tuple[str, str], Touch], hand_force: float) -> PlayState:
        model, data = self._scene.model, self.data
        # A step leaves positions of before its integration behind.
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        palm, person_palm = self._scene.avatar_palm(data), self._scene.person_palm(data)
        return PlayState(time_ns, self._scene.get_pose(data), palm, person_palm, tuple(touches.values()), hand_force)
