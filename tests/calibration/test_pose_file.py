"""Poses of a calibration that broke off come back as they were; those of another arm, or of nobody, do not."""

import json
from pathlib import Path

import numpy as np
import pytest

from highfive.calibration.pose_file import TakenPose, load_poses, save_poses
from highfive.model.errors import HighFiveError

NAMES = ("a", "b", "c")


def poses() -> list[TakenPose]:
    rng = np.random.default_rng(0)
    return [
        TakenPose(*rng.normal(size=(3, 6)), rng.normal(size=(3, 3)), np.array([True, False, True])) for _ in range(4)
    ]


def test_poses_come_back(tmp_path: Path) -> None:
    file, given = tmp_path / "poses.json", poses()
    save_poses(file, "arm", NAMES, given)
    for found, one in zip(load_poses(file, "arm", NAMES, 6), given, strict=True):
        for name, value in vars(one).items():
            np.testing.assert_array_equal(getattr(found, name), value)


def test_other_arms_plates_and_files_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "poses.json"
    save_poses(file, "arm", NAMES, poses())
    for arm, names in (("other", NAMES), ("arm", ("a", "b", "d"))):
        with pytest.raises(HighFiveError, match="another arm or plate"):
            load_poses(file, arm, names, 6)
    with pytest.raises(HighFiveError, match="has no poses of this program"):
        load_poses(file, "arm", NAMES, 7)
    whole = json.loads(file.read_text())
    whole["poses"][1]["encoders"][0] = float("nan")
    for text in ("", "[]", "{}", json.dumps(whole), file.read_text()[:-9]):
        file.write_text(text)
        with pytest.raises(HighFiveError, match="has no poses of this program"):
            load_poses(file, "arm", NAMES, 6)
    with pytest.raises(HighFiveError, match="cannot read the poses"):
        load_poses(tmp_path / "none.json", "arm", NAMES, 6)
