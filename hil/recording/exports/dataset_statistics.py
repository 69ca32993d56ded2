"""What a lerobot dataset says of each feature's numbers: by episode, and of all of them.

As lerobot computes them (``lerobot.datasets.compute_stats``): quantiles of several episodes are the mean of theirs,
weighed by frames; all else is that of all frames.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from highfive.model.geometry.rotations import Array

QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}

Statistics = Mapping[str, Array]
"""``min``, ``max``, ``mean``, ``std`` and quantiles, each (D,); and ``count`` (1,)."""


def of_episode(values: Array) -> Statistics:
    """Of values (T, D)."""
    return {
        "min": values.min(axis=0),
        "max": values.max(axis=0),
        "mean": values.mean(axis=0),
        "std": values.std(axis=0),
        "count": np.array([len(values)]),
        **{name: np.quantile(values, share, axis=0) for name, share in QUANTILES.items()},
    }


def of_all(episodes: Sequence[Statistics]) -> Statistics:
    """Of all frames of some episodes."""
    counts = np.array([episode["count"][0] for episode in episodes], dtype=float)[:, None]
    each = {name: np.stack([episode[name] for episode in episodes]) for name in episodes[0]}
    weights = counts / counts.sum()
    mean = (weights * each["mean"]).sum(axis=0)
    variance = (weights * (each["std"] ** 2 + (each["mean"] - mean) ** 2)).sum(axis=0)
    return {
        "min": each["min"].min(axis=0),
        "max": each["max"].max(axis=0),
        "mean": mean,
        "std": np.sqrt(variance),
        "count": each["count"].sum(axis=0),
        **{name: (weights * each[name]).sum(axis=0) for name in QUANTILES},
    }
