"""Several seeds, resumed, damaged and killed: what comes out is what an undisturbed training gives."""

from __future__ import annotations

import signal
import subprocess
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from paths import HELPERS

from highfive.model.errors import HighFiveError
from highfive.model.gp.optimise import State, minimise
from highfive.model.hgpdm.checkpoint import Checkpoint
from highfive.model.hgpdm.restarts import Best, best_of

STEPS = 60


def wavy(vector: jnp.ndarray) -> jnp.ndarray:
    """Many minima, so that the seeds end in different ones."""
    return jnp.sum(0.05 * vector**2 - jnp.cos(3.0 * vector))


def draw(seed: int) -> jnp.ndarray:
    return jnp.asarray(np.random.default_rng(seed).uniform(-4.0, 4.0, 4))


class Killed(BaseException):
    """As good as a kill: nothing is caught and nothing is tidied up."""


def run(path: Path | None, restarts: int = 3, kill_at: int = -1, failing: tuple[int, ...] = (), say=lambda line: None):
    """The best of some seeds, killed after so many steps in all; the starts of ``failing`` seeds have no value."""
    left = [kill_at]

    def progress(report) -> None:
        left[0] -= report.iteration > 0
        if left[0] == 0:
            raise Killed

    def optimise(start: jnp.ndarray, stage: str, resume: State | None, keep: Callable[[State], None]):
        return minimise(wavy, start, STEPS, STEPS, 0.05, stage, progress, resume, keep)

    def drawn(seed: int) -> jnp.ndarray:
        return draw(seed) * np.nan if seed in failing else draw(seed)

    checkpoint = None if path is None else Checkpoint(path, {"seed": 5})
    return best_of(optimise, drawn, 5, restarts, checkpoint, say)


def assert_same(found: Best, expected: Best) -> None:
    np.testing.assert_array_equal(found.parameters, expected.parameters)
    assert (found.seed, found.trace, found.starts) == (expected.seed, expected.trace, expected.starts)


def test_the_seed_with_the_lowest_objective_is_kept():
    best = run(None)
    assert [start.seed for start in best.starts] == [5, 6, 7]
    objectives = [start.objective for start in best.starts if start.objective is not None]
    assert len(set(objectives)) == 3
    assert best.trace[-1] == min(objectives) == best.starts[best.seed - 5].objective
    assert_same(run(None, restarts=1), Best(run(None, 1).parameters, 5, run(None, 1).trace, best.starts[:1]))


@pytest.mark.parametrize("kill_at", [10, 45, 60, 61, 100, 130, 175])
@pytest.mark.slow
def test_a_killed_training_goes_on_to_the_same_end(tmp_path: Path, kill_at: int):
    path, said = tmp_path / "run.npz", []
    with pytest.raises(Killed):
        run(path, kill_at=kill_at)
    assert_same(run(path, say=said.append), run(None))
    assert len(said) == (kill_at > 20)
    assert all("training goes on after step" in line for line in said)
    # What is done is done: asked again, nothing is left to do.
    assert_same(run(path, kill_at=1), run(None))


def test_damaged_and_foreign_checkpoints_are_set_aside_with_a_word(tmp_path: Path):
    path, said = tmp_path / "run.npz", []
    path.write_bytes(b"nonsense")
    assert_same(run(path, say=said.append), run(None))
    Checkpoint(path, {"seed": 4}).save({"starts": np.array("[]")})
    assert_same(run(path, say=said.append), run(None))
    assert len(said) == 2 and "kept as run.npz.old, and training begins anew" in said[0]
    assert "seed 4 instead of 5" in said[1] and "kept as run.npz.old-2, and training begins anew" in said[1]
    assert (tmp_path / "run.npz.old").read_bytes() == b"nonsense"  # what was set aside before stays


def test_a_seed_that_fails_is_replaced_by_the_next():
    said: list[str] = []
    best = run(None, restarts=2, failing=(5, 7), say=said.append)
    assert [start.seed for start in best.starts] == [5, 6, 7, 8]
    assert [start.objective is None for start in best.starts] == [True, False, True, False]
    assert all("not positive definite" in start.failure for start in best.starts if start.failure)
    assert [line.split(" failed")[0] for line in said] == ["seed 5", "seed 7"]
    with pytest.raises(HighFiveError, match=r"3 seeds failed, the last one: .* cannot start"):
        run(None, failing=(5, 6, 7, 8))


def test_training_survives_a_checkpoint_that_cannot_be_written(tmp_path: Path):
    said: list[str] = []
    assert_same(run(tmp_path / "absent" / "run.npz", say=said.append), run(None))
    (line,) = said
    assert "cannot write the checkpoint" in line and "training goes on" in line


CHILD = """
    import sys
    from dataclasses import replace
    from pathlib import Path
    import numpy as np
    sys.path.insert(0, {tests!r})
    from made_up import SMALL, made_up_trial
    from highfive.model.hgpdm.store import save_model
    from highfive.model.hgpdm.training import train
    rng = np.random.default_rng(1)
    trials = [made_up_trial(goal, emotion, 60.0, rng) for goal in (0.3, 0.5, 0.7) for emotion in ("neutral", "angry")]
    preset = replace(SMALL, iterations=50, adam_steps=50, points=200)
    model = train(trials, preset, inducing=12, seed=3, checkpoint=sys.argv[1], restarts=2,
                  progress=lambda p: print(p.stage, p.iteration, flush=True), say=lambda line: print("said", line))
    save_model(model, sys.argv[2])
"""


@pytest.mark.slow(35)
def test_killed_by_the_system_it_goes_on_to_the_same_model(tmp_path: Path):
    """SIGKILL in the middle of the second seed of a real training; the files of the models are the same."""
    code = textwrap.dedent(CHILD.format(tests=str(HELPERS)))

    def child(out: str) -> list[str]:
        return [sys.executable, "-c", code, str(tmp_path / f"{out}.npz"), str(tmp_path / out)]

    with subprocess.Popen(child("killed"), stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if line == "training, seed 4 33\n":
                process.send_signal(signal.SIGKILL)
                break
    assert process.wait() == -signal.SIGKILL
    assert not (tmp_path / "killed").exists()
    done = subprocess.run(child("killed"), capture_output=True, text=True, check=True)
    assert "goes on after step 20 of seed 4 (seed 3: " in done.stdout
    assert "training, seed 3 1\n" not in done.stdout and "training, seed 4 21\n" in done.stdout
    subprocess.run(child("whole"), capture_output=True, text=True, check=True)
    assert (tmp_path / "killed").read_bytes() == (tmp_path / "whole").read_bytes()
