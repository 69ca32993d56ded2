"""The emulated servos of an arm, and for each the joint that it drives."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

from highfive.hil.drivers.bus.control_table import load_table
from highfive.hil.drivers.bus.rig import REVERSE, Rig, required_registers
from highfive.hil.drivers.emulator.emulated_servo import EmulatedServo

Servo = TypeVar("Servo", bound=EmulatedServo)


def build_servos(
    rig: Rig, *, configured: bool = True, baud_rate: int | None = None, kind: type[Servo] = EmulatedServo
) -> tuple[list[Servo], list[int]]:
    """The servos of an arm, and for each the joint that it drives.

    Args:
        rig: the arm.
        configured: they hold what the rig wants of them, EEPROM and RAM; otherwise what they left the factory with, but
            for ID, baud rate, drive mode and whom they shadow, without which the arm could not have been put together.
        baud_rate: what they listen at; None for the rig's.
        kind: class of the servos.
    """
    servos, joints = [], []
    rig = rig if baud_rate is None else replace(rig, baud_rate=baud_rate)
    for servo, required in required_registers(rig).items():
        joint = rig.servos[servo]
        kept = (
            required
            if configured
            else {name: required[name] for name in ("id", "baud_rate", "drive_mode", "shadow_id")}
        )
        sign = -1 if required["drive_mode"] & REVERSE else 1
        servos.append(kind(load_table(joint.model), kept, sign=sign, zero=joint.zero))
        joints.append(rig.joints.index(joint))
    return servos, joints
