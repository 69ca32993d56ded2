"""The tables of ``scenes`` are what the compiled model is made of."""

import mujoco
import numpy as np
import pytest

from highfive.hil.sim.body_geometry import is_finger
from highfive.hil.sim.scene import NATURAL_FREQUENCY_HZ, build_scene
from highfive.scenes import anthropometry


@pytest.fixture(scope="module")
def scene():
    return build_scene()


def test_joints_are_53_times_three_hinges_with_the_limits_of_the_table(scene):
    model, skeleton = scene.model, scene.skeleton
    assert scene.hinge_qpos.size == 159
    joints = model.dof_jntid[scene.hinge_dofs]
    assert np.all(model.jnt_type[joints] == mujoco.mjtJoint.mjJNT_HINGE)
    assert np.all(model.jnt_limited[joints])
    np.testing.assert_allclose(model.jnt_range[joints], skeleton.hinge_limits, atol=1e-12)
    axes = np.eye(3)[[["xyz".index(a) for a in order] for order in skeleton.hinge_orders]]
    np.testing.assert_array_equal(model.jnt_axis[joints], axes)


def test_masses_are_those_of_the_table(scene):
    model = scene.model
    avatar = [model.body(name).mass[0] for name in scene.skeleton.names]
    assert sum(avatar) == pytest.approx(anthropometry.MASS, rel=1e-3)
    hand = sum(
        model.body(n).mass[0] for n in scene.skeleton.names if n == "left_wrist" or ("left" in n and is_finger(n))
    )
    assert hand == pytest.approx(anthropometry.SEGMENT_MASS_FRACTION["wrist"] * anthropometry.MASS)
    assert all(mass > 0.0 for mass in avatar)


def test_bones_have_the_lengths_of_the_table(scene):
    centres = {name: np.array(centre) for name, _, centre in anthropometry.joint_table()}
    for name, parent, centre in anthropometry.joint_table():
        if parent is not None:
            np.testing.assert_allclose(scene.model.body(name).pos, np.array(centre) - centres[parent], atol=1e-12)


def test_every_coordinate_has_one_actuator_critically_damped(scene):
    model = scene.model
    assert model.nu == 162
    assert sorted(model.actuator_trnid[:, 0]) == list(range(162))
    stiffness, damping = model.actuator_gainprm[:, 0], -model.actuator_biasprm[:, 2]
    # k = m w², d = 2 m w for any inertia m that is moved.
    np.testing.assert_allclose(damping / stiffness, 2.0 / (2.0 * np.pi * NATURAL_FREQUENCY_HZ), rtol=1e-9)
    assert np.all(stiffness > 0.0)


def test_the_room_has_the_cameras(scene):
    assert {scene.model.camera(i).name for i in range(scene.model.ncam)} == {"wide", "close", "shoulder", "front"}
