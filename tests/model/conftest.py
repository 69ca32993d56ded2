"""A small made-up pair of actors, and a small model trained on it once."""

from dataclasses import replace

import numpy as np
import pytest

from model.answers import Body
from model.hgpdm import HGPDM
from model.presets import DEFAULT
from model.skeleton import skeleton_from_table
from model.training import train
from model.trials import Trial

JOINTS = 9
EMOTIONS = ("neutral", "angry")
SMALL = replace(DEFAULT, avatar_dims=3, human_dims=2, interaction_dims=3, adam_steps=60, iterations=70, points=700)


def reach(progress: np.ndarray) -> np.ndarray:
    """Minimum-jerk rise from 0 to 1 (Flash & Hogan 1985)."""
    u = np.clip(progress, 0.0, 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


def made_up_trial(goal: float, emotion: str, rate_hz: float, rng: np.random.Generator, test: bool = False) -> Trial:
    """A hand that rises to a height and sinks, and joints that follow in one of two styles."""
    times = np.arange(0.0, 2.4, 1.0 / rate_hz)
    rise = reach((times - 0.4) / 0.8) - reach((times - 1.4) / 0.8)
    wrist = np.stack([1.0 - 0.4 * rise, 0.2 * np.sin(goal) * rise, 0.9 + goal * rise], axis=1)
    knuckles = wrist + np.array([-0.02, 0.0, 0.08]) * rise[:, None]
    mix = np.random.default_rng(0).normal(size=(3, JOINTS))
    style = {"neutral": 0.2, "angry": -0.5}[emotion]
    joints = np.tanh(np.stack([rise, goal * rise, style * (1.0 + rise)], axis=1) @ mix)
    palm = np.array([0.2, -0.3, 0.8]) + rise[:, None] * np.array([0.4, 0.3, goal])
    hands = np.stack([wrist, knuckles], axis=1) + rng.normal(size=(len(times), 2, 3)) * 1e-3
    root = np.tile([0.0, 0.0, 0.93], (len(times), 1))
    frame = int(1.3 * rate_hz)
    return Trial(rate_hz, hands, joints, root, palm, palm, frame, emotion, "", -1, test)


@pytest.fixture(scope="session")
def trials() -> list[Trial]:
    rng = np.random.default_rng(1)
    goals = np.linspace(0.3, 0.7, 5)
    train_trials = [made_up_trial(goal, emotion, 60.0, rng) for goal in goals for emotion in EMOTIONS]
    return train_trials + [made_up_trial(0.45, emotion, 60.0, rng, test=True) for emotion in EMOTIONS]


@pytest.fixture(scope="session")
def model(trials: list[Trial]) -> HGPDM:
    return train(trials, SMALL, inducing=40, skeleton_hash="0123456789abcdef")


@pytest.fixture(scope="session")
def body() -> Body:
    """Three joints in a row, the last of them the wrist."""
    table = [("hips", None, (0.0, 0.0, 0.9)), ("shoulder", "hips", (0.0, 0.0, 1.4)),
             ("right_wrist", "shoulder", (0.0, 0.0, 0.9))]  # fmt: skip
    hinges = {name: ("xyz", [(-180.0, 180.0)] * 3) for name, _, _ in table}
    return Body(skeleton_from_table(table, hinges, {}), np.array([0.0, 0.0, -0.1]))
