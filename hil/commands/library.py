"""``train`` and ``evaluate`` for programs: a data folder in, a value out, nothing printed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from highfive.hil.commands.evaluate import EvaluateOptions
from highfive.hil.commands.evaluate import evaluate as _evaluate
from highfive.hil.commands.train import gestures_beside
from highfive.hil.commands.training_memory import checked_memory
from highfive.hil.datasets.training_data import load_trials
from highfive.hil.sim.avatar import avatar_arm, avatar_skeleton
from highfive.model.hgpdm import training
from highfive.model.hgpdm.presets import preset_named
from highfive.model.hgpdm.trained import HGPDM


def train(
    data: Path | str,
    *,
    preset: str = "default",
    inducing: int = 200,
    seed: int = 0,
    iterations: int | None = None,
    human: str = "human",
    avatar: str = "avatar",
    human_set: str | None = None,
    avatar_set: str | None = None,
    distractors: bool = True,
) -> HGPDM:
    """Learns a model from the training trials of a folder; :func:`highfive.save_model` keeps it.

    Args:
        data: folder of C3D files with a ``trials.csv`` (docs/data.md).
        preset: ``default`` or ``paper``.
        inducing: inducing inputs of each layer.
        seed: of the choice of inducing inputs.
        iterations: steps of the optimiser; None takes the preset's.
        human, avatar: prefixes of the two people's markers.
        human_set, avatar_set: their marker sets; None finds those that fit.
        distractors: simulates waves, stretches and the like, by which the model learns that no contact is coming,
            beside the folder's own trials without a contact.

    Raises:
        HighFiveError: the data cannot be read or learned from.
    """
    chosen = preset_named(preset)
    if iterations is not None:
        chosen = chosen.with_iterations(iterations)

    def check(lengths: list[float]) -> None:
        checked_memory(lengths, chosen, inducing)

    pairs = load_trials(Path(data), human, avatar, human_set, avatar_set, learn_only=True, lengths=check)
    simulating = _untold if distractors else None
    return training.train(
        [pair.trial for pair in pairs],
        chosen,
        inducing=inducing,
        seed=seed,
        skeleton_hash=avatar_skeleton().hash,
        chain=avatar_arm(),
        gestures=gestures_beside(Path(data), len(pairs), seed, human, human_set, simulating),
    )


def _untold(_: int) -> Callable[[], None]:
    return lambda: None


def evaluate(
    data: Path | str,
    model: Path | str | None = None,
    *,
    also: Sequence[str] = (),
    leave_out: str | None = None,
    preset: str = "default",
    inducing: int = 200,
    seeds: int = 1,
    gestures: bool = True,
    out: Path | str | None = None,
) -> dict[str, Any]:
    """Scores of a model beside plain regressions on the held-out trials of a folder.

    Args:
        data: folder of C3D files with a ``trials.csv``.
        model: a model file; None trains one.
        also: models of your own beside them, each ``file.py:function`` or the name of a plug-in.
        leave_out: ``repetition`` or ``cell``: each is held out in turn, whatever the table's split.
        preset, inducing: of the model that is trained.
        seeds: trainings; the scores are medians.
        gestures: counts the model's false starts, too: simulated gestures, some minutes of computing.
        out: folder for a report with figures; None writes nothing.

    Returns:
        ``scores``: method → metric → value in SI units, and what ``highfive evaluate --json`` says beside them.

    Raises:
        HighFiveError: nothing to score, broken files, or a model that fails.
    """
    options = EvaluateOptions(
        data=Path(data),
        model=None if model is None else Path(model),
        preset=preset,
        inducing=inducing,
        seeds=seeds,
        leave_out=leave_out,
        out=None if out is None else Path(out),
        also=tuple(also),
        gestures=gestures,
    )
    return _evaluate(options, lambda label, total: _no_progress)


def _no_progress(note: str = "", done: int | None = None) -> None:
    """A program is not shown how far it is."""
