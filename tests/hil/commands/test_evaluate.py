import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from highfive.hil.cli.main import app
from highfive.hil.commands.evaluate import EvaluateOptions, after_interruption
from highfive.hil.sim.people.actors import simulate_pair
from highfive.hil.sim.people.capture import Defects, record_pair
from highfive.mocap_bridge.files.c3d import read_c3d, write_c3d
from highfive.mocap_bridge.files.trial_table import read_table, write_table
from highfive.model import DEFAULT_MODEL
from highfive.model.errors import HighFiveError
from highfive.model.files import UNFINISHED


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Eight sequences of an arm that moves and four joints that follow it."""
    rng, arrays = np.random.default_rng(0), {}
    for part, count in (("train", 6), ("test", 2)):
        inputs, targets = [], []
        for _ in range(count):
            arm = np.sin(rng.uniform(2.0, 6.0) * np.arange(40)[:, None] / 30.0 + np.linspace(0.0, 1.0, 9))
            frames = np.concatenate([arm, np.diff(arm, axis=0, prepend=arm[:1])], axis=1)
            inputs += [frames[s : s + 5].ravel() for s in range(1, 30)]
            targets += [np.tanh(arm[s + 5 : s + 10, :4]).ravel() for s in range(1, 30)]
        arrays[f"{part}_input"], arrays[f"{part}_target"] = np.array(inputs), np.array(targets)
        arrays[f"{part}_sequence_lengths"] = np.full(count, 29)
        arrays[f"{part}_action"] = np.arange(count) % 2
    np.savez(tmp_path / "windows.npz", **arrays)
    return tmp_path / "windows.npz"


FRAMES = ("points", "valid", "unlabelled", "unlabelled_valid")
"""Of a recording, what it has of each frame."""


def run(*arguments: object):
    return CliRunner().invoke(app, ["evaluate", *map(str, arguments)], catch_exceptions=True)


def test_an_interrupted_one_says_whether_anything_is_kept(tmp_path: Path):
    options = EvaluateOptions(out=tmp_path / "out")
    assert after_interruption(EvaluateOptions()) == ""
    assert after_interruption(options) == "; nothing is kept yet"
    (tmp_path / "out" / "models").mkdir(parents=True)
    (tmp_path / "out" / "models" / f"{UNFINISHED}x").touch()
    assert after_interruption(options) == "; nothing is kept yet"
    (tmp_path / "out" / "models" / "hgpdm_0123456789abcdef.safetensors").touch()
    assert after_interruption(options) == f"; the same command goes on from {tmp_path / 'out' / 'models'}"


@pytest.mark.slow(25)
def test_a_windows_file_gives_scores_of_all_methods(file: Path):
    result = run("--windows", file, "--seeds", 2, "--inducing", 12, "--json")
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert list(found["scores"]) == ["hgpdm", "sparse_gp", "knn", "ridge", "mean"]
    for method, values in found["scores"].items():
        assert list(values) == ["wave", "handshake"]
        for action, value in values.items():
            assert found["smallest"][method][action] <= value <= found["largest"][method][action]
            assert value <= found["scores"]["mean"][action]
    assert found["smallest"]["mean"] == found["largest"]["mean"]
    assert found["smallest"]["hgpdm"] != found["largest"]["hgpdm"]


@pytest.mark.slow(25)
def test_a_learning_curve_over_sequences_has_each_method_and_goes_on_where_it_was(file: Path, tmp_path: Path) -> None:
    words = ["--windows", file, "--seeds", 1, "--inducing", 12, "--learning-curve", "2,3,9", "--json"]
    result = run(*words, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    curve = json.loads(result.stdout)["learning_curve"]
    assert curve["trials_per_style"] == [2, 3] and curve["draws"] == 1  # there are three sequences of an action
    for method in ("hgpdm", "sparse_gp", "knn", "ridge", "mean"):
        for values in curve["methods"][method].values():
            assert len(values["median"]) == 2 and values["smallest"] == values["median"] == values["largest"]
            assert set(values["law"]) == {"floor", "gain", "exponent"}
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "out" / "models").iterdir()}
    again = json.loads(run(*words, "--out", tmp_path / "out", "--overwrite").stdout)
    assert again["learning_curve"] == curve
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "out" / "models").iterdir()} == kept
    assert (tmp_path / "out" / "figures" / "over_trials.png").is_file()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "either a data folder or --windows"),
        (["{file}", "{folder}"], "either a data folder or --windows"),
        (["{folder}", "{folder}"], "one data folder"),
        (["{model}", "{file}"], "leave the model out"),
        (["default", "{file}"], "leave the model out"),
        (["{folder}"], "cannot read"),
        (["{file}", "--leave-out", "cell"], "leave --leave-out out"),
        (["{model}", "{folder}", "--leave-out", "cell"], "trains models of its own"),
        (["{folder}", "--locked", "--leave-out", "cell"], "so does --leave-out; leave one of them out"),
        (["{file}", "--locked"], "so does a windows file; leave one of them out"),
        (["missing.safetensors", "{folder}"], "no model file"),
        (["missing"], "cannot read missing/trials.csv"),
        (["{model}"], "alone cannot be scored"),
        (["--windows", "missing.npz"], "not a windows file"),
        (["--windows", "{model}"], "no archive of arrays (.npz), or it is cut short"),
        (["{file}", "--out", "/proc/report"], "cannot write to /proc/report"),
        (["{file}", "--preset", "best"], "no preset called"),
        (["{folder}", "--learning-curve", "3,some"], "expected numbers of trials"),
        (["{folder}", "--learning-curve", "0,5"], "at least one trial a style"),
        (["{model}", "{folder}", "--learning-curve", "5"], "leave the model out"),
        (["{folder}", "--leave-out", "cell", "--learning-curve", "5"], "leave --leave-out out"),
        (["{file}", "--from", "default"], "not to a windows file"),
        (["{folder}", "--jobs", "2"], "--jobs needs a folder of trainings"),
    ],
)
def test_what_cannot_be_scored_is_said_in_one_line(file: Path, arguments: list[str], message: str):
    filled = [text.format(file=file, folder=file.parent, model=DEFAULT_MODEL) for text in arguments]
    error = run(*filled).exception
    assert isinstance(error, HighFiveError)
    assert message in str(error)
    assert "\n" not in str(error)


@pytest.mark.sweep
@pytest.mark.slow
def test_a_number_of_trials_that_is_too_few_to_learn_from_is_named_before_any_training(captured: Path, tmp_path: Path):
    rows = []
    for row, split in zip(read_table(captured)[:3], ("train", "train", "test"), strict=True):
        whole = read_c3d(captured / row.file)
        half = slice(len(whole) // 4, len(whole) * 3 // 4)
        write_c3d(tmp_path / row.file, replace(whole, **{name: getattr(whole, name)[half] for name in FRAMES}))
        rows.append((row.file, row.emotion, row.cell, "1", split))
    write_table(tmp_path, rows)
    error = run(tmp_path, "--learning-curve", "1,2", "--seeds", 1, "--inducing", 12).exception
    assert isinstance(error, HighFiveError), error
    assert re.search(r"--learning-curve: 1 a style gives \d\d training points, at least 50 are needed", str(error))


@pytest.mark.sweep
@pytest.mark.slow(70)
@pytest.mark.usefixtures("hurried")
def test_repetitions_left_out_in_turn_give_a_report_and_go_on_where_they_were(tmp_path: Path):
    lab, rows = tmp_path / "lab", []
    lab.mkdir()
    for number, cell in enumerate(("A1", "B2", "C3") * 2):
        rng = np.random.default_rng([5, number])
        trial = simulate_pair("angry", cell, number, rng)
        write_c3d(lab / f"{number}.c3d", record_pair(trial, Defects(), rng))
        rows.append((f"{number}.c3d", "angry", cell, str(1 + number // 3), "train"))
    write_table(lab, rows)
    words = [lab, "--leave-out", "repetition", "--seeds", 1, "--inducing", 12, "--json"]
    first = run(*words, "--out", tmp_path / "out")
    assert first.exit_code == 0, first.output
    found = json.loads(first.stdout)
    assert found["held_out_trials"] == found["trials"] == 6
    assert list(found["by_fold"]) == ["1", "2"]
    assert all(isinstance(value, float) for values in found["scores"].values() for value in values.values())
    assert found["scores"]["hgpdm"]["palm"] < found["scores"]["mean"]["palm"]
    assert "contact_point_within_90" in found["scores"]["sparse_gp"].keys() - found["scores"]["knn"].keys()
    page = (tmp_path / "out" / "report.html").read_text()
    assert "http" not in page and "<script" not in page
    figures = {path.stem for path in (tmp_path / "out" / "figures").glob("*.png")}
    assert figures >= {"errors", "calibration", "left_out", "by_horizon", "trajectories", "latent_spaces"}
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "out" / "models").iterdir()}
    assert len(kept) == 4
    assert "model 1 of 2, about 1 min for all" in first.stderr
    assert run(*words, "--out", tmp_path / "out").exit_code != 0  # a report that is there stays
    again = json.loads(run(*words, "--out", tmp_path / "out", "--overwrite").stdout)
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "out" / "models").iterdir()} == kept
    assert again["scores"]["hgpdm"]["palm"] == found["scores"]["hgpdm"]["palm"]
