"""Five poses find a bumped base and a horn that slipped; an arm that is as it was passes."""

from dataclasses import replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hidden_poses import UP, postures, seen_poses

from highfive.calibration.arm_file import ArmCalibration, load_arm, save_arm
from highfive.calibration.arm_fit import fit_arm
from highfive.calibration.arm_plate import held_out, plate_of_fit
from highfive.calibration.arm_result import Source, calibration_of
from highfive.calibration.pose_check import BASE, POSE_CHECK, check_poses
from highfive.calibration.pose_choice import choose_poses
from highfive.hil.arm.drawn_shape import drawn_shape
from highfive.hil.arm.hidden_arm import TEMPLATE, HiddenTruth, drawn_truth
from highfive.hil.arm_model.servo_arm import DEFAULT_MOUNT, default_arm

SHAPE = drawn_shape(default_arm(), TEMPLATE.markers)
FREE = postures(60)
FIVE = FREE[choose_poses(SHAPE, FREE, POSE_CHECK.poses, BASE)]
SEEDS = range(4)


@cache
def kept_of(seed: int) -> ArmCalibration:
    poses = seen_poses(drawn_truth(seed), FREE[:30])
    fit = fit_arm(SHAPE, poses, UP)
    mount = (np.array(DEFAULT_MOUNT.position), DEFAULT_MOUNT.quaternion)
    source = Source("0123456789ab", "vicon", datetime(2026, 11, 25, tzinfo=UTC), "0.2.0", "test")
    off = held_out(SHAPE, poses, UP, TEMPLATE)
    return calibration_of(Path("arm.toml"), fit, poses, plate_of_fit(fit, TEMPLATE), TEMPLATE, off, mount, source)


def five(seed: int, truth: HiddenTruth) -> str:
    return check_poses(SHAPE, kept_of(seed), seen_poses(truth, FIVE)).trouble


@pytest.mark.parametrize("seed", SEEDS)
def test_an_arm_as_it_was_passes_and_a_bumped_one_does_not(seed: int) -> None:
    truth = drawn_truth(seed)
    assert five(seed, truth) == ""
    slipped = truth.zero.copy()
    slipped[1] += np.radians(0.5)
    for other in (
        replace(truth, base=truth.base + np.array([0.0, 0.003, 0.0])),
        replace(truth, base_turn=truth.base_turn + np.array([0.0, 0.0, np.radians(0.3)])),
        replace(truth, zero=slipped),
    ):
        assert "was the base bumped" in five(seed, other)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_world_is_where_the_mount_says_but_for_height_and_tilt(seed: int) -> None:
    kept = kept_of(seed)
    np.testing.assert_allclose(kept.mount[:2], DEFAULT_MOUNT.position[:2], atol=1e-9)
    assert abs(kept.mount[2] - DEFAULT_MOUNT.position[2]) < 0.2
    up = np.array([0.0, 0.0, 1.0])
    np.testing.assert_allclose(
        kept.registration.placement.turned(np.diag([0.0, 0.0, 1.0])), np.outer(up, up), atol=1e-9
    )


def test_the_check_of_a_kept_file_is_that_of_the_fit(tmp_path: Path) -> None:
    file, poses = tmp_path / "arm.toml", seen_poses(drawn_truth(0), FREE[40:45])
    save_arm(file, kept_of(0))
    before, after = check_poses(SHAPE, kept_of(0), poses), check_poses(SHAPE, load_arm(file), poses)
    np.testing.assert_allclose(after.off, before.off, atol=1e-8)
