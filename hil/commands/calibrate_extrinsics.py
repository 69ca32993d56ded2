"""``highfive calibrate extrinsics``: where an arm stands in the motion capture's room, and by what it differs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from highfive.calibration.arm_file import load_arm, save_arm
from highfive.calibration.arm_fit import ArmFit, check_fit, fit_arm
from highfive.calibration.arm_kinematics import ArmShape
from highfive.calibration.arm_observability import check_excitation, not_observed
from highfive.calibration.arm_plate import Plate, check_loose, held_out, plate_of_fit
from highfive.calibration.arm_result import Source, calibration_of
from highfive.calibration.kept_servos import LAGS, SEEN, SERVOS, KeptServos, kept_servos, with_servos, without_play
from highfive.calibration.plate_template import PlateTemplate, load_template
from highfive.calibration.pose_choice import choose_poses
from highfive.calibration.pose_file import TakenPose, load_poses, save_poses, together
from highfive.calibration.registration import REGISTRATION
from highfive.hil.arm.arm_options import VIRTUAL, ArmOptions
from highfive.hil.arm.calibrated import calibration_troubles
from highfive.hil.arm.drawn_shape import drawn_shape
from highfive.hil.arm.extrinsics import check_directions, take_poses
from highfive.hil.arm.fingerprint import fingerprint
from highfive.hil.arm.free_postures import check_way, free_postures
from highfive.hil.arm.hidden_arm import TEMPLATE, drawn_truth
from highfive.hil.arm.plate_errors import contact_postures, missed, true_plates
from highfive.hil.arm.plate_watch import PlateWatch
from highfive.hil.arm.posture_drive import PostureDrive
from highfive.hil.arm.posture_route import route
from highfive.hil.arm.preconditions import check_options
from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.arm_model.servo_arm import ServoArm, mounted
from highfive.hil.commands.calibration_checks import (
    check_in_a_room,
    check_system,
    kept_where_refused,
    rehearsed,
)
from highfive.hil.commands.calibration_room import calibration_room
from highfive.hil.commands.rig.rehearsal import differences, hidden_lines
from highfive.hil.drivers.bus.rig import Rig
from highfive.hil.runtime.console import Bar, say_aside
from highfive.hil.runtime.folders import check_toml
from highfive.hil.trials.summary import versions
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

FEWEST, MOST = REGISTRATION.fewest_poses, 100
UP = np.array([0.0, 0.0, 1.0])
"""Of the motion capture's frame: links hand over frames with z up."""


@dataclass(frozen=True)
class ExtrinsicsOptions:
    """What is calibrated.

    Attributes:
        arm: which arm; it moves slowly.
        source: the motion capture's address; None to rehearse.
        plate: file of the plate's template; None to rehearse.
        poses: number of postures.
        seed: of the postures, and of an arm that rehearses.
        note: of the operator, for the file.
        out: the calibration.
        overwrite: replace it if it is there.
    """

    arm: ArmOptions
    source: str | None
    plate: Path | None
    poses: int = 30
    seed: int = 0
    note: str = ""
    out: Path = Path("arm.toml")
    overwrite: bool = False


@dataclass(frozen=True)
class Calibrated:
    """What a run works on, before anything moves; ``system`` sees the plate, :data:`VIRTUAL` in a rehearsal."""

    options: ExtrinsicsOptions
    rig: Rig
    template: PlateTemplate
    system: str

    @cached_property
    def body(self) -> ServoArm:
        """The arm as drawn."""
        return mounted(find_arm(self.options.arm.arm))

    @property
    def shape(self) -> ArmShape:
        """The arm as drawn, with the template's markers."""
        return drawn_shape(self.body, self.template.markers)

    @property
    def arm(self) -> str:
        """Fingerprint."""
        return fingerprint(self.rig, self.body.folder)

    @cached_property
    def kept(self) -> KeptServos:
        """What of the file that is to be replaced is still valid; nothing where there is none."""
        out = self.options.out
        if not out.exists():
            return KeptServos()
        try:
            before = load_arm(out)
        except HighFiveError as error:
            return KeptServos(dropped={f"{SERVOS} or {LAGS}": str(error)})
        return kept_servos(before, self.arm, self.system, datetime.now(UTC))

    @property
    def half_done(self) -> Path:
        """Where poses are kept until the calibration is written."""
        out = self.options.out
        return out.with_name(f"{out.stem}.poses.json")


