"""A session killed at random moments: real processes, SIGKILL. What was said to be over is there, and nothing twice."""

import os
import signal
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from experiments import head, study

from highfive.hil.experiments.study import has_run
from highfive.hil.experiments.trial_log import open_log, read_session
from highfive.hil.experiments.trial_row import Outcome


def child(folder: Path, participant: str, pipe: int) -> None:
    """Answers trials, and says on a pipe which was asked, and which is over."""
    with open_log(
        folder, head(participant), resume=has_run(folder, participant) and _begun(folder, participant)
    ) as log:
        while (trial := log.begin()) is not None:
            os.write(pipe, f"asked {trial.name}\n".encode())
            log.finish(Outcome(answer=trial.answer))
            os.write(pipe, f"over {trial.name}\n".encode())
    os.write(pipe, b"end\n")


def _begun(folder: Path, participant: str) -> bool:
    return read_session(folder, participant, 1).plan is not None


def killed(folder: Path, participant: str, rng: np.random.Generator) -> list[str]:
    """What a process said until it was killed, or until the end."""
    reading, writing = os.pipe()
    if (process := os.fork()) == 0:
        code = 1
        try:
            os.close(reading)
            child(folder, participant, writing)
            code = 0
        finally:
            os._exit(code)
    os.close(writing)
    said, least = b"", int(rng.integers(0, 60))
    while said.count(b"\n") < least and (more := os.read(reading, 4096)):
        said += more
    # Less than a few trials take: not all that are left.
    time.sleep(float(rng.uniform(0.0, 0.003)))
    os.kill(process, signal.SIGKILL)
    while more := os.read(reading, 4096):
        said += more
    os.close(reading)
    _, status = os.waitpid(process, 0)
    assert os.WIFSIGNALED(status) or os.WEXITSTATUS(status) == 0, said
    return said.decode().splitlines()


def kill(folder: Path, times: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    number, over, asked, kills = 1, Counter[str](), Counter[str](), 0
    for _ in range(times):
        participant = f"P{number:02d}"
        said = killed(folder, participant, rng)
        kills += said[-1:] != ["end"]
        over += Counter(line.removeprefix("over ") for line in said if line.startswith("over"))
        asked += Counter(line.removeprefix("asked ") for line in said if line.startswith("asked"))
        if not has_run(folder, participant):
            continue
        content = read_session(folder, participant, 1)
        finished = Counter(row.trial for row in content.finished)
        assert all(finished[trial] >= count for trial, count in over.items()), "a finished trial is lost"
        begun = Counter(content.asks.values())
        assert all(begun[trial] >= count for trial, count in asked.items()), "a trial was asked, and is not in the log"
        unmarked = Counter(trial for ask, trial in content.asks.items() if ask not in (content.marked or {}))
        # What was killed is marked as the session is resumed.
        with_all = [trial.name for trial in content.plan.trials] if content.plan else []
        assert max(unmarked.values(), default=1) == 1, f"asked twice and unmarked: {unmarked.most_common(1)}"
        assert [row.trial for row in content.standing] == with_all[: len(content.standing)]
        if said[-1:] == ["end"]:
            assert len(content.standing) == len(with_all)
            number, over, asked = number + 1, Counter(), Counter()
    assert kills > times // 2


@pytest.mark.slow
def test_no_trial_is_lost_and_none_asked_twice_unmarked(tmp_path: Path) -> None:
    # As many people as kills: on a quick disk one may answer all before the kill.
    kill(study(tmp_path, changes={"participants = 12": "participants = 8"}), times=8, seed=0)


@pytest.mark.slow
@pytest.mark.parametrize("times", [50, 200])
def test_many_kills_lose_nothing(tmp_path: Path, times: int) -> None:
    folder = study(tmp_path, changes={"participants = 12": f"participants = {times}"})
    kill(folder, times=times, seed=1)
