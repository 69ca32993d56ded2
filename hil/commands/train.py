"""Training from a folder of recordings to a model file."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from highfive.hil.commands.training_memory import checked_memory
from highfive.hil.datasets.gestures import load_gestures
from highfive.hil.datasets.training_data import SolvedPair, load_trials
from highfive.hil.evaluation.curves import further_trials
from highfive.hil.evaluation.training_progress import training_bars
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.runtime.console import Bar, counted, say_aside
from highfive.hil.runtime.folders import check_file
from highfive.hil.sim.avatar import avatar_arm, avatar_skeleton
from highfive.hil.trials.distractors import drawn_gestures
from highfive.model.errors import HighFiveError
from highfive.model.evaluation.learning_curve import gains, proxy_curve
from highfive.model.files import DEFAULT_MODEL
from highfive.model.gp.optimise import fall_at_the_end
from highfive.model.hgpdm import training
from highfive.model.hgpdm.adaptation import adapt
from highfive.model.hgpdm.arm_features import have_arms
from highfive.model.hgpdm.checkpoint import is_checkpoint
from highfive.model.hgpdm.presets import preset_named
from highfive.model.hgpdm.sharding import host_count, host_number, join_hosts
from highfive.model.hgpdm.store import load_model, save_model
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Gesture

SHIPPED = "default"
"""The name of the shipped model, where a model's file could stand."""

FEW = 10
"""With fewer trials a model is made, but there is a warning."""

TRIALS_A_ROUND, MOST_ROUNDS = 27, 4
"""For so many trials each gesture that is no high five is simulated once in each emotion, up to so many times."""
TOLD_M = 5e-4
"""m; where further trials are foretold to bring less, in every draw, nothing is foretold."""

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
    whole_arm: bool | None = None
    distractors: bool = True
    start: str | None = None
    hosts: tuple[str, ...] = ()
    process: int | None = None
    memory_gb: float | None = None

    @property
    def checkpoint(self) -> Path:
        """Where an unfinished training is kept."""
        return self.out.with_name(f"{self.out.name.removesuffix('.safetensors')}.checkpoint.npz")


