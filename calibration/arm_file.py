"""The calibration of one arm in one room, kept in a file that people can read, and that tells when it was changed.

Tables: ``[meta]``, ``[arm]``, ``[world]`` (where the room is: :mod:`highfive.calibration.registration`), ``[mount]``,
``[plate]``, ``[joints.NAME]``, ``[latency]`` (once it is measured), ``[quality]`` and ``[[pose]]``; SI units in the
names.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from highfive.calibration.arm_latency import SERVO_LAG
from highfive.calibration.placement_file import check_frame, vector
from highfive.calibration.registration import FORMAT, Registration, aware, registration_of
from highfive.model.errors import HighFiveError
from highfive.model.files import write_whole
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting
from highfive.model.toml_file import is_table, number, read_toml, table, typed

DIGEST = "digest = "
"""What the last line begins with: SHA-256 of all lines before it."""


@dataclass(frozen=True)
class ArmFileSettings(Settings):
    """What may stand in a file."""

    zero: float = setting(float(np.radians(10.0)), "rad", above=0.0)
    compliance: float = setting(0.010, "rad/(N·m)", above=0.0)
    """More than that gives by 5° under the arm's own weight: something is loose."""
    play: float = setting(float(np.radians(3.0)), "rad", above=0.0)
    length: float = setting(0.010, "m", above=0.0)
    tilt: float = setting(float(np.radians(3.0)), "rad", above=0.0)
    friction: float = setting(5.0, "N·m", above=0.0)
    """More than half of what the strongest servo gives: it is blocked."""
    shadow: float = setting(float(np.radians(3.0)), "rad", above=0.0)
    lag: float = setting(0.2, "s", above=0.0)
    """Servos that follow later could meet nobody."""
    late: float = setting(0.25, "s", above=0.0)
    """Of the motion capture, either way."""
    markers: int = setting(3, least=3)
    """Of the plate, that tell where it is."""


ARM_FILE = ArmFileSettings()


@dataclass(frozen=True)
class CalibratedJoint:
    """By what one joint differs from its drawing.

    Attributes:
        zero: rad, added to what its encoder says.
        compliance: rad/(N·m), by which it gives way that its encoder does not see; 0 or more.
        play: rad, between the two sides of approach.
        length, tilt: (3,) m and rad (a rotation vector), in the frame before it.
        friction: N·m, against slow motion; None where it was not measured.
        shadow: rad, by which its second servo said less than its first with torque off; None where there is none, or
            nobody measured it.
    """

    zero: float
    compliance: float
    play: float
    length: Array
    tilt: Array
    friction: float | None = None
    shadow: float | None = None


@dataclass(frozen=True)
class KeptPose:
    """One posture that the calibration rests on.

    Attributes:
        encoders: (J,) rad, what the servos said.
        residual: m, of its markers, root mean square; strays counted in full.
        held_out: m, distance of the plate's middle from where it was seen, by a fit that did not know this posture;
            None where the plate was not seen whole.
    """

    encoders: Array
    residual: float
    held_out: float | None


@dataclass(frozen=True)
class ArmCalibration:
    """What is known of one arm in one room.

    Attributes:
        registration: where the room is, of which arm, when, and how good it is.
        tool: version of the program that measured it.
        command: by which.
        note: of the operator.
        mount, mount_rotation: (3,) m and (4,) quaternion, of the arm's base in the world.
        plate, plate_normal: (3,) m and a unit vector, of its surface in the last joint's frame.
        marker_names, markers: (M,) and (M, 3) m, on the plate, in the last joint's frame.
        joints: by name.
        held_out_median, held_out_max: m, beside the registration's 95 of 100.
        rms: m, of what is left of the markers.
        temperatures: °C of the joints' servos, lowest and highest while it was measured; None where nobody read them.
        latency: s, by name, once it is measured; empty before.
        servos_date, latency_date: UTC, when play, friction and shadows, and when lags were measured; None where that
            was not done, or not told: the registration's date is that of its room, links and plate.
        poses: that it rests on; empty where they were not kept.
    """

    registration: Registration
    tool: str
    command: str
    note: str
    mount: Array
    mount_rotation: Array
    plate: Array
    plate_normal: Array
    marker_names: tuple[str, ...]
    markers: Array
    joints: Mapping[str, CalibratedJoint]
    held_out_median: float
    held_out_max: float
    rms: float
    temperatures: tuple[float, float] | None
    latency: Mapping[str, float]
    servos_date: datetime | None = None
    latency_date: datetime | None = None
    poses: tuple[KeptPose, ...] = ()


