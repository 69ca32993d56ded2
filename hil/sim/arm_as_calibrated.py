"""A compiled model's arm made the one that was calibrated: for an emulated arm that rehearses for a real one."""

from __future__ import annotations

from typing import Any

import mujoco

from highfive.hil.arm_model.arm_folder import ArmFolder
from highfive.hil.arm_model.corrections import Corrections
from highfive.hil.arm_model.from_mujoco import compiled_body
from highfive.hil.sim.arm_body import PREFIX
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array


def correct(model: Any, folder: ArmFolder, base: Array, by: Corrections) -> None:  # MuJoCo's stubs lack what it changes
    """Changes places and turns of the arm's bodies.

    Args:
        model: compiled, with the arm in it.
        folder: what arm it is.
        base: (3, 3) axes of its base in the world, in columns.
        by: in what it differs; its joints' compliance is not in a rigid body.
    """
    data: Any = mujoco.MjData(model)
    data.qpos[:] = 0.0
    mujoco.mj_kinematics(model, data)
    drawn = compiled_body(folder)

    def to_parent(body: int) -> Array:
        """(3, 3): from the drawing's frames, parallel to the base, to that of a body's parent."""
        return data.xmat[model.body_parentid[body]].reshape(3, 3).T @ base

    for name, length, tilt in zip(folder.names, by.lengths, by.tilts, strict=True):
        body = int(model.joint(PREFIX + name).bodyid[0])
        back = to_parent(body)
        model.body_pos[body] += back @ length
        turn = rotations.from_rotation_vector(back @ tilt)
        model.body_quat[body] = rotations.multiply(turn, model.body_quat[body])
    plate = model.body(PREFIX + "plate").id
    back = to_parent(plate)
    model.body_pos[plate] += back @ (by.plate - drawn.plate)
    turn = rotations.rotation_between(back @ drawn.normal, back @ by.normal)
    model.body_quat[plate] = rotations.multiply(turn, model.body_quat[plate])
