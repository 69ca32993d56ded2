"""A model of the user's own in ``simulate`` and ``evaluate``."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from paths import ROOT
from typer.testing import CliRunner

from highfive.hil.cli.main import app
from highfive.hil.commands import simulate as command
from highfive.hil.runtime.console import Advance
from highfive.model.errors import HighFiveError
from highfive.model.hgpdm import presets
from highfive.model.hgpdm.presets import DEFAULT
from highfive.model.hgpdm.store import load_model, save_model

NEIGHBOURS = f"{ROOT / 'examples' / 'own_model' / 'nearest_neighbours.py'}:fit"
MODELS = """
from reaction_models import Standing, misshapen, raises, sleeps, standing
stands, breaks, grows, dozes = Standing(), Standing(raises), Standing(misshapen), Standing(sleeps)
foreign = Standing(skeleton_hash="ffff")
number = 7
def learns(trials): raise ValueError("too few\\ntrials")
def gives_nothing(trials): return None
played = []
def second(n):
    played.append(n)
    if n == 1: second.trials += 1
    return raises(n) if second.trials > 2 else standing(n)
second.trials = 0
later = Standing(second)
"""


@pytest.fixture
def models(tmp_path: Path) -> Path:
    file = tmp_path / "my_models.py"
    file.write_text(MODELS)
    return file


def simulate(folder: Path, *arguments: object):
    words = ["simulate", "--out", folder, "--no-pictures", *arguments]
    return CliRunner().invoke(app, list(map(str, words)), catch_exceptions=True)


@pytest.mark.slow
def test_it_is_played_and_reported(tmp_path: Path, models: Path) -> None:
    result = simulate(tmp_path / "out", "--model", f"{models}:stands", "--trials", 1, "--json")
    summary = json.loads(result.stdout)
    assert summary["model"] == f"{models}:stands"
    assert len(summary["rows"]) == 1
    assert "my_models.py:stands" in (tmp_path / "out" / "report.html").read_text()
    assert (tmp_path / "out" / "session.mcap").is_file()


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("breaks", "reaction_models.Standing: step raised KeyError: 'elbow'"),
        ("grows", "reaction_models.Standing: joints has shape (160,); expected (159,)"),
        ("dozes", "reaction_models.Standing took 7"),
        ("number", "my_models.py:number is a int; expected a function"),
        ("nobody", "AttributeError"),
        ("learns", "learns from trials; give a data folder (--data DIR)"),
    ],
)
@pytest.mark.slow
def test_one_that_fails_is_named_in_one_line(tmp_path: Path, models: Path, name: str, says: str) -> None:
    result = simulate(tmp_path / "out", "--model", f"{models}:{name}", "--trials", 1)
    assert says in str(result.exception)
    assert "\n" not in str(result.exception)


@pytest.mark.parametrize("own", [True, False])
def test_one_of_another_skeleton_is_refused_before_there_are_people(tmp_path: Path, models: Path, own: bool) -> None:
    file, begun = tmp_path / "foreign.safetensors", list[str]()
    save_model(replace(load_model(), skeleton_hash="ffff"), file)

    def bar(title: str, total: int) -> Advance:
        begun.append(title)
        return lambda note="", done=None: None

    options = command.SimulateOptions(model=f"{models}:foreign" if own else file, trials=1)
    with pytest.raises(HighFiveError, match=r"foreign.* for skeleton '?ffff'?, .*[0-9a-f]{16}"):
        command.simulate(options, tmp_path / "out", bar)
    assert begun == [] and not (tmp_path / "out").exists()


@pytest.mark.slow
def test_one_that_fails_later_ends_the_session_with_its_report(tmp_path: Path, models: Path) -> None:
    result = simulate(tmp_path / "out", "--model", f"{models}:later", "--trials", 2)
    assert result.exit_code == 1
    assert "high five 2 was broken off and does not count" in result.output
    assert "step raised KeyError: 'elbow'" in result.output
    assert "interrupted" in (tmp_path / "out" / "report.html").read_text()


def test_data_without_a_model_that_learns_is_refused(tmp_path: Path) -> None:
    result = simulate(tmp_path / "out", "--data", tmp_path, "--trials", 1)
    assert "--data is what a model of your own learns from" in str(result.exception)


@pytest.mark.slow(50)
@pytest.mark.usefixtures("hurried")
def test_nearest_neighbours_learn_are_played_and_stand_in_the_table(
    tmp_path: Path, to_learn: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside ours, of which nothing is asked here: they learn in a hurry."""
    monkeypatch.setitem(presets.PRESETS, "small", replace(DEFAULT, name="small", iterations=30, points=600))
    result = simulate(tmp_path / "out", "--model", NEIGHBOURS, "--data", to_learn, "--trials", 2, "--json")
    rows = json.loads(result.stdout)["rows"]
    assert [row["met"] for row in rows] == [True, True]
    words = [
        "evaluate",
        to_learn,
        "--also",
        NEIGHBOURS,
        "--seeds",
        1,
        "--preset",
        "small",
        "--inducing",
        12,
        "--json",
        "--out",
        tmp_path / "scored",
    ]
    scored = CliRunner().invoke(app, list(map(str, words)))
    assert scored.exit_code == 0, scored.output
    scores = json.loads(scored.stdout)["scores"]
    assert scores[NEIGHBOURS]["palm_at_contact"] < scores["mean"]["palm_at_contact"]
    assert scores[NEIGHBOURS]["step_ms_p50"] > 0.0
    assert "nearest_neighbours.py" in (tmp_path / "scored" / "report.html").read_text()
