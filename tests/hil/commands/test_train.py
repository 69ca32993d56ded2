"""``highfive train`` from outside: what it writes, what it says, and how it goes on after an interruption."""

from __future__ import annotations

import json
import os
import resource
import signal
import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from unseen import Export, write_set

from highfive.hil.commands.train import CONVERGED, TrainOptions, after_interruption, summary, train
from highfive.hil.evaluation.training_progress import TrainingCount, training_bars
from highfive.model.errors import HighFiveError
from highfive.model.gp.optimise import Progress
from highfive.model.hgpdm.checkpoint import Checkpoint
from highfive.model.hgpdm.store import load_model


def options(folder: Path, out: Path, **changes) -> TrainOptions:
    given = {"preset": "default", "inducing": 10, "human": "human", "avatar": "avatar", "human_set": None}
    given |= {"avatar_set": None, "seed": 0, "overwrite": False, "distractors": False}
    return TrainOptions(folder, out, **(given | changes))


def test_a_place_that_takes_no_model_is_named_before_anything_is_solved(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("kept")
    for out, message in (
        (tmp_path, "is a folder"),
        (tmp_path / "file", "is there already"),
        (tmp_path / "file" / "m.safetensors", "cannot write to"),
        (Path("/proc/m.safetensors"), "cannot write to"),
    ):
        with pytest.raises(HighFiveError, match=message):
            train(options(tmp_path / "no data", out), lambda label, total: pytest.fail("solves"))
    assert (tmp_path / "file").read_text() == "kept"


def test_a_foreign_file_of_the_checkpoints_name_stays_where_it_is(tmp_path: Path) -> None:
    chosen = options(tmp_path / "no data", tmp_path / "x.safetensors")
    np.savez(chosen.checkpoint, mine=np.arange(3))
    mine = chosen.checkpoint.read_bytes()
    with pytest.raises(HighFiveError, match=r"x\.checkpoint\.npz is there already and is no training's checkpoint"):
        train(chosen, lambda label, total: pytest.fail("solves"))
    assert "goes on" not in after_interruption(chosen)
    assert chosen.checkpoint.read_bytes() == mine and list(tmp_path.iterdir()) == [chosen.checkpoint]
    with pytest.raises(HighFiveError, match="no data"):  # now it is the data's turn
        train(replace(chosen, overwrite=True), lambda label, total: pytest.fail("solves"))
    Checkpoint(chosen.checkpoint, {"seed": 9}).save({"starts": np.array("[]")})
    assert "goes on" in after_interruption(chosen)
    with pytest.raises(HighFiveError, match="no data"):
        train(chosen, lambda label, total: pytest.fail("solves"))


def test_more_memory_than_may_be_taken_is_refused_before_anything_is_solved(lab: Path, tmp_path: Path) -> None:
    chosen = options(lab, tmp_path / "m.safetensors", memory_gb=0.5)
    with pytest.raises(HighFiveError, match=r"points need about 1\.\d GB, there are 0\.5"):
        train(chosen, lambda label, total: pytest.fail("solves"))
    assert not list(tmp_path.iterdir())


def test_a_resumed_bar_begins_where_the_training_was() -> None:
    shown: list[tuple[str, int | None]] = []

    def bar(label: str, total: int):
        assert (label, total) == ("seed 1, training", 90)
        return lambda note="", done=None: shown.append((note, done))

    step = training_bars(bar, "seed 1, ")
    for done, objective in ((0, float("nan")), (60, -1.5), (61, -1.75)):
        step(Progress("training", done, 90, objective))
    assert shown == [("compiling", 0), ("objective -1.500", 60), ("objective -1.750", 61)]


def test_it_is_said_which_of_how_many_models_and_for_how_long() -> None:
    """Three models of one stage of 60 steps, 1 s each; the first compiles for 100 s; 30 s of scoring after each."""
    now = 0.0
    said: list[str] = []
    labels: list[str] = []

    def bar(label: str, total: int):
        labels.append(label)
        return lambda note="", done=None: None

    count = TrainingCount(bar, 3, said.append, lambda: round(1e9 * now))
    for model in range(3):
        step = count.next(f"seed {model}")
        step(Progress("training", 0, 60, float("nan")))
        now += 100.0
        for done in range(1, 61):
            step(Progress("training", done, 60, -1.0))
            now += 1.0
        now += 30.0
    assert labels == [f"model {n} of 3, seed {n - 1}, training" for n in (1, 2, 3)]
    # After 105 s of the first model 54 are left of it, and twice 159 come. Later the 190 s of one are known.
    assert said == ["model 1 of 3, about 6 min for all", "model 2 of 3, about 5 min for all",
                    "model 3 of 3, about 1 min for all"]  # fmt: skip


def test_a_model_that_is_found_ready_counts_but_tells_nothing() -> None:
    now, said = 0.0, []
    count = TrainingCount(
        lambda label, total: lambda note="", done=None: None, 2, said.append, lambda: round(1e9 * now)
    )
    count.next()
    step = count.next()
    for done in range(1, 101):
        step(Progress("training", done, 100, -1.0))
        now += 6.0
    assert said == ["model 2 of 2, about 9 min for all"]


def test_the_summary_says_whether_it_converged_and_what_became_of_each_seed() -> None:
    starts = [{"seed": 4, "steps": 9, "objective": -2.0, "failure": ""}]
    result = {
        "model": "m", "trials": 3, "points": 70, "seconds": 1.0, "marker_rms_mm": {"C7": 2.0}, "marker_rms_mm_all": 1.0,
        "objective": -2.5, "steps": 90, "fall_at_the_end": 0.5 * CONVERGED, "converged": True, "starts": starts,
        "seed": 5, "more_trials": {}, "whole_arm": True, "pose_by_arm": 0.0,
    }  # fmt: skip
    assert "by the whole arm, and 40 % of the pose" in summary(result | {"pose_by_arm": 0.4})[2]
    assert summary(result)[2].endswith("by the whole arm")
    assert "by the whole arm" in summary(result)[2] and "the hand alone" in summary(result | {"whole_arm": False})[2]
    assert len(summary(result)) == 4 and "settled" not in summary(result)[1]
    result |= {"fall_at_the_end": 0.02, "converged": False}
    assert "it fell by 2.00 % over the last tenth" in summary(result)[1]
    assert "it has not settled: --iterations 180" in summary(result)[1]
    starts.append({"seed": 5, "steps": 9, "objective": -2.5, "failure": ""})
    assert "kept seed 5 of: seed 4 -2.000, seed 5 -2.500" in summary(result)[3]
    assert "cannot be told from these" in summary(result)[4]
    result["more_trials"] = {"3": [0.012, 0.01, 0.02]}
    assert "3 more a style bring the palm 1.2 cm nearer (1.0 to 2.0)" in summary(result)[4]


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("lab")
    write_set(folder, ("B2", "A3", "C1"), Export())
    return folder


def command(lab: Path, out: Path, *words: str) -> list[str]:
    return [
        sys.executable,
        "-m",
        "highfive.hil.cli.main",
        "train",
        str(lab),
        "--out",
        str(out),
        "--inducing",
        "10",
        *words,
    ]


def run(lab: Path, out: Path, *words: str, **given) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command(lab, out, *words), capture_output=True, text=True, check=False, **given)


