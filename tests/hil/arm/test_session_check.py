"""The five-pose check at the wire: a hidden arm, its driver, bus and servos in virtual time, and its cameras."""

from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hidden_calibration import hidden_calibration

from highfive.calibration.arm_file import ArmCalibration
from highfive.calibration.pose_check import POSE_CHECK, PoseCheck
from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.calibrated import known_arm
from highfive.hil.arm.driven_arm import virtual_driven_arm
from highfive.hil.arm.hidden_arm import TEMPLATE, HiddenTruth, drawn_truth
from highfive.hil.arm.hidden_rig import CameraFaults, PlateCamera, hidden_bus
from highfive.hil.arm.plate_watch import PlateWatch
from highfive.hil.arm.session_check import five_poses, plate_of
from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.arm_model.servo_arm import default_arm
from highfive.hil.commands.session_check import check_before_session
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.emulator.virtual_rig import VirtualRig
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.trials.live_partner import live_source
from highfive.hil.trials.plate_wiring import camera_wiring
from highfive.mocap_bridge.files.recording import EVERYBODY
from highfive.model.errors import HighFiveError

TRUTH = drawn_truth(40)


@pytest.fixture(scope="module")
def calibration(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ArmCalibration]:
    file = tmp_path_factory.mktemp("arm") / "arm.toml"
    return file, hidden_calibration(TRUTH, file)


def checked(
    calibration: tuple[Path, ArmCalibration], truth: HiddenTruth, faults: CameraFaults | None = None
) -> PoseCheck:
    """The arm that is there now, held to what was calibrated."""
    file, found = calibration
    body = known_arm(find_arm(), found)
    options = ArmOptions("virtual", slow=True, calibration=file)
    with VirtualClock(truth.seed) as clock:
        bus, plant = hidden_bus(truth, load_rig())
        camera = PlateCamera(clock, truth, plant, faults or CameraFaults())
        with closing(live_source("vicon://cameras", EVERYBODY, camera_wiring(clock, camera))) as source:
            watch = PlateWatch(source, plate_of(found), clock)
            with virtual_driven_arm(VirtualRig(clock, bus), options, body, watch.in_the_way) as drive:
                return five_poses(drive, watch, body, found)


def slipped(joint: int, degrees: float) -> HiddenTruth:
    zero = TRUTH.zero.copy()
    zero[joint] += np.radians(degrees)
    return replace(TRUTH, zero=zero)


@pytest.mark.slow(20)
def test_an_arm_as_it_was_calibrated_passes(calibration: tuple[Path, ArmCalibration]) -> None:
    check = checked(calibration, TRUTH)
    assert check.trouble == ""
    assert check.rms < 0.5 * POSE_CHECK.worst
    assert len(check.off) == POSE_CHECK.poses


@pytest.mark.slow(30)
def test_an_arm_that_slipped_is_refused(calibration: tuple[Path, ArmCalibration]) -> None:
    """By what a shoulder's horn leaves; a base that was moved or turned: ``tests/calibration/test_pose_check.py``."""
    with pytest.raises(HighFiveError, match=r"nothing moves any more: the plate is .* extrinsics again"):
        checked(calibration, slipped(1, 0.5))


@pytest.mark.slow(20)
def test_who_stays_in_the_way_keeps_the_arm_from_checking_itself(calibration: tuple[Path, ArmCalibration]) -> None:
    with pytest.raises(HighFiveError, match="somebody is in the arm's way"):
        checked(calibration, TRUTH, CameraFaults(visitor=(0.0, 1e9)))


def test_the_plate_of_a_calibration_is_its_template_as_glued(calibration: tuple[Path, ArmCalibration]) -> None:
    plate = plate_of(calibration[1])
    assert plate.names == TEMPLATE.names
    np.testing.assert_allclose(plate.places, TEMPLATE.places, atol=0.004)
    np.testing.assert_allclose(plate.centre, default_arm().packed.plate, atol=0.006)


def test_there_is_no_check_without_a_calibration() -> None:
    with pytest.raises(HighFiveError, match="--calibration"):
        check_before_session(ArmOptions("/dev/ttyUSB99", armed=True, person="vicon://host"), None)
