"""An arm's own files: what may be sent to it, and what it is driven by."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from highfive.hil.arm_model.arm_folder import ARMS, DEFAULT_ARM, ArmFolder, find_arm
from highfive.hil.arm_model.from_mujoco import compiled_body
from highfive.hil.drivers.bus.rig import DEFAULT_RIG, Rig, load_rig
from highfive.hil.safety.limits import Ceilings, Limits
from highfive.hil.safety.limits_file import FILE, load_limits
from highfive.model.errors import HighFiveError


def limits_of(folder: ArmFolder, file: Path | None = None) -> Limits:
    """An arm's limits, by default those in its folder; no file can raise them above what its model and servos can.

    Raises:
        HighFiveError: as :func:`highfive.hil.safety.limits_file.load_limits`, or they are of another arm.
    """
    own = limits_file(folder)
    if file is None and not own.is_file():
        raise HighFiveError(f"{folder.folder} has no {own.name}; draft one: highfive rig draft {folder.folder}")
    return load_limits(file or own, ceilings_of(folder))


def ceilings_of(folder: ArmFolder) -> Ceilings:
    """What the arm's joints and servos can."""
    body = compiled_body(folder)
    stops = tuple((float(low), float(high)) for low, high in zip(body.low, body.high, strict=True))
    return Ceilings(folder.names, stops, tuple(folder.stall_currents.tolist()), tuple(folder.voltages.tolist()))


def limits_file(folder: ArmFolder) -> Path:
    """Where an arm's limits stand."""
    return FILE if folder == find_arm(DEFAULT_ARM) else folder.folder / "limits.toml"


def rig_file(folder: ArmFolder) -> Path:
    """Where an arm's rig is described."""
    return DEFAULT_RIG if folder == find_arm(DEFAULT_ARM) else folder.folder / "rig.toml"


def rig_of(folder: ArmFolder, file: Path | None = None, *, simulated: bool = False) -> Rig:
    """An arm's rig, by default that in its folder.

    Args:
        folder: which arm.
        file: other than its own.
        simulated: no bus is to be driven: servos that cannot be driven together are taken, too.

    Raises:
        HighFiveError: as :func:`highfive.hil.drivers.bus.rig.load_rig`, or its servos do not fit the arm's joints.
    """
    path = file or rig_file(folder)
    if file is None and not path.is_file():
        raise HighFiveError(f"{folder.folder} has no {path.name}; draft one: highfive rig draft {folder.folder}")
    rig = load_rig(path, simulated=simulated)
    if (names := tuple(joint.name for joint in rig.joints)) != folder.names:
        raise HighFiveError(
            f"{path}: the rig has the joints {', '.join(names)}; this arm has {', '.join(folder.names)}"
        )
    for joint, driven in zip(rig.joints, folder.joints, strict=True):
        if (joint.model, len(joint.ids)) != (driven.model, driven.servos):
            raise HighFiveError(
                f"{path}: {joint.name} has {len(joint.ids)} × {joint.model}; {folder.name} has {driven.servos} × "
                f"{driven.model} there"
            )
    return called(rig, folder, file)


def called(rig: Rig, folder: ArmFolder, file: Path | None) -> Rig:
    """A rig that knows by what a command line names it: its arm, and its file where that is not the arm's own."""
    name = folder.key if folder.folder == ARMS / folder.key else str(folder.folder)
    return replace(rig, file=file, arm="" if folder == find_arm(DEFAULT_ARM) else name)


def resting_pose(folder: ArmFolder) -> np.ndarray:
    """(J,) rad, where the arm rests."""
    return limits_of(folder).way_points[-1]