def stopped(lab: Path, out: Path, kind: signal.Signals, *words: str) -> tuple[int, str]:
    """The command, stopped by a signal once there is a checkpoint; exit code and standard error."""
    with subprocess.Popen(command(lab, out, *words), stderr=subprocess.PIPE, text=True) as process:
        while process.poll() is None and not list(out.parent.glob("*.checkpoint.npz")):
            time.sleep(0.05)
        process.send_signal(kind)
        return process.returncode if process.poll() is not None else process.wait(), process.stderr.read()  # type: ignore


@pytest.mark.slow(100)
def test_after_ctrl_c_and_after_a_kill_the_same_command_goes_on_to_the_same_model(lab: Path, tmp_path: Path) -> None:
    words = ("--iterations", "100")
    whole = run(lab, tmp_path / "whole.safetensors", *words, "--json")
    assert whole.returncode == 0, whole.stderr
    out = tmp_path / "again" / "m.safetensors"
    out.parent.mkdir()
    code, said = stopped(lab, out, signal.SIGINT, *words)
    checkpoint = out.with_name("m.checkpoint.npz")
    assert code == 1 and not out.exists()
    assert said.splitlines()[-1] == f"interrupted; the same command goes on from {checkpoint}"
    code, _ = stopped(lab, out, signal.SIGKILL, *words)
    assert code == -signal.SIGKILL and checkpoint.exists() and not out.exists()
    end = run(lab, out, *words, "--json")
    assert end.returncode == 0, end.stderr
    assert f"found {checkpoint}: training goes on after step" in end.stderr
    assert not checkpoint.exists()
    assert out.read_bytes() == (tmp_path / "whole.safetensors").read_bytes()
    assert json.loads(end.stdout)["objective"] == json.loads(whole.stdout)["objective"]
    curve = load_model(out).learning_curve
    assert len(curve) == 100 and curve[-1] == pytest.approx(json.loads(end.stdout)["objective"])


