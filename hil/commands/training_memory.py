"""What a training will take is said, or refused, before a marker is solved."""

from __future__ import annotations

from collections.abc import Sequence

from highfive.hil.runtime.console import say_aside
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.mocap_bridge.sources.source import RATE_HZ
from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.memory import available_bytes, points_of, training_bytes, trial_bytes
from highfive.model.hgpdm.presets import Preset

SAID_GB = 2.0
"""A training that takes more memory says so beforehand."""


def checked_memory(
    lengths: Sequence[float], preset: Preset, inducing: int, limit_gb: float | None = None, at_once: int = 1
) -> float:
    """GB that training will take at its peak; said where it is much.

    Args:
        lengths: of the trials, s.
        preset: of the training.
        inducing: inducing inputs of each layer.
        limit_gb: what it may take; None for what there is.
        at_once: trainings at the same time, each in a process of its own.

    Raises:
        HighFiveError: there is not that much.
    """
    joints = 3 * len(avatar_skeleton())
    shape = points_of(lengths, RATE_HZ, joints, preset)
    each = trial_bytes(lengths, RATE_HZ, joints) + training_bytes(shape, inducing, preset)
    needed, limit = 1e-9 * at_once * each, limit_gb or 1e-9 * available_bytes()
    times = f"{at_once} times " if at_once > 1 else ""
    if needed > SAID_GB:
        say_aside(f"{times}{shape.points} points will take about {needed:.1f} GB, of {limit:.1f}")
    if needed > limit:
        raise HighFiveError(
            f"{times}{shape.points} points need about {needed:.1f} GB, there are {limit:.1f}: give fewer --inducing, "
            f"{'fewer --jobs, ' if at_once > 1 else ''}less data, or another machine"
        )
    return needed