def checked_extrinsics(options: ExtrinsicsOptions) -> Calibrated:
    """Looks at what was requested before anything is opened.

    Raises:
        HighFiveError: something cannot be used; one line says what.
    """
    rehearsal = rehearsed(options.arm, options.source)
    system = VIRTUAL if rehearsal else check_system(options.source)
    if rehearsal and options.plate is not None:
        raise HighFiveError("--plate: a rehearsal has a plate of its own; leave it out")
    if not rehearsal and options.plate is None:
        raise HighFiveError("--plate: which file has the plate's template? (docs/calibration.md)")
    if not FEWEST <= options.poses <= MOST:
        raise HighFiveError(f"--poses {options.poses}; expected {FEWEST} to {MOST}, 30 are good")
    check_toml(options.out, "a calibration", options.overwrite)
    options = replace(options, arm=replace(options.arm, as_drawn=True))
    template = TEMPLATE if options.plate is None else load_template(options.plate)
    return Calibrated(options, check_options(options.arm)[1], template, system)


def calibrate_extrinsics(options: ExtrinsicsOptions, bar: Bar) -> dict[str, Any]:
    """Moves an arm to postures that tell most of it, watches its plate, fits, and writes the calibration.

    Returns:
        The summary.

    Raises:
        HighFiveError: something cannot be used, the arm was stopped, or nothing should rest on what was found.
    """
    run = checked_extrinsics(options)
    if run.system != VIRTUAL:
        check_in_a_room(options.arm)
    for line in not_kept(run):
        say_aside(line)
    with kept_where_refused(run.half_done):
        here = calibration_room(run.options.arm, options.source, run.template, options.seed)
        with here as room, room.driven(run.body) as drive:
            poses = measured(run, drive, room.watch, bar)
        return fitted(run, poses, drive.moving_s)


def not_kept(run: Calibrated) -> list[str]:
    """What of the calibration that is replaced will not be in the new one, and what measures it again: a line each."""
    options, port, out = run.options, run.options.arm.port, str(run.options.out)
    same = ("--calibration", out, "--out", out, "--overwrite")
    seen = () if options.source is None else ("--source", options.source)
    again = {
        SERVOS: run.rig.calibrate("servos", port, *seen, *same),
        LAGS: run.rig.calibrate("latency", port, *same),
        SEEN: run.rig.calibrate("latency", port, *seen, *same),
    }
    lines = []
    for what, why in run.kept.dropped.items():
        commands = [command for name, command in again.items() if name in what]
        lines.append(f"{options.out}: {what} in it are not kept, for {why}; afterwards: {'; '.join(commands)}")
    return lines


def measured(run: Calibrated, drive: PostureDrive, watch: PlateWatch, bar: Bar) -> list[TakenPose]:
    """Takes the postures; those of a run that broke off are not taken again.

    Raises:
        HighFiveError: as :func:`calibrate_extrinsics`.
    """
    shape, names = run.shape, run.template.names
    before: list[TakenPose] = []
    if run.half_done.exists():
        before = load_poses(run.half_done, run.arm, names, len(shape.names))
        say_aside(f"{len(before)} poses are there from {run.half_done}; the rest is taken now")
    postures = chosen_postures(run)
    stages = route(run.body, postures, before)  # all that takes time before the arm moves
    advance = bar("poses", len(postures))
    advance("", len(before))
    check_way(run.body, drive.positions, run.body.ready, drive.command("release"))
    drive.go(run.body.ready)
    check_directions(drive, watch, shape, run.body)

    def keep(poses: list[TakenPose]) -> None:
        drive.while_standing(lambda: save_poses(run.half_done, run.arm, names, poses))
        advance()

    return take_poses(drive, watch, run.body.ready, stages, before, keep)


def chosen_postures(run: Calibrated) -> Array:
    """Postures (N, J), rad, that tell most."""
    free = free_postures(run.body, run.options.seed)
    return free[choose_poses(run.shape, free, run.options.poses)]


