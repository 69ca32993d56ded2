from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scene_helpers import RAISED, person_with_palm, pose_of, random_pose

from highfive.hil.sim.avatar import right_palm
from highfive.hil.sim.scene import build_scene, contact_pairs, rest_pose
from highfive.hil.sim.touch import TouchReader
from highfive.model.geometry import rotations


@pytest.fixture(scope="module")
def scene():
    return build_scene()


def touches(scene, data):
    mujoco.mj_kinematics(scene.model, data)
    mujoco.mj_collision(scene.model, data)
    return TouchReader(scene).read(data, forces=False)


@pytest.mark.parametrize("seed", range(8))
def test_mujoco_kinematics_agree_with_the_skeletons(scene, seed):
    pose = random_pose(scene.skeleton, np.random.default_rng(seed))
    data = scene.make_data()
    scene.set_pose(data, pose)
    mujoco.mj_kinematics(scene.model, data)
    positions, orientations = scene.skeleton.forward_kinematics(pose.root_in_world, pose.quaternions)
    bodies = [scene.model.body(name).id for name in scene.skeleton.names]
    np.testing.assert_allclose(data.xpos[bodies], positions, atol=1e-12)
    agreement = np.abs(np.sum(data.xquat[bodies] * orientations, axis=-1))
    np.testing.assert_allclose(agreement, 1.0, atol=1e-12)
    centre, normal, fingers = right_palm(scene.skeleton, positions, orientations)
    palm = scene.avatar_palm(data)
    np.testing.assert_allclose(palm.position, centre, atol=1e-12)
    np.testing.assert_allclose(palm.normal, normal, atol=1e-12)
    np.testing.assert_allclose(palm.fingers, fingers, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_a_pose_comes_back_as_it_was_set(scene, seed):
    pose = random_pose(scene.skeleton, np.random.default_rng(100 + seed))
    data = scene.make_data()
    scene.set_pose(data, pose)
    back = scene.get_pose(data)
    np.testing.assert_allclose(back.root_in_world, pose.root_in_world, atol=1e-14)
    same = np.abs(np.sum(back.quaternions * pose.quaternions, axis=-1))
    np.testing.assert_allclose(same, 1.0, atol=1e-12)
    angles = data.qpos[scene.hinge_qpos]
    np.testing.assert_allclose(angles, scene.skeleton.clamp(angles), atol=1e-9)


def test_hinges_near_half_a_turn_come_out_inside_their_limits(scene):
    skeleton = scene.skeleton
    angles = np.zeros((len(skeleton), 3))
    shoulder = skeleton.index("right_shoulder")
    angles[shoulder, 0] = -np.pi + 1e-9
    for nudge in (0.0, -2e-9):
        quaternions = skeleton.from_hinges(angles + nudge)
        assert skeleton.to_hinges(quaternions)[shoulder, 0] == pytest.approx(-np.pi, abs=1e-6)


def test_hinge_conversion_is_the_one_of_rotations(scene):
    skeleton, rng = scene.skeleton, np.random.default_rng(5)
    angles = rng.uniform(skeleton.hinge_limits[..., 0], skeleton.hinge_limits[..., 1], (6, len(skeleton), 3))
    one_by_one = [rotations.from_euler(o, angles[:, i]) for i, o in enumerate(skeleton.hinge_orders)]
    np.testing.assert_allclose(skeleton.from_hinges(angles), np.stack(one_by_one, axis=1), atol=1e-14)
    np.testing.assert_allclose(skeleton.to_hinges(skeleton.from_hinges(angles)), angles, atol=1e-9)


@pytest.mark.parametrize("degrees", [{}, RAISED, {"right_elbow_y": -60.0, "right_shoulder_y": -60.0}])
def test_nothing_touches_in_everyday_poses(scene, degrees):
    data = scene.make_data()
    scene.set_pose(data, pose_of(scene.skeleton, degrees))
    scene.set_person(data, person_with_palm([1.0, 0.35, 0.9], [-1.0, 0.0, 0.0]))
    assert touches(scene, data) == []


def test_palms_pressed_together_touch_along_the_palm_normal(scene):
    data = scene.make_data()
    scene.set_pose(data, pose_of(scene.skeleton, RAISED))
    mujoco.mj_kinematics(scene.model, data)
    palm = scene.avatar_palm(data)
    overlap = 0.003
    scene.set_person(data, person_with_palm(palm.position - overlap * palm.normal, -palm.normal, palm.fingers))
    touch = next(t for t in touches(scene, data) if (t.first, t.second) == ("right_palm", "person_palm"))
    assert touch.expected
    assert touch.distance == pytest.approx(-overlap, abs=2e-4)
    assert touch.normal @ palm.normal > np.cos(np.radians(2.0))
    np.testing.assert_allclose(touch.position, palm.position, atol=0.006)


def test_a_hand_in_the_persons_face_is_not_expected(scene):
    data = scene.make_data()
    scene.set_pose(data, pose_of(scene.skeleton, RAISED))
    mujoco.mj_kinematics(scene.model, data)
    head = scene.avatar_palm(data).position + np.array([0.06, 0.0, 0.0])
    scene.set_person(data, person_with_palm([1.0, 0.4, 0.9], [-1.0, 0.0, 0.0], head=head))
    found = touches(scene, data)
    assert {touch.second for touch in found} == {"person_head"}
    assert not any(touch.expected for touch in found)


def test_a_hand_in_the_own_belly_is_not_expected(scene):
    data = scene.make_data()
    degrees = {"right_shoulder_y": -10.0, "right_elbow_y": -80.0, "right_shoulder_z": 75.0}
    scene.set_pose(data, pose_of(scene.skeleton, degrees))
    scene.set_person(data, person_with_palm([1.0, 0.4, 0.9], [-1.0, 0.0, 0.0]))
    found = touches(scene, data)
    assert found
    assert not any(touch.expected for touch in found)


def test_the_persons_bodies_are_where_the_person_is(scene):
    data = scene.make_data()
    arm = person_with_palm(
        [0.6, 0.1, 1.5], [-0.9, 0.1, 0.2] / np.linalg.norm([0.9, 0.1, 0.2]), velocity=[1.0, 0.0, 0.0]
    )
    scene.set_person(data, arm)
    mujoco.mj_kinematics(scene.model, data)
    palm = scene.person_palm(data)
    np.testing.assert_allclose(palm.position, arm.palm.position, atol=1e-12)
    np.testing.assert_allclose(palm.normal, arm.palm.normal, atol=1e-12)
    np.testing.assert_allclose(palm.fingers, arm.palm.fingers, atol=1e-12)
    for name, start, end in (("person_upper_arm", arm.shoulder, arm.elbow), ("person_forearm", arm.elbow, arm.wrist)):
        body = data.body(name)
        along = (end - start) / np.linalg.norm(end - start)
        np.testing.assert_allclose(body.xpos, start, atol=1e-12)
        np.testing.assert_allclose(-body.xmat.reshape(3, 3)[:, 2], along, atol=1e-9)


def test_leaning_does_not_move_the_persons_feet_but_walking_does(scene):
    data = scene.make_data()

    def feet(x):
        arm = person_with_palm([x - 0.5, 0.1, 1.4], [-1.0, 0.0, 0.0], head=[x, 0.0, 1.66])
        scene.set_person(data, arm)
        mujoco.mj_kinematics(scene.model, data)
        return data.body("person_pelvis").xpos.copy()

    standing = feet(1.10)
    np.testing.assert_array_equal(feet(1.04), standing)
    assert np.linalg.norm(feet(2.5) - standing) > 0.5


def test_contacts_are_explicit_pairs_only(scene):
    expected, unwanted = contact_pairs(scene.skeleton)
    assert scene.model.npair == len(expected) + len(unwanted) == len(set(expected + unwanted))
    assert not scene.model.geom_contype.any()
    assert not scene.model.geom_conaffinity.any()


def test_the_exported_file_is_the_same_model(scene, tmp_path):
    scene.save_xml(tmp_path / "scene.xml")
    again = mujoco.MjModel.from_xml_path(str(tmp_path / "scene.xml"))
    assert (again.nq, again.nv, again.nu, again.npair) == tuple(
        getattr(scene.model, size) for size in ("nq", "nv", "nu", "npair")
    )
    np.testing.assert_allclose(again.body_mass, scene.model.body_mass, rtol=1e-5)
    np.testing.assert_allclose(again.jnt_range, scene.model.jnt_range, atol=1e-5)


def test_the_rest_pose_is_the_skeletons(scene):
    pose = rest_pose(scene.skeleton)
    np.testing.assert_array_equal(pose.quaternions, scene.skeleton.rest)


def test_a_degenerate_arm_still_gives_frames(scene):
    data = scene.make_data()
    arm = person_with_palm([0.6, 0.1, 1.5], [-1.0, 0.0, 0.0])
    for change in (
        {"elbow": arm.shoulder},
        {"shoulder": arm.head_position},
        {"elbow": arm.wrist, "shoulder": arm.wrist},
    ):
        scene.set_person(data, replace(arm, **change))
        mujoco.mj_kinematics(scene.model, data)
        assert np.all(np.isfinite(data.xpos))
        np.testing.assert_allclose(np.linalg.norm(data.mocap_quat, axis=1), 1.0, atol=1e-9)
