"""The command line: bad input gives one line and exit code 2; --json gives one object."""

from pathlib import Path
from typing import Any

import ezc3d
import numpy as np
import pytest
import typer

from highfive.hil.cli import main as cli
from highfive.hil.cli.bench import _run
from highfive.hil.commands.bench import Measured
from highfive.mocap_bridge.files.trial_table import write_table


def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    monkeypatch.setattr("sys.argv", ["highfive", *map(str, words)])
    with pytest.raises(SystemExit) as exit_info:
        cli.main()
    out, err = capsys.readouterr()
    code = exit_info.value.code
    return 0 if code is None else int(code), out, err


@pytest.fixture
def highfive(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path):
    monkeypatch.chdir(tmp_path)
    return lambda *words: run(monkeypatch, capsys, *words)


def test_arm_says_which_arm_where_a_name_follows_and_else_that_a_real_one_may_move(highfive: Any) -> None:
    """Which arm it is lets nothing move."""
    refused = highfive("simulate", "--rig", "/dev/ttyUSB99", "--arm", "wx250s")
    assert_one_line(refused, "only with --arm", "up to 0.8 m")
    assert_one_line(highfive("simulate", "--rig", "/dev/ttyUSB99", "--arm=wx250s"), "only with --arm")
    assert_one_line(highfive("rig", "play", "absent", "--port", "/dev/ttyUSB99", "--arm", "absent2"), "unexpected")
    # Said twice it is both: now the port is looked at.
    both = ("--arm", "openmanipulator_x", "--arm", "--nobody-near")
    assert_one_line(highfive("rig", "play", "absent", "--port", "/dev/ttyUSB99", *both), "absent")
    assert_one_line(highfive("simulate", "--rig", "emulated", "--arm=nonsense"), "no arm 'nonsense'")
    assert_one_line(highfive("simulate", "--arm", "wx250s"), "--arm is about an arm, and none takes part")
    assert_one_line(highfive("rig", "check", "/dev/ttyUSB99", "--arm", "nonsense"), "no arm 'nonsense'")
    assert_one_line(highfive("rig", "check", "/dev/ttyUSB99", "--arm", "wx250s"), "/dev/ttyUSB99")


def errors(err: str) -> list[str]:
    return [line for line in err.splitlines() if line.startswith("error:")]


def assert_one_line(result: tuple[int, str, str], *parts: str) -> None:
    code, out, err = result
    assert code == 2
    assert out == ""
    assert "Traceback" not in err
    assert len(errors(err)) == 1
    assert len([line for line in err.splitlines() if line.strip()]) == 1
    for part in parts:
        assert part in err


def c3d(path: Path, labels: list[str], unit: str = "mm", rate: float = 120.0, scale: float = 1.0) -> Path:
    """A C3D file by the independent library, of points that a body could have."""
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["UNITS"]["value"] = [unit]
    file["parameters"]["POINT"]["RATE"]["value"] = [rate]
    file["parameters"]["POINT"]["LABELS"]["value"] = labels
    points = np.ones((4, len(labels), 30))
    rng = np.random.default_rng(0)
    points[:3] = scale * (np.array([0.0, 0.0, 1000.0])[:, None, None] + 400.0 * rng.uniform(size=(3, len(labels), 1)))
    file["data"]["points"] = points
    file.write(str(path))
    return path


def test_unknown_emotion_lists_the_known(highfive) -> None:
    assert_one_line(highfive("simulate", "--emotion", "bored"), "bored", "happy", "sad")
    assert_one_line(highfive("capture", "--emotion", "bored", "--out", "x"), "bored", "happy")


def test_how_a_style_is_written_is_said_and_its_weights_are_named(highfive) -> None:
    assert_one_line(highfive("simulate", "--style", "angry:0.5,neutral:0.5"), "write angry=0.5")
    assert_one_line(highfive("simulate", "--style", "angry=0.5,sad=0.4"), "angry=0.5,sad=0.4 sum to 0.9")
    assert_one_line(highfive("simulate", "--style", "angry=0.5,angry=0.5"), "angry is there twice")
    assert_one_line(highfive("simulate", "--style", "angry=nan"), "'nan' is no number")
    assert_one_line(highfive("simulate", "--style", "angry=1e308,happy=1e308"), "none may be above 1")


def test_two_people_for_one_option_are_refused(highfive) -> None:
    words = ("simulate", "--source", "absent.c3d")
    assert_one_line(highfive(*words, "--human", "A", "--person", "B"), "--human A and --person B", "give one of them")
    assert_one_line(highfive(*words, "--human=A", "--human", "B"), "--human A and --human B")
    assert_one_line(highfive("train", "x", "--human-set", "a", "--person-set=b"), "--human-set a and --person-set b")
    assert_one_line(highfive(*words, "--human", "A", "--person", "A"), "absent.c3d")


def test_an_arm_that_may_not_move_is_refused_before_the_session_is_read(highfive) -> None:
    assert_one_line(highfive("rig", "play", "absent", "--port", "/dev/ttyUSB99"), "only with --arm")


@pytest.mark.parametrize("style", ["angry=0.5,neutral=0.4", "angry=-0.5,neutral=1.5", "angry=x", "bored=1"])
def test_style_weights_that_are_none(highfive, style: str) -> None:
    assert_one_line(highfive("simulate", "--style", style, "--trials", "1"))


def test_unknown_cell_option_and_command(highfive) -> None:
    assert_one_line(highfive("simulate", "--cell", "D4"), "D4", "A1")
    assert_one_line(highfive("simulate", "--trials", "none"), "--trials")
    assert_one_line(highfive("simulate", "--nonsense"), "--nonsense")
    assert_one_line(highfive("wave"), "wave")


