"""Every example runs in a process of its own and prints what it promises; notebooks give the outputs that they hold."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from runpy import run_path

import nbformat
import pytest
from paths import ROOT

import highfive
from highfive.mocap_bridge.files.c3d import write_c3d

EXAMPLES = ROOT / "examples"
SCRIPTS = sorted(path.name for path in EXAMPLES.glob("*.py"))
NOTEBOOKS = ("latent_space", "study", "tracker")
LONGEST_LINES = 40
LARGEST_BYTES = 300_000


@pytest.fixture
def run(tmp_path: Path):
    def call(name: str, *arguments: object) -> str:
        words = [sys.executable, str(EXAMPLES / name), *map(str, arguments)]
        path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
        done = subprocess.run(
            words, cwd=tmp_path, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        assert done.stderr == ""
        return done.stdout

    return call


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recorded") / "person.c3d"
    write_c3d(path, highfive.simulated_person("happy", "B2").recording)
    return path


def test_there_are_ten_short_scripts_and_three_notebooks_and_all_are_listed_and_tried() -> None:
    assert len(SCRIPTS) == 10
    assert sorted(path.stem for path in EXAMPLES.glob("*.ipynb")) == sorted(NOTEBOOKS)
    listed, here = (EXAMPLES / "README.md").read_text(), Path(__file__).read_text()
    for name in SCRIPTS:
        text = (EXAMPLES / name).read_text()
        assert len(text.splitlines()) <= LONGEST_LINES
        said = re.search(r"Takes (\d+) s", text.split('"""')[1])
        assert said, f"{name} does not say how long it takes"
        assert re.search(rf"\[`{name}`\]\({name}\).*\| {said[1]} \|", listed) and f'"{name}"' in here
    for name in NOTEBOOKS:
        assert f"[`{name}.ipynb`]({name}.ipynb)" in listed


def numbers(pattern: str, text: str) -> list[list[float]]:
    """Of each line that fits, the groups as numbers."""
    return [[float(one) for one in found.groups()] for found in re.finditer(pattern, text, re.MULTILINE)]


@pytest.mark.slow
def test_respond(run) -> None:
    rows = numbers(r"^([\d.]+) s before: contact in ([-\d.]+) ± ([\d.]+) s, ([\d.]+) cm", run("respond.py"))
    assert len(rows) >= 6
    left, said, spread, off = rows[-1]
    assert abs(left - said) < 2.0 * spread and off < 3.0
    assert rows[0][3] > 2.0 * off  # it sharpens


@pytest.mark.slow
def test_style_blend(run) -> None:
    rows = re.findall(r"^(.+?) +peak speed ([\d.]+) m/s, way ([\d.]+) m, nearest (\d+) mm", run("style_blend.py"), re.M)
    speed = {name: float(peak) for name, peak, _, _ in rows}
    assert len(rows) == 5 and all(int(nearest) <= 10 for *_, nearest in rows)
    assert speed["100% angry"] > 1.3 * speed["100% neutral"]
    assert speed["50% angry + 50% sad"] not in (speed["100% angry"], speed["100% sad"])


def test_live_source(run, file: Path) -> None:
    assert "1 of 2 markers" in (own := run("live_source.py")) or "2 of 2 markers" in own
    assert re.search(r"frame \d+: 1\d of 16 markers", run("live_source.py", file))


@pytest.mark.slow
def test_track_file(run, file: Path) -> None:
    ((seen, filled),) = numbers(r"^([\d.]+)% of the markers seen, ([\d.]+)% after", run("track_file.py"))
    assert seen < 97.0 and filled == 100.0
    assert "elbow flexion from" in run("track_file.py", file)


def test_read_session(run, tmp_path: Path) -> None:
    out = run("read_session.py")
    assert "recorded with model default.safetensors, 53 joints" in out
    assert out.count("the wrist went") == 4 and out.count("met after") == 4
    from scipy.io import loadmat  # noqa: PLC0415

    assert loadmat(tmp_path / "session.mat")["wrist_1"].shape == (246, 4)


@pytest.mark.slow
def test_export_motion(run, tmp_path: Path) -> None:
    out = run("export_motion.py")
    names = re.findall(r"^(\S+): \d+ frames", out, re.M)
    assert [Path(name).suffix for name in names] == [".bvh", ".glb", ".npz"]
    assert (tmp_path / names[0]).read_text().startswith("HIERARCHY")
    assert (tmp_path / names[1]).read_bytes()[:4] == b"glTF"


