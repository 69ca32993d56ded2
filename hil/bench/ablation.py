"""What each departure of the default preset from the paper changes on held-out trials: each is taken back alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.box import SIMPLE_HEAD
from rich.table import Table

from highfive.hil.datasets.training_data import load_trials
from highfive.hil.evaluation.cross_validation import body, scorable
from highfive.hil.evaluation.score_table import metric_named
from highfive.hil.evaluation.training_progress import training_bars
from highfive.hil.runtime.console import STDOUT
from highfive.hil.sim.avatar import avatar_arm, avatar_skeleton
from highfive.model.evaluation import scores as evaluation
from highfive.model.evaluation.predictions import online
from highfive.model.evaluation.splits import own_split
from highfive.model.hgpdm import training
from highfive.model.hgpdm.presets import DEFAULT, PAPER, Preset
from highfive.model.hgpdm.trained import HGPDM

if TYPE_CHECKING:
    from highfive.hil.runtime.console import Bar

SHOWN = (
    "joint_angle", "all_joints", "palm", "palm_at_contact", "palm_at_contact_median", "rms_jerk",
    "pose_within_90", "palm_within_90",
)  # fmt: skip
"""Metrics that a row has; see docs/evaluation.md."""


@dataclass(frozen=True)
class Departure:
    """A model without one departure.

    Attributes:
        name: what is taken back.
        preset: it is trained with.
        after: what is done to it after training.
    """

    name: str
    preset: Preset
    after: Callable[[HGPDM], HGPDM] = lambda model: model


def through_interaction(model: HGPDM) -> HGPDM:
    """The model with X¹ from I alone, not projected back from the hand."""
    dims, last = model.preset.interaction_dims, model.back[-1]
    cut = last._replace(
        weights=last.weights[:, :dims], offset=last.offset[:dims], noise=last.noise[:dims], scale=last.scale[:dims]
    )
    return replace(model, back=(*model.back[:-1], cut))


def departures() -> list[Departure]:
    """The default preset, it without each departure in turn, and the paper's."""
    like_paper = {
        "two-dimensional X¹ and X², three-dimensional I": ("avatar_dims", "human_dims", "interaction_dims"),
        "free latents, projections r and s fitted afterwards": ("back_constrained", "history"),
        "no history of the hand": ("history",),
        "unbounded noise of the upper layers": ("interaction_noise", "dynamics_noise", "human_noise", "avatar_noise"),
        "DTC without trace term": ("variational",),
        "one noise for all channels of the pose": ("channel_noise",),
        "dynamics with a mean of zero": ("velocity_decay",),
        "the hierarchy alone": ("pooled",),
    }
    rows = [Departure("default", DEFAULT), Departure("X¹ from I alone", DEFAULT, through_interaction)]
    for name, fields in like_paper.items():
        rows.append(Departure(name, replace(DEFAULT, **{field: getattr(PAPER, field) for field in fields})))
    return [*rows, Departure("paper", PAPER)]


def ablate(data: Path, inducing: int, seed: int, bar: Bar) -> dict[str, Any]:
    """Scores of each departure on the held-out trials of a data folder, answered online.

    Raises:
        HighFiveError: the folder cannot be read or learned from, or holds out nothing of an emotion that it teaches.
    """
    pairs = load_trials(data, progress=lambda total: bar("solving markers", total), hold_out=True)
    (fold,) = own_split([pair.trial for pair in pairs])
    (indices,) = scorable([fold])
    held_out = [fold.trials[index] for index in indices]
    rows: dict[str, dict[str, float]] = {}
    for row in departures():
        step = training_bars(bar, f"{row.name}, ")
        skeleton, chain = avatar_skeleton().hash, avatar_arm()
        model = training.train(fold.trials, row.preset, None, inducing, seed, skeleton, step, chain=chain)
        method = online(row.after(model), body())
        answers = [method(trial) for trial in held_out]
        scores = evaluation.score(held_out, answers, evaluation.held_out(held_out, answers, body()), body())
        rows[row.name] = {metric: scores[metric] for metric in SHOWN}
    return {"data": str(data), "held_out_trials": len(held_out), "inducing": inducing, "seed": seed, "rows": rows}


def print_ablation(result: dict[str, Any]) -> None:
    """The table for people."""
    metrics = [metric_named(name, "") for name in SHOWN]
    table = Table("model", *(metric.heading for metric in metrics), box=SIMPLE_HEAD)
    for name, scores in result["rows"].items():
        table.add_row(name, *(metric.show(scores[shown]) for metric, shown in zip(metrics, SHOWN, strict=True)))
    STDOUT.print(table)
