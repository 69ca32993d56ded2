"""How much memory a training will take at its peak, said before it begins.

The likelihood goes through the points in blocks and keeps nothing of size M × N (model/gp/likelihood.py), so that
what grows with the points are their own arrays: features, channels, latents and the gradients by latents, and once, for
the start, two matrices of points × inducing inputs.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from highfive.model.hgpdm.dataset import AUXILIARY, HAND_DIMS, sample_rate
from highfive.model.hgpdm.presets import Preset

NUMBER = 8  # bytes of a float64
# Fitted to 50,000 and 200,000 points of 169 channels and 24 features, 200 inducing inputs (docs/performance.md).
PROGRAM = 1.15e9  # bytes of Python, JAX, its compiled code, and what does not grow
CHANNEL_COPIES = 4.0  # of points × channels: outputs, scaled, and at the start and the end of training
DIRECT_COPIES = 13.0  # of the same, for the direct answers: errors of each, of the pool and of the arm
START_COPIES = 1.5  # of points × inducing inputs, where the start's regression is made
FEATURE_COPIES = 4.0
TRIAL_POINTS = 24  # coordinates of a trial's frame beside the joints: hand, arm, root and both palms
LATENT_COPIES = 20.0  # of points × latents: values, inputs of four layers, gradients, what differentiation keeps


class Shape(NamedTuple):
    """Points N, channels D and features F of a training."""

    points: int
    channels: int
    features: int


def points_of(lengths: Sequence[float], rate_hz: float, joints: int, preset: Preset) -> Shape:
    """How many points a training will sample of trials of so many ``lengths``, s, to a few of each trial.

    Args:
        lengths: of those that are learned from.
        rate_hz: of the slowest of them.
        joints: channels of an actor's joints.
        preset: that of the training.
    """
    seconds = sum(lengths)
    points = round(seconds * sample_rate(seconds, rate_hz, preset)) + len(lengths)
    return Shape(points, joints + AUXILIARY, HAND_DIMS * (len(preset.history) + 1))


def training_bytes(shape: Shape, inducing: int, preset: Preset) -> float:
    """Bytes at the peak of a training, beside the trials themselves; right to some 30 % (docs/performance.md)."""
    latents = preset.avatar_dims + preset.human_dims + preset.interaction_dims
    channels = CHANNEL_COPIES + (DIRECT_COPIES if preset.pooled else 0.0)
    row = channels * shape.channels + START_COPIES * inducing
    row += FEATURE_COPIES * shape.features + LATENT_COPIES * latents
    return PROGRAM + NUMBER * shape.points * row


def trial_bytes(lengths: Sequence[float], rate_hz: float, joints: int) -> float:
    """Bytes of the trials themselves: an actor's ``joints``, and the other points of :class:`Trial`, of each frame."""
    return NUMBER * sum(lengths) * rate_hz * (joints + TRIAL_POINTS)


def available_bytes() -> float:
    """Bytes that this process may still take: what is free, and of a container what it may have at most."""
    free = float(os.sysconf("SC_PAGE_SIZE")) * float(os.sysconf("SC_PHYS_PAGES"))
    if (kernel := Path("/proc/meminfo")).is_file():
        line = next((line for line in kernel.read_text().splitlines() if line.startswith("MemAvailable:")), "")
        free = 1024.0 * float(line.split()[1]) if line else free
    limit = Path("/sys/fs/cgroup/memory.max")
    if limit.is_file() and (text := limit.read_text().strip()).isdecimal():
        free = min(free, float(text))
    return free
