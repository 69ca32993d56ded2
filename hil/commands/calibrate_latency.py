"""``highfive calibrate latency``: how late each joint of an arm is, kept beside what else is known of it."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from highfive.calibration.arm_file import load_arm, save_arm
from highfive.calibration.servo_lag import ServoLag
from highfive.hil.arm.arm_options import EMULATED, VIRTUAL, ArmOptions
from highfive.hil.arm.calibrated import LAG, calibration_file, known_arm
from highfive.hil.arm.calibration_arm import calibration_arm, virtual_calibration_arm
from highfive.hil.arm.fingerprint import fingerprint
from highfive.hil.arm.lifecycle import emulator_options
from highfive.hil.arm.preconditions import check_options
from highfive.hil.arm.rig_planner import retarget_settings
from highfive.hil.arm.servo_lags import servo_lags
from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.drivers.emulator.emulator_process import make_bus
from highfive.hil.drivers.emulator.virtual_rig import VirtualRig
from highfive.hil.runtime.console import Bar
from highfive.hil.runtime.folders import check_file
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.model.errors import HighFiveError

MS = 1e3
CONTACT_HZ = 1.0
"""About so fast joints go to and fro in a high five: the lag at it is printed beside that of slow motion."""


@dataclass(frozen=True)
class LatencyOptions:
    """What is measured.

    Attributes:
        arm: which arm, with its calibration; it moves slowly.
        out: the calibration with the lags in it.
        overwrite: replace it if it is there.
    """

    arm: ArmOptions
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
        check_file(options.out, options.overwrite)
    limits, rig = check_options(arm)
    file, folder = calibration_file(arm, rig), find_arm(arm.arm)
    if file is None and not arm.emulated:
        raise HighFiveError("lags are kept in the arm's calibration; give it with --calibration FILE.toml")
    found = None if file is None else load_arm(file)
    body = known_arm(folder, found)
    with ExitStack() as stack:
        if arm.emulated:
            clock = stack.enter_context(VirtualClock())
            virtual = VirtualRig(clock, make_bus(emulator_options(arm)))
            drive = stack.enter_context(virtual_calibration_arm(virtual, arm, body, lambda: ""))
        else:
            drive = stack.enter_context(calibration_arm(arm, body, lambda: ""))
        lags = servo_lags(drive, body, limits, folder.names, bar("joints", len(folder.names)))
        moving_s = drive.moving_s
    if found is not None and not arm.emulated:
        latency = {**found.latency, **{name + LAG: lag.lag for name, lag in lags.items()}}
        new = replace(found, latency=latency, latency_date=datetime.now(UTC))
        save_arm(options.out, new, replace=options.overwrite)
    return {
        "out": None if arm.emulated else str(options.out),
        "arm": fingerprint(rig, folder),
        "moving_s": round(moving_s, 1),
        "formula_ms": round(MS * retarget_settings(rig, limits, 0.0, folder).lag, 2),
        "joints": {name: _described(lag) for name, lag in lags.items()},
    }


def _described(lag: ServoLag) -> dict[str, float]:
    return {
        "lag_ms": round(MS * lag.lag, 2),
        "error_ms": round(MS * lag.lag_error, 2),
        "at_contact_ms": round(MS * lag.lag_at(CONTACT_HZ), 2),
        "delay_ms": round(MS * lag.delay, 2),
        "omega_rad_s": round(lag.omega, 2),
        "zeta": round(lag.zeta, 3),
        "gain": round(lag.gain, 4),
        "residual_mrad": round(MS * lag.residual, 3),
    }


def print_latency(summary: dict[str, Any]) -> None:
    """The summary for people."""
    print(f"The arm moved for {summary['moving_s']:.0f} s. From command to encoder, ms:")
    for name, of in summary["joints"].items():
        print(
            f"  {name:<14}{of['lag_ms']:6.1f} ± {of['error_ms']:.1f} slowly, {of['at_contact_ms']:6.1f} at "
            f"{CONTACT_HZ:g} Hz (delay {of['delay_ms']:.1f}, {of['omega_rad_s']:.0f} rad/s, damping {of['zeta']:.2f})"
        )
    print(f"  without a measurement {summary['formula_ms']:.1f} is taken for all")
    print("an emulated arm's: not kept" if summary["out"] is None else f"Written: {summary['out']}")
