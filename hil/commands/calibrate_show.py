"""``highfive calibrate show``: what is calibrated of an arm, when and how well, and how two calibrations differ."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from highfive.calibration.arm_difference import arm_difference, plate_places
from highfive.calibration.arm_file import ArmCalibration, CalibratedJoint, load_arm
from highfive.calibration.arm_latency import SERVO_LAG
from highfive.calibration.registration import REGISTRATION
from highfive.hil.arm.arm_files import rig_of
from highfive.hil.arm.calibrated import calibration_troubles
from highfive.hil.arm.drawn_shape import drawn_shape
from highfive.hil.arm.fingerprint import fingerprint
from highfive.hil.arm.free_postures import PostureSettings, free_postures
from highfive.hil.arm_model.arm_folder import DEFAULT_ARM, ArmFolder, find_arm
from highfive.hil.arm_model.servo_arm import mounted
from highfive.hil.drivers.bus.rig import COUNTS
from highfive.hil.runtime.console import STDOUT, counted
from highfive.hil.runtime.folders import check_file
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

MM, MRAD, MS = 1e3, 1e3, 1e3
FAR_M = 4.0
"""A motion capture's origin that is further from the arm would make all else small in the picture."""
FEW = 10
"""Postures below which those of the arm as drawn are taken, too, to tell two calibrations apart."""


@dataclass(frozen=True)
class ShowOptions:
    """What is shown.

    Attributes:
        files: one calibration, or two of the same arm.
        arm: name of the arm, or its folder.
        rig: file of the rig; None for the arm's own.
        picture: where the room and the residuals are drawn; None for nowhere.
        overwrite: replace a picture that is there.
    """

    files: tuple[Path, ...]
    arm: str = DEFAULT_ARM
    rig: Path | None = None
    picture: Path | None = None
    overwrite: bool = False


def calibrate_show(options: ShowOptions) -> dict[str, Any]:
    """What one calibration says, and how a second one differs.

    Raises:
        HighFiveError: one is none, they are of two arms, or the picture cannot be written.
    """
    if len(options.files) > 2:
        raise HighFiveError(f"{len(options.files)} calibrations; expected one, or two to compare")
    if options.picture is not None:
        if options.picture.suffix != ".png":
            raise HighFiveError(f"--picture {options.picture}: a picture is a PNG file; write it as picture.png")
        check_file(options.picture, options.overwrite, "--picture")
    folder, now = find_arm(options.arm), datetime.now(UTC)
    rig = rig_of(folder, options.rig, simulated=True)
    found = [load_arm(file) for file in options.files]
    own = fingerprint(rig, folder)
    result: dict[str, Any] = {
        "arm": folder.name,
        "fingerprint": own,
        "calibrations": [
            _described(one, folder, now) | {"troubles": calibration_troubles(one, rig, folder, now)} for one in found
        ],
    }
    if len(found) == 2:
        result["difference"] = _compared(found[0], found[1], folder)
    if options.picture is not None:
        _draw(options.picture, found[0], folder, options.overwrite)
        result["picture"] = str(options.picture)
    return result


def _draw(path: Path, found: ArmCalibration, folder: ArmFolder, overwrite: bool) -> None:
    from highfive.hil.report.calibration_figure import CalibrationShown, draw_calibration  # noqa: PLC0415 (matplotlib)

    room, poses = found.registration, found.poses
    frames = {
        "world": (np.zeros(3), np.eye(3)),
        "base": (found.mount, rotations.to_matrix(found.mount_rotation)),
        room.system: (room.translation, rotations.to_matrix(room.world_from_mocap)),
    }
    if np.linalg.norm(room.translation - found.mount) > FAR_M:
        frames.pop(room.system)
    plates = np.zeros((0, 3))
    if poses and _joints(found) == folder.names:
        shape = drawn_shape(mounted(folder), found.markers)
        plates = plate_places(shape, found, np.array([pose.encoders for pose in poses]))
    shown = CalibrationShown(
        title=f"{room.path.name}, {room.date:%Y-%m-%d}",
        frames=frames,
        plates=plates,
        held_out=np.array([np.nan if pose.held_out is None else pose.held_out for pose in poses]),
        residuals=np.array([pose.residual for pose in poses]),
        worst=REGISTRATION.worst,
    )
    draw_calibration(path, shown, replace=overwrite)


def _joints(found: ArmCalibration) -> tuple[str, ...]:
    return tuple(found.joints)


