"""The simulated pair: palms that meet, feet that stand, limits that hold, emotions that differ."""

import numpy as np
import pytest

from highfive.hil.sim.avatar import right_palm
from highfive.hil.sim.limb_ik import solve_arm, solve_leg
from highfive.hil.sim.people.actors import PairTrial, simulate_pair
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.people.grid import CELLS, GRID_Y, GRID_Z
from highfive.hil.sim.people.role import RATE_HZ
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations


def palms(trial: PairTrial) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    motions = (trial.avatar, trial.person)
    return [right_palm(m.skeleton, *m.skeleton.forward_kinematics(m.root_in_world, m.quaternions)) for m in motions]


@pytest.fixture(scope="module")
def trials() -> dict[str, PairTrial]:
    return {e: simulate_pair(e, "B2", 0, np.random.default_rng(7)) for e in EMOTIONS}


@pytest.mark.parametrize("cell", ["A1", "A3", "B2", "C1", "C3"])
@pytest.mark.slow
def test_palms_meet_at_the_cell(cell: str) -> None:
    trial = simulate_pair("neutral", cell, 0, np.random.default_rng(11))
    (ours, normal, _), (theirs, facing, _) = palms(trial)
    k = trial.contact_frame
    assert np.linalg.norm(ours[k] - theirs[k]) < 1e-3
    assert normal[k] @ facing[k] < -np.cos(np.radians(1.0))
    row, column = divmod(CELLS.index(cell), 3)
    assert abs(ours[k, 1] - GRID_Y[column]) < 0.06
    assert abs(ours[k, 2] - GRID_Z[row]) < 0.06


def test_nobody_leaves_the_joint_limits_or_slides(trials: dict[str, PairTrial]) -> None:
    for trial in trials.values():
        for motion in (trial.avatar, trial.person):
            hinges = motion.skeleton.to_hinges(motion.quaternions)[:, 1:]
            np.testing.assert_allclose(np.delete(motion.skeleton.clamp(
                motion.skeleton.to_hinges(motion.quaternions)), 0, axis=1), hinges, atol=1e-7)  # fmt: skip
            positions, _ = motion.skeleton.forward_kinematics(motion.root_in_world, motion.quaternions)
            for side in ("right", "left"):
                assert np.ptp(positions[:, motion.skeleton.index(f"{side}_ankle")], axis=0).max() < 2e-3


def test_motion_is_smooth_and_both_return(trials: dict[str, PairTrial]) -> None:
    for trial in trials.values():
        for palm, _, _ in palms(trial):
            assert np.linalg.norm(np.diff(palm, n=2, axis=0), axis=-1).max() * RATE_HZ**2 < 400.0  # m/s²
            assert np.linalg.norm(palm[-1] - palm[0]) < 0.35


def test_speeds_are_ordered_as_the_emotions_are(trials: dict[str, PairTrial]) -> None:
    peak = {}
    for emotion, trial in trials.items():
        palm = palms(trial)[0][0][: trial.contact_frame]
        peak[emotion] = np.linalg.norm(np.diff(palm, axis=0), axis=-1).max() * RATE_HZ
    assert peak["sad"] < peak["neutral"] < peak["happy"] < peak["angry"]
    for emotion, speed in peak.items():
        assert speed == pytest.approx(EMOTIONS[emotion].peak_speed, rel=0.45)


def test_avatar_reacts_after_the_person(trials: dict[str, PairTrial]) -> None:
    for trial in trials.values():
        onsets = []
        for palm, _, _ in palms(trial):
            moved = np.linalg.norm(palm[: trial.contact_frame] - palm[0], axis=-1)
            onsets.append(int(np.argmax(moved > 0.10 * moved[-1])))
        assert onsets[0] > onsets[1]


@pytest.mark.slow
def test_a_seed_gives_the_same_trial_and_another_another() -> None:
    a, b, c = (simulate_pair("happy", "B3", 0, np.random.default_rng(s)) for s in (5, 5, 6))
    np.testing.assert_array_equal(a.avatar.quaternions, b.avatar.quaternions)
    assert a.contact_frame != c.contact_frame or not np.array_equal(a.avatar.root_in_world, c.avatar.root_in_world)


def test_unknown_emotion_and_cell_are_named() -> None:
    with pytest.raises(HighFiveError, match=r"bored.*neutral"):
        simulate_pair("bored", "B2", 0, np.random.default_rng(0))
    with pytest.raises(HighFiveError, match=r"D4.*A1"):
        simulate_pair("happy", "D4", 0, np.random.default_rng(0))


def test_arm_ik_is_exact_where_the_palm_is_within_reach(trials: dict[str, PairTrial]) -> None:
    skeleton = trials["neutral"].person.skeleton
    clavicle = (np.array([0.0, -0.03, 1.42]), rotations.from_rotation_vector([0.1, -0.05, 0.2]))
    rng = np.random.default_rng(0)
    for _ in range(50):
        palm = np.array([0.35, -0.1, 1.35]) + rng.uniform(-0.12, 0.12, 3)
        hand = rotations.normalize(rng.normal(size=4))
        normal, fingers = rotations.rotate(hand, [1.0, 0, 0]), rotations.rotate(hand, [0, 0, 1.0])
        angles = solve_arm(skeleton, clavicle, palm, normal, fingers, rng.uniform(0, 1))
        hinges = np.zeros((len(skeleton), 3))
        hinges[[skeleton.index(f"right_{n}") for n in ("shoulder", "elbow", "wrist")]] = angles
        quaternions = skeleton.from_hinges(hinges)
        # hang the arm on the clavicle that was requested
        chain = skeleton.index("right_clavicle")
        quaternions[chain] = clavicle[1]
        positions, orientations = skeleton.forward_kinematics(np.zeros(3), quaternions)
        got, facing, along = right_palm(skeleton, positions, orientations)
        np.testing.assert_allclose(got - positions[chain] + clavicle[0], palm, atol=1e-9)
        np.testing.assert_allclose(facing, normal, atol=1e-9)
        np.testing.assert_allclose(along, fingers, atol=1e-9)


def test_leg_ik_keeps_the_foot_flat_where_it_stands(trials: dict[str, PairTrial]) -> None:
    skeleton = trials["neutral"].avatar.skeleton
    pelvis = (np.array([0.03, 0.02, 0.90]), rotations.from_rotation_vector([0.05, 0.02, 0.3]))
    ankle = np.array([0.02, -0.11, 0.07])
    hinges = np.zeros((len(skeleton), 3))
    legs = [skeleton.index(f"right_{n}") for n in ("hip", "knee", "ankle")]
    hinges[legs] = solve_leg(skeleton, "right", pelvis, ankle)
    quaternions = skeleton.from_hinges(hinges)
    quaternions[0] = pelvis[1]
    positions, orientations = skeleton.forward_kinematics(pelvis[0], quaternions)
    np.testing.assert_allclose(positions[legs[2]], ankle, atol=1e-9)
    np.testing.assert_allclose(np.abs(orientations[legs[2]]), [1, 0, 0, 0], atol=1e-9)
