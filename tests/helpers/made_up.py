"""A small made-up pair of actors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from highfive.model.hgpdm.presets import DEFAULT
from highfive.model.hgpdm.trials import Trial

JOINTS = 9
EMOTIONS = ("neutral", "angry")
SMALL = replace(DEFAULT, avatar_dims=3, human_dims=2, interaction_dims=3, adam_steps=60, iterations=70, points=700)


def reach(progress: np.ndarray) -> np.ndarray:
    """Minimum-jerk rise from 0 to 1 (Flash & Hogan 1985)."""
    u = np.clip(progress, 0.0, 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


def with_arm(trial: Trial) -> Trial:
    """The same with elbow, shoulder and head: she stands, and her elbow is half way up to her hand."""
    shoulder, head = np.array([1.1, 0.2, 1.4]), np.array([1.1, 0.0, 1.65])
    elbow = 0.5 * (trial.hand_points[:, 0] + shoulder) - [0.0, 0.0, 0.1]
    points = np.stack([elbow, *(np.broadcast_to(one, elbow.shape) for one in (shoulder, head))], axis=1)
    return replace(trial, arm_points=points)


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
