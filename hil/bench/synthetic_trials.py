"""Made-up high fives of any number of frames and joints: what the speed of training is measured on."""

from __future__ import annotations

import numpy as np

from highfive.hil.sim.profiles import minimum_jerk
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.trials import Trial

RATE = 30.0  # frames per second
FRAMES = 53  # about, a trial
EMOTIONS = ("neutral", "happy", "angry", "sad")
LATENT = 14  # dimensions that the joints move in


def _wander(times: Array, size: int, amplitude: float, rng: np.random.Generator) -> Array:
    """Slow oscillations (T, size)."""
    return amplitude * np.sin(times[:, None] * rng.uniform(1.0, 4.0, size) + rng.uniform(0.0, 6.0, size))


def made_up_trials(points: int, channels: int, seed: int) -> list[Trial]:
    """Trials of ``points`` frames in all, with ``channels`` joint angles.

    A hand rises to a place of its own, and the joints follow along smooth functions of it that depend on the emotion.
    """
    rng = np.random.default_rng(seed)
    count = max(points // FRAMES, len(EMOTIONS))
    lengths = np.full(count, points // count) + (np.arange(count) < points % count)
    mix = 0.5 * rng.normal(size=(3, 8))
    fall = np.exp(-0.2 * np.arange(LATENT))[:, None]
    onto_joints = 0.3 * rng.normal(size=(LATENT, channels)) * fall
    styles = 1.0 + 0.3 * rng.normal(size=(len(EMOTIONS), 8))
    return [
        _trial(int(length), number % len(EMOTIONS), mix, styles, onto_joints, rng)
        for number, length in enumerate(lengths)
    ]


def _trial(frames: int, emotion: int, mix: Array, styles: Array, onto_joints: Array, rng: np.random.Generator) -> Trial:
    times, goal = np.arange(frames) / RATE, 0.15 * rng.normal(size=3)
    contact = min(rng.uniform(0.75, 1.1), times[-1])
    rise = minimum_jerk((times - contact + 0.6) / 0.6) - minimum_jerk((times - contact - 0.2) / 0.5)
    wrist = np.array([1.0, 0.2, 0.9]) + rise[:, None] * (np.array([-0.4, 0.0, 0.5]) + goal)
    wrist = wrist + _wander(times, 3, 0.01, rng)
    knuckles = wrist + rise[:, None] * np.array([0.0, 0.0, 0.08])
    course = 4.0 * rise[:, None] * goal + np.stack([rise, rise**2, 0.3 * np.sin(3.0 * times)], axis=1)
    latent = np.concatenate([np.tanh(course @ mix * styles[emotion]), _wander(times, LATENT - 8, 0.2, rng)], axis=1)
    palm = np.array([0.2, -0.3, 0.8]) + rise[:, None] * (np.array([0.4, 0.3, 0.5]) + goal)
    return Trial(
        rate_hz=RATE,
        hand_points=np.stack([wrist, knuckles], axis=1),
        joints=latent @ onto_joints,
        root=np.tile([0.0, 0.0, 0.93], (frames, 1)),
        palm=palm,
        person_palm=palm,
        contact_frame=int(contact * RATE),
        emotion=EMOTIONS[emotion],
        cell="",
        repetition=-1,
        test=False,
    )
