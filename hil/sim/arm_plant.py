"""The body that servos move: the arm's dynamics, with stops and whoever pushes against its palm."""

from __future__ import annotations

import math
from collections.abc import Callable

import mujoco
import numpy as np

from highfive.hil.arm_model.arm_folder import ArmFolder
from highfive.hil.arm_model.mount import Mount
from highfive.hil.sim.arm_body import arm_alone
from highfive.mocap_bridge.frames import PalmPose
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array


class ArmPlant:
    """The mounted arm in MuJoCo; a :class:`highfive.hil.drivers.values.Plant`.

    Friction, gear inertia, gravity and the joint stops are in it; what a servo makes of its supply is the servo's.
    """

    def __init__(
        self,
        mount: Mount,
        joints: Array,
        change: Callable[[mujoco.MjModel], object] = lambda model: None,
        *,
        folder: ArmFolder | None = None,
    ) -> None:
        """Starts at rest.

        Args:
            mount: where the arm stands.
            joints: (J,) rad.
            folder: which arm; None for the default one.
            change: makes masses and friction other than those of the arm's model.
        """
        self._twin = arm_alone(mount, folder)
        change(self._twin.model)
        mujoco.mj_setConst(self._twin.model, mujoco.MjData(self._twin.model))  # pyright: ignore[reportAttributeAccessIssue]
        self._data = mujoco.MjData(self._twin.model)
        self._positions, self._velocities, self._control = self._data.qpos, self._data.qvel, self._data.ctrl  # views
        self._left = 0.0
        self.force = np.zeros(3)
        """(3,) N in the world, that pushes at the middle of the plate; set it at any time."""
        self.reset(joints)

    def reset(self, joints: Array) -> None:
        """Puts the arm there at rest."""
        mujoco.mj_resetData(self._twin.model, self._data)
        self._data.qpos[self._twin.qpos] = joints
        self._left = 0.0
        mujoco.mj_forward(self._twin.model, self._data)

    def step(self, torques: Array, seconds: float) -> tuple[Array, Array]:
        """Positions (J,), rad, and velocities (J,), rad/s, ``seconds`` later; what is left of a physics step waits.

        Raises:
            HighFiveError: torques that are no numbers, or time that runs backwards.
        """
        torques = np.asarray(torques, float)
        if not (math.isfinite(torques.sum()) and torques.shape == self._twin.dofs.shape and seconds >= 0.0):
            raise HighFiveError(f"got torques {torques} for {seconds} s; expected a finite number a joint, and a time")
        model, data = self._twin.model, self._data
        self._left += seconds
        steps = int(self._left / model.opt.timestep + 1e-9)
        self._left -= steps * model.opt.timestep
        self._control[self._twin.actuators] = torques
        if np.count_nonzero(self.force):
            for _ in range(steps):
                mujoco.mj_kinematics(model, data)
                mujoco.mj_comPos(model, data)
                data.qfrc_applied[self._twin.dofs] = self._twin.jacobian(data).T @ self.force
                mujoco.mj_step(model, data)
        elif steps:
            data.qfrc_applied[:] = 0.0
            mujoco.mj_step(model, data, steps)
        return self._positions[self._twin.qpos], self._velocities[self._twin.dofs]

    def plate(self) -> PalmPose:
        """The plate as it is now."""
        mujoco.mj_kinematics(self._twin.model, self._data)
        mujoco.mj_comPos(self._twin.model, self._data)
        mujoco.mj_comVel(self._twin.model, self._data)
        return self._twin.plate(self._data)
