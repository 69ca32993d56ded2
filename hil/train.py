"""Training from a folder of recordings to a model file."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hil.avatar import avatar_skeleton
from hil.training_data import SolvedPair, load_trials
from model import training
from model.errors import HighFiveError
from model.optimise import Progress
from model.presets import preset_named
from model.store import save_model


@dataclass(frozen=True)
class TrainOptions:
    """What to train on and how; see ``highfive train --help``."""

    data: Path
    out: Path
    preset: str
    inducing: int
    human: str
    avatar: str
    human_set: str | None
    avatar_set: str | None
    seed: int
    overwrite: bool


def train(options: TrainOptions, bar: Callable[[str, int], Callable[[], None]]) -> dict[str, Any]:
    """Solves the markers, trains, saves; returns the figures of the training.

    Raises:
        HighFiveError: the data cannot be read or learned from, or the model's file is there already.
    """
    if options.out.exists() and not options.overwrite:
        raise HighFiveError(f"{options.out} is there already; give another --out, or --overwrite")
    preset = preset_named(options.preset)
    start = time.monotonic()
    pairs = load_trials(
        options.data,
        options.human,
        options.avatar,
        options.human_set,
        options.avatar_set,
        lambda total: bar("solving markers", total),
    )
    trials = [pair.trial for pair in pairs]
    bars: dict[str, Callable[[], None]] = {}

    def step(progress: Progress) -> None:
        if progress.stage not in bars:
            bars[progress.stage] = bar(progress.stage, progress.iterations)
        bars[progress.stage]()

    model = training.train(
        trials,
        preset,
        inducing=options.inducing,
        seed=options.seed,
        skeleton_hash=avatar_skeleton().hash,
        progress=step,
        checkpoint=options.out.with_suffix(".checkpoint.npz"),
    )
    save_model(model, options.out)
    options.out.with_suffix(".checkpoint.npz").unlink(missing_ok=True)
    rms = _marker_rms(pairs)
    return {
        "model": str(options.out),
        "preset": preset.name,
        "trials": sum(not trial.test for trial in trials),
        "points": int(model.settings["points"]),
        "objective": float(model.settings["objective"]),
        "marker_rms_mm": {name: round(1e3 * value, 3) for name, value in rms.items()},
        "marker_rms_mm_all": round(1e3 * float(np.sqrt(np.mean(np.square(list(rms.values()))))), 3),
        "seed": options.seed,
        "seconds": round(time.monotonic() - start, 1),
    }


def _marker_rms(pairs: list[SolvedPair]) -> dict[str, float]:
    """Residual of each marker over all trials, m, the worst first."""
    mean_squares = np.mean([pair.rms**2 for pair in pairs], axis=0)
    named = dict(zip(pairs[0].markers, np.sqrt(mean_squares).tolist(), strict=True))
    return dict(sorted(named.items(), key=lambda item: -item[1]))