@pytest.mark.slow
def test_retarget_arm(run) -> None:
    out = run("retarget_arm.py")
    rows = numbers(
        r"([-+][\d.]+) to ([-+][\d.]+) rad \(may: ([-+][\d.]+) to ([-+][\d.]+)\), ([\d.]+) rad/s \(may: ([\d.]+)", out
    )
    assert len(rows) == 6
    for low, high, lowest, highest, speed, limit in rows:
        assert lowest <= low <= high <= highest and speed <= limit
    ((miss,),) = numbers(r"within (\d+) mm", out)
    assert miss < 30.0


def test_safety_envelope(run) -> None:
    out = run("safety_envelope.py")
    speeds = [row[0] for row in numbers(r"waist +([-\d.]+) rad/s sent", out)]
    assert 0.5 < max(speeds) <= 3.14 and speeds[-1] == 0.0
    assert "catch_up" in out and out.splitlines()[-1].startswith("stopped: waist")


@pytest.mark.slow
def test_analyse_answers(run, tmp_path: Path) -> None:
    ((low, high),) = numbers(r"logit \(95 % ([-+][\d.]+) to ([-+][\d.]+)\)", run("analyse_answers.py"))
    assert low < 0.89 < high  # what was put in: the odds of .85 over those of .70, as a logarithm
    names = {path.stem for path in (tmp_path / "analysis/figures").glob("*.png")}
    assert {"confusions", "effects"} <= names
    own = "participant,condition,emotion,key_resp.keys\nA1,interactive,happy,right\nA1,replay,happy,left\n"
    own += "B2,interactive,angry,left\nB2,replay,angry,left\n"
    (tmp_path / "psychopy.csv").write_text(own)
    assert run("analyse_answers.py", "psychopy.csv").startswith("interactive: ")
    assert "A1,replay,happy,angry" in (tmp_path / "answers.csv").read_text()


@pytest.mark.slow(55)
def test_train_and_score(run, to_learn: Path, tmp_path: Path) -> None:
    scored = dict(re.findall(r"^(\w+) +palm at contact ([\d.]+) cm", run("train_and_score.py", to_learn), re.M))
    assert float(scored["hgpdm"]) < 0.5 * float(scored["mean"])
    assert highfive.load_model(tmp_path / "my_model.safetensors").emotions == ("angry",)


def text_of(notebook: nbformat.NotebookNode) -> list[list[str]]:
    """Of each code cell, what its outputs say; and of a figure that there is one."""
    return [
        [
            str(one.get("text") or ("figure" if "image/png" in one.data else one.data["text/plain"]))
            for one in cell.outputs
        ]
        for cell in notebook.cells
        if cell.cell_type == "code"
    ]


@pytest.mark.slow
@pytest.mark.parametrize("name", NOTEBOOKS)
def test_a_notebook_gives_what_it_holds(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    path = EXAMPLES / f"{name}.ipynb"
    paths = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    monkeypatch.setenv("PYTHONPATH", paths)
    again = run_path(str(ROOT / "docs/make_notebooks.py"))["executed"](path)
    assert text_of(again) == text_of(nbformat.read(path, as_version=4))


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_a_notebook_is_kept_with_its_figures_and_nothing_of_when_and_where(name: str) -> None:
    path = EXAMPLES / f"{name}.ipynb"
    content = path.read_text()
    assert len(content.encode()) <= LARGEST_BYTES
    notebook = nbformat.reads(content, as_version=4)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert sum("figure" in said for said in text_of(notebook)) >= 3
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    assert all(not cell.metadata for cell in notebook.cells) and set(notebook.metadata) == {
        "kernelspec",
        "language_info",
    }
    said = "\n".join("\n".join(part) for part in text_of(notebook))
    assert not re.search(r"/tmp/|/home/|/root/|/work/|\d{4}-\d\d-\d\d|Traceback|Warning", said)


def test_what_executes_notebooks_is_for_developers() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert any(one.startswith("nbclient") for one in project["optional-dependencies"]["dev"])
    assert not any(one.startswith(("nbclient", "ipykernel")) for one in project["dependencies"])
