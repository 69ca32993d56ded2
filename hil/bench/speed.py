"""How fast the model trains and answers on this machine, beside a published library."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import numpy as np
from jax.flatten_util import ravel_pytree

from highfive.hil.bench import gp_baseline as peers
from highfive.hil.bench.synthetic_trials import RATE, made_up_trials
from highfive.hil.runtime.threads import use_one_blas_thread
from highfive.model.errors import HighFiveError
from highfive.model.gp.optimise import Progress
from highfive.model.hgpdm.dataset import AUXILIARY, HAND_DIMS, training_set
from highfive.model.hgpdm.hierarchy import objective, problem
from highfive.model.hgpdm.initial import initial_parameters
from highfive.model.hgpdm.presets import Preset, preset_named
from highfive.model.hgpdm.training import train
from highfive.model.hgpdm.trials import Trial
from highfive.model.online.responder import Responder

if TYPE_CHECKING:
    from collections.abc import Iterator

    from highfive.hil.runtime.console import Bar
    from highfive.model.hgpdm.trained import HGPDM

ADVICE = "no library to compare with: pip install 'high-five[peers]', or --peer-python with one that has GPflow"
CLOSE = 1e-3  # of the way that training goes: nearer the end than this it counts as arrived


@dataclass(frozen=True)
class BenchOptions:
    """What is measured; see ``highfive bench model --help``."""

    points: int = 5605
    channels: int = 159
    inducing: int = 200
    sizes: tuple[int, ...] = (1000, 2000, 5000, 10000, 20000, 50000)
    repeats: int = 7
    steps: int = 2000
    preset: str = "default"
    seed: int = 0
    training: bool = True
    peer_python: Path = Path(sys.executable)


def bench_model(options: BenchOptions, bar: Bar) -> dict[str, Any]:
    """Times, in s and ms; medians of repeated runs, and the peer's taken in turn with ours.

    Raises:
        HighFiveError: the peer's interpreter cannot be run, or the model cannot be trained.
    """
    use_one_blas_thread()
    preset = preset_named(options.preset)
    trials = made_up_trials(options.points, options.channels, options.seed)
    with _peer(options) as (peer, evaluate_peer):
        advance = bar("objective and gradient", options.repeats)
        evaluate = _evaluation(trials, preset, options)
        own, others, alls = [], [], []
        for _ in range(options.repeats):
            own.append(_seconds(evaluate))
            if peer is not None:
                others.append(evaluate_peer(""))
                if peer["all"]:
                    alls.append(evaluate_peer("all"))
            advance()
    result: dict[str, Any] = {
        "preset": preset.name,
        "points": options.points,
        "channels": options.channels,
        "inducing": options.inducing,
        "cores": os.cpu_count(),
        "devices": jax.device_count(),
        "objective_gradient_s": float(np.median(own)),
        "peer": peer,
        "peer_objective_gradient_s": float(np.median(others)) if others else None,
        "peer_all_layers_s": float(np.median(alls)) if alls else None,
    }
    if peer is None:
        result["peer_advice"] = ADVICE
    result["by_points"] = _by_points(preset, options, bar)
    if options.training:
        model, figures = _training(trials, preset, options, bar)
        result |= figures
        result["step_ms"] = _steps(model, trials, options.steps, bar)
    return result


def _seconds(function: Callable[[], object]) -> float:
    begun = time.perf_counter()
    function()
    return time.perf_counter() - begun


def _evaluation(trials: list[Trial], preset: Preset, options: BenchOptions) -> Callable[[], object]:
    """One objective and gradient of all layers, compiled."""
    points = sum(len(trial.joints) for trial in trials)
    task = problem(training_set(trials, replace(preset, points=2 * points)), preset)
    start = initial_parameters(task, options.inducing, np.random.default_rng(options.seed))
    vector, unravel = ravel_pytree(start)
    both = jax.jit(jax.value_and_grad(lambda flat, points: objective(unravel(flat), task, points)))

    def evaluate() -> object:
        return jax.block_until_ready(both(vector, task.points))

    evaluate()
    return evaluate


def _by_points(preset: Preset, options: BenchOptions, bar: Bar) -> list[dict[str, float]]:
    rows, advance = [], bar("by number of points", len(options.sizes))
    for size in options.sizes:
        trials = made_up_trials(size, options.channels, options.seed)
        evaluate = _evaluation(trials, preset, options)
        seconds = float(np.median([_seconds(evaluate) for _ in range(options.repeats)]))
        rows.append({"points": size, "objective_gradient_s": seconds, "s_per_point": seconds / size})
        advance()
    return rows


def _training(trials: list[Trial], preset: Preset, options: BenchOptions, bar: Bar) -> tuple[HGPDM, dict[str, float]]:
    """A whole training: how long it takes, and when it is within ``CLOSE`` of its final objective."""
    begun, advance = time.perf_counter(), bar("training", preset.iterations)
    when: list[tuple[float, float]] = []

    def step(progress: Progress) -> None:
        if progress.stage == "training" and progress.iteration > 0:
            when.append((time.perf_counter() - begun, progress.objective))
            advance()

    model = train(
        trials, replace(preset, points=2 * options.points), inducing=options.inducing, seed=options.seed, progress=step
    )
    seconds = time.perf_counter() - begun
    last = when[-1][1]
    near = max((at for at, value in when if abs(value - last) > CLOSE * abs(last)), default=0.0)
    arrived = next(at for at, _ in when if at > near)
    return model, {"training_s": seconds, "training_to_0.1_percent_s": arrived, "training_objective": last}


def _steps(model: HGPDM, trials: list[Trial], steps: int, bar: Bar) -> dict[str, float]:
    """Milliseconds of one online step with its covariance."""
    responder = Responder(model, trials[0].emotion, RATE)
    hands = np.concatenate([trial.hand_points for trial in trials])
    seconds, advance = [], bar("online steps", steps)
    for number in range(steps + 100):
        begun = time.perf_counter()
        response = responder.step(hands[number % len(hands)])
        _ = response.joints_std, response.latent_covariance
        if number >= 100:  # warm
            seconds.append(time.perf_counter() - begun)
            advance()
    p50, p99 = 1e3 * np.percentile(seconds, [50, 99])
    return {"p50": float(p50), "p99": float(p99)}


def _layers(preset: Preset, joints: int) -> list[tuple[int, int]]:
    """Dimensions of the inputs and channels of the model's four layers: avatar, human, interaction and dynamics."""
    q, below = preset.interaction_dims, preset.avatar_dims + preset.human_dims
    return [(preset.avatar_dims, joints + AUXILIARY), (preset.human_dims, HAND_DIMS), (q, below), (2 * q, q)]


