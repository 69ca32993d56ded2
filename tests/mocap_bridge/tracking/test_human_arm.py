from dataclasses import replace

import numpy as np
import pytest

from highfive.hil.sim.avatar import avatar_skeleton, right_palm
from highfive.mocap_bridge.frames import TrackedMarkers
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set, marker_set_names
from highfive.mocap_bridge.tracking.filter_settings import NEVER
from highfive.mocap_bridge.tracking.human_arm import HumanArmEstimator
from highfive.model.geometry import rotations

SKELETON = avatar_skeleton()


def raised_arm(time=0.0):
    """Root (3,) and pose (53, 4) of a person who faces −x and raises the right hand, at a time in s."""
    angles = np.zeros((len(SKELETON), 3))
    angles[0, 0] = np.pi
    angles[SKELETON.index("right_shoulder")] = [-1.2 - 0.8 * time, -0.2, 0.3]
    angles[SKELETON.index("right_elbow")] = [-1.0 + 0.9 * time, 0.0, -0.8]
    angles[SKELETON.index("right_wrist")] = [0.2 * time, 0.1, 0.0]
    angles[SKELETON.index("head")] = [0.2, 0.1, 0.3]
    return np.array([1.0 + 0.1 * time, 0.02, 0.93]), SKELETON.from_hinges(angles)


def tracked(marker_set, time=0.0, step=1e-6):
    def positions(at):
        return marker_set.simulate(SKELETON, *SKELETON.forward_kinematics(*raised_arm(at)))

    count = len(marker_set)
    return TrackedMarkers(
        names=marker_set.names,
        positions=positions(time),
        velocities=(positions(time + step) - positions(time - step)) / (2 * step),
        covariances=np.zeros((count, 3, 3)),
        seen=np.ones(count, dtype=bool),
        age_ns=np.zeros(count, dtype=np.int64),
        valid=np.ones(count, dtype=bool),
        rejected=np.zeros(count, dtype=bool),
        time_ns=7,
    )


@pytest.mark.parametrize("name", ["paper", "full_body"])
def test_the_arm_of_a_simulated_person_is_the_skeletons(name):
    marker_set = load_marker_set(name)
    arm = HumanArmEstimator(marker_set)(tracked(marker_set))
    centres, orientations = SKELETON.forward_kinematics(*raised_arm())
    palm, normal, fingers = right_palm(SKELETON, centres, orientations)
    limits = {"shoulder": 0.025, "elbow": 0.005, "wrist": 0.005}
    for joint, limit in limits.items():
        assert np.linalg.norm(getattr(arm, joint) - centres[SKELETON.index(f"right_{joint}")]) < limit
    assert np.linalg.norm(arm.palm.position - palm) < 0.004
    assert arm.palm.normal @ normal > np.cos(np.radians(3))
    assert arm.palm.fingers @ fingers > np.cos(np.radians(3))
    head = SKELETON.index("head")
    turn = rotations.multiply(rotations.conjugate(orientations[head]), arm.head_orientation)
    assert np.linalg.norm(rotations.to_rotation_vector(turn)) < 1e-6
    expected_head = centres[head] + rotations.rotate(orientations[head], marker_set.arm.centre_in_head)
    np.testing.assert_allclose(arm.head_position, expected_head, atol=1e-4)
    np.testing.assert_allclose(arm.hand_points, [arm.wrist, arm.knuckles])
    assert arm.valid
    assert arm.time_ns == 7


def test_a_neck_that_is_seen_does_not_tell_where_the_head_is():
    """The joint centre at the top of the neck is measured in this very frame; the point on the head was so long ago."""
    marker_set = load_marker_set("cmu_joint_centres")
    markers, hidden = tracked(marker_set), marker_set.index("head")
    markers.age_ns[hidden], markers.covariances[hidden] = 200_000_000, 0.03**2 / 3 * np.eye(3)
    assert marker_set.arm.head == ("upperneck", "head")
    arm = HumanArmEstimator(marker_set)(markers)
    assert arm.head_unseen_ns == 200_000_000
    assert arm.head_deviation == pytest.approx(0.03)


