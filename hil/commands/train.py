"""Training from a folder of recordings to a model file."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from highfive.hil.datasets.training_data import SolvedPair, load_trials
from highfive.hil.evaluation.training_progress import training_bars
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.runtime.console import Bar, counted, say_aside
from highfive.hil.runtime.folders import check_file
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.model.errors import HighFiveError
from highfive.model.gp.optimise import fall_at_the_end
from highfive.model.hgpdm import training
from highfive.model.hgpdm.checkpoint import is_checkpoint
from highfive.model.hgpdm.presets import preset_named
from highfive.model.hgpdm.store import save_model

FEW = 10
"""With fewer trials a model is made, but there is a warning."""

CONVERGED = 1e-3
"""An objective that falls by no more, relatively, over the last tenth of the steps has converged."""


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
    restarts: int = 1
    iterations: int | None = None
    whole_arm: bool = False

    @property
    def checkpoint(self) -> Path:
        """Where an unfinished training is kept."""
        return self.out.with_name(f"{self.out.name.removesuffix('.safetensors')}.checkpoint.npz")


def train(options: TrainOptions, bar: Bar, clock: Clock = MACHINE) -> dict[str, Any]:
    """Solves the markers, trains, saves; returns the figures of the training.

    Raises:
        HighFiveError: the data cannot be read or learned from, the model's file is there already or cannot be written,
            or somebody else's file has the name of its checkpoint.
    """
    check_file(options.out, options.overwrite)
    _check_checkpoint(options)
    preset = preset_named(options.preset)
    if options.iterations is not None:
        preset = preset.with_iterations(options.iterations)
    start = clock.now()
    pairs = load_trials(
        options.data,
        options.human,
        options.avatar,
        options.human_set,
        options.avatar_set,
        lambda total: bar("solving markers", total),
        learn_only=True,
    )
    if len(pairs) < FEW:
        advice = "places and people that are not among them will be answered poorly"
        say_aside(f"{counted(len(pairs), 'trial')} to learn from: {advice}")
    solved = clock.now()
    model = training.train(
        [pair.trial for pair in pairs],
        preset,
        inducing=options.inducing,
        seed=options.seed,
        skeleton_hash=avatar_skeleton().hash,
        progress=training_bars(bar),
        checkpoint=options.checkpoint,
        restarts=options.restarts,
        say=say_aside,
        whole_arm=options.whole_arm,
    )
    try:
        save_model(model, options.out, replace=options.overwrite)
    except HighFiveError as error:
        kept = f"; make room, and the same command goes on from {options.checkpoint}"
        raise HighFiveError(f"{error}{kept if options.checkpoint.exists() else ''}") from None
    options.checkpoint.unlink(missing_ok=True)
    rms = _marker_rms(pairs)
    fall = fall_at_the_end(model.learning_curve.tolist())
    return {
        "model": str(options.out),
        "preset": preset.name,
        "trials": len(pairs),
        "points": model.settings["points"],
        "inducing": model.settings["inducing"],
        "objective": model.settings["objective"],
        "steps": model.settings["iterations"],
        "fall_at_the_end": fall,
        "converged": fall <= CONVERGED,
        "starts": model.settings["starts"],
        "marker_rms_mm": {name: round(1e3 * value, 3) for name, value in rms.items()},
        "marker_rms_mm_all": round(1e3 * float(np.sqrt(np.mean(np.square(list(rms.values()))))), 3),
        "seed": model.settings["seed"],
        "solving_seconds": round(1e-9 * (solved - start), 1),
        "seconds": round(1e-9 * (clock.now() - start), 1),
    }


def summary(result: dict[str, Any]) -> list[str]:
    """The figures of a training for people."""
    worst = ", ".join(f"{name} {rms:.1f}" for name, rms in list(result["marker_rms_mm"].items())[:3])
    fall = f"it fell by {100.0 * result['fall_at_the_end']:.2f} % over the last tenth of {result['steps']} steps"
    more = f"--iterations {2 * result['steps']} lowers it further; evaluate says whether new trials gain"
    advice = "" if result["converged"] else f"; it has not settled: {more}"
    lines = [
        f"{result['model']}: {counted(result['trials'], 'trial')}, {result['points']} points, "
        f"{result['seconds']:.0f} s; markers met to {result['marker_rms_mm_all']:.1f} mm (worst: {worst})",
        f"objective {result['objective']:.3f}; {fall}{advice}",
    ]
    if len(result["starts"]) > 1:
        each = [f"seed {s['seed']} {s['failure'] or format(s['objective'], '.3f')}" for s in result["starts"]]
        lines.append(f"kept seed {result['seed']} of: {', '.join(each)}")
    return lines


def after_interruption(options: TrainOptions) -> str:
    """What is said behind "interrupted"."""
    if is_checkpoint(options.checkpoint):
        return f"; the same command goes on from {options.checkpoint}"
    return " before a first checkpoint; the same command begins again"


def _check_checkpoint(options: TrainOptions) -> None:
    """A file of the checkpoint's name that is none is not moved away unasked."""
    path = options.checkpoint
    if path.is_dir():
        raise HighFiveError(f"{path} is a folder, and the training's checkpoint takes that name; give another --out")
    if os.path.lexists(path) and not (options.overwrite or is_checkpoint(path)):
        raise HighFiveError(
            f"{path} is there already and is no training's checkpoint; give another --out, or --overwrite, which keeps "
            f"it as {path.name}.old"
        )


def _marker_rms(pairs: list[SolvedPair]) -> dict[str, float]:
    """Residual of each marker over all trials, m, the worst first."""
    mean_squares = np.mean([pair.rms**2 for pair in pairs], axis=0)
    named = dict(zip(pairs[0].markers, np.sqrt(mean_squares).tolist(), strict=True))
    return dict(sorted(named.items(), key=lambda item: -item[1]))
