"""What the dynamics see and expect before anything is learned; for NumPy's arrays and JAX's alike."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeVar

from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.presets import Preset

if TYPE_CHECKING:
    import jax

Latent = TypeVar("Latent", Array, "jax.Array")

VELOCITY_UNIT = 0.1
"""s; latent velocities enter the dynamics' kernel as the change in this time, of the latents' own size."""


def dynamics_input(now: Latent, before: Latent, lag: float) -> Latent:
    """Inputs (..., 2 q) of the dynamics from two successive latents (..., q): where it is and how fast it moves.

    An invertible linear change of (i_{n−1}, i_{n−2}) whose lengthscales are not tied by their strong correlation.
    """
    xp = now.__array_namespace__()  # NumPy's arrays stay NumPy's: JAX would compile for one line
    return xp.concatenate([now, (now - before) * (VELOCITY_UNIT / lag)], axis=-1)


def dynamics_mean(now: Latent, before: Latent, lag: float, preset: Preset) -> Latent:
    """Mean of the next latent (..., q) before anything is learned.

    A velocity that dies away: unlike a zero mean it carries a lost hand on smoothly, and unlike a constant velocity it
    comes to rest.
    """
    if preset.velocity_decay == 0.0:
        return 0.0 * now
    return now + math.exp(-lag / preset.velocity_decay) * (now - before)
