"""Two calibrations of one arm: what a moved room, a moved base and a slipped horn look like."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hidden_poses import postures
from kept_arm import kept_arm

from highfive.calibration.arm_difference import ArmDifference, arm_difference, in_mocap, plate_places
from highfive.calibration.arm_file import ArmCalibration
from highfive.hil.arm.calibrated import known_arm
from highfive.hil.arm.drawn_shape import drawn_shape
from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.arm_model.servo_arm import default_arm
from highfive.model.geometry import rotations

POSTURES = postures(30)
TURN = rotations.from_axis_angle("z", 0.01)


def one() -> ArmCalibration:
    mount = find_arm().mount
    room = replace(
        kept_arm().registration, world_from_mocap=rotations.from_axis_angle("z", 0.7), translation=np.array([1.0, 2, 0])
    )
    return replace(
        kept_arm(), registration=room, mount=np.array(mount.position), mount_rotation=np.array(mount.quaternion)
    )


def apart(other: ArmCalibration, first: ArmCalibration | None = None) -> ArmDifference:
    shape = drawn_shape(default_arm(), one().markers)
    return arm_difference((shape, shape), first or one(), other, POSTURES)


def test_the_plate_is_where_a_session_has_it() -> None:
    """Another path to the same: the arm that planning takes, with corrections compiled into it."""
    found = one()
    arm = known_arm(find_arm(), found)
    angles = POSTURES + np.array([joint.zero for joint in found.joints.values()])
    sag = np.array([joint.compliance for joint in found.joints.values()])
    expected = [arm.plate_at(q - sag * arm.gravity(q)).position for q in angles]
    shape = drawn_shape(default_arm(), found.markers)
    np.testing.assert_allclose(plate_places(shape, found, POSTURES), expected, atol=2e-5)


def test_the_same_is_no_difference_however_the_world_lies() -> None:
    """World, base and motion capture turned and moved together: the arm stands where it stood in the room."""
    first = one()
    moved = np.array([0.3, -0.1, 0.0])
    second = replace(
        first,
        registration=replace(
            first.registration,
            world_from_mocap=rotations.multiply(TURN, first.registration.world_from_mocap),
            translation=rotations.rotate(TURN, first.registration.translation) + moved,
        ),
        mount=rotations.rotate(TURN, first.mount) + moved,
        mount_rotation=rotations.multiply(TURN, first.mount_rotation),
    )
    for other in (first, second):
        found = apart(other)
        assert max(found.plate.max(), found.bent.max(), found.moved, found.turned) < 1e-6
        assert found.trouble == ""


def test_a_bumped_base_moves_the_arm_as_a_whole() -> None:
    first = one()
    turn = rotations.from_axis_angle("x", 0.02)
    aside = np.array([0.0, 0.01, 0.0])
    found = apart(
        replace(first, mount=first.mount + aside, mount_rotation=rotations.multiply(turn, first.mount_rotation))
    )
    # What is left: gravity, seen from a base that leans, and joints that give way to it.
    assert found.moved == pytest.approx(0.01, abs=3e-4) and found.turned == pytest.approx(0.02, abs=3e-4)
    assert found.bent.max() < 3e-4
    assert "the base was bumped" in found.trouble


def test_a_slipped_horn_bends_it() -> None:
    first = one()
    joints = dict(first.joints)
    joints["elbow"] = replace(joints["elbow"], zero=joints["elbow"].zero + np.radians(1.5))
    found = apart(replace(first, joints=joints))
    assert np.percentile(found.bent, 95) > 0.004 and "a horn, a servo or the plate changed" in found.trouble


def test_two_systems_have_no_frame_in_common() -> None:
    first = one()
    room = replace(first.registration, system="qtm", translation=np.array([9.0, 9.0, 9.0]), path=Path("other.toml"))
    found = apart(replace(first, registration=room))
    assert found.plate.size == 0 and found.trouble == ""


def test_the_world_and_the_motion_captures_frame_are_each_others_inverse() -> None:
    first, rng = one(), np.random.default_rng(0)
    places = rng.normal(size=(5, 3))
    np.testing.assert_allclose(first.registration.placement.apply(in_mocap(first, places)), places, atol=1e-12)
