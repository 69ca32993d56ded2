from dataclasses import replace

import numpy as np
import pytest

from highfive.calibration.subject import SubjectSettings, fit_subject, same_bodies
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.mocap_bridge.body.body_solver import solve_body
from highfive.mocap_bridge.files.c3d import read_c3d
from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.markers.marker_set import segment_lengths
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.model.errors import HighFiveError

SKELETON = avatar_skeleton()
FACTORS = {"elbow": 1.08, "wrist": 0.94, "knee": 1.05, "ankle": 0.97, "neck": 1.04}


def person():
    """A body of other size and proportions."""
    sides = {f"{side}_{joint}": 1.05 * f for joint, f in FACTORS.items() for side in ("left", "right")}
    trunk = {joint: 1.05 * 1.04 for joint in ("lumbar_5", "lumbar_3", "thoracic_12", "thoracic_8", "neck")}
    return SKELETON.scaled({name: 1.05 for name in SKELETON.names} | sides | trunk)


def lively(body, marker_set, frames=40, noise=0.0):
    rng = np.random.default_rng(3)
    time = np.arange(frames)[:, None, None] * 0.1
    low, high = SKELETON.hinge_limits[..., 0], SKELETON.hinge_limits[..., 1]
    wave = np.sin(rng.uniform(0, 2 * np.pi, low.shape) + rng.uniform(0.5, 2.0, low.shape) * time)
    angles = 0.5 * (low + high) + 0.35 * (high - low) * wave
    angles[:, 0] = [0.3, 0.1, 0.0]
    root = np.tile([0.1, 0.2, 0.95], (frames, 1))
    points = marker_set.simulate(body, *body.forward_kinematics(root, body.from_hinges(angles)))
    return points + rng.normal(scale=noise, size=points.shape)


def test_the_size_of_a_simulated_person_is_found():
    full, body = load_marker_set("full_body"), person()
    points = lively(body, full, noise=0.001)
    subject = fit_subject(SKELETON, full, points, np.ones(points.shape[:2], dtype=bool), SubjectSettings(frames=20))
    for joint, factor in FACTORS.items():
        measure = "trunk" if joint == "neck" else joint
        assert subject.scales[measure] == pytest.approx(1.05 * factor, rel=0.015)
    assert np.sqrt((subject.rms**2).mean()) < 0.002
    moved = np.linalg.norm(subject.marker_set.local_positions - full.local_positions, axis=1)
    assert np.median(moved) < 0.004


@pytest.mark.slow
def test_lengths_are_as_sure_as_they_say():
    """On people of other proportions with markers worn elsewhere; a still pose shows less than movement."""
    full, rng, away = load_marker_set("plug_in_gait_upper"), np.random.default_rng(8), []
    still = moving = fit_subject(SKELETON, full, lively(SKELETON, full)[:1], np.ones((1, len(full)), dtype=bool))
    for _ in range(4):
        moved = rng.normal(scale=full.spreads[:, None], size=(len(full), 3))
        worn = replace(full, local_positions=full.local_positions + moved)
        body = SKELETON.scaled(dict(zip(SKELETON.names, proportions(rng), strict=True)))
        points = lively(body, worn, noise=0.001)
        moving = fit_subject(SKELETON, full, points, np.ones(points.shape[:2], dtype=bool), SubjectSettings(frames=10))
        lengths = segment_lengths(body), segment_lengths(moving.skeleton)
        for joint, sigma in moving.length_sigmas.items():
            true, found = (each[SKELETON.index(joint)] for each in lengths)
            away.append((found - true) / sigma)
    assert 0.3 < np.sqrt(np.mean(np.square(away))) < 1.3
    for joint in ("right_shoulder", "right_elbow"):
        assert still.length_sigmas[joint] > 1.2 * moving.length_sigmas[joint]


def proportions(rng):
    """A factor for each joint's offset, the same left and right; the trunk has one."""
    trunk = {"lumbar_5", "lumbar_3", "thoracic_12", "thoracic_8", "neck"}
    plain = [name.removeprefix("left_").removeprefix("right_") for name in SKELETON.names]
    measures = ["trunk" if name in trunk else name for name in plain]
    factors = {measure: rng.normal(1.0, 0.05) for measure in dict.fromkeys(measures)}
    return [factors[measure] for measure in measures]


def test_left_and_right_are_alike_and_the_reference_body_is_left_alone():
    full = load_marker_set("full_body")
    points = lively(SKELETON, full)
    subject = fit_subject(SKELETON, full, points, np.ones(points.shape[:2], dtype=bool), SubjectSettings(frames=12))
    assert all(scale == pytest.approx(1.0, abs=0.01) for scale in subject.scales.values())
    for side, other in (("left_elbow", "right_elbow"), ("left_knee", "right_knee")):
        lengths = [np.linalg.norm(subject.skeleton.offsets[SKELETON.index(joint)]) for joint in (side, other)]
        assert lengths[0] == pytest.approx(lengths[1], rel=1e-12)


def test_a_recording_without_markers_is_refused():
    full = load_marker_set("full_body")
    with pytest.raises(HighFiveError, match="cannot be fitted"):
        fit_subject(SKELETON, full, np.zeros((5, len(full), 3)), np.zeros((5, len(full)), dtype=bool))


@pytest.mark.data
@pytest.mark.parametrize("who", ["A", "B"])
@pytest.mark.slow
def test_real_people_are_fitted_to_millimetres(recordings, who):
    recording = read_c3d(recordings / "high_five" / "cmu_20_21_11_high_five.c3d").person(who)
    centres = load_marker_set("cmu_joint_centres")
    points, valid = centres.arrange(recording.names, recording.points, recording.valid)
    subject = fit_subject(SKELETON, centres, points, valid, SubjectSettings(frames=20))
    before = solve_body(SKELETON, centres, points, valid)
    after = solve_body(subject.skeleton, subject.marker_set, points, valid)
    assert np.sqrt((after.residuals**2).mean()) < 0.003
    assert np.sqrt((after.residuals**2).mean()) < 0.3 * np.sqrt((before.residuals**2).mean())
    step = np.abs(np.diff(SKELETON.to_hinges(after.quaternions)[:, 1:], axis=0)).max()
    assert np.degrees(step) < 25.0  # between frames at 120 Hz: no joint jumps


def test_people_are_distinguished_by_their_limbs():
    centres = load_marker_set("joint_centres")

    def recording(body, seed):
        points = lively(body, centres, noise=0.004)
        points += np.random.default_rng(seed).normal(scale=0.002, size=points.shape)
        return make_recording(30.0, centres.names, points, np.ones(points.shape[:2], dtype=bool))

    bodies = [SKELETON, person(), SKELETON.scaled(0.93)]
    recordings = [recording(bodies[n % 3], n) for n in range(9)]
    assert same_bodies(recordings, centres) == [[0, 3, 6], [1, 4, 7], [2, 5, 8]]
    # Markers on the skin do not tell the length of a limb: they count as one person's.
    full = load_marker_set("full_body")
    points = lively(person(), full)
    skin = make_recording(30.0, full.names, points, np.ones(points.shape[:2], dtype=bool))
    assert same_bodies([skin, skin], full) == [[0, 1]]
