from dataclasses import replace

import numpy as np
import pytest

from highfive.calibration.hands import meeting_hands, mirror_columns, mirrored
from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set, marker_set_names
from highfive.model.geometry.rotations import Array

CENTRES, PAPER = load_marker_set("joint_centres"), load_marker_set("paper")


def body(at: Array, facing: float, hands: dict[str, Array]):
    """A rigid body at a place, facing ±x, with some hands elsewhere."""
    zero = np.array([CENTRES.segments[joint].centre for joint in CENTRES.joints]) + CENTRES.local_positions
    points = zero * [facing, facing, 1.0] + at
    for side, place in hands.items():
        points[CENTRES.index(f"{side}_hand")] = place
    return make_recording(30.0, CENTRES.names, points[None], np.ones((1, len(CENTRES)), dtype=bool))


@pytest.mark.parametrize("name", marker_set_names())
def test_a_mirror_image_twice_is_the_thing_itself(name):
    marker_set = load_marker_set(name)
    points = np.random.default_rng(0).normal(size=(4, len(marker_set), 3))
    recording = make_recording(30.0, marker_set.names, points, np.ones((4, len(marker_set)), dtype=bool))
    twice = mirrored(mirrored(recording, marker_set), marker_set)
    paired = mirror_columns(marker_set) >= 0
    np.testing.assert_array_equal(twice.points[:, paired], points[:, paired])
    assert not twice.valid[:, ~paired].any()


@pytest.mark.parametrize("person", ["right", "left"])
@pytest.mark.parametrize("actor", ["right", "left"])
def test_the_hands_that_come_nearest_are_found(person, actor):
    point = np.array([0.5, 0.1, 1.4])
    pair = (body(np.array([1.1, 0, 0]), -1.0, {person: point}), body(np.zeros(3), 1.0, {actor: point + 0.02}))
    hands = meeting_hands([pair], CENTRES, CENTRES)
    assert (hands.person, hands.actor, hands.fraction) == (person, actor, 1.0)
    assert hands.distance == pytest.approx(0.02 * np.sqrt(3))


def test_a_set_with_a_right_arm_alone_meets_with_it():
    points = np.zeros((1, len(PAPER), 3))
    person = make_recording(30.0, PAPER.names, points, np.ones((1, len(PAPER)), dtype=bool))
    actor = body(np.zeros(3), 1.0, {"left": np.zeros(3)})
    assert meeting_hands([(person, replace(actor))], PAPER, CENTRES).person == "right"
