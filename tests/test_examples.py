"""Every example runs, and prints what it promises."""

import runpy
from pathlib import Path

import pytest
from paths import ROOT

import highfive
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


@pytest.mark.slow
def test_read_session_and_train_and_score(run, tmp_path: Path, to_learn: Path) -> None:
    from typer.testing import CliRunner  # noqa: PLC0415

    from highfive.hil.cli.main import app  # noqa: PLC0415

    CliRunner().invoke(app, ["simulate", "--trials", "1", "--no-pictures", "--out", str(tmp_path / "session")])
    assert "1 high fives" in run("read_session.py", tmp_path / "session" / "session.mcap")
    assert "hgpdm       palm at contact" in run("train_and_score.py", to_learn)
