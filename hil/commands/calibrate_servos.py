"""``highfive calibrate servos``: zeros, directions, play, compliance, friction and shadows of an arm's servos.

Zeros stay in the host's file: no servo is written to, and homing offsets are as the rig has them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from highfive.calibration.arm_file import ArmCalibration, CalibratedJoint, load_arm, save_arm
from highfive.calibration.arm_kinematics import ArmShape
from highfive.calibration.pose_file import TakenPose, load_poses, save_poses, together
from highfive.calibration.servo_fit import ServoFit, fit_servos
from highfive.hil.arm.arm_files import limits_of, rig_of
from highfive.hil.arm.arm_options import VIRTUAL, ArmOptions
from highfive.hil.arm.calibrated import calibration_file, known_arm, known_limits, known_rig
from highfive.hil.arm.drawn_shape import drawn_shape
from highfive.hil.arm.extrinsics import check_directions
from highfive.hil.arm.fingerprint import fingerprint
from highfive.hil.arm.free_postures import check_way
from highfive.hil.arm.plate_watch import PlateWatch
from highfive.hil.arm.posture_drive import PostureDrive
from highfive.hil.arm.posture_route import route
from highfive.hil.arm.preconditions import check_options
from highfive.hil.arm.servo_poses import SWEEP_SPEED, frictions, pair_postures, take_pairs
from highfive.hil.arm.session_check import plate_of
from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.arm_model.servo_arm import ServoArm, mounted
from highfive.hil.commands.calibration_checks import (
    check_in_a_room,
    check_system,
    kept_where_refused,
    rehearsed,
)
from highfive.hil.commands.calibration_room import calibration_room
from highfive.hil.drivers.bus.rig import COUNTS, Rig
from highfive.hil.drivers.bus.rig_setup import shadow_counts
from highfive.hil.drivers.bus.serial_line import Wiring
from highfive.hil.drivers.bus.servo_bus import ServoBus
from highfive.hil.drivers.bus.servo_port import PATIENCE_MS
from highfive.hil.runtime.console import Bar, say_aside
from highfive.hil.runtime.folders import check_toml
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

FEWEST, MOST = 6, 60

Agreed = Callable[[list[str]], bool]
"""Whether what is new may be written; it is shown the lines."""


@dataclass(frozen=True)
class ServoOptions:
    """What is calibrated.

    Attributes:
        arm: which arm, with its calibration; it moves slowly.
        source: the motion capture's address; None to rehearse.
        pairs: number of postures, each of which is taken from both sides.
        seed: of the postures, and of an arm that rehearses.
        out: the calibration with the servos in it.
        overwrite: replace it if it is there.
    """

    arm: ArmOptions
    source: str | None
    pairs: int = 12
    seed: int = 0
    out: Path = Path("arm.toml")
    overwrite: bool = False


@dataclass(frozen=True)
class KnownServos:
    """What a run works on, before anything moves: the options, and the arm as it was calibrated."""

    options: ServoOptions
    rig: Rig
    found: ArmCalibration
    body: ServoArm

    @property
    def arm(self) -> str:
        """Fingerprint."""
        return fingerprint(self.rig, self.body.folder)

    @property
    def half_done(self) -> Path:
        """Where pairs are kept until the calibration is written."""
        out = self.options.out
        return out.with_name(f"{out.stem}.pairs.json")

    @property
    def shape(self) -> ArmShape:
        """The arm as drawn, with the markers as they were calibrated."""
        return drawn_shape(mounted(self.body.folder), self.found.markers)


@dataclass(frozen=True)
class Seen:
    """What a run measured.

    Attributes:
        poses: pairs.
        friction: N·m, by joint.
        shadows: counts, by which a second servo says less than its first, torque off, by joint.
        moving_s: s, that the arm moved.
    """

    poses: list[TakenPose]
    friction: dict[str, float]
    shadows: dict[str, int]
    moving_s: float


def checked_servos(options: ServoOptions) -> KnownServos:
    """Looks at what was requested before anything is opened.

    Raises:
        HighFiveError: something cannot be used; one line says what.
    """
    system = VIRTUAL if rehearsed(options.arm, options.source) else check_system(options.source)
    if not FEWEST <= options.pairs <= MOST:
        raise HighFiveError(f"--pairs {options.pairs}; expected {FEWEST} to {MOST}, 12 are good")
    check_toml(options.out, "a calibration", options.overwrite)
    rig = check_options(options.arm)[1]
    if (file := calibration_file(options.arm, rig)) is None:
        raise HighFiveError(
            "servos are calibrated in a room that is known: run highfive calibrate extrinsics first, and give its file "
            "with --calibration FILE.toml"
        )
    found = load_arm(file)
    if system != found.registration.system:
        raise HighFiveError(f"--source is a {system} system; {file} is of a {found.registration.system} system")
    return KnownServos(options, rig, found, known_arm(find_arm(options.arm.arm), found))


def calibrate_servos(options: ServoOptions, bar: Bar, agreed: Agreed) -> dict[str, Any]:
    """Moves an arm to postures from both sides, fits its servos, and writes what is new once that is agreed to.

    Returns:
        The summary; ``written`` says whether it was.

    Raises:
        HighFiveError: something cannot be used, the arm was stopped, or nothing should rest on what was found.
    """
    run = checked_servos(options)
    if run.found.registration.system != VIRTUAL:
        check_in_a_room(options.arm)
    with kept_where_refused(run.half_done):
        with calibration_room(options.arm, options.source, plate_of(run.found), options.seed) as room:
            shadows = shadows_of(run, room.port, room.wiring)
            with room.driven(run.body) as drive:
                seen = seen_servos(run, drive, room.watch, shadows, bar)
        return written_servos(run, seen, agreed)


def shadows_of(run: KnownServos, port: str, wiring: Wiring) -> dict[str, int]:
    """Counts by which second servos say less than their firsts, torque off, by joint.

    Raises:
        HighFiveError: torque is on (they hold each other where they are), or a servo does not answer.
    """
    bus = ServoBus(port, run.rig.baud_rate, run.rig.models, PATIENCE_MS, wiring)
    try:
        if live := [servo for servo in run.rig.servos if bus.read(servo, "torque_enable")]:
            raise HighFiveError(
                f"servo {live[0]}: torque is on, and shadows are looked at without; hold the arm, and "
                f"{run.rig.command('release', port)}"
            )
        return shadow_counts(bus, run.rig)
    finally:
        bus.close()


def seen_servos(run: KnownServos, drive: PostureDrive, watch: PlateWatch, shadows: dict[str, int], bar: Bar) -> Seen:
    """Turns joints to see their directions, takes pairs of postures, and sweeps joints for their friction.

    Raises:
        HighFiveError: as :func:`calibrate_servos`.
    """
    ready, options = run.body.ready, run.options
    postures, sides = pair_postures(run.body, run.shape, options.pairs, options.seed)
    names, before = run.found.marker_names, list[TakenPose]()
    if run.half_done.exists():
        before = load_poses(run.half_done, run.arm, names, len(ready))
        say_aside(f"{len(before) // 2} pairs are there from {run.half_done}; the rest is taken now")
    stages = route(run.body, postures, before)  # all that takes time before the arm moves
    advance = bar("pairs and joints", len(postures) + len(ready))
    advance("", len(before) // 2)
    check_way(run.body, drive.positions, ready, drive.command("release"))
    drive.go(ready)
    check_directions(drive, watch, run.shape, run.body)

    def keep(poses: list[TakenPose]) -> None:
        drive.while_standing(lambda: save_poses(run.half_done, run.arm, names, poses))
        advance()

    poses = take_pairs(drive, watch, stages, postures, sides, before, keep)
    return Seen(poses, frictions(drive, run.body, advance), shadows, drive.moving_s)


def written_servos(run: KnownServos, seen: Seen, agreed: Agreed) -> dict[str, Any]:
    """Fits, checks the limits again, shows what is new, and writes and reads it back if that is agreed to.

    Raises:
        HighFiveError: nothing should rest on it, a joint's limits leave no way with its zero, or the file does not hold
            what was written.
    """
    options, found = run.options, run.found
    zeros = np.array([found.joints[name].zero for name in run.shape.names])
    poses = together(seen.poses)
    fit = fit_servos(run.shape, found, replace(poses, encoders=poses.encoders - zeros))
    gaps = {name: counts * math.tau / COUNTS for name, counts in seen.shadows.items()}
    joints = {
        name: replace(joint, friction=seen.friction.get(name), shadow=gaps.get(name))
        for name, joint in (fit.found if fit.after < fit.before else found).joints.items()
    }
    new = replace(fit.found, joints=joints, servos_date=datetime.now(UTC))
    folder = run.body.folder
    known_arm(folder, new)
    known_limits(limits_of(folder), known_rig(rig_of(folder, options.arm.rig), new), folder)
    lines = [
        line
        for name, errors in zip(joints, 1.96 * fit.sigmas.T, strict=True)
        for line in _changes(name, found.joints[name], joints[name], errors)
    ]
    if written := agreed(lines):
        save_arm(options.out, new, replace=options.overwrite)
        kept = load_arm(options.out)
        if changed := [name for name in joints if _changes(name, joints[name], kept.joints[name])]:
            raise HighFiveError(f"{options.out} does not hold what was written ({changed[0]}); is the disk whole?")
        run.half_done.unlink(missing_ok=True)
    return _summary(run, seen, fit, new, lines, written)


def _changes(name: str, old: CalibratedJoint, new: CalibratedJoint, errors: Array | None = None) -> list[str]:
    """What is new of a joint, a line each; to the places that people read. ``errors``: (3,) of zero, compliance and
    play, 95 %: what is within them is said to be so."""
    rows = {
        "zero": (_degrees(old.zero), _degrees(new.zero)),
        "compliance": (f"{1e3 * old.compliance:.2f} mrad/N·m", f"{1e3 * new.compliance:.2f} mrad/N·m"),
        "play": (_degrees(old.play), _degrees(new.play)),
        "friction": (_maybe(old.friction, "N·m"), _maybe(new.friction, "N·m")),
        "shadow": (_counts(old.shadow), _counts(new.shadow)),
    }
    within = {
        what: errors is not None and abs(getattr(new, what) - getattr(old, what)) <= errors[row]
        for row, what in enumerate(("zero", "compliance", "play"))
    }
    return [
        f"{name}: {what} {before} -> {after}{', which is within its error' if within.get(what) else ''}"
        for what, (before, after) in rows.items()
        if before != after
    ]


def _degrees(angle: float) -> str:
    return f"{round(float(np.degrees(angle)), 2) + 0.0:.2f}°"  # + 0: never -0.00


def _maybe(value: float | None, unit: str) -> str:
    return "not measured" if value is None else f"{value:.3f} {unit}"


def _counts(value: float | None) -> str:
    return "not measured" if value is None else f"{round(value * COUNTS / math.tau)} counts apart"


def _summary(
    run: KnownServos, seen: Seen, fit: ServoFit, new: ArmCalibration, lines: list[str], written: bool
) -> dict[str, Any]:
    return {
        "out": str(run.options.out),
        "written": written,
        "arm": run.arm,
        "pairs": len(seen.poses) // 2,
        "moving_s": round(seen.moving_s, 1),
        "off_before_mm": round(1e3 * fit.before, 2),
        "off_mm": round(1e3 * fit.after, 2),
        "friction_at_rad_s": SWEEP_SPEED,
        "changes": lines,
        "joints": {
            name: {
                "zero_deg": round(float(np.degrees(joint.zero)), 4),
                "zero_moved_deg": round(float(np.degrees(joint.zero - run.found.joints[name].zero)), 3),
                "zero_error_deg": round(float(np.degrees(1.96 * fit.sigmas[0, j])), 3),
                "compliance_mrad_Nm": round(1e3 * joint.compliance, 3),
                "play_deg": round(float(np.degrees(joint.play)), 4),
                "play_error_deg": round(float(np.degrees(1.96 * fit.sigmas[2, j])), 3),
                "friction_Nm": None if joint.friction is None else round(joint.friction, 4),
                "shadow_counts": seen.shadows.get(name),
            }
            for j, (name, joint) in enumerate(new.joints.items())
        },
    }


def print_servos(summary: dict[str, Any]) -> None:
    """The summary for people."""
    print(f"{summary['pairs']} postures from both sides, the arm moved for {summary['moving_s']:.0f} s.")
    for name, of in summary["joints"].items():
        shadow = "" if of["shadow_counts"] is None else f", shadow {of['shadow_counts']} counts"
        print(
            f"  {name:<14}zero {of['zero_deg']:6.2f}° ± {of['zero_error_deg']:.2f}, play {of['play_deg']:5.2f}° ± "
            f"{of['play_error_deg']:.2f}, gives {of['compliance_mrad_Nm']:.2f} mrad/N·m, friction "
            f"{of['friction_Nm']:.2f} N·m{shadow}"
        )
    before, after = summary["off_before_mm"], summary["off_mm"]
    better = "and is" if after < before else "and would be"
    print(
        f"The plate was {before:.2f} mm off (root mean square), {better} {after:.2f} in postures held out of the fit"
        f"{'.' if after < before else ': zeros, compliance and play stay as they were.'}"
    )
    say = f"Written, and read back: {summary['out']}" if summary["written"] else "Nothing was written."
    print(say)


def shown(lines: list[str]) -> None:
    """What would be new, on standard error."""
    for line in lines or ["nothing is new"]:
        say_aside(f"  {line}")
