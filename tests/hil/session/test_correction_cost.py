"""What the correction minimises, against its formula in NumPy with MuJoCo's Jacobian."""

import mujoco
import numpy as np
import pytest

from highfive.hil.session.correction_cost import bounded, palm_and_posture
from highfive.hil.sim.scene import Scene, build_scene


@pytest.fixture(scope="module")
def scene() -> Scene:
    return build_scene()


@pytest.mark.parametrize("weights", [(1.0, 0.1), (0.3, 0.03), (0.0, 0.0)])
def test_cost_and_derivatives_are_those_of_mujocos_jacobian(scene: Scene, weights: tuple[float, float]) -> None:
    rng, model, data, count = np.random.default_rng(2), scene.model, scene.make_data(), len(scene.arm_dofs)
    for _ in range(20):
        data.qpos[scene.hinge_qpos] += rng.normal(0.0, 0.2, scene.hinge_qpos.shape)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        translation, rotation = np.zeros((2, 3, model.nv))
        mujoco.mj_jacSite(model, data, translation, rotation, scene.palm_site)
        place, frame = data.site_xpos[scene.palm_site], data.site_xmat[scene.palm_site]
        position, normal = place + rng.normal(0.0, 0.1, 3), rng.normal(size=3)
        moved, pull = rng.normal(size=count), rng.uniform(0.1, 1.0, count)
        facing = frame.reshape(3, 3)[:, 2]
        residual = np.concatenate([weights[0] * (place - position), weights[1] * (facing - normal)])
        turning = np.cross(rotation[:, scene.arm_dofs].T, facing).T
        jacobian = np.vstack([weights[0] * translation[:, scene.arm_dofs], weights[1] * turning])

        gradient, hessian = np.full(count, np.nan), np.full((count, count), np.nan)
        hinges = data.xanchor, data.xaxis, model.dof_jntid[scene.arm_dofs].astype(np.int64)
        cost = palm_and_posture((place, frame), hinges, (position, normal, *weights), (moved, pull), gradient, hessian)
        np.testing.assert_allclose(cost, residual @ residual + pull @ moved**2, rtol=1e-12)
        np.testing.assert_allclose(gradient, jacobian.T @ residual + pull * moved, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(hessian, jacobian.T @ jacobian + np.diag(pull), rtol=1e-9, atol=1e-12)


def test_a_step_keeps_to_the_limits_and_is_no_longer_than_allowed() -> None:
    rng = np.random.default_rng(3)
    angles, matrix = rng.uniform(-1.0, 1.0, 18), rng.normal(size=(18, 18))
    limits, box, damped = (np.full(18, -1.0), np.full(18, 1.0)), (np.zeros(18), np.zeros(18)), matrix.copy()
    bounded(angles, limits, 0.5, 0.01, damped, box)
    np.testing.assert_array_equal(box[0], np.maximum(-1.0 - angles, -0.5))
    np.testing.assert_array_equal(box[1], np.minimum(1.0 - angles, 0.5))
    np.testing.assert_array_equal(damped, matrix + 0.01 * np.eye(18))