def test_what_is_wrong_names_the_help_of_the_command_that_was_asked(highfive) -> None:
    assert_one_line(highfive("simulate", "--trials", "0"), "it should be greater", "see highfive simulate --help")
    assert_one_line(highfive("rig", "scan", "--absent"), "No such option", "see highfive rig scan --help")
    assert_one_line(highfive("rig", "play", "x.mcap", "--port"), "requires an argument", "see highfive rig play --help")
    assert_one_line(highfive("absent"), "No such command", "see highfive --help")


def test_a_name_that_is_too_long_is_one_line(highfive) -> None:
    assert_one_line(highfive("simulate", "--trials", "1", "--out", "a" * 300), "File name too long")


@pytest.mark.slow
@pytest.mark.parametrize("value", ["inf", "nan", "-1", "1e9"])
@pytest.mark.parametrize(
    ("bench", "option"),
    [
        ("session", "--minutes"),
        ("recording", "--hours"),
        ("tick", "--seconds"),
        ("bus", "--seconds"),
        ("protocols", "--seconds"),
        ("view", "--seconds"),
        ("webcam", "--hold"),
        ("webcam", "--latency"),
        ("rates", "--rate"),
        ("latency", "--latency"),
    ],
)
def test_what_cannot_be_measured_for_so_long_is_refused(highfive, bench: str, option: str, value: str) -> None:
    assert_one_line(highfive("bench", bench, option, value))


@pytest.mark.parametrize(
    ("figures", "code"),
    [
        ({"broken": [], "stopped": "", "rig": {"stops": 0}}, 0),
        ({"broken": [{"law": "closing speed"}]}, 1),
        ({"stopped": "servo 4 does not answer"}, 1),
        ({"stopped": [{"arm": 3, "why": "servo 4 does not answer"}]}, 1),
        ({"twin": {}, "rig": {"stops": 1}}, 1),
    ],
)
def test_a_bench_that_broke_a_law_or_stopped_an_arm_ends_with_one(figures: dict[str, Any], code: int) -> None:
    bench = typer.Typer()
    bench.command()(lambda: _run(False, lambda bar: Measured(figures, lambda found: None)))
    assert (bench(args=[], standalone_mode=False) or 0) == code


def test_model_files_that_are_none(highfive, tmp_path: Path) -> None:
    assert_one_line(highfive("simulate", "--model", "absent.safetensors"), "absent.safetensors")
    for name, content in (("empty.safetensors", b""), ("text.safetensors", b"not a model")):
        (tmp_path / name).write_bytes(content)
        assert_one_line(highfive("simulate", "--model", name), name)


def test_a_port_that_was_not_named(highfive) -> None:
    for command in ("check", "configure", "release"):
        assert_one_line(highfive("rig", command), "Missing argument 'PORT'. (highfive rig scan lists ports;")


@pytest.mark.slow
def test_sources_that_are_none(highfive, tmp_path: Path) -> None:
    arm = ["human:RSHO", "human:RELB"]
    whole = c3d(tmp_path / "whole.c3d", arm).read_bytes()
    (tmp_path / "empty.c3d").write_bytes(b"")
    (tmp_path / "cut.c3d").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "text.c3d").write_text("this is no C3D file\n" * 100)
    for name in ("mine.bvh", "mine.trc", "mine.csv"):
        (tmp_path / name).write_text("HIERARCHY\n")
        for command in (["track"], ["simulate", "--source"]):
            assert_one_line(highfive(*command, name), f"{name} is not a C3D file", f"highfive import --human {name}")
    c3d(tmp_path / "unit.c3d", arm, unit="furlong")
    c3d(tmp_path / "large.c3d", arm, scale=1000.0)
    for name in ("absent", "empty", "cut", "text", "unit", "large"):
        assert_one_line(highfive("simulate", "--source", f"{name}.c3d", "--human", "human"), name)
    assert_one_line(highfive("simulate", "--source", "whole.c3d", "--human", "human"), "RSHO")
    assert_one_line(highfive("simulate", "--source", "whole.c3d", "--human", "Eve"), "Eve", "human")
    assert_one_line(highfive("simulate", "--source", "whole.c3d", "--person", "Eve"), "Eve", "human")
    assert_one_line(highfive("track", "whole.c3d", "--human", "Eve"), "Eve", "human")
    assert_one_line(highfive("simulate", "--source", "whole.c3d", "--human", "human", "--marker-set", "none"), "none")
    assert not list(tmp_path.glob("out*/session*"))


def test_data_folders_that_are_none(highfive, tmp_path: Path) -> None:
    assert_one_line(highfive("train", "absent"), "absent", "trials.csv")
    folder = tmp_path / "data"
    folder.mkdir()
    (folder / "trials.csv").write_text("recording,emotion\na.c3d,happy\n")
    assert_one_line(highfive("train", folder), "file is missing")
    write_table(folder, [])
    assert_one_line(highfive("train", folder), "no trial")
    write_table(folder, [("a.c3d", "happy", "A1", "1", "training")])
    assert_one_line(highfive("train", folder), "training")
    write_table(folder, [("a.c3d", "happy", "A1", "1", "train")])
    assert_one_line(highfive("train", folder), "a.c3d")
    (tmp_path / "there.safetensors").write_bytes(b"kept")
    assert_one_line(highfive("train", folder, "--out", "there.safetensors"), "there.safetensors")
    assert (tmp_path / "there.safetensors").read_bytes() == b"kept"


def test_a_recording_is_never_overwritten(highfive, tmp_path: Path) -> None:
    (tmp_path / "done").mkdir()
    (tmp_path / "done" / "session.mcap").write_bytes(b"kept")
    assert_one_line(highfive("simulate", "--out", "done", "--trials", "1"), "done", "--out")
    assert (tmp_path / "done" / "session.mcap").read_bytes() == b"kept"
