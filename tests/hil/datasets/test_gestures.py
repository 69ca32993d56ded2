"""Recordings of a raised hand to which no contact comes: in the avatar's world as recorded, any other placed."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from highfive.hil.datasets.gestures import gesture_of, load_gestures
from highfive.hil.trials.distractors import JUDGE_SEED, Drawn, distractor_partner, judging_gestures
from highfive.mocap_bridge.files.c3d import read_c3d, write_c3d
from highfive.mocap_bridge.markers.recognise import find_marker_set
from highfive.model.geometry import rotations


def test_a_person_before_the_avatar_is_taken_as_she_was_recorded(tmp_path: Path) -> None:
    partner, _ = distractor_partner(Drawn("watch", "angry", (3, 1)))
    write_c3d(tmp_path / "a.c3d", partner.recording)
    (tmp_path / "broken.c3d").write_bytes(b"no recording")
    (tmp_path / "trials.csv").write_text("file,cell,split,contact\na.c3d,watch,test,\nbroken.c3d,,,\n")
    said: list[str] = []
    (found,) = load_gestures(tmp_path, say=said.append)
    assert (found.name, found.test, found.rate_hz) == ("watch", True, 120.0)
    assert len(said) == 1 and said[0].startswith("broken.c3d is left out")
    assert partner.palm is not None
    knuckles = found.hand_points[:, 1]
    assert np.linalg.norm(knuckles - partner.palm, axis=1).max() < 0.12


def test_whoever_stands_elsewhere_is_placed_before_the_avatar() -> None:
    partner, _ = distractor_partner(Drawn("point", "angry", (3, 2)))
    turn, recording = rotations.from_axis_angle("z", 2.0), partner.recording
    elsewhere = rotations.rotate(turn, recording.points) + np.array([7.0, -4.0, 0.0])
    moved = np.where(recording.valid[..., None], elsewhere, 0.0)
    found = gesture_of(replace(recording, points=moved), partner.marker_set)
    assert np.all(np.abs(found.hand_points.mean(axis=(0, 1))[:2]) < 1.5)


def test_who_judges_is_drawn_once_and_never_for_learning() -> None:
    judging = judging_gestures(2)
    assert len({drawn.seed for drawn in judging}) == len(judging) == 80
    assert all(drawn.seed[0] == JUDGE_SEED and drawn.body is not None for drawn in judging)


@pytest.mark.data
def test_a_recorded_walk_is_a_hand_without_a_contact(recordings: Path) -> None:
    walk = read_c3d(recordings / "markers" / "Movement_trial.c3d")
    found = gesture_of(walk, find_marker_set(walk.names))
    assert np.isfinite(found.hand_points).all() and len(found.hand_points) > 200
