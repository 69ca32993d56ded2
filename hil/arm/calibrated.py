"""What a calibration makes of an arm: where it stands, how long its links are, what its servos' counts mean.

From here on everything that plans, judges or limits takes the arm for what was measured, not for its drawing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

import numpy as np

from highfive.calibration.arm_file import ArmCalibration, load_arm
from highfive.calibration.arm_latency import SERVO_LAG
from highfive.hil.arm.arm_files import limits_of, rig_of
from highfive.hil.arm.arm_options import VIRTUAL, ArmOptions
from highfive.hil.arm.fingerprint import fingerprint
from highfive.hil.arm_model.arm_folder import ArmFolder, find_arm
from highfive.hil.arm_model.corrections import Corrections
from highfive.hil.arm_model.from_mujoco import compiled_body
from highfive.hil.arm_model.mount import Mount
from highfive.hil.arm_model.servo_arm import ServoArm, mounted
from highfive.hil.drivers.bus.rig import Rig
from highfive.hil.safety.limits import Limits
from highfive.hil.safety.limits_file import lowered
from highfive.mocap_bridge.sources.address import parse_address
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class CalibratedSettings(Settings):
    """By how much a calibrated arm may differ from its files: more is another arm, another frame or another unit."""

    base: float = setting(0.1, "m", above=0.0)
    """Of the base's height: the world takes its place and yaw from the mount's file."""
    turn: float = setting(float(np.radians(10.0)), "rad", above=0.0)
    plate: float = setting(0.03, "m", above=0.0)
    facing: float = setting(float(np.radians(10.0)), "rad", above=0.0)


CALIBRATED = CalibratedSettings()


def calibration_file(options: ArmOptions, rig: Rig) -> Path | None:
    """What was named for the session, else what the rig's file names; None for neither."""
    return None if options.as_drawn else options.calibration or rig.calibration


def session_calibration(options: ArmOptions) -> Path | None:
    """The same, for whoever has no rig yet.

    Raises:
        HighFiveError: the rig's file cannot be used.
    """
    return calibration_file(options, rig_of(find_arm(options.arm), options.rig))


def trusted_calibration(options: ArmOptions, rig: Rig, now: datetime) -> ArmCalibration | None:
    """The arm's calibration; None where none is named: it is taken for what it was drawn as.

    Args:
        options: which arm.
        rig: of it.
        now: UTC.

    Raises:
        HighFiveError: it is not whole, of another arm, or, with a real port, nothing that a real arm may rely on.
    """
    if (file := calibration_file(options, rig)) is None:
        return None
    found, folder = load_arm(file), find_arm(options.arm)
    own = found.registration
    system = parse_address(options.person).scheme if options.person else own.system
    wrong = own.mismatches(fingerprint(rig, folder), system, now)
    if options.emulated:  # it stands in no room, and no tripod of it is moved
        wrong = own.mismatches(fingerprint(rig, folder), own.system, own.date)
    elif own.system == VIRTUAL:
        wrong = (f"calibration {own.path} was rehearsed with an emulated arm; measure this one", *wrong)
    if wrong:
        raise HighFiveError(wrong[0] + (f" (and {len(wrong) - 1} more)" if len(wrong) > 1 else ""))
    known_arm(folder, found)
    return found