def fitted(run: Calibrated, taken: list[TakenPose], moving_s: float) -> dict[str, Any]:
    """Fits, holds the result to what it has to be, and writes it; the poses that were kept are deleted then.

    Raises:
        HighFiveError: nothing should rest on it; the poses stay.
    """
    options, shape, template = run.options, run.shape, run.template
    poses = without_play(together(taken), run.kept.play(shape.names))
    check_excitation(shape.names, poses)
    fit = fit_arm(shape, poses, UP)
    check_loose(fit, poses, template)
    check_fit(fit)
    plate = plate_of_fit(fit, template)
    off = held_out(shape, poses, UP, template)
    mount = run.body.mount
    source = Source(
        arm=run.arm,
        system=run.system,
        date=datetime.now(UTC),
        tool=str(versions()["high-five"]),
        command="highfive calibrate extrinsics",
        note=options.note,
    )
    place = (np.array(mount.position), mount.quaternion)
    kept = with_servos(calibration_of(options.out, fit, poses, plate, template, off, place, source), run.kept)
    if troubles := calibration_troubles(kept, run.rig, run.body.folder, source.date):
        there = f"; {options.out} stays as it was" if options.out.exists() else ""
        raise HighFiveError(f"no session would take what was found: {'; '.join(troubles)}{there}")
    save_arm(options.out, kept, replace=options.overwrite)
    run.half_done.unlink(missing_ok=True)
    return {
        "out": str(options.out),
        "arm": run.arm,
        "system": source.system,
        "poses": len(poses),
        "moving_s": round(moving_s, 1),
        "residual_mm": round(1e3 * fit.rms, 2),
        "held_out_mm": {
            "median": round(1e3 * kept.held_out_median, 2),
            "p95": round(1e3 * kept.registration.held_out_p95, 2),
            "max": round(1e3 * kept.held_out_max, 2),
        },
        "base_moved_mm": (1e3 * (kept.mount - np.array(mount.position))).round(1).tolist(),
        "zeros_deg": {name: round(float(np.degrees(joint.zero)), 2) for name, joint in kept.joints.items()},
        "strays": int(np.sum((fit.weights > 0.0) & (fit.weights < 0.25))),
        "not_observed": list(not_observed(fit)),
        "kept": {
            what: day.isoformat()
            for what, day in ((SERVOS, kept.servos_date), (LAGS, kept.latency_date))
            if day is not None
        },
        "not_kept": not_kept(run),
        "rehearsal": _judged(run, fit, plate) if run.system == VIRTUAL else None,
    }


def _judged(run: Calibrated, fit: ArmFit, plate: Plate) -> dict[str, Any]:
    """What nobody knows of a real arm: by what it differs from its drawing, and how far off its plate is at contact."""
    truth, contacts = drawn_truth(run.options.seed), contact_postures()
    off = 1e3 * missed(fit, plate, contacts, true_plates(truth, contacts))
    return {
        "hidden": differences(truth),
        "truly_off_mm": {
            "median": round(float(np.median(off)), 2),
            "p95": round(float(np.percentile(off, 95)), 2),
            "max": round(float(off.max()), 2),
        },
    }


def print_extrinsics(summary: dict[str, Any]) -> None:
    """The summary for people."""
    off = summary["held_out_mm"]
    print(f"{summary['poses']} poses, the arm moved for {summary['moving_s']:.0f} s.")
    print(
        f"The plate, in poses held out of the fit: {off['median']:.1f} mm (median), {off['p95']:.1f} (95 %), "
        f"{off['max']:.1f} (largest)."
    )
    if (rehearsal := summary["rehearsal"]) is not None:
        truly = rehearsal["truly_off_mm"]
        print(
            f"A rehearsal: where palms meet the plate is really {truly['median']:.1f} mm off (median), "
            f"{truly['p95']:.1f} (95 %), {truly['max']:.1f} (largest)."
        )
        print(*hidden_lines(rehearsal["hidden"]), sep="\n")
    print(f"Residuals {summary['residual_mm']:.1f} mm; {summary['strays']} markers were astray.")
    print(f"Not told by these poses, and left as drawn: {len(summary['not_observed'])} numbers (--json names them).")
    for what, day in summary["kept"].items():
        print(f"Kept of the calibration that it replaces: {what} ({day[:10]}).")
    for line in summary["not_kept"]:
        print(line)
    print(f"Written: {summary['out']}")
