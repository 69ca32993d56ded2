"""How late joints are, at the wire: servos that act on their goals later than others by a time that nobody reads."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hidden_calibration import hidden_calibration

from highfive.calibration.arm_file import load_arm, save_arm
from highfive.calibration.arm_latency import SERVO_LAG
from highfive.calibration.chirp import ChirpSettings
from highfive.calibration.servo_lag import ServoLag
from highfive.hil.arm.arm_files import limits_of
from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.driven_arm import virtual_driven_arm
from highfive.hil.arm.free_postures import check_way
from highfive.hil.arm.hidden_arm import drawn_truth
from highfive.hil.arm.lifecycle import session_planner
from highfive.hil.arm.planner import LAG_BY_DATA, LAG_MEASURED
from highfive.hil.arm.preconditions import check_options
from highfive.hil.arm.rig_planner import retarget_settings, sags
from highfive.hil.arm.servo_lags import lead_along, servo_lags
from highfive.hil.arm_model.servo_arm import default_arm
from highfive.hil.bench.perturbed_arm import drawn_perturbation, perturbed_bus
from highfive.hil.commands.calibrate_latency import LatencyOptions, calibrate_latency
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.emulator.virtual_rig import VirtualRig
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.model.errors import HighFiveError

ARM = default_arm()
READY = np.array(ARM.folder.ready)
SLOW = ArmOptions("virtual", slow=True)
JOINTS = ("elbow", "wrist_angle")


def measured(late_s: tuple[float, float]) -> dict[str, ServoLag]:
    """Lags of two joints whose servos act on goals so much later than the others do."""
    as_drawn = replace(drawn_perturbation(3), delay_s=0.0)
    with VirtualClock(3) as clock:
        bus, rig = perturbed_bus(as_drawn, load_rig()), load_rig()
        late = dict(zip(JOINTS, late_s, strict=True))
        for servo in bus.servos:
            servo.delay_ns = round(1e9 * late.get(rig.servos[servo.id].name, 0.0))  # type: ignore[attr-defined]
        with virtual_driven_arm(VirtualRig(clock, bus), SLOW, ARM, lambda: "") as drive:
            led = lead_along(drive, ARM, limits_of(ARM.folder), JOINTS, settings=ChirpSettings(seconds=6.0))
        return servo_lags(led, ARM, limits_of(ARM.folder), sag=sags(rig, ARM.folder))


@pytest.mark.slow(20)
def test_what_a_servo_is_late_by_is_found_joint_by_joint() -> None:
    plain, late = measured((0.0, 0.0)), measured((0.012, 0.006))
    for name, truth in zip(JOINTS, (0.012, 0.006), strict=True):
        # By what both fits say of themselves; an emulated servo looks for goals once a millisecond.
        sure = float(np.hypot(plain[name].lag_error, late[name].lag_error)) + 1e-3
        assert sure < 4e-3 and late[name].lag - plain[name].lag == pytest.approx(truth, abs=sure), name
        assert 0.015 < plain[name].lag < 0.045 and plain[name].gain == pytest.approx(1.0, abs=0.05)


def test_a_way_through_the_floor_is_refused() -> None:
    """From beside the mount, stretched down, straight to where the arm waits: through the table's edge or the floor."""
    below = next(q for q in _postures() if ARM.clearance(0.5 * (q + READY)) < -0.02 and ARM.clearance(q) > 0.0)
    with pytest.raises(HighFiveError, match="move it by hand"):
        check_way(ARM, below, READY, "highfive rig release PORT")
    check_way(ARM, READY, READY, "release")


def _postures() -> Iterator[np.ndarray]:
    rng = np.random.default_rng(0)
    while True:
        yield rng.uniform(ARM.packed.low, ARM.packed.high)


def lagged(folder: Path) -> tuple[Path, dict[str, float]]:
    file = folder / "arm.toml"
    found = hidden_calibration(drawn_truth(5), file)
    lags = dict(zip(ARM.folder.names, (0.03, 0.034, 0.034, 0.031, 0.031, 0.06), strict=True))
    save_arm(file, replace(found, latency={name + SERVO_LAG: lag for name, lag in lags.items()}), replace=True)
    return file, lags


def test_a_session_plans_by_what_was_measured_of_all_joints(tmp_path: Path) -> None:
    """The middle one of its joints' lags, and half a period for which a command is held."""
    file, lags = lagged(tmp_path)
    options = ArmOptions("virtual", calibration=file)
    limits, rig = check_options(options)
    planned = session_planner(options, rig, limits)
    assert planned.settings.lag == pytest.approx(float(np.median(list(lags.values()))) + 0.5 / 120.0)
    assert planned.lag_from == LAG_MEASURED
    one_less = {name + SERVO_LAG: lag for name, lag in list(lags.items())[1:]}
    save_arm(file, replace(load_arm(file), latency=one_less), replace=True)
    planned = session_planner(options, rig, limits)
    assert planned.settings.lag == pytest.approx(retarget_settings(rig, limits).lag)
    assert planned.lag_from == LAG_BY_DATA


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (ArmOptions("emulated", slow=True), "no measure of an emulated arm"),
        (ArmOptions("/dev/ttyUSB99", slow=True), "only with --arm"),
        (ArmOptions("/dev/ttyUSB99", slow=True, armed=True), "give it with --calibration"),
    ],
)
def test_bad_input_of_the_latency_is_one_line(tmp_path: Path, options: ArmOptions, says: str) -> None:
    with pytest.raises(HighFiveError, match=says):
        calibrate_latency(LatencyOptions(options, out=tmp_path / "out.toml"), lambda *_: lambda *_, **__: None)
    assert not (tmp_path / "out.toml").exists()


def test_a_calibration_that_is_there_is_kept(tmp_path: Path) -> None:
    file, _ = lagged(tmp_path)
    before = file.read_bytes()
    real = ArmOptions("/dev/ttyUSB99", slow=True, armed=True, calibration=file)
    with pytest.raises(HighFiveError, match="--overwrite"):
        calibrate_latency(LatencyOptions(real, out=file), lambda *_: lambda *_, **__: None)
    assert file.read_bytes() == before