def _described(found: ArmCalibration, folder: ArmFolder, now: datetime) -> dict[str, Any]:
    room = found.registration
    away = MM * (found.mount - np.array(folder.mount.position))
    turned = rotations.multiply(found.mount_rotation, rotations.conjugate(folder.mount.quaternion))
    return {
        "file": str(room.path),
        "arm": room.arm,
        "system": room.system,
        "tool": found.tool,
        "command": found.command,
        "note": found.note,
        "measured": {
            "extrinsics": _when(room.date, now),
            "servos": None if found.servos_date is None else _when(found.servos_date, now),
            "latency": None if found.latency_date is None else _when(found.latency_date, now),
        },
        "quality_mm": {
            "held_out_median": round(MM * found.held_out_median, 2),
            "held_out_p95": round(MM * room.held_out_p95, 2),
            "held_out_max": round(MM * found.held_out_max, 2),
            "residual_rms": round(MM * found.rms, 2),
        },
        "poses": [
            {
                "encoders_deg": np.degrees(pose.encoders).round(2).tolist(),
                "residual_mm": round(MM * pose.residual, 2),
                "held_out_mm": None if pose.held_out is None else round(MM * pose.held_out, 2),
            }
            for pose in found.poses
        ],
        "poses_counted": room.poses,
        "base_moved_mm": away.round(1).tolist(),
        "base_turned_deg": round(float(np.degrees(np.linalg.norm(rotations.to_rotation_vector(turned)))), 2),
        "temperatures_C": found.temperatures,
        "joints": _joints_of(found),
        "latency_ms": {
            name: round(MS * value, 2) for name, value in found.latency.items() if not name.endswith(SERVO_LAG)
        },
    }


def _when(date: datetime, now: datetime) -> dict[str, Any]:
    return {"date": date.isoformat(), "days_ago": round((now - date).total_seconds() / 86_400.0, 1)}


def _joints_of(found: ArmCalibration) -> dict[str, dict[str, Any]]:
    return {
        name: _joint(joint, found.latency.get(name + SERVO_LAG), found.servos_date is not None)
        for name, joint in found.joints.items()
    }


def _joint(joint: CalibratedJoint, lag: float | None, servos: bool) -> dict[str, Any]:
    return {
        "zero_deg": round(float(np.degrees(joint.zero)), 3),
        "play_deg": round(float(np.degrees(joint.play)), 3) if servos or joint.play else None,
        "compliance_mrad_Nm": round(MRAD * joint.compliance, 3),
        "length_mm": round(MM * float(np.linalg.norm(joint.length)), 2),
        "tilt_deg": round(float(np.degrees(np.linalg.norm(joint.tilt))), 3),
        "friction_Nm": None if joint.friction is None else round(joint.friction, 3),
        "shadow_counts": None if joint.shadow is None else round(joint.shadow * COUNTS / (2.0 * np.pi)),
        "lag_ms": None if lag is None else round(MS * lag, 2),
    }


def _compared(one: ArmCalibration, two: ArmCalibration, folder: ArmFolder) -> dict[str, Any]:
    """How the second differs from the first."""
    for found in (one, two):
        if _joints(found) != folder.names:
            raise HighFiveError(
                f"{found.registration.path} has the joints {', '.join(found.joints)}; {folder.name} has "
                f"{', '.join(folder.names)}: which arm is it? give --arm NAME"
            )
    if one.registration.arm != two.registration.arm:
        raise HighFiveError(
            f"{two.registration.path} is of another arm ({two.registration.arm}) than {one.registration.path} "
            f"({one.registration.arm}); two of one arm can be compared"
        )
    arm, encoders = mounted(folder), _postures(one, two, folder)
    apart = arm_difference((drawn_shape(arm, one.markers), drawn_shape(arm, two.markers)), one, two, encoders)
    return {
        "postures": len(encoders),
        "plate_mm": _spread(apart.plate),
        "plate_alone_mm": _spread(apart.bent),
        "moved_mm": round(MM * apart.moved, 2) if apart.plate.size else None,
        "turned_deg": round(float(np.degrees(apart.turned)), 3) if apart.plate.size else None,
        "joints": _changes(one, two),
        "disagreement": apart.trouble,
    }


def _postures(one: ArmCalibration, two: ArmCalibration, folder: ArmFolder) -> Array:
    """Those that both rest on; where few were kept, others."""
    kept = [pose.encoders for found in (one, two) for pose in found.poses]
    if len(kept) < FEW:
        kept += list(free_postures(mounted(folder), 0, PostureSettings(candidates=30)))
    return np.array(kept)


