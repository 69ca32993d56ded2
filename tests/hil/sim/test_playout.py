import mujoco
import numpy as np
import pytest
from scene_helpers import RAISED, person_with_palm, pose_of

from highfive.hil.sim.avatar import Pose
from highfive.hil.sim.contact_check import contact_report, palm_offset
from highfive.hil.sim.playout import KinematicPlayOut, PhysicsPlayOut
from highfive.hil.sim.scene import build_scene
from highfive.model.geometry import rotations

FAR_AWAY = person_with_palm([1.0, 0.4, 0.9], [-1.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def scene():
    return build_scene()


def tick(number):
    return round(number * 1e9 / 120.0)


def reach(skeleton, ticks):
    """The right arm rises in a minimum-jerk movement."""
    start, end = pose_of(skeleton, {"right_elbow_y": -40.0}), pose_of(skeleton, RAISED)
    for s in np.linspace(0.0, 1.0, ticks):
        part = np.full(len(skeleton), s**3 * (10.0 - 15.0 * s + 6.0 * s * s))
        yield Pose.from_quaternions(start.root_in_world, rotations.slerp(start.quaternions, end.quaternions, part))


def palm_of(scene, pose):
    data = scene.make_data()
    scene.set_pose(data, pose)
    mujoco.mj_kinematics(scene.model, data)
    return scene.avatar_palm(data)


def test_kinematic_play_out_shows_the_pose_and_its_velocity(scene):
    play = KinematicPlayOut(scene)
    poses = list(reach(scene.skeleton, 60))
    play.reset(poses[0], FAR_AWAY)
    for number, pose in enumerate(poses[1:], start=1):
        state = play.step(pose, FAR_AWAY, tick(number))
        here, before = palm_of(scene, pose), palm_of(scene, poses[number - 1])
        np.testing.assert_allclose(state.palm.position, here.position, atol=1e-12)
        np.testing.assert_allclose(state.palm.velocity, (here.position - before.position) * 120.0, atol=1e-4)


def test_physics_follows_a_reach_in_free_space(scene):
    play = PhysicsPlayOut(scene)
    poses = list(reach(scene.skeleton, 96))
    play.reset(poses[0], FAR_AWAY)
    errors, speeds = [], []
    for number, pose in enumerate(poses[1:], start=1):
        state = play.step(pose, FAR_AWAY, tick(number))
        errors.append(np.linalg.norm(state.palm.position - palm_of(scene, pose).position))
        speeds.append(np.linalg.norm(state.palm.velocity))
    assert max(speeds) > 1.0
    assert max(errors) < 0.004
    assert np.median(errors) < 0.002


def test_physics_holds_a_pose_against_nothing(scene):
    play, pose = PhysicsPlayOut(scene), pose_of(scene.skeleton, RAISED)
    state = play.reset(pose, FAR_AWAY)
    for number in range(1, 61):
        state = play.step(pose, FAR_AWAY, tick(number))
    assert np.linalg.norm(state.palm.position - palm_of(scene, pose).position) < 1e-5


def test_the_persons_palm_does_not_lag_at_constant_speed(scene):
    play, pose = PhysicsPlayOut(scene), pose_of(scene.skeleton, {})
    velocity = np.array([0.0, 0.0, 1.0])
    where = [np.array([1.0, 0.35, 0.9]) + velocity * number / 120.0 for number in range(60)]
    state = play.reset(pose, person_with_palm(where[0], [-1.0, 0.0, 0.0]))
    for number in range(1, 60):
        state = play.step(pose, person_with_palm(where[number], [-1.0, 0.0, 0.0], velocity=velocity), tick(number))
    assert np.linalg.norm(state.person_palm.position - where[-1]) < 0.001
    np.testing.assert_allclose(state.person_palm.velocity, velocity, atol=0.02)


def push(scene, speed, through=0.02):
    """The person's palm comes in at ``speed`` and stops 2 cm behind where the avatar holds its own."""
    play, pose = PhysicsPlayOut(scene), pose_of(scene.skeleton, RAISED)
    palm = palm_of(scene, pose)
    states = []
    for number in range(48):
        ahead = max(speed * (20 - number) / 120.0, -through)
        velocity = -speed * palm.normal if ahead > -through else np.zeros(3)
        arm = person_with_palm(palm.position + ahead * palm.normal, -palm.normal, palm.fingers, velocity)
        states.append(play.step(pose, arm, tick(number)) if number else play.reset(pose, arm))
    return states


def test_a_faster_hand_hits_harder_and_a_hand_can_push_the_avatar(scene):
    forces = []
    for speed in (0.3, 0.6, 1.2):
        report = contact_report(push(scene, speed))
        assert report.met
        assert report.approach_speed == pytest.approx(speed, rel=0.1)
        assert not report.unwanted
        forces.append(report.peak_force)
    assert forces == sorted(forces)
    assert 5.0 < forces[0] < forces[-1] < 150.0
    gap, _ = palm_offset(push(scene, 0.6)[-1].palm, push(scene, 0.6)[-1].person_palm)
    assert abs(gap) < 0.01


def test_two_runs_are_the_same_bit_for_bit(scene):
    first, second = push(scene, 0.8), push(scene, 0.8)
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a.palm.position, b.palm.position)
        assert a.hand_force == b.hand_force


def test_a_gap_in_time_does_not_throw_the_avatar_about(scene):
    play, poses = PhysicsPlayOut(scene), list(reach(scene.skeleton, 40))
    play.reset(poses[0], FAR_AWAY)
    for number, pose in enumerate(poses[1:20], start=1):
        play.step(pose, FAR_AWAY, tick(number))
    state = play.step(poses[-1], FAR_AWAY, tick(400))
    for number in range(401, 460):
        state = play.step(poses[-1], FAR_AWAY, tick(number))
    assert np.linalg.norm(state.palm.position - palm_of(scene, poses[-1]).position) < 0.005
