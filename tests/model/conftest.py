"""A small made-up data set, and a small model trained on it once."""

from pathlib import Path

import numpy as np
import pytest
from kept import kept
from made_up import EMOTIONS, SMALL, made_up_trial
from same_model import assert_same_model

from highfive.model.evaluation.predictions import Body
from highfive.model.geometry.skeleton import skeleton_from_table
from highfive.model.hgpdm.store import load_model, save_model
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.training import train
from highfive.model.hgpdm.trials import Trial


@pytest.fixture(scope="session")
def trials() -> list[Trial]:
    rng = np.random.default_rng(1)
    goals = np.linspace(0.3, 0.7, 5)
    train_trials = [made_up_trial(goal, emotion, 60.0, rng) for goal in goals for emotion in EMOTIONS]
    return train_trials + [made_up_trial(0.45, emotion, 60.0, rng, test=True) for emotion in EMOTIONS]


@pytest.fixture(scope="session")
def model(trials: list[Trial]) -> HGPDM:
    """As it is read from the file that it is written to."""

    def make(folder: Path) -> None:
        trained = train(trials, SMALL, inducing=40, skeleton_hash="0123456789abcdef")
        save_model(trained, folder / "model.safetensors")
        assert_same_model(load_model(folder / "model.safetensors"), trained)

    return load_model(kept("small-model", make) / "model.safetensors")


@pytest.fixture(scope="session")
def body() -> Body:
    """Three joints, the last of them the wrist; the second does not carry it."""
    table = [("hips", None, (0.0, 0.0, 0.9)), ("head", "hips", (0.0, 0.0, 1.6)),
             ("right_wrist", "hips", (0.0, -0.2, 0.9))]  # fmt: skip
    hinges = {name: ("xyz", [(-180.0, 180.0)] * 3) for name, _, _ in table}
    return Body(skeleton_from_table(table, hinges, {}), np.array([0.0, 0.0, -0.1]))