@pytest.mark.parametrize("name", marker_set_names())
def test_the_palms_velocity_is_the_derivative_of_its_position(name):
    marker_set = load_marker_set(name)
    estimate = HumanArmEstimator(marker_set)
    step = 1e-4
    before, after = (estimate(tracked(marker_set, t)).palm.position for t in (0.3 - step, 0.3 + step))
    velocity = estimate(tracked(marker_set, 0.3)).palm.velocity
    assert np.linalg.norm(velocity) > 0.2
    # The size of the hand is held for the derivative: it is a measure of the body, not of the motion.
    np.testing.assert_allclose(velocity, (after - before) / (2 * step), atol=0.01)


@pytest.mark.parametrize("name", marker_set_names())
def test_turning_the_world_turns_the_arm(name):
    marker_set = load_marker_set(name)
    turn, shift = rotations.from_axis_angle("z", 0.7), np.array([0.3, -2.0, 0.1])
    partner = rotations.rotate(turn, [-1.0, 0.0, 0.0])
    here = tracked(marker_set)
    there = replace(
        here,
        positions=rotations.rotate(turn, here.positions) + shift,
        velocities=rotations.rotate(turn, here.velocities),
    )
    a = HumanArmEstimator(marker_set)(here)
    b = HumanArmEstimator(marker_set, (partner[0], partner[1], partner[2]))(there)
    for point in ("head_position", "shoulder", "elbow", "wrist", "knuckles"):
        np.testing.assert_allclose(getattr(b, point), rotations.rotate(turn, getattr(a, point)) + shift, atol=1e-9)
    for vector in ("normal", "fingers", "velocity"):
        np.testing.assert_allclose(getattr(b.palm, vector), rotations.rotate(turn, getattr(a.palm, vector)), atol=1e-6)
    expected = rotations.multiply(turn, a.head_orientation)
    assert abs(expected @ b.head_orientation) == pytest.approx(1.0, abs=1e-9)


def test_without_markers_across_the_hand_the_palm_faces_the_partner():
    marker_set = load_marker_set("cmu_joint_centres")
    palm = HumanArmEstimator(marker_set)(tracked(marker_set)).palm
    assert palm.normal @ palm.fingers == pytest.approx(0.0, abs=1e-9)
    in_plane = np.array([-1.0, 0.0, 0.0]) + palm.fingers[0] * palm.fingers
    np.testing.assert_allclose(palm.normal, in_plane / np.linalg.norm(in_plane), atol=1e-9)


def test_one_doubtful_marker_of_the_arm_makes_it_invalid_and_its_age_shows():
    marker_set = load_marker_set("paper")
    frame = tracked(marker_set)
    valid, age = frame.valid.copy(), frame.age_ns.copy()
    valid[marker_set.index("RFIN")] = False
    age[marker_set.index("RFIN")] = 40
    arm = HumanArmEstimator(marker_set)(replace(frame, valid=valid, age_ns=age))
    assert not arm.valid
    assert arm.age_ns == 40
    age[marker_set.indices([*marker_set.arm.wrist, *marker_set.arm.hand])] = NEVER
    assert HumanArmEstimator(marker_set)(replace(frame, age_ns=age)).age_ns == NEVER
    valid[marker_set.index("RFIN")], valid[marker_set.index("RUPB")] = True, False
    assert HumanArmEstimator(marker_set)(replace(frame, valid=valid)).valid


def test_without_points_on_the_hand_it_goes_on_from_the_forearm():
    centres = load_marker_set("joint_centres")
    bare = centres.subset(centres.arm.markers)
    names = [name for name in bare.names if name != "right_hand"]
    bare = replace(bare, arm=replace(bare.arm, hand=())).subset(names)
    straight = replace(tracked(bare), velocities=np.zeros((len(bare), 3)))
    arm = HumanArmEstimator(bare)(straight)
    along = (arm.wrist - arm.elbow) / np.linalg.norm(arm.wrist - arm.elbow)
    knuckles = arm.knuckles - arm.wrist
    np.testing.assert_allclose(knuckles, np.linalg.norm(centres.arm.knuckles_in_hand) * along, atol=1e-4)
    assert (arm.palm.position - arm.wrist) @ along == pytest.approx(-centres.arm.palm_in_hand[2], rel=0.02)
