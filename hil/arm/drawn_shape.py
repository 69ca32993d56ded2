"""The arm's drawing as calibration takes it: arrays."""

from __future__ import annotations

from highfive.calibration.arm_kinematics import ArmShape
from highfive.hil.arm_model.servo_arm import ServoArm
from highfive.model.geometry.rotations import Array


def drawn_shape(arm: ServoArm, markers: Array) -> ArmShape:
    """An arm with markers (M, 3), m, in its last joint's frame."""
    packed = arm.packed
    return ArmShape(
        names=arm.folder.names,
        axes=packed.axes,
        offsets=packed.offsets,
        masses=packed.masses,
        centres=packed.centres,
        markers=markers,
    )
