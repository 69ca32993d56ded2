"""The file that says where the arm stands in the room: what is read from it, and what is refused."""

from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest
from kept_arm import DATE, changed, kept_text

from highfive.calibration.arm_file import load_arm
from highfive.calibration.registration import REGISTRATION, Registration
from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.fingerprint import fingerprint
from highfive.hil.arm.preconditions import room
from highfive.hil.drivers.bus.rig import load_rig
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations

ARM = "0123456789ab"
EXAMPLE = kept_text()


def written(path: Path, **changes: str) -> Path:
    """A calibration with some of its values changed, and signed again."""
    file = path / "room.toml"
    file.write_text(changed(EXAMPLE, **changes))
    return file


def load_registration(path: Path) -> Registration:
    return load_arm(path).registration


def test_a_kept_calibration_is_a_registration(tmp_path: Path) -> None:
    found = load_registration(written(tmp_path))
    assert found.mismatches(ARM, "vicon", DATE) == ()
    assert found.date == DATE


def test_points_of_the_motion_capture_go_where_the_file_says(tmp_path: Path) -> None:
    turn = rotations.from_axis_angle("z", np.pi / 2)
    file = written(tmp_path, rotation=str(turn.tolist()), translation_m="[1.0, 2.0, 0.5]")
    points = np.array([[0.3, 0.0, 1.2], [0.0, -0.4, 0.0]])
    expected = np.array([[1.0, 2.3, 1.7], [1.4, 2.0, 0.5]])  # x to y, y to -x, then shifted
    np.testing.assert_allclose(load_registration(file).placement.apply(points), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("arm", "system", "later", "changes", "says"),
    [
        ("ffffffffffff", "vicon", timedelta(), {}, "another arm"),
        (ARM, "qtm", timedelta(), {}, "vicon system"),
        (ARM, "vicon", timedelta(days=REGISTRATION.longest_age + 1), {}, "31 days old"),
        (ARM, "vicon", timedelta(days=-3), {}, "to come"),
        (ARM, "vicon", timedelta(), {"poses": str(REGISTRATION.fewest_poses - 1)}, "9 poses"),
        (ARM, "vicon", timedelta(), {"held_out_p95_m": "0.0051"}, "5.1 mm"),
    ],
)
def test_a_registration_that_does_not_fit_says_why(
    tmp_path: Path, arm: str, system: str, later: timedelta, changes: dict[str, str], says: str
) -> None:
    (line,) = load_registration(written(tmp_path, **changes)).mismatches(arm, system, DATE + later)
    assert says in line
    assert "room.toml" in line


@pytest.mark.parametrize(
    ("system", "address"), [("vicon", "VICON://host"), ("Vicon", "vicon://host"), ("vicon", " Vicon://host")]
)
def test_a_system_in_capitals_is_the_same_system(tmp_path: Path, system: str, address: str) -> None:
    """In the live person's address, or in the file; a space before it, which addresses may have, is none of it."""
    rig = load_rig()
    file = written(tmp_path, system=f'"{system}"', fingerprint=f'"{fingerprint(rig)}"')
    options = ArmOptions("/dev/ttyUSB99", person=address, calibration=file)
    assert room(options, rig, DATE).mismatches == ()


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"format": "2"}, "meta.format is 2"),
        ({"date": "2026-11-23T09:30:00"}, "time zone"),
        ({"date": '"yesterday"'}, "meta.date"),
        ({"date": "2026-11-23"}, "meta.date is a date without a time; write 2026-11-23T10:00:00+01:00"),
        ({"rotation": "[1.0, 0.1, 0.0, 0.0]"}, "unit quaternion"),
        ({"rotation": "[1.0, 0.0, 0.0]"}, "4 numbers"),
        ({"rotation": "[nan, 0.0, 0.0, 0.0]"}, "not all numbers"),
        ({"translation_m": "[1200.0, 300.0, 0.0]"}, "millimetres"),
        ({"translation_m": '["a", 0.0, 0.0]'}, "3 numbers"),
        ({"poses": "true"}, "quality.poses"),
        ({"poses": "12.5"}, "quality.poses"),
        ({"held_out_p95_m": "nan"}, "held_out_p95_m"),
        ({"held_out_p95_m": "-0.001"}, "held_out_p95_m"),
        ({"fingerprint": "12"}, "arm.fingerprint"),
    ],
)
def test_what_is_no_registration_is_refused_in_one_line(tmp_path: Path, changes: dict[str, str], says: str) -> None:
    with pytest.raises(HighFiveError, match=r"is no calibration of an arm: .*; measure it again") as error:
        load_registration(written(tmp_path, **changes))
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def test_a_file_that_is_missing_cut_short_or_no_toml_is_refused(tmp_path: Path) -> None:
    with pytest.raises(HighFiveError, match="cannot read"):
        load_registration(tmp_path / "none.toml")
    file = tmp_path / "room.toml"
    for count in range(0, len(EXAMPLE.rstrip()) - 8, 29):
        file.write_text(EXAMPLE[:count])
        with pytest.raises(HighFiveError):
            load_registration(file)
    file.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(HighFiveError, match="no TOML"):
        load_registration(file)
