"""How much memory a training is said to take."""

from dataclasses import fields

import numpy as np
from made_up import EMOTIONS, SMALL, made_up_trial, with_arm

from highfive.model.hgpdm.dataset import training_set
from highfive.model.hgpdm.memory import Shape, available_bytes, points_of, training_bytes, trial_bytes
from highfive.model.hgpdm.presets import DEFAULT


def test_the_points_are_those_that_training_samples() -> None:
    rng = np.random.default_rng(0)
    trials = [made_up_trial(goal, e, 60.0, rng, test=goal > 0.6) for goal in (0.3, 0.5, 0.7) for e in EMOTIONS]
    for preset in (SMALL, DEFAULT):
        lengths = [len(trial.joints) / 60.0 for trial in trials if not trial.test]
        found, data = points_of(lengths, 60.0, trials[0].joints.shape[1], preset), training_set(trials, preset)
        assert abs(found.points - len(data.trial)) <= len(trials)
        assert found.channels == data.outputs.shape[1]


def test_twice_the_points_take_at_most_twice_the_memory_and_four_gb_hold_fifty_thousand() -> None:
    sizes = [training_bytes(Shape(n, 169, 24), 200, DEFAULT) for n in (5_600, 50_000, 100_000, 200_000)]
    assert sizes == sorted(sizes) and sizes[2] < 2.0 * sizes[1]
    assert sizes[1] < 4e9 and sizes[3] < 32e9


def test_what_is_there_is_a_machine_and_a_trial_takes_what_its_arrays_do() -> None:
    assert 1e8 < available_bytes() < 1e14
    trial = with_arm(made_up_trial(0.5, EMOTIONS[0], 60.0, np.random.default_rng(0)))
    arrays = [value for field in fields(trial) if isinstance(value := getattr(trial, field.name), np.ndarray)]
    lengths, joints = [len(trial.joints) / 60.0], trial.joints.shape[1]
    assert trial_bytes(lengths, 60.0, joints) == sum(value.nbytes for value in arrays)
