"""``highfive calibrate latency``: how late each joint of an arm is, kept beside what else is known of it."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from highfive.calibration.arm_file import ArmCalibration, load_arm, save_arm
from highfive.calibration.arm_latency import SERVO_LAG, ArmLatency
from highfive.calibration.servo_lag import ServoLag
from highfive.hil.arm.arm_options import EMULATED, VIRTUAL, ArmOptions
from highfive.hil.arm.calibrated import MOCAP_AGE, MOCAP_LATE, calibration_file, known_arm
from highfive.hil.arm.drawn_shape import drawn_shape
from highfive.hil.arm.driven_arm import driven_arm, virtual_driven_arm
from highfive.hil.arm.fingerprint import fingerprint
from highfive.hil.arm.lifecycle import emulator_options
from highfive.hil.arm.mocap_lags import MocapDelay, SeenFrames, Source, together
from highfive.hil.arm.plate_watch import PlateWatch
from highfive.hil.arm.preconditions import check_options
from highfive.hil.arm.rig_planner import planned_ahead, retarget_settings, sags
from highfive.hil.arm.servo_lags import PlateSeen, lead_along, servo_lags
from highfive.hil.arm.session_check import plate_of
from highfive.hil.arm.wand_lag import Followed, WandSeen, follow_wand, followed_wand
from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.arm_model.servo_arm import mounted
from highfive.hil.commands.calibration_checks import check_in_a_room, check_system
from highfive.hil.drivers.bus.rig import Rig
from highfive.hil.drivers.emulator.emulator_process import make_bus
from highfive.hil.drivers.emulator.virtual_rig import VirtualRig
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.runtime.console import Bar, say_aside
from highfive.hil.runtime.folders import check_toml
from highfive.hil.runtime.interrupts import INTERRUPTS
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.trials.live_partner import live_source
from highfive.mocap_bridge.files.recording import EVERYBODY
from highfive.mocap_bridge.sources.address import parse_address
from highfive.model.errors import HighFiveError

MS = 1e3
CONTACT_HZ = 1.0
"""About so fast joints go to and fro in a high five: the lag at it is printed beside that of slow motion."""


@dataclass(frozen=True)
class LatencyOptions:
    """What is measured.

    Attributes:
        arm: which arm, with its calibration; it moves slowly.
        source: address of the motion capture that sees the plate; None measures the servos alone.
        wand: label of a marker that the arm is to follow afterwards; None has it follow nothing.
        out: the calibration with the lags in it.
        overwrite: replace it if it is there.
    """

    arm: ArmOptions
    source: str | None = None
    wand: str | None = None
    out: Path = Path("arm.toml")
    overwrite: bool = False


def calibrate_latency(options: LatencyOptions, bar: Bar) -> dict[str, Any]:
    """Leads one joint after the other along a chirp, fits its lag, and writes all into the arm's calibration.

    What an emulated arm says is shown, and not kept.

    Returns:
        The summary.

    Raises:
        HighFiveError: something cannot be used, the arm was stopped, or a joint does not follow. Nothing is written.
    """
    arm = options.arm
    if arm.port == EMULATED:
        raise HighFiveError(f"a machine's clock is no measure of an emulated arm; take {VIRTUAL}, or a serial port")
    if not arm.emulated:
        check_toml(options.out, "a calibration", options.overwrite)
    limits, rig = check_options(arm)
    file, folder = calibration_file(arm, rig), find_arm(arm.arm)
    if file is None and not arm.emulated:
        raise HighFiveError("lags are kept in the arm's calibration; give it with --calibration FILE.toml")
    found = None if file is None else load_arm(file)
    check_seen(options, found)
    body = known_arm(folder, found)
    plate, clear = None, no_one
    with ExitStack() as stack:
        if arm.emulated:
            clock = stack.enter_context(VirtualClock())
            stack.enter_context(clock.signals_to_first(INTERRUPTS))
            virtual = VirtualRig(clock, make_bus(emulator_options(arm)))
            drive = stack.enter_context(virtual_driven_arm(virtual, arm, body, no_one))
        else:
            if options.source is not None and found is not None:
                source = stack.enter_context(closing(live_source(options.source, EVERYBODY)))
                source.first()
                plate = plate_seen(options, source, found, rig, MACHINE)
                clear = PlateWatch(source, plate_of(found), MACHINE).in_the_way
            drive = stack.enter_context(driven_arm(arm, body, clear))
        advance = bar("joints", len(folder.names) + (options.wand is not None))
        frames = None if plate is None else plate.frames
        led = lead_along(drive, body, limits, folder.names, advance, frames=frames)
        wand = None if plate is None or options.wand is None else follow_wand(drive, body, limits, plate, say_aside)
        moving_s = drive.moving_s
    lags = servo_lags(led, body, limits, plate, rig.reply_s, sags(rig, folder))
    seen = None if plate is None else seen_lags(plate, wand)
    if found is not None and not arm.emulated:
        latency = {**found.latency, **{name + SERVO_LAG: lag.lag for name, lag in lags.items()}}
        latency |= {} if seen is None else seen.kept
        new = replace(found, latency=latency, latency_date=datetime.now(UTC))
        save_arm(options.out, new, replace=options.overwrite)
    return {
        "out": None if arm.emulated else str(options.out),
        "arm": fingerprint(rig, folder),
        "moving_s": round(moving_s, 1),
        "planned_ms": round(MS * planned_ahead(np.array([lag.lag for lag in lags.values()])), 2),
        "formula_ms": round(MS * retarget_settings(rig, limits, folder=folder).lag, 2),
        "joints": {name: _described(lag) for name, lag in lags.items()},
        "seen": None if seen is None else seen.described(),
    }


@dataclass(frozen=True)
class SeenLags:
    """What the motion capture showed.

    Attributes:
        mocap: of all joints together.
        by_joint: of those that tell.
        followed, whole: of a wand; None where none was followed.
    """

    mocap: MocapDelay
    by_joint: Mapping[str, MocapDelay]
    followed: Followed | None = None
    whole: ArmLatency | None = None

    @property
    def kept(self) -> dict[str, float]:
        """s, by the names in a calibration."""
        found = {MOCAP_AGE: self.mocap.age, MOCAP_LATE: self.mocap.late}
        return found if self.whole is None else found | {"host_s": self.whole.host, "end_to_end_s": self.whole.whole}

    def described(self) -> dict[str, Any]:
        """ms"""
        one, whole = self.mocap, self.whole
        wand = None
        if whole is not None and self.followed is not None:
            wand = {
                "joint": whole.followed,
                "whole": round(MS * whole.whole, 2),
                "error": round(MS * self.followed.whole.lag_error, 2),
                "parts": round(MS * whole.parts, 2),
                "host": round(MS * whole.host, 2),
                "servo": round(MS * whole.servo, 2),
            }
        return {
            "motion_capture_ms": {
                "age": round(MS * one.age, 2),
                "late": round(MS * one.late, 2),
                "error": round(MS * one.error, 2),
                "by_joint": {name: round(MS * by.age, 2) for name, by in self.by_joint.items()},
            },
            "wand_ms": wand,
        }


def check_seen(options: LatencyOptions, found: ArmCalibration | None) -> None:
    """Whether the motion capture can tell of this arm.

    Raises:
        HighFiveError: it is no system, another one than the arm was calibrated by, or there is no arm in its room.
    """
    if options.source is None:
        if options.wand is not None:
            raise HighFiveError(f"--wand {options.wand} is seen by a motion capture; give --source, too")
        return
    check_system(options.source)
    check_in_a_room(options.arm)
    assert found is not None  # a real arm has one
    if (system := parse_address(options.source).scheme) != found.registration.system:
        raise HighFiveError(
            f"--source is a {system} system; {found.registration.path} is of a {found.registration.system} system"
        )
    if options.wand in found.marker_names:
        raise HighFiveError(f"--wand {options.wand} is a marker of the plate; give that of the wand")


def plate_seen(options: LatencyOptions, source: Source, found: ArmCalibration, rig: Rig, clock: Clock) -> PlateSeen:
    """Who sees the plate, and the wand behind it."""
    folder = find_arm(options.arm.arm)
    names = found.marker_names if options.wand is None else (*found.marker_names, options.wand)
    shape = drawn_shape(mounted(folder), found.markers)
    strengths = folder.each[0] / folder.stall_currents
    return PlateSeen(SeenFrames(source, names, clock), shape, found, strengths, rig.reply_s)


def seen_lags(plate: PlateSeen, wand: WandSeen | None = None) -> SeenLags:
    """What chirps told of the motion capture, and what following a wand tells of all together.

    Raises:
        HighFiveError: joints disagree, the wand was not moved as it has to be, or parts and whole do not add up.
    """
    mocap = together(list(plate.delays.values()))
    if wand is None:
        return SeenLags(mocap, plate.delays)
    followed = followed_wand(wand)
    whole = ArmLatency(mocap.age, followed.host, followed.servo.lag, followed.whole.lag, followed.joint)
    whole.check()
    return SeenLags(mocap, plate.delays, followed, whole)


def no_one() -> str:
    """Nobody is seen to be in the way, where nothing looks."""
    return ""


def _described(lag: ServoLag) -> dict[str, float | None]:
    return {
        "lag_ms": round(MS * lag.lag, 2),
        "error_ms": round(MS * lag.lag_error, 2),
        "at_contact_ms": round(MS * lag.lag_at(CONTACT_HZ), 2),
        "delay_ms": round(MS * lag.delay, 2) if lag.apart else None,
        "omega_rad_s": round(lag.omega, 2) if lag.apart else None,
        "zeta": round(lag.zeta, 3) if lag.apart else None,
        "gain": round(lag.gain, 4),
        "residual_mrad": round(MS * lag.residual, 3),
    }


def print_latency(summary: dict[str, Any]) -> None:
    """The summary for people."""
    print(f"The arm moved for {summary['moving_s']:.0f} s. From command to encoder, ms:")
    for name, of in summary["joints"].items():
        apart = "delay, frequency and damping are not told apart"
        if of["delay_ms"] is not None:
            apart = f"delay {of['delay_ms']:.1f}, {of['omega_rad_s']:.0f} rad/s, damping {of['zeta']:.2f}"
        lag = f"{of['lag_ms']:6.1f} ± {of['error_ms']:.1f} slowly, {of['at_contact_ms']:6.1f} at {CONTACT_HZ:g} Hz"
        print(f"  {name:<14}{lag} ({apart})")
    print(
        f"  planned ahead by in a session, their median and half a period of the bus: {summary['planned_ms']:.1f}; "
        f"without a measurement {summary['formula_ms']:.1f}"
    )
    if (seen := summary["seen"]) is not None:
        of = seen["motion_capture_ms"]
        print(
            f"From the plate to the arrival of its frame: {of['age']:.1f} ± {of['error']:.1f} ms. At the time at which "
            f"a session takes it to have been seen it is {of['late']:.1f} ms late, which is made up for from now on."
        )
        print("  by joint: " + ", ".join(f"{name} {age:.1f}" for name, age in of["by_joint"].items()))
        if (whole := seen["wand_ms"]) is not None:
            print(
                f"From the wand to the plate, in one stream: {whole['whole']:.1f} ± {whole['error']:.1f} ms; the parts "
                f"add up to {whole['parts']:.1f} (motion capture {of['age']:.1f}, host {whole['host']:.1f}, "
                f"{whole['joint']} {whole['servo']:.1f})."
            )
    print("an emulated arm's: not kept" if summary["out"] is None else f"Written: {summary['out']}")