def save_arm(path: Path, found: ArmCalibration, *, replace: bool = False) -> None:
    """Writes a calibration in one piece, beside and renamed.

    Raises:
        HighFiveError: it cannot be written, or there is such a file and it is not to be replaced.
    """
    content = arm_text(found)
    try:
        write_whole(path, content.encode(), replace=replace)
    except OSError as error:
        raise HighFiveError(f"cannot write the calibration {path}: {error.strerror or error}") from None


def arm_text(found: ArmCalibration) -> str:
    """The file's content."""
    room = found.registration
    days = {"servos_date": found.servos_date, "latency_date": found.latency_date}
    lines = [
        "# Where one arm stands in one room, and by what it differs from its drawing: highfive calibrate extrinsics.",
        "# What is changed here by hand is refused: measure again.",
        "[meta]",
        f"format = {FORMAT}",
        f"date = {_date(room.date)}",
        *(f"{key} = {_date(day)}" for key, day in days.items() if day is not None),
        f"tool = {_text(found.tool)}",
        f"command = {_text(found.command)}",
        f"note = {_text(found.note)}",
        "\n[arm]",
        f"fingerprint = {_text(room.arm)}  # of servos, directions, zeros, lengths and mount",
        "\n[world]",
        f"system = {_text(room.system)}",
        f"rotation = {_list(room.world_from_mocap)}  # w, x, y, z: from the motion capture's frame to the world",
        f"translation_m = {_list(room.translation)}  # added after the rotation",
        "\n[mount]",
        f"position_m = {_list(found.mount)}  # of the arm's base in the world",
        f"rotation = {_list(found.mount_rotation)}",
        "\n[plate]",
        f"centre_m = {_list(found.plate)}  # of its surface, in the last joint's frame",
        f"normal = {_list(found.plate_normal)}",
        "\n[plate.markers_m]",
        *(f"{_text(n)} = {_list(at)}" for n, at in zip(found.marker_names, found.markers, strict=True)),
    ]
    for name, joint in found.joints.items():
        lines += [
            f"\n[joints.{name}]",
            f"zero_rad = {joint.zero:.9f}",
            f"compliance_rad_per_Nm = {joint.compliance:.9f}",
            f"play_rad = {joint.play:.9f}",
            f"length_m = {_list(joint.length)}",
            f"tilt_rad = {_list(joint.tilt)}",
        ]
        measured = {"friction_Nm": joint.friction, "shadow_rad": joint.shadow}
        lines += [f"{key} = {value:.9f}" for key, value in measured.items() if value is not None]
    if found.latency:
        lines += ["\n[latency]", *(f"{name} = {value:.6f}" for name, value in found.latency.items())]
    lines += [
        "\n[quality]",
        f"poses = {room.poses}",
        f"held_out_median_m = {found.held_out_median:.6f}",
        f"held_out_p95_m = {room.held_out_p95:.6f}",
        f"held_out_max_m = {found.held_out_max:.6f}",
        f"residual_rms_m = {found.rms:.6f}",
    ]
    if found.temperatures is not None:
        lines.append(f"temperatures_C = {_list(np.array(found.temperatures))}")
    for pose in found.poses:
        lines += ["\n[[pose]]", f"encoders_rad = {_list(pose.encoders)}", f"residual_m = {pose.residual:.6f}"]
        lines += [] if pose.held_out is None else [f"held_out_m = {pose.held_out:.6f}"]
    body = "\n".join(lines) + "\n\n[check]\n"
    return signed(body)


def load_arm(path: Path, settings: ArmFileSettings = ARM_FILE) -> ArmCalibration:
    """Reads a calibration, and checks that it is whole, as it was written, and of this world.

    Whether it is of this arm and room, new enough and good enough: :meth:`Registration.mismatches`.

    Raises:
        HighFiveError: it is not so; one line says what.
    """
    data = read_toml(path, "the calibration")
    if data and not {"arm", "mount", "joints"} & data.keys():
        kinds = ", ".join(f"[{name}]" for name in data)
        raise HighFiveError(f"{path} is no calibration of an arm: it has {kinds}, an arm's has [mount] and [joints]")
    try:
        _check_digest(path)
        return _calibration(path, data, settings)
    except HighFiveError as error:
        raise HighFiveError(f"{path} is no calibration of an arm: {error}; measure it again") from None


def _check_digest(path: Path) -> None:
    body, found, rest = path.read_text(encoding="utf-8").rpartition(DIGEST)
    if not found:
        raise HighFiveError("check.digest is missing")
    if rest.strip() != f'"{_digest(body)}"':
        raise HighFiveError("it was changed after it was written (check.digest)")


def signed(body: str) -> str:
    """A file's text with its sum at the end."""
    return f'{body}{DIGEST}"{_digest(body)}"\n'


def _digest(body: str) -> str:
    return hashlib.sha256(body.encode()).hexdigest()


