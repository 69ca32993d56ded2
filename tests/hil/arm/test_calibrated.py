"""What a calibration makes of an arm: kinematics, counts, limits; and which calibrations no arm relies on."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import mujoco
import numpy as np
import pytest
from kept_arm import DATE, changed, kept_arm

from highfive.calibration.arm_file import ArmCalibration, arm_text, load_arm
from highfive.calibration.arm_kinematics import frames_of
from highfive.calibration.pose_check import calibrated
from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.calibrated import known_arm, known_limits, known_rig, trusted_calibration
from highfive.hil.arm.drawn_shape import drawn_shape
from highfive.hil.arm.fingerprint import fingerprint
from highfive.hil.arm.hidden_arm import TEMPLATE
from highfive.hil.arm.lifecycle import emulator_options, session_planner
from highfive.hil.arm.preconditions import check_options
from highfive.hil.arm.rig_planner import planner
from highfive.hil.arm.simulated_driver import mounted_arm
from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.arm_model.mount import Mount
from highfive.hil.arm_model.servo_arm import default_arm
from highfive.hil.drivers.bus.rig import DEFAULT_RIG, angle, count, load_rig, required_registers
from highfive.hil.drivers.emulator.emulated_servo import EmulatedServo
from highfive.hil.drivers.emulator.emulator_process import make_bus
from highfive.hil.safety.limits_file import load_limits
from highfive.hil.sim.arm_as_calibrated import correct
from highfive.hil.sim.arm_body import arm_alone
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations

READY = default_arm().ready

NOW = DATE + timedelta(days=1)


def kept() -> ArmCalibration:
    """A calibration of the default arm whose every part differs from the drawing."""
    mount = find_arm().mount
    turn = rotations.from_rotation_vector(np.array([0.02, -0.015, 0.03]))
    found = kept_arm()
    return replace(
        found,
        registration=replace(found.registration, arm=fingerprint(load_rig())),
        mount=np.array(mount.position) + np.array([0.0, 0.0, 0.012]),
        mount_rotation=rotations.multiply(turn, mount.quaternion),
        plate=TEMPLATE.centre + np.array([0.002, -0.001, 0.0015]),
        plate_normal=rotations.rotate(rotations.from_rotation_vector(np.array([0.0, 0.02, -0.01])), TEMPLATE.normal),
    )


def written(path: Path, found: ArmCalibration | None = None) -> Path:
    path.write_text(arm_text(found or kept()))
    return path


def some_postures(number: int = 20) -> np.ndarray:
    body = default_arm().packed
    return np.random.default_rng(3).uniform(0.6 * body.low, 0.6 * body.high, (number, len(READY)))


def test_the_plate_is_where_the_calibration_s_own_kinematics_has_it() -> None:
    """The fit turns frames one after the other; here tilts are folded into axes and offsets."""
    found, postures = kept(), some_postures()
    arm = known_arm(find_arm(), found)
    shape = drawn_shape(default_arm(), TEMPLATE.markers)
    frames = frames_of(shape, calibrated(shape, found), postures)
    places = frames.centres[:, -1] + frames.last @ found.plate
    for joints, place, normal in zip(postures, places, frames.last @ found.plate_normal, strict=True):
        plate = arm.plate_at(joints)
        np.testing.assert_allclose(plate.position, place, atol=1e-9)
        np.testing.assert_allclose(plate.normal, normal, atol=1e-9)
        np.testing.assert_allclose(plate.fingers @ plate.normal, 0.0, atol=1e-12)


@pytest.mark.parametrize("glued", [True, False])
def test_its_gravity_and_places_are_those_of_the_corrected_body_in_mujoco(glued: bool) -> None:
    """A plate glued otherwise moves its surface, not its weight: gravity is judged with the plate as drawn."""
    arm = known_arm(find_arm(), kept())
    assert arm.corrections is not None
    if not glued:
        drawn = default_arm().packed
        arm = replace(arm, corrections=replace(arm.corrections, plate=drawn.plate, normal=drawn.normal))
        assert arm.corrections is not None
    twin = arm_alone(arm.mount)
    correct(twin.model, arm.folder, arm.packed.base_axes, arm.corrections)
    data = mujoco.MjData(twin.model)
    for joints in some_postures(6):
        data.qpos[twin.qpos] = joints
        mujoco.mj_forward(twin.model, data)
        plate, seen = arm.plate_at(joints), twin.plate(data)
        np.testing.assert_allclose(plate.position, seen.position, atol=1e-9)
        np.testing.assert_allclose(plate.normal, seen.normal, atol=1e-9)
        if not glued:
            np.testing.assert_allclose(arm.gravity(joints), data.qfrc_bias[twin.dofs], atol=1e-8)


def test_a_mount_is_its_position_and_quaternion_again() -> None:
    turn = rotations.from_rotation_vector(np.array([0.1, -0.4, 2.0]))
    mount = Mount.of(np.array([0.1, 0.2, 0.3]), turn)
    np.testing.assert_allclose(rotations.to_matrix(mount.quaternion), rotations.to_matrix(turn), atol=1e-12)
    assert mount.position == (0.1, 0.2, 0.3)


def test_without_a_calibration_nothing_differs() -> None:
    limits, rig = load_limits(), load_rig()
    assert known_rig(rig, None) is rig
    assert known_limits(limits, rig, find_arm()) == limits
    assert known_arm(find_arm(), None) == default_arm()


def test_zeros_are_the_host_s_and_the_servos_are_set_as_before() -> None:
    found, drawn = kept(), load_rig()
    rig = known_rig(drawn, found)
    assert required_registers(rig) == required_registers(drawn)
    assert fingerprint(rig) == fingerprint(drawn)
    for own, other in zip(rig.joints, drawn.joints, strict=True):
        zero = found.joints[own.name].zero
        assert angle(own, 1000) == pytest.approx(angle(other, 1000) + zero)
        assert angle(own, count(own, 0.5)) == pytest.approx(0.5, abs=np.pi / 4096.0)


def test_limits_leave_out_what_a_servo_s_turn_has_lost_to_its_zero() -> None:
    found, limits = kept(), load_limits()
    zeros = {"waist": 0.03, "wrist_rotate": -0.03, "elbow": 0.04}
    found = replace(found, joints={name: replace(one, zero=zeros.get(name, 0.0)) for name, one in found.joints.items()})
    rig = known_rig(load_rig(), found)
    safer = known_limits(limits, rig, find_arm())
    waist, elbow, rotate = (limits.names.index(name) for name in ("waist", "elbow", "wrist_rotate"))
    assert safer.lowest[waist] == pytest.approx(-np.pi + 0.03)
    assert safer.highest[waist] == limits.highest[waist]
    assert safer.highest[rotate] == pytest.approx(np.pi - 0.03)
    assert safer.lowest[elbow] >= limits.lowest[elbow]
    for joint, own in zip(rig.joints, safer.joints, strict=True):
        assert joint.astray + joint.lower <= own.lowest < own.highest <= joint.astray + joint.upper
        assert 0 <= count(joint, own.lowest) < count(joint, own.highest) <= 4096


def test_a_zero_that_leaves_no_way_back_is_refused() -> None:
    found, limits = kept(), load_limits()
    rig = load_rig()
    joint = rig.joints[1]
    narrow = replace(rig, joints=(rig.joints[0], replace(joint, lower=0.3, astray=0.1), *rig.joints[2:]))
    with pytest.raises(HighFiveError, match=r"retract\.path|where the arm waits"):
        known_limits(limits, narrow, find_arm())
    assert found.joints


def test_goals_lead_by_what_encoders_do_not_see() -> None:
    limits, rig, arm = load_limits(), load_rig(), known_arm(find_arm(), kept())
    calibrated_plan, drawn_plan = planner(rig, limits, arm), planner(rig, limits)
    more = np.array(calibrated_plan.settings.sag) - np.array(drawn_plan.settings.sag)
    np.testing.assert_allclose(more, arm.compliance, atol=1e-15)
    assert arm.compliance.max() > 0.0
    stands = arm.standing(READY)
    np.testing.assert_allclose(stands, READY - arm.compliance * arm.gravity(READY), atol=1e-12)


def test_an_emulated_arm_is_the_one_that_was_calibrated(tmp_path: Path) -> None:
    file = written(tmp_path / "arm.toml")
    options = ArmOptions(calibration=file)
    limits, rig = check_options(options)
    bus = make_bus(emulator_options(options))
    bus.advance(300_000_000)  # servos take 0.2 s to start
    by_id = {servo.id: servo for servo in bus.servos}

    def counts(servo: EmulatedServo) -> int:
        register = servo.table["present_position"]
        return int.from_bytes(servo.read(register.address, register.size)[1], "little", signed=True)

    said = [angle(joint, counts(by_id[joint.id])) for joint in rig.joints]
    positions, velocities = bus.body  # without torque it falls; servos know of the step before
    assert (np.abs(said - positions) < 2e-3 + 2e-3 * np.abs(velocities)).all()
    retarget = session_planner(options, rig, limits)
    plant = mounted_arm(f"vx300s::{file}")
    plant.reset(READY)
    np.testing.assert_allclose(plant.plate().position, retarget.arm.plate_at(READY).position, atol=1e-9)


def test_a_rig_s_file_names_its_calibration(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    text = DEFAULT_RIG.read_text().replace("baud_rate = 1_000_000", 'baud_rate = 1_000_000\ncalibration = "arm.toml"')
    file.write_text(text)
    with pytest.raises(HighFiveError, match="cannot read the calibration"):
        check_options(ArmOptions(rig=file))
    assert check_options(ArmOptions(rig=file, as_drawn=True))[1].joints[1].astray == 0.0
    written(tmp_path / "arm.toml")
    assert check_options(ArmOptions(rig=file))[1].joints[1].astray == pytest.approx(kept().joints["shoulder"].zero)


REAL = ArmOptions("/dev/ttyUSB99", armed=True, person="vicon://host")


@pytest.mark.parametrize(
    ("options", "later", "changes", "says"),
    [
        (REAL, timedelta(days=40), {}, "days old"),
        (REAL, timedelta(), {"fingerprint": '"ffffffffffff"'}, "another arm"),
        (REAL, timedelta(), {"held_out_p95_m": "0.0061"}, "6.1 mm"),
        (REAL, timedelta(), {"poses": "5"}, "5 poses"),
        (replace(REAL, person="qtm://host"), timedelta(), {}, "vicon system"),
        (REAL, timedelta(), {"position_m": "[-70.0, -80.0, 1280.0]"}, "millimetres"),
        (REAL, timedelta(), {"position_m": "[-0.07, -0.08, 0.9]"}, "off its mount"),
        (REAL, timedelta(), {"centre_m": "[180.0, 0.0, 0.0]"}, "template in metres"),
        (REAL, timedelta(), {"zero_rad": "2.0"}, "zero_rad"),
        (REAL, timedelta(), {"length_m": "[0.7, 0.0, 0.0]"}, "length_m"),
        (replace(REAL, person="", nobody_near=True), timedelta(days=40), {}, "days old"),
        (replace(REAL, person="", nobody_near=True), timedelta(), {"system": '"virtual"'}, "was rehearsed"),
        (ArmOptions(), timedelta(), {"fingerprint": '"ffffffffffff"'}, "another arm"),
    ],
)
def test_what_no_arm_may_rely_on_is_refused_in_one_line(
    tmp_path: Path, options: ArmOptions, later: timedelta, changes: dict[str, str], says: str
) -> None:
    file = tmp_path / "arm.toml"
    file.write_text(changed(arm_text(kept()), **changes))
    with pytest.raises(HighFiveError) as error:
        trusted_calibration(replace(options, calibration=file), load_rig(), NOW + later)
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def test_what_was_tampered_with_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "arm.toml"
    file.write_text(arm_text(kept()).replace("zero_rad = 0.0", "zero_rad = 0.1", 1))
    with pytest.raises(HighFiveError, match="changed after it was written"):
        trusted_calibration(replace(REAL, calibration=file), load_rig(), NOW)


def test_a_real_arm_near_a_live_person_needs_one_and_takes_a_good_one(tmp_path: Path) -> None:
    with pytest.raises(HighFiveError, match="--calibration"):
        check_options(REAL)
    own = kept()
    fresh = replace(own, registration=replace(own.registration, date=datetime.now(UTC)))
    file = written(tmp_path / "arm.toml", fresh)
    _, rig = check_options(replace(REAL, calibration=file))
    assert rig.joints[2].astray == pytest.approx(load_arm(file).joints["elbow"].zero)


def test_an_old_one_will_do_for_an_emulated_arm(tmp_path: Path) -> None:
    file = written(tmp_path / "arm.toml")
    assert trusted_calibration(ArmOptions(calibration=file), load_rig(), NOW + timedelta(days=400)) is not None
