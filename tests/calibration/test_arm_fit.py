"""The fit of an arm: its Jacobian against differences, its places against MuJoCo, and what it refuses."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hidden_poses import UP, postures, seen_poses

from highfive.calibration.arm_fit import ARM_FIT, EXTRINSICS, check_fit, fit_arm
from highfive.calibration.arm_kinematics import (
    ArmShape,
    as_drawn,
    frames_of,
    gravity_torques,
    jacobian,
    marker_places,
    true_angles,
)
from highfive.calibration.arm_observability import check_excitation, not_observed
from highfive.calibration.arm_plate import check_loose, held_out, plate_of_fit
from highfive.calibration.arm_poses import ArmPoses
from highfive.calibration.pose_choice import choose_poses
from highfive.hil.arm.drawn_shape import drawn_shape
from highfive.hil.arm.hidden_arm import TEMPLATE, HiddenArm, drawn_truth
from highfive.hil.arm_model.servo_arm import default_arm
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

SHAPE = drawn_shape(default_arm(), TEMPLATE.markers)
FREE = postures(90)


def drawn(joints: int, seed: int = 0) -> ArmShape:
    """Any arm."""
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(joints, 3))
    return ArmShape(
        tuple(f"joint {n}" for n in range(joints)),
        axes / np.linalg.norm(axes, axis=1, keepdims=True),
        rng.uniform(-0.2, 0.3, (joints, 3)),
        rng.uniform(0.1, 1.0, joints),
        rng.uniform(-0.1, 0.1, (joints, 3)),
        rng.uniform(-0.05, 0.05, (4, 3)),
    )


@pytest.mark.parametrize("joints", [4, 5, 6, 7])
def test_the_jacobian_is_that_of_differences(joints: int) -> None:
    shape, rng = drawn(joints), np.random.default_rng(joints)
    start = as_drawn(shape, rotations.to_matrix(rotations.from_rotation_vector(rng.normal(size=3))), rng.normal(size=3))
    errors = start.unpacked(rng.normal(0.0, 0.1, start.packed().size))
    encoders, sides = rng.uniform(-2.0, 2.0, (3, joints)), rng.choice([-1.0, 1.0], (3, joints))
    torques = rng.normal(0.0, 5.0, (3, joints))

    def places(values: Array) -> Array:
        at = start.unpacked(values)
        return marker_places(shape, at, frames_of(shape, at, true_angles(at, encoders, torques, sides)))

    frames = frames_of(shape, errors, true_angles(errors, encoders, torques, sides))
    found = jacobian(errors, frames, places(errors.packed()), encoders, torques, sides)
    step = 1e-6 * np.eye(found.shape[-1])
    differences = [(places(errors.packed() + one) - places(errors.packed() - one)) / 2e-6 for one in step]
    np.testing.assert_allclose(found, np.stack(differences, axis=-1), atol=1e-8)


def test_plate_and_gravity_of_the_drawing_are_those_of_the_arm() -> None:
    arm = default_arm()
    errors = as_drawn(SHAPE, arm.packed.base_axes, arm.packed.base)
    frames = frames_of(SHAPE, errors, FREE)
    torques = gravity_torques(SHAPE, frames, UP)
    for n, joints in enumerate(FREE[:20]):
        pose = arm.plate_at(joints)
        np.testing.assert_allclose(frames.centres[n, -1] + frames.last[n] @ TEMPLATE.centre, pose.position, atol=1e-12)
        np.testing.assert_allclose(torques[n], arm.gravity(joints), atol=1e-12)


def misses(seed: int, poses: ArmPoses, fitted: tuple[str, ...] | None = None) -> Array:
    """m, of the plate's middle in postures that the fit did not see, with the arm of that seed."""
    fit = fit_arm(SHAPE, poses, UP) if fitted is None else fit_arm(SHAPE, poses, UP, fitted)
    plate, arm = plate_of_fit(fit, TEMPLATE), HiddenArm(drawn_truth(seed))
    others = FREE[60:]
    _, places, axes = fit.predicted(others)
    centres = plate.at(places, axes)[0]
    found = []
    for joints, centre in zip(others, centres, strict=True):
        arm.stand(joints, np.zeros(6), repeat=False)
        found.append(np.linalg.norm(arm.plate()[0] - centre))
    return np.array(found)


def test_a_hidden_arm_is_found_to_a_millimetre_and_a_half_where_the_base_alone_leaves_a_centimetre() -> None:
    seeds = range(4)
    poses = [seen_poses(drawn_truth(seed), FREE[:30]) for seed in seeds]
    whole = np.concatenate([misses(seed, one) for seed, one in zip(seeds, poses, strict=True)])
    assert np.median(whole) < 1.3e-3
    assert np.percentile(whole, 95) < 2.7e-3
    with pytest.raises(HighFiveError, match="residuals are"):
        check_fit(fit_arm(SHAPE, poses[0], UP, EXTRINSICS))
    for one in poses:
        check_fit(fit_arm(SHAPE, one, UP))


def test_the_base_is_free_to_stand_anywhere_in_the_room() -> None:
    poses = seen_poses(drawn_truth(1), FREE[:20])
    turn = rotations.from_rotation_vector(np.array([0.4, -1.9, 2.2]))
    moved = replace(poses, markers=rotations.rotate(turn, poses.markers) + np.array([7.0, -3.0, 1.0]))
    here, there = fit_arm(SHAPE, poses, UP), fit_arm(SHAPE, moved, rotations.rotate(turn, UP))
    np.testing.assert_allclose(
        rotations.rotate(turn, here.predicted(FREE[60:])[0]) + np.array([7.0, -3.0, 1.0]),
        there.predicted(FREE[60:])[0],
        atol=1e-5,
    )