@contextmanager
def _peer(options: BenchOptions) -> Iterator[tuple[dict[str, Any] | None, Callable[[str], float]]]:
    """Name and version of the peer, or None, and a function that has it evaluate one layer ('') or ``all`` once, and
    gives the seconds.
    """
    layers = _layers(preset_named(options.preset), options.channels)
    sizes = (options.points, options.channels, options.inducing, options.seed, json.dumps(layers))
    command = [str(options.peer_python), str(Path(peers.__file__)), *map(str, sizes)]
    try:
        process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
    except OSError as error:
        raise HighFiveError(f"--peer-python {options.peer_python} cannot be run: {error.strerror}") from None
    assert process.stdin is not None and process.stdout is not None
    with process:
        requests, answers = process.stdin, process.stdout

        def evaluate(what: str) -> float:
            requests.write(f"{what}\n")
            requests.flush()
            return float(answers.readline())

        try:
            yield json.loads(answers.readline() or "null"), evaluate
        finally:
            process.kill()


def print_bench(result: dict[str, Any]) -> None:
    """The figures for people."""
    peer = result["peer"]
    print(f"{result['points']} points, {result['channels']} channels, {result['inducing']} inducing inputs per layer")
    print(f"  objective and gradient, four layers  {result['objective_gradient_s']:.3f} s")
    if peer is None:
        print(f"  {result['peer_advice']}")
    else:
        label = f"the same, one layer of {peer['name']} {peer['version']}"
        print(f"  {label:<37}{result['peer_objective_gradient_s']:.3f} s")
        if (every := result["peer_all_layers_s"]) is not None:
            label = f"four layers of {peer['name']}, in one"
            print(f"  {label:<37}{every:.3f} s")
    for row in result["by_points"]:
        per_point = 1e6 * row["s_per_point"]
        print(f"    {row['points']:>6} points  {row['objective_gradient_s']:8.3f} s  {per_point:6.1f} µs per point")
    if "training_s" in result:
        arrived = result["training_to_0.1_percent_s"]
        print(f"  training  {result['training_s']:.0f} s, {arrived:.0f} s to within 0.1 % of its final objective")
        print(f"  online step  p50 {result['step_ms']['p50']:.3f} ms, p99 {result['step_ms']['p99']:.3f} ms")