def known_arm(folder: ArmFolder, found: ArmCalibration | None, settings: CalibratedSettings = CALIBRATED) -> ServoArm:
    """An arm as it is known: as calibrated, or, where it was not, as drawn.

    Raises:
        HighFiveError: the calibration differs by more from the drawing than an arm does.
    """
    drawn = mounted(folder)
    if found is None:
        return drawn
    where = f"calibration {found.registration.path}"
    if tuple(found.joints) != folder.names:
        raise HighFiveError(f"{where} has the joints {', '.join(found.joints)}; this arm {', '.join(folder.names)}")
    body = compiled_body(folder)
    away = float(np.linalg.norm(found.mount - np.array(folder.mount.position)))
    turned = _angle(rotations.multiply(found.mount_rotation, rotations.conjugate(folder.mount.quaternion)))
    if away > settings.base or turned > settings.turn:
        raise HighFiveError(
            f"{where}: the base stands {1e3 * away:.0f} mm and {np.degrees(turned):.1f}° off its mount, expected at "
            f"most {1e3 * settings.base:.0f} mm and {np.degrees(settings.turn):.0f}°; correct the mount, measure again"
        )
    off = float(np.linalg.norm(found.plate - body.plate))
    faces = float(np.arccos(np.clip(found.plate_normal @ body.normal, -1.0, 1.0)))
    if off > settings.plate or faces > settings.facing:
        raise HighFiveError(
            f"{where}: the plate is {1e3 * off:.0f} mm and {np.degrees(faces):.1f}° off the arm's model, expected at "
            f"most {1e3 * settings.plate:.0f} mm and {np.degrees(settings.facing):.0f}°; is its template in metres?"
        )
    joints = [found.joints[name] for name in folder.names]
    by = Corrections(
        lengths=np.array([joint.length for joint in joints]),
        tilts=np.array([joint.tilt for joint in joints]),
        compliance=np.array([joint.compliance for joint in joints]),
        plate=np.array(found.plate),
        normal=np.array(found.plate_normal),
    )
    return replace(drawn, mount=Mount.of(found.mount, found.mount_rotation), corrections=by)


def known_rig(rig: Rig, found: ArmCalibration | None) -> Rig:
    """A rig whose counts mean what was measured: zeros stay in the host's file, homing offsets as they are."""
    if found is None:
        return rig
    known = [(one, found.joints[one.name]) for one in rig.joints]
    return replace(rig, joints=tuple(replace(one, astray=by.zero, gap=by.shadow or 0.0) for one, by in known))


def calibration_troubles(found: ArmCalibration, rig: Rig, folder: ArmFolder, now: datetime) -> list[str]:
    """What stands against driving an arm by its calibration, a line each; nothing where nothing does.

    Args:
        found: the calibration.
        rig: of the arm, as its file has it.
        folder: the arm.
        now: UTC.
    """
    own = found.registration
    troubles = list(own.mismatches(fingerprint(rig, folder), own.system, now))
    try:
        known_arm(folder, found)
        known_limits(limits_of(folder), known_rig(rig, found), folder)
    except HighFiveError as error:
        troubles.append(str(error))
    return troubles


MOCAP_AGE, MOCAP_LATE = "mocap_age_s", "mocap_late_s"
"""How old a frame is as it arrives, and how late it is at the time at which a session takes it to have been seen."""


def known_lags(found: ArmCalibration | None, names: Sequence[str]) -> Array | None:
    """(J,) s, from command to encoder; None unless all joints were measured."""
    if found is None or not all(name + SERVO_LAG in found.latency for name in names):
        return None
    return np.array([found.latency[name + SERVO_LAG] for name in names])


def known_limits(limits: Limits, rig: Rig, folder: ArmFolder) -> Limits:
    """Limits of joints whose zeros were measured: a servo has one turn, which its zero has moved.

    Raises:
        HighFiveError: where the arm rests, goes back along, or waits is beyond them.
    """
    changes: dict[str, float] = {}
    for own, joint in zip(limits.joints, rig.joints, strict=True):
        low, high = joint.lower + joint.astray, joint.upper + joint.astray
        if low > own.lowest:
            changes[f"joint.{joint.name}.lowest"] = low
        if high < own.highest:
            changes[f"joint.{joint.name}.highest"] = high
    safer = lowered(limits, changes) if changes else limits
    ready = np.array(folder.ready)
    beyond = (ready < safer.lowest) | (ready > safer.highest)
    if beyond.any():
        name = limits.names[int(np.flatnonzero(beyond)[0])]
        raise HighFiveError(f"with its measured zero {name} cannot go to where the arm waits; put its horn on again")
    return safer


def _angle(quaternion: np.ndarray) -> float:
    return float(np.linalg.norm(rotations.to_rotation_vector(quaternion)))