@pytest.mark.slow(45)
@pytest.mark.parametrize(("kibibytes", "kept"), [(16, False), (200, True)])
def test_a_full_disk_is_said_in_one_line(lab: Path, tmp_path: Path, kibibytes: int, kept: bool) -> None:
    """A limit to the size of files is a full disk that needs no disk to fill: for all, or for the model alone."""
    out = tmp_path / "m.safetensors"
    limits = (1024 * kibibytes, resource.getrlimit(resource.RLIMIT_FSIZE)[1])
    environment = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}
    words = ("--inducing", "60", "--iterations", "25")
    full = run(lab, out, *words, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, limits), env=environment)
    assert full.returncode == 2 and "Traceback" not in full.stderr, full.stderr
    assert "error: cannot write the model to" in full.stderr
    assert ("training goes on, but a kill would lose it" in full.stderr) != kept
    assert ("the same command goes on from" in full.stderr) == kept
    assert [path.name for path in tmp_path.glob("m*")] == ["m.checkpoint.npz"] * kept


def test_an_adaptation_takes_no_words_of_a_training_and_needs_a_model(tmp_path: Path) -> None:
    chosen = options(tmp_path / "no data", tmp_path / "x.safetensors", start="default")
    for changes in ({"restarts": 2}, {"iterations": 5}, {"whole_arm": True}, {"whole_arm": False}):
        with pytest.raises(HighFiveError, match="leave --whole-arm, --hand-alone, --restarts and --iterations out"):
            train(replace(chosen, **changes), lambda label, total: pytest.fail("solves"))
    with pytest.raises(HighFiveError, match="leave --hosts out"):
        train(replace(chosen, hosts=("auto",)), lambda label, total: pytest.fail("solves"))
    with pytest.raises(HighFiveError, match="which of --hosts this is"):
        train(replace(chosen, start=None, process=1), lambda label, total: pytest.fail("solves"))
    with pytest.raises(HighFiveError, match="--process-id takes its number, from 0 to 1"):
        train(replace(chosen, start=None, hosts=("a:1", "b")), lambda label, total: pytest.fail("solves"))
    with pytest.raises(HighFiveError, match="no model file"):
        train(replace(chosen, start=str(tmp_path / "none.safetensors")), lambda label, total: pytest.fail("solves"))


@pytest.mark.slow
def test_the_shipped_model_is_adapted_to_a_folder_and_says_what_moved(lab: Path, tmp_path: Path) -> None:
    out = tmp_path / "adapted.safetensors"
    done = subprocess.run(command(lab, out, "--from", "default", "--json"), capture_output=True, text=True, check=True)
    result = json.loads(done.stdout)
    moved = result["adaptation"]
    assert result["trials"] == moved["trials"] == 2 and moved["emotions"] == ["neutral"]
    assert load_model(out).emotions == load_model().emotions
    assert all(after < before for before, after in (moved["left_out"]["pose"], moved["left_out"]["palm"]))
    assert "cannot be told from these" in summary(result)[-1]


@pytest.mark.slow(95)
def test_two_hosts_train_one_model_that_the_first_writes(lab: Path, tmp_path: Path) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        hosts = f"127.0.0.1:{free.getsockname()[1]},127.0.0.1"
    words = ("--hosts", hosts, "--inducing", "10", "--iterations", "3", "--json")
    both = [
        subprocess.Popen(
            command(lab, tmp_path / "m.safetensors", *words, "--process-id", number), stdout=subprocess.PIPE, text=True
        )
        for number in ("0", "1")
    ]
    first, second = (json.loads(process.communicate(timeout=300)[0]) for process in both)  # Gloo prints, too
    assert first["model"].endswith("m.safetensors") and second["model"] is None
    assert first["hosts"] == second["hosts"] == 2 and first["objective"] == second["objective"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m.safetensors"]
