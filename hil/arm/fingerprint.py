"""Tells one arm from another, so that nobody takes one's calibration for the other's."""

from __future__ import annotations

import hashlib

import numpy as np

from highfive.hil.arm_model.arm_folder import ArmFolder, find_arm
from highfive.hil.arm_model.from_mujoco import compiled_body
from highfive.hil.drivers.bus.rig import Rig


def fingerprint(rig: Rig, folder: ArmFolder | None = None) -> str:
    """Tells this arm, with its mount, from others: what a registration of it depends on."""
    folder = folder or find_arm()
    body = compiled_body(folder)
    shape = [np.round(part, 6).tolist() for part in (body.axes, body.offsets, body.plate, body.normal)]
    parts = (rig.joints, shape, folder.mount)
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:12]