def _calibration(path: Path, data: Mapping[str, Any], settings: ArmFileSettings) -> ArmCalibration:
    meta, mount, plate, quality = (table(data, name) for name in ("meta", "mount", "plate", "quality"))
    rotation, position = vector(mount, "mount.", "rotation", 4), vector(mount, "mount.", "position_m", 3)
    check_frame(rotation, position, "mount.", "position_m")
    normal = vector(plate, "plate.", "normal", 3)
    if abs(math.hypot(*normal) - 1.0) > 1e-6:
        raise HighFiveError("plate.normal is no unit vector")
    markers = table(plate, "markers_m")
    places = np.array([vector(markers, "plate.markers_m.", name, 3) for name in markers]).reshape(-1, 3)
    heat = vector(quality, "quality.", "temperatures_C", 2) if "temperatures_C" in quality else None
    times = data.get("latency", {})
    if not is_table(times):
        raise HighFiveError("[latency] is no table")
    if len(markers) < settings.markers:
        raise HighFiveError(f"plate.markers_m has {len(markers)} markers; {settings.markers} tell where the plate is")
    joints = {name: _joint(table(data, "joints"), name, settings) for name in table(data, "joints")}
    return ArmCalibration(
        registration=registration_of(path, data),
        tool=typed(meta, "meta.", "tool", str),
        command=typed(meta, "meta.", "command", str),
        note=typed(meta, "meta.", "note", str),
        mount=position,
        mount_rotation=rotation,
        plate=vector(plate, "plate.", "centre_m", 3),
        plate_normal=normal,
        marker_names=tuple(markers),
        markers=places,
        joints=joints,
        held_out_median=number(quality, "quality.", "held_out_median_m", float, 0.0, 1.0),
        held_out_max=number(quality, "quality.", "held_out_max_m", float, 0.0, 1.0),
        rms=number(quality, "quality.", "residual_rms_m", float, 0.0, 1.0),
        temperatures=None if heat is None else (float(heat[0]), float(heat[1])),
        latency={name: number(times, "latency.", name, float, *_times(name, settings)) for name in times},
        servos_date=_day(meta, "servos_date"),
        latency_date=_day(meta, "latency_date"),
        poses=_poses(data.get("pose", []), len(joints)),
    )


def _day(meta: Mapping[str, Any], name: str) -> datetime | None:
    return aware(meta, "meta.", name) if name in meta else None


def _poses(rows: object, joints: int) -> tuple[KeptPose, ...]:
    if not isinstance(rows, list):
        raise HighFiveError("[[pose]] is no list of tables")
    found, where = [], "pose."
    for row in rows:
        if not is_table(row):
            raise HighFiveError("a [[pose]] is no table")
        found.append(
            KeptPose(
                encoders=vector(row, where, "encoders_rad", joints),
                residual=number(row, where, "residual_m", float, 0.0, 1.0),
                held_out=_maybe(row, where, "held_out_m", 0.0, 1.0),
            )
        )
    return tuple(found)


def _joint(joints: Mapping[str, Any], name: str, settings: ArmFileSettings) -> CalibratedJoint:
    entry, where = table(joints, name), f"joints.{name}."
    length, tilt = vector(entry, where, "length_m", 3), vector(entry, where, "tilt_rad", 3)
    if (worst := float(np.abs(length).max())) > settings.length:
        raise HighFiveError(f"{where}length_m is {worst:g} off, at most {settings.length:g} are believed")
    if (worst := float(np.abs(tilt).max())) > settings.tilt:
        raise HighFiveError(f"{where}tilt_rad is {worst:g} off, at most {settings.tilt:g} are believed")
    return CalibratedJoint(
        zero=number(entry, where, "zero_rad", float, -settings.zero, settings.zero),
        compliance=number(entry, where, "compliance_rad_per_Nm", float, 0.0, settings.compliance),
        play=number(entry, where, "play_rad", float, -settings.play, settings.play),
        length=length,
        tilt=tilt,
        friction=_maybe(entry, where, "friction_Nm", 0.0, settings.friction),
        shadow=_maybe(entry, where, "shadow_rad", -settings.shadow, settings.shadow),
    )


def _times(name: str, settings: ArmFileSettings) -> tuple[float, float]:
    """Within which a latency is believed, s."""
    return (0.0, settings.lag) if name.endswith(SERVO_LAG) else (-settings.late, settings.late)


def _maybe(entry: Mapping[str, Any], where: str, name: str, low: float, high: float) -> float | None:
    return number(entry, where, name, float, low, high) if name in entry else None


def _date(value: datetime) -> str:
    return f"{value.astimezone(UTC):%Y-%m-%dT%H:%M:%SZ}"


def _text(value: str) -> str:
    plain = "".join(c if c.isprintable() else " " for c in value)
    return '"' + plain.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _list(values: Array) -> str:
    return "[" + ", ".join(f"{value:.12f}" for value in values) + "]"