def test_one_marker_in_ten_astray_by_30_mm_costs_little() -> None:
    found = []
    for seed in range(4):
        poses, rng = seen_poses(drawn_truth(seed), FREE[:30]), np.random.default_rng(seed)
        away = rng.normal(size=poses.markers.shape)
        away *= 0.03 / np.linalg.norm(away, axis=-1, keepdims=True)
        astray = rng.random(poses.seen.shape) < 0.1
        found.append(misses(seed, replace(poses, markers=poses.markers + np.where(astray[..., None], away, 0.0))))
    assert np.percentile(np.concatenate(found), 95) < 2.8e-3


def test_markers_that_were_not_seen_have_no_say() -> None:
    poses, rng = seen_poses(drawn_truth(2), FREE[:20]), np.random.default_rng(0)
    seen = rng.random(poses.seen.shape) < 0.8
    one = fit_arm(SHAPE, replace(poses, seen=seen, markers=np.where(seen[..., None], poses.markers, 0.0)), UP)
    other = fit_arm(SHAPE, replace(poses, seen=seen, markers=np.where(seen[..., None], poses.markers, 9.0)), UP)
    np.testing.assert_array_equal(one.errors.packed(), other.errors.packed())


def test_play_is_found_from_both_sides_of_approach() -> None:
    truth = drawn_truth(5, play=float(np.radians(0.3)))
    one = seen_poses(truth, FREE[:40], noise=0.0001, repeat=False)
    fit = fit_arm(SHAPE, one, UP, ("base_turn", "base_place", "zero", "compliance", "length", "tilt", "marker", "play"))
    np.testing.assert_allclose(fit.errors.play[:5], truth.play[:5], atol=np.radians(0.12))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda places: places * [1.0, -1.0, 1.0], "mirror image"),
        (lambda places: 1000.0 * places, "does the motion capture send metres"),
        (lambda places: 1.03 * places, "links come out 1.02|residuals are"),
        (lambda places: np.where(np.arange(5)[:, None] == 0, np.nan, places), "not finite"),
    ],
)
def test_streams_that_are_not_the_room_are_refused(change: Callable[[Array], Array], says: str) -> None:
    poses = seen_poses(drawn_truth(0), FREE[:20])
    with pytest.raises(HighFiveError, match=says):
        changed = replace(poses, markers=change(poses.markers))
        check_fit(fit_arm(SHAPE, changed, UP))


@pytest.mark.parametrize("joint", range(6))
def test_a_reversed_joint_is_refused(joint: int) -> None:
    poses = seen_poses(drawn_truth(0), FREE[:30])
    turned = poses.encoders.copy()
    turned[:, joint] *= -1.0
    with pytest.raises(HighFiveError, match="residuals are"):
        reversed_one = replace(poses, encoders=turned)
        check_fit(fit_arm(SHAPE, reversed_one, UP))


def test_poses_that_leave_a_joint_where_it_was_are_refused_by_its_name() -> None:
    poses = seen_poses(drawn_truth(0), FREE[:12])
    still = poses.encoders.copy()
    still[:, 2] = 0.3
    check_excitation(SHAPE.names, poses)
    with pytest.raises(HighFiveError, match=r"elbow 0°.*take other poses"):
        check_excitation(SHAPE.names, replace(poses, encoders=still))


def test_what_poses_cannot_tell_is_named() -> None:
    named = not_observed(fit_arm(SHAPE, seen_poses(drawn_truth(0), FREE[:30]), UP))
    assert "compliance wrist_rotate" in named
    assert "zero elbow" not in named
    assert "compliance shoulder" not in named


def test_held_out_poses_tell_how_far_the_plate_really_is_off() -> None:
    poses = seen_poses(drawn_truth(3), FREE[:30])
    told, true = held_out(SHAPE, poses, UP, TEMPLATE), misses(3, poses)
    assert np.isfinite(told).all()
    assert 0.5 * np.median(true) < np.median(told) < 3.0 * np.median(true)


def test_chosen_poses_tell_more_than_random_ones() -> None:
    chosen = FREE[choose_poses(SHAPE, FREE, 12)]

    def sure(encoders: Array) -> float:
        fit = fit_arm(SHAPE, seen_poses(drawn_truth(0), encoders), UP, settings=ARM_FIT)
        free = fit.priors > 0.0
        return float(np.log(fit.sigmas[free] / fit.priors[free]).sum())

    assert sure(chosen) < min(sure(FREE[12 * n : 12 * n + 12]) for n in range(5))
    with pytest.raises(HighFiveError, match="90 postures can be taken, 91 are needed"):
        choose_poses(SHAPE, FREE, 91)


def test_a_marker_that_came_loose_is_named() -> None:
    poses = seen_poses(drawn_truth(0), FREE[:30])
    fit = fit_arm(SHAPE, poses, UP)
    check_loose(fit, poses, TEMPLATE)
    arm, moved = HiddenArm(drawn_truth(0)), poses.markers.copy()
    for n in range(15, 30):
        arm.stand(FREE[n], np.zeros(6))
        at, normal = arm.plate()
        side = np.cross(normal, moved[n, 1] - at)
        moved[n, 1] += 0.005 * side / np.linalg.norm(side)
    loose = replace(poses, markers=moved)
    with pytest.raises(HighFiveError, match="marker plate2 is loose"):
        check_loose(fit_arm(SHAPE, loose, UP), loose, TEMPLATE)
