"""A kept calibration comes back as it was, and anything else is refused in one line."""

from dataclasses import replace
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest
from kept_arm import DATE, changed, kept_arm, kept_text

from highfive.calibration.arm_file import ArmCalibration, CalibratedJoint, KeptPose, load_arm, save_arm
from highfive.calibration.registration import Registration
from highfive.model.errors import HighFiveError


def numbers(value: object) -> list[float]:
    """All of them, in the order of the fields."""
    if isinstance(value, CalibratedJoint | ArmCalibration | Registration | KeptPose):
        return [n for own in vars(value).values() for n in numbers(own)]
    if isinstance(value, dict):
        return [n for own in value.values() for n in numbers(own)]
    if isinstance(value, tuple):
        return [n for own in value for n in numbers(own)]
    if isinstance(value, np.ndarray | float | int):
        return [float(n) for n in np.ravel(value)]
    return []


def test_what_is_kept_comes_back(tmp_path: Path) -> None:
    file, days = tmp_path / "arm.toml", [DATE + timedelta(days=2), DATE - timedelta(days=3)]
    kept = replace(kept_arm(), latency={"mocap_s": 0.0071}, servos_date=days[0], latency_date=days[1])
    save_arm(file, kept)
    found = load_arm(file)
    assert len(numbers(kept)) > 80
    np.testing.assert_allclose(numbers(found), numbers(kept), atol=1e-9)
    assert found.registration.date == kept.registration.date
    assert [found.servos_date, found.latency_date] == days
    assert [pose.held_out is None for pose in found.poses] == [False, True, False]
    assert (found.note, found.marker_names, found.latency) == (kept.note, kept.marker_names, kept.latency)
    with pytest.raises(HighFiveError, match="cannot write"):
        save_arm(file, kept)
    save_arm(file, kept, replace=True)
    assert [path.name for path in tmp_path.iterdir()] == ["arm.toml"]


def test_every_change_by_hand_is_seen(tmp_path: Path) -> None:
    file, text = tmp_path / "arm.toml", kept_text()
    for at in range(0, len(text), 41):
        other = "7" if text[at] != "7" else "3"
        file.write_text(text[:at] + other + text[at + 1 :])
        with pytest.raises(HighFiveError):
            load_arm(file)
    file.write_text(text)
    load_arm(file)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"zero_rad": "0.2"}, "joints.waist.zero_rad is 0.2, expected -0.174533 to 0.174533"),
        ({"compliance_rad_per_Nm": "-0.001"}, "compliance_rad_per_Nm is -0.001"),
        ({"length_m": "[0.0, 0.3, 0.0]"}, "length_m is 0.3 off"),
        ({"tilt_rad": "[0.0, 0.3, 0.0]"}, "tilt_rad is 0.3 off"),
        ({"normal": "[1.0, 1.0, 0.0]"}, "plate.normal is no unit vector"),
        ({"position_m": "[1280.0, 0.0, 0.0]"}, "mount.position_m is further than 50 m"),
        ({"residual_rms_m": "nan"}, "residual_rms_m"),
        ({"encoders_rad": "[1.0]"}, "pose.encoders_rad"),
        ({"held_out_m": "3.0"}, "pose.held_out_m is 3"),
    ],
)
def test_what_no_arm_is_like_is_refused(tmp_path: Path, changes: dict[str, str], says: str) -> None:
    file = tmp_path / "arm.toml"
    file.write_text(changed(kept_text(), **changes))
    with pytest.raises(HighFiveError, match="is no calibration of an arm") as error:
        load_arm(file)
    assert says in str(error.value)


def test_a_sound_file_of_another_kind_is_not_to_be_measured_again(tmp_path: Path) -> None:
    file = tmp_path / "headset.toml"
    file.write_text("[meta]\nformat = 1\n[headset]\nrms_m = 0.001\n")
    with pytest.raises(HighFiveError, match=r"it has \[meta\], \[headset\], an arm's has") as error:
        load_arm(file)
    assert "measure it again" not in str(error.value)