def gestures_beside(
    data: Path,
    trials: int,
    seed: int,
    human: str,
    human_set: str | None,
    simulating: Callable[[int], Callable[[], None]] | None,
) -> list[Gesture]:
    """Raised hands to which no contact comes, for a training: those of the folder, and simulated ones.

    Args:
        data: the folder.
        trials: how many there are to learn from; of more, more gestures are simulated.
        seed: of the simulated ones.
        human, human_set: the person's prefix and marker set.
        simulating: progress of the simulated ones; None for none of these.

    Raises:
        HighFiveError: the table cannot be used.
    """
    found = load_gestures(data, human, human_set)
    if simulating is not None:
        found += drawn_gestures(min(1 + (trials - 1) // TRIALS_A_ROUND, MOST_ROUNDS), seed, simulating)
    return found


def train(options: TrainOptions, bar: Bar, clock: Clock = MACHINE) -> dict[str, Any]:
    """Solves the markers, trains, saves; returns the figures of the training.

    Raises:
        HighFiveError: the data cannot be read or learned from, the model's file is there already or cannot be written,
            or somebody else's file has the name of its checkpoint.
    """
    if options.process is not None and not options.hosts:
        raise HighFiveError(f"--process-id {options.process} says which of --hosts this is; give these, too")
    if options.hosts and options.start is not None:
        raise HighFiveError("--from takes seconds on one host; leave --hosts out")
    if options.hosts and (own := join_hosts(options.hosts, options.process)) > 0:
        # Every host computes the same model, and the first one writes it; a checkpoint each, on a shared disk, too.
        options = replace(options, out=options.out.with_name(f"{options.out.stem}.host{own}.safetensors"))
    check_file(options.out, options.overwrite)
    if options.start is not None:
        return _adapt(options, bar, clock)
    _check_checkpoint(options)
    preset = preset_named(options.preset)
    if options.iterations is not None:
        preset = preset.with_iterations(options.iterations)
    start = clock.now()
    needed: list[float] = []
    memory_of = partial(checked_memory, preset=preset, inducing=options.inducing, limit_gb=options.memory_gb)
    pairs = _solved(options, bar, lambda lengths: needed.append(memory_of(lengths)))
    if len(pairs) < FEW:
        advice = f"--from {SHIPPED} adapts the shipped model to them, evaluate --learning-curve says what is better"
        say_aside(f"{counted(len(pairs), 'trial')} to learn from, {advice}")
    rounds = partial(bar, "simulating distractors") if options.distractors else None
    gestures = gestures_beside(options.data, len(pairs), options.seed, options.human, options.human_set, rounds)
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
        chain=avatar_arm(),
        gestures=gestures,
    )
    try:
        if host_number() == 0:
            save_model(model, options.out, replace=options.overwrite)
    except HighFiveError as error:
        kept = f"; make room, and the same command goes on from {options.checkpoint}"
        raise HighFiveError(f"{error}{kept if options.checkpoint.exists() else ''}") from None
    options.checkpoint.unlink(missing_ok=True)
    rms = _marker_rms(pairs)
    fall = fall_at_the_end(model.learning_curve.tolist())
    return {
        "model": str(options.out) if host_number() == 0 else None,
        "preset": preset.name,
        "trials": len(pairs),
        "without_contact": sum(not gesture.test for gesture in gestures),
        "whole_arm": model.arm_contact is not None,
        "pose_by_arm": _pose_by_arm(model),
        "points": model.settings["points"],
        "memory_gb": round(needed[0], 2),
        "hosts": host_count(),
        "inducing": model.settings["inducing"],
        "objective": model.settings["objective"],
        "steps": model.settings["iterations"],
        "fall_at_the_end": fall,
        "converged": fall <= CONVERGED,
        "starts": model.settings["starts"],
        "marker_rms_mm": {name: round(1e3 * value, 3) for name, value in rms.items()},
        "marker_rms_mm_all": round(1e3 * float(np.sqrt(np.mean(np.square(list(rms.values()))))), 3),
        "more_trials": _more_trials(pairs, options.seed),
        "seed": model.settings["seed"],
        "solving_seconds": round(1e-9 * (solved - start), 1),
        "seconds": round(1e-9 * (clock.now() - start), 1),
    }


def _pose_by_arm(model: HGPDM) -> float:
    """Share of the whole arm in what is said of the pose, 0 to 1."""
    return 0.0 if model.ensemble is None or model.ensemble.arm is None else float(model.ensemble.arm.share)


def _solved(
    options: TrainOptions, bar: Bar, lengths: Callable[[list[float]], None] = lambda seconds: None
) -> list[SolvedPair]:
    return load_trials(
        options.data,
        options.human,
        options.avatar,
        options.human_set,
        options.avatar_set,
        lambda total: bar("solving markers", total),
        learn_only=True,
        lengths=lengths,
    )


def model_file(given: Path) -> Path:
    """A model's file; the shipped one's where :data:`SHIPPED` is given, and nothing here has that name."""
    return DEFAULT_MODEL if str(given) == SHIPPED and not given.exists() else given


def model_to_adapt(start: str) -> HGPDM:
    """The model of a file, or the shipped one; see :func:`model_file`.

    Raises:
        HighFiveError: there is none, or it is of another skeleton.
    """
    return load_model(model_file(Path(start)), avatar_skeleton().hash)


def _adapt(options: TrainOptions, bar: Bar, clock: Clock) -> dict[str, Any]:
    """Adapts a trained model; see :func:`train`."""
    assert options.start is not None
    if options.whole_arm is not None or options.restarts > 1 or options.iterations is not None:
        raise HighFiveError(
            "--from adapts in closed form: leave --whole-arm, --hand-alone, --restarts and --iterations out"
        )
    begun, before = clock.now(), model_to_adapt(options.start)
    pairs = _solved(options, bar)
    trials = [pair.trial for pair in pairs]
    if before.arm_contact is not None and not have_arms([trial for trial in trials if not trial.test]):
        say_aside("elbow, shoulder and head are known in too few trials: the adapted model looks at the hand alone")
    model, moved = adapt(before, trials, options.seed)
    save_model(model, options.out, replace=options.overwrite)
    rms = _marker_rms(pairs)
    return {
        "model": str(options.out),
        "from": options.start,
        "trials": len(pairs),
        "adaptation": asdict(moved),
        "marker_rms_mm": {name: round(1e3 * value, 3) for name, value in rms.items()},
        "marker_rms_mm_all": round(1e3 * float(np.sqrt(np.mean(np.square(list(rms.values()))))), 3),
        "more_trials": _more_trials(pairs, options.seed),
        "seed": options.seed,
        "seconds": round(1e-9 * (clock.now() - begun), 1),
    }


def _more_trials(pairs: Sequence[SolvedPair], seed: int) -> dict[str, list[float]]:
    """Further trials a style → fall of the neighbours' error of the palm, m: median, smallest and largest; {} of few.

    Neighbours stand in for the model, since a training of it takes minutes and there would have to be a dozen.
    """
    counts, errors = proxy_curve([pair.trial for pair in pairs], seed)
    if len(counts) < 3:
        return {}
    falls = gains(counts, errors, further := further_trials(counts))
    if max(high for _, _, high in falls) < TOLD_M:  # a flat fit says nothing
        return {}
    return {str(n): list(fall) for n, fall in zip(further, falls, strict=True)}


def _advice(result: dict[str, Any]) -> str:
    measured = "evaluate DATA --learning-curve 3,5,10,20,40 measures it for the model"
    if not (more := result["more_trials"]):
        return f"what more trials would bring cannot be told from these; {measured}"
    falls = [
        f"{n} more a style bring the palm {100 * middle:.1f} cm nearer ({100 * low:.1f} to {100 * high:.1f})"
        for n, (middle, low, high) in more.items()
    ]
    return f"more trials, judged by nearest neighbours in this set: {', '.join(falls)}; {measured}"


def _adaptation_lines(result: dict[str, Any]) -> list[str]:
    """What moved, and by how much, for people."""
    moved = result["adaptation"]
    palms = ", ".join(f"{name} {100.0 * value:.1f}" for name, value in moved["palm"].items())
    lines = [
        f"{result['model']}: {result['from']} adapted to {counted(result['trials'], 'trial')}, "
        f"{result['seconds']:.0f} s; markers met to {result['marker_rms_mm_all']:.1f} mm",
        f"moved: mean pose {np.degrees(moved['body']):.1f}°, pose {np.degrees(moved['pose']):.1f}°, palm by style "
        f"{palms} cm, contact point {100.0 * moved['contact_point']:.1f} cm, its time {1e3 * moved['time']:.0f} ms",
        f"what was learned before counts for {100.0 * moved['share']:g} % in the avatar layer, "
        f"{100.0 * moved['contact_share']:g} % in the contact layer"
        + ("" if moved["arm_share"] is None else f", {100.0 * moved['arm_share']:g} % in that of the whole arm"),
    ]
    units = {"pose": ("°", 180.0 / np.pi), "palm": (" cm", 100.0)}
    units |= {"contact_point": (" cm", 100.0), "time": (" ms", 1e3)}
    parts = [
        f"{name.replace('_', ' ')} {factor * before:.1f} → {factor * after:.1f}{unit}"
        for name, (unit, factor) in units.items()
        if name in moved["left_out"]
        for before, after in [moved["left_out"][name]]
    ]
    names = {"pose": "pose", "forecast": "contact forecast", "arm": "the whole arm's forecast"}
    if moved["kept"]:
        kept = ", ".join(names[name] for name in moved["kept"])
        lines.append(f"left as it was, since trials left out are answered no better for its moving: {kept}")
    said = [f"RMS error of trials left out, before → after: {', '.join(parts)}"] if parts else []
    return [*lines, *said, _advice(result)]


def summary(result: dict[str, Any]) -> list[str]:
    """The figures of a training for people."""
    if "adaptation" in result:
        return _adaptation_lines(result)
    worst = ", ".join(f"{name} {rms:.1f}" for name, rms in list(result["marker_rms_mm"].items())[:3])
    fall = f"it fell by {100.0 * result['fall_at_the_end']:.2f} % over the last tenth of {result['steps']} steps"
    more = f"--iterations {2 * result['steps']} lowers it further; evaluate says whether new trials gain"
    advice = "" if result["converged"] else f"; it has not settled: {more}"
    where = result["model"] or "host 0 writes the model"
    lines = [
        f"{where}: {counted(result['trials'], 'trial')}, {result['points']} points, "
        f"{result['seconds']:.0f} s; markers met to {result['marker_rms_mm_all']:.1f} mm (worst: {worst})",
        f"objective {result['objective']:.3f}; {fall}{advice}",
    ]
    by = "the whole arm" if result["whole_arm"] else "the hand alone"
    pose = f", and {100.0 * result['pose_by_arm']:.0f} % of the pose" if result["pose_by_arm"] else ""
    lines.append(f"where and when palms meet is foretold by {by}{pose}")
    if len(result["starts"]) > 1:
        each = [f"seed {s['seed']} {s['failure'] or format(s['objective'], '.3f')}" for s in result["starts"]]
        lines.append(f"kept seed {result['seed']} of: {', '.join(each)}")
    return [*lines, _advice(result)]


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