def _spread(off: Array) -> dict[str, float] | None:
    if off.size == 0:
        return None
    return {"median": round(MM * float(np.median(off)), 2), "p95": round(MM * float(np.percentile(off, 95)), 2)}


def _changes(one: ArmCalibration, two: ArmCalibration) -> dict[str, dict[str, float | None]]:
    """By joint, what the second has more than the first; None where one of them does not have it."""
    before, after = _joints_of(one), _joints_of(two)
    return {
        name: {
            key: None if value is None or after[name][key] is None else round(after[name][key] - value, 3)
            for key, value in row.items()
        }
        for name, row in before.items()
    }


def print_show(result: dict[str, Any]) -> None:
    """For people."""
    for found in result["calibrations"]:
        _print_one(found)
    if (apart := result.get("difference")) is not None:
        _print_difference(apart, result["calibrations"])
    if "picture" in result:
        print(f"Drawn: {result['picture']}")


COLUMNS = {
    "zero_deg": "zero\n°", "play_deg": "play\n°", "compliance_mrad_Nm": "gives\nmrad/Nm", "length_mm": "length\nmm",
    "tilt_deg": "tilt\n°", "friction_Nm": "friction\nNm", "shadow_counts": "shadow\ncounts", "lag_ms": "lag\nms",
}  # fmt: skip


def _table(rows: dict[str, dict[str, Any]], signed: bool = False) -> Table:
    """Joints below each other; columns that say nothing are left out."""
    told = [key for key in COLUMNS if any(row[key] is not None for row in rows.values())]
    columns = (COLUMNS[key] for key in told)
    table = Table("joint", *columns, box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for name, row in rows.items():
        cells = ["–" if row[key] is None else f"{row[key]:{'+' if signed else ''}g}" for key in told]
        table.add_row(name, *cells)
    return table


def _print_one(found: dict[str, Any]) -> None:
    off, days = found["quality_mm"], found["measured"]
    print(f"{found['file']}: arm {found['arm']}, {found['system']}" + (f", {found['note']}" if found["note"] else ""))
    for what, when in days.items():
        said = "not measured" if when is None else f"{when['date'][:10]}, {when['days_ago']:.0f} days ago"
        print(f"  {what:<12}{said}")
    x, y, z = found["base_moved_mm"]
    print(f"  base        {x:+.0f}, {y:+.0f}, {z:+.0f} mm and {found['base_turned_deg']:.1f}° off its mount's file")
    print(
        f"  plate       {off['held_out_median']:.1f} mm (median), {off['held_out_p95']:.1f} (95 %), "
        f"{off['held_out_max']:.1f} (largest) in {counted(found['poses_counted'], 'posture')} held out; residuals "
        f"{off['residual_rms']:.1f}"
    )
    worst = sorted((p for p in enumerate(found["poses"], 1) if p[1]["held_out_mm"]), key=lambda p: -p[1]["held_out_mm"])
    for number, pose in worst[:3]:
        at = ", ".join(f"{angle:.0f}" for angle in pose["encoders_deg"])
        left = f"{pose['held_out_mm']:.1f} mm held out, residuals {pose['residual_mm']:.1f}"
        print(f"  posture {number:<4}{left}, at {at}°")
    for name, value in found["latency_ms"].items():
        print(f"  {name.removesuffix('_s'):<12}{value:.1f} ms")
    for line in found["troubles"]:
        print(f"  no real arm is moved by it: {line}")
    STDOUT.print(_table(found["joints"]))


def _print_difference(apart: dict[str, Any], both: list[dict[str, Any]]) -> None:
    print(f"{both[1]['file']} has more than {both[0]['file']}:")
    STDOUT.print(_table(apart["joints"], signed=True))
    if (plate := apart["plate_mm"]) is not None:
        print(
            f"The plate, by both, in {apart['postures']} postures: {plate['median']:.1f} mm apart (median), "
            f"{plate['p95']:.1f} (95 %)."
        )
        print(f"The arm as a whole: {apart['moved_mm']:.1f} mm and {apart['turned_deg']:.2f}° in the room.")
    alone = apart["plate_alone_mm"]
    print(f"Without that: {alone['median']:.1f} mm (median), {alone['p95']:.1f} (95 %).")
    print(apart["disagreement"].capitalize() or "They agree.")
