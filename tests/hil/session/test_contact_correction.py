"""The correction: palm to palm inside the joint limits, against MuJoCo's own least-squares solver as the oracle."""

import mujoco
import numpy as np
import pytest
from mujoco import minimize

from highfive.hil.session.contact_correction import ContactCorrection, CorrectionSettings
from highfive.hil.sim.avatar import Pose, avatar_skeleton
from highfive.hil.sim.people.actors import simulate_pair
from highfive.hil.sim.scene import Scene, build_scene
from highfive.model.geometry import rotations


@pytest.fixture(scope="module")
def scene() -> Scene:
    return build_scene()


@pytest.fixture(scope="module")
def contact_pose() -> Pose:
    trial = simulate_pair("neutral", "B2", 0, np.random.default_rng(3))
    k = trial.contact_frame
    return Pose.from_quaternions(trial.avatar.root_in_world[k], trial.avatar.quaternions[k])


def random_targets(count: int, reach: float) -> list[tuple[np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(count, 3))
    steps = directions / np.linalg.norm(directions, axis=1, keepdims=True) * rng.uniform(0.0, reach, (count, 1))
    turns = rotations.from_rotation_vector(rng.normal(0.0, 0.12, (count, 3)))
    return list(zip(steps, turns, strict=True))


def test_palm_comes_to_the_target_and_limits_hold(scene: Scene, contact_pose: Pose) -> None:
    correction = ContactCorrection(scene)
    palm = correction.palm_of(contact_pose)
    limits = avatar_skeleton().hinge_limits
    misses, angles = [], []
    for step, turn in random_targets(200, 0.08):
        correction.reset()
        normal = rotations.rotate(turn, palm.normal)
        solved = correction.solve(contact_pose, palm.position + step, normal)
        hinges = solved.pose.hinges
        assert np.all(hinges >= limits[..., 0] - 1e-9)
        assert np.all(hinges <= limits[..., 1] + 1e-9)
        misses.append(np.linalg.norm(solved.palm.position - palm.position - step))
        angles.append(np.degrees(np.arccos(min(1.0, float(solved.palm.normal @ normal)))))
        assert not solved.out_of_reach
    assert np.median(misses) < 0.3e-3
    assert np.max(misses) < 2e-3
    assert np.max(angles) < 3.0


def test_no_other_joint_moves(scene: Scene, contact_pose: Pose) -> None:
    correction = ContactCorrection(scene)
    palm = correction.palm_of(contact_pose)
    solved = correction.solve(contact_pose, palm.position + np.array([0.0, 0.03, 0.02]), palm.normal)
    others = np.setdiff1d(np.arange(53), scene.arm_joints)
    moved = np.abs(solved.pose.hinges - contact_pose.hinges)
    assert moved[others].max() < 1e-9
    assert moved[scene.arm_joints].max() > 1e-3


def test_where_nothing_is_asked_nothing_changes(scene: Scene, contact_pose: Pose) -> None:
    correction = ContactCorrection(scene)
    palm = correction.palm_of(contact_pose)
    solved = correction.solve(contact_pose, palm.position, palm.normal)
    np.testing.assert_allclose(solved.pose.hinges, contact_pose.hinges, atol=1e-6)


def test_cost_is_no_higher_than_the_oracles(scene: Scene, contact_pose: Pose) -> None:
    correction = ContactCorrection(scene, CorrectionSettings(iterations=30))
    palm = correction.palm_of(contact_pose)
    model, data = scene.model, mujoco.MjData(scene.model)
    qpos = scene.hinge_qpos[scene.arm_joints].ravel()
    limits = avatar_skeleton().hinge_limits[scene.arm_joints].reshape(-1, 2)
    start = contact_pose.hinges[scene.arm_joints].ravel()
    scale = np.sqrt(correction.posture_cost)
    for step, turn in random_targets(8, 0.12):
        target, normal = palm.position + step, rotations.rotate(turn, palm.normal)

        def residual(columns: np.ndarray, target=target, normal=normal) -> np.ndarray:
            out = []
            for x in columns.T:
                scene.set_pose(data, contact_pose)
                data.qpos[qpos] = x
                mujoco.mj_kinematics(model, data)
                site = data.site_xmat[scene.palm_site].reshape(3, 3)[:, 2]
                place = CorrectionSettings().position_weight * (data.site_xpos[scene.palm_site] - target)
                out.append(
                    np.concatenate([place, CorrectionSettings().normal_weight * (site - normal), scale * (x - start)])
                )
            return np.array(out).T

        oracle, _ = minimize.least_squares(start, residual, bounds=[limits[:, 0], limits[:, 1]], verbose=0)
        correction.reset()
        solved = correction.solve(contact_pose, target, normal)
        ours = solved.pose.hinges[scene.arm_joints].ravel()
        cost = [0.5 * np.sum(residual(x[:, None]) ** 2) for x in (ours, oracle)]
        assert cost[0] < 1.02 * cost[1] + 1e-9


def test_out_of_reach_is_said_and_the_arm_stretches_towards_it(scene: Scene, contact_pose: Pose) -> None:
    correction = ContactCorrection(scene)
    far = np.array([1.6, 0.1, 1.5])
    for _ in range(10):  # ten ticks, each from the last
        solved = correction.solve(contact_pose, far, np.array([1.0, 0.0, 0.0]))
    assert solved.out_of_reach
    near = np.linalg.norm(far - solved.palm.position)
    assert near == pytest.approx(solved.miss)
    assert near < np.linalg.norm(far - correction.palm_of(contact_pose).position) - 0.05


def test_a_target_that_moves_smoothly_moves_the_joints_smoothly(scene: Scene, contact_pose: Pose) -> None:
    correction = ContactCorrection(scene)
    palm = correction.palm_of(contact_pose)
    phase = np.linspace(0.0, 2.0 * np.pi, 240)
    track = []
    for angle in phase:
        offset = 0.03 * np.array([np.sin(angle), 1.0 - np.cos(angle), 0.5 * np.sin(angle)])
        track.append(correction.solve(contact_pose, palm.position + offset, palm.normal).pose.hinges)
    accelerations = np.diff(np.array(track), n=2, axis=0) * 120.0**2
    assert np.abs(accelerations).max() < 6.0  # rad/s²; the target itself accelerates by 0.3 m/s²


def test_settings_reach_the_solver(scene: Scene, contact_pose: Pose) -> None:
    """A posture that is held hard leaves the palm where the model had it."""
    usual, held = ContactCorrection(scene), ContactCorrection(scene, CorrectionSettings(posture_weight=10.0))
    palm = usual.palm_of(contact_pose)
    place = palm.position + np.array([0.0, 0.02, 0.02])
    assert usual.solve(contact_pose, place, palm.normal).miss < 0.005
    assert held.solve(contact_pose, place, palm.normal).miss > 0.02


@pytest.mark.parametrize("rate", [30.0, 60.0, 240.0, 500.0])
def test_a_change_that_is_not_needed_any_more_fades_as_quickly_at_any_rate(
    scene: Scene, contact_pose: Pose, rate: float
) -> None:
    def left_after(seconds: float, hz: float) -> float:
        correction = ContactCorrection(scene)
        palm = correction.palm_of(contact_pose)
        start = correction.solve(contact_pose, palm.position + np.array([0.0, 0.03, 0.02]), palm.normal).pose.hinges
        for _ in range(round(seconds * hz)):
            pose = correction.solve(contact_pose, palm.position, palm.normal, 0.0, 1.0 / hz).pose
        return float(np.linalg.norm(pose.hinges - contact_pose.hinges) / np.linalg.norm(start - contact_pose.hinges))

    assert left_after(0.1, 120.0) == pytest.approx(0.38, abs=0.1)
    assert left_after(0.1, rate) == pytest.approx(left_after(0.1, 120.0), abs=0.06)
