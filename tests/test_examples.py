"""Every example runs, and prints what it promises."""

import json
import runpy
from pathlib import Path

import matplotlib
import pytest
from matplotlib.figure import Figure
from paths import ROOT
from recorded_trials import record_trial
from trial_results import some_results

import highfive
from highfive.hil.recording.recorder import SessionRecorder
from highfive.hil.trials.summary import SessionSettings
from highfive.mocap_bridge.files.c3d import write_c3d

EXAMPLES = ROOT / "examples"


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path):
    def call(name: str, *arguments: object) -> str:
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr("sys.argv", [name, *map(str, arguments)])
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        return capsys.readouterr().out

    return call


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recorded") / "person.c3d"
    write_c3d(path, highfive.simulated_person("happy", "B2").recording)
    return path


def test_all_of_them_are_listed_and_tried() -> None:
    listed = (EXAMPLES / "README.md").read_text()
    here = Path(__file__).read_text() + (ROOT / "tests/hil/commands/test_own_model.py").read_text()
    for path in EXAMPLES.glob("*.py"):
        assert f"`{path.name}`" in listed
        assert path.name in here


def test_respond(run) -> None:
    assert "contact in" in run("respond.py")


def test_session_tick(run, file: Path) -> None:
    assert "ticks; at contact" in run("session_tick.py")
    assert "ticks; at contact" in run("session_tick.py", file)


def test_live_source(run, file: Path) -> None:
    assert "markers" in run("live_source.py", file)


def test_track_file(run, file: Path) -> None:
    assert "elbow flexion from" in run("track_file.py", file)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("session") / "session.mcap"
    with SessionRecorder(path, SessionSettings(seed=3, model="default", trials=2)) as recorder:
        for result in some_results()[:2]:
            record_trial(recorder, result)
    return path


def test_read_session(run, session: Path) -> None:
    out = run("read_session.py", session)
    assert "recorded with model default, 53 joints" in out
    assert out.count("the wrist went") == 2 and "met after" in out


def test_the_notebook_runs_cell_by_cell(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    matplotlib.use("agg")
    cells = json.loads((EXAMPLES / "read_session.ipynb").read_text())["cells"]
    names: dict[str, object] = {}
    for cell in cells:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == []  # no results are kept in the repository
            source = "".join(cell["source"]).replace("out/session-1/session.mcap", str(session))
            exec(compile(source, cell["id"], "exec"), names)
    out = capsys.readouterr().out
    assert ("neutral" in out and "time" in out) or "pandas" in out
    figure = names["figure"]
    assert isinstance(figure, Figure) and len(figure.axes[0].lines) >= 2


@pytest.mark.slow
def test_train_and_score(run, to_learn: Path) -> None:
    assert "hgpdm       palm at contact" in run("train_and_score.py", to_learn)
