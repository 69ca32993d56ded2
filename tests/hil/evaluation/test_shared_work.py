"""Trainings that several processes share out through one folder."""

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up import EMOTIONS, SMALL, made_up_trial

from highfive.hil.evaluation.model_cache import fit, is_kept
from highfive.hil.evaluation.shared_work import Training, claimed, in_processes
from highfive.model.hgpdm.trials import Trial

HOLDER = """
import sys, time
from pathlib import Path
from highfive.hil.evaluation.shared_work import claimed
with claimed(Path(sys.argv[1])) as mine:
    print(mine, flush=True)
    time.sleep(60)
"""


@pytest.mark.slow
def test_one_process_has_a_training_and_a_killed_one_no_longer(tmp_path: Path) -> None:
    path = tmp_path / "x.lock"
    with subprocess.Popen([sys.executable, "-c", HOLDER, path], stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None and other.stdout.readline().strip() == "True"
        with claimed(path) as mine:
            assert not mine
        os.kill(other.pid, signal.SIGKILL)
        other.wait()
        with claimed(path) as mine:
            assert mine


@pytest.fixture(scope="module")
def trials() -> tuple[Trial, ...]:
    rng = np.random.default_rng(1)
    return tuple(made_up_trial(goal, e, 60.0, rng) for goal in (0.3, 0.4, 0.5, 0.6) for e in EMOTIONS)


def test_a_training_has_one_key_on_all_hosts_and_another_for_anything_else(trials: tuple[Trial, ...]) -> None:
    one = Training("", trials, SMALL, 10, 0)
    assert one.key == Training("", tuple(replace(trial) for trial in trials), SMALL, 10, 0).key
    held = (replace(trials[0], test=True), *trials[1:])
    others = [replace(one, seed=1), replace(one, inducing=9), replace(one, trials=held), replace(one, name="A1")]
    assert len({one.key, *(other.key for other in others)}) == 5


@pytest.mark.slow(35)
def test_processes_share_out_trainings_and_leave_what_one_alone_would(trials: tuple[Trial, ...], tmp_path) -> None:
    preset = SMALL.with_iterations(6)
    work = [Training("", trials, preset, 10, seed) for seed in (0, 1)]
    in_processes(work, tmp_path / "shared", 2)
    names = {path.name for path in (tmp_path / "shared").iterdir() if path.suffix == ".safetensors"}
    assert len(names) == 4 and all(is_kept(path) for path in (tmp_path / "shared").iterdir())
    alone = fit(trials, preset, 10, 0, tmp_path / "alone")
    assert {path.name for path in (tmp_path / "alone").iterdir()} < names
    shared = fit(trials, preset, 10, 0, tmp_path / "shared")
    np.testing.assert_allclose(
        shared.model.avatar.weights, np.asarray(alone.model.avatar.weights), rtol=1e-4, atol=1e-4
    )
