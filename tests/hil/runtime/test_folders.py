"""What is there already stays: every command that writes, whenever it is interrupted, unless --overwrite is said."""

import csv
import inspect
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from multiprocessing import get_context
from pathlib import Path
from typing import get_args, get_type_hints

import numpy as np
import pytest
import typer
from writes_for_ever import write_for_ever

from highfive.hil.cli import main as cli
from highfive.hil.runtime.folders import check_file, next_folder, results_folder
from highfive.hil.sim.people.actors import simulate_pair
from highfive.hil.sim.people.capture import CLEAN, markers_of, record
from highfive.hil.sim.people.grid import CELLS
from highfive.mocap_bridge.files.c3d import read_c3d, write_c3d
from highfive.mocap_bridge.files.trial_table import TABLE, write_table
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.model.errors import HighFiveError
from highfive.model.files import UNFINISHED, write_whole
from highfive.model.hgpdm.checkpoint import Checkpoint

# Nothing that these name is there: a command that names them in its error has looked at them before its results.
FOLDERS = {
    "simulate --out": ["simulate", "--source", "absent.c3d", "--model", "absent.safetensors"],
    "capture --out": ["capture", "--emotion", "bored"],
    "evaluate --out": ["evaluate", "absent", "absent.safetensors"],
    "track --out": ["track", "absent.c3d"],
    "rig play --out": ["rig", "play", "absent"],
    "experiment analyse --out": ["experiment", "analyse", "--counts", "absent.csv"],
}
FILES = {
    "train --out": ["train", "absent"],
    "calibrate subject --out": ["calibrate", "subject", "absent.c3d"],
    "calibrate headset --out": ["calibrate", "headset", "--source", "vicon://127.0.0.1:9"],
    "calibrate latency --out": ["calibrate", "latency", "/dev/ttyUSB99", "--arm"],
    "calibrate servos --out": ["calibrate", "servos", "/dev/ttyUSB99", "--source", "vicon://127.0.0.1:9", "--arm"],
    "calibrate extrinsics --out": [
        *("calibrate", "extrinsics", "absent", "--source", "vicon://127.0.0.1:9", "--plate", "absent.toml")
    ],
    "calibrate room --out": ["calibrate", "room", "--source", "vicon://127.0.0.1:9", "--markers", "a,b,c"],
    "stream --record": ["stream", "vicon://127.0.0.1:9"],
    "bench contact --picture": ["bench", "contact", "--baseline", "absent.json"],
    "rig reach --picture": ["rig", "reach"],
    "rig emulate --plate": ["rig", "emulate", "--faults", "dead"],
    "calibrate show --picture": ["calibrate", "show", "absent.toml"],
}
ENDINGS = {
    "train --out": ".safetensors", "calibrate subject --out": ".toml", "calibrate headset --out": ".toml",
    "calibrate extrinsics --out": ".toml", "calibrate latency --out": ".toml", "calibrate servos --out": ".toml",
    "calibrate room --out": ".toml", "rig emulate --plate": ".toml",
    "stream --record": ".c3d",
}  # fmt: skip
# Options and arguments that name what is read, not written. A new one has to be put into one of the tables.
READ = {
    *("simulate --data", "simulate --rig-file", "simulate --limits", "simulate --estop"),
    *("simulate --calibration", "simulate --camera", "bench locked --model"),
    *("train data", "evaluate paths", "evaluate --windows", "classify-style paths", "observe paths"),
    *("serve file", "view recording", "track file", "track --subject", "calibrate subject file"),
    *("bench model --peer-python", "bench ablation data", "bench tracker --real", "bench tracker --peers-python"),
    *("bench protocols --file", "bench contact --baseline"),
    *(
        "rig emulate --rig",
        "rig scan --rig",
        "rig check --rig",
        "rig configure --rig",
        "rig release --rig",
        "rig play --rig",
    ),
    *("rig follow --rig", "rig follow --limits", "rig follow --calibration", "rig follow --estop", "rig joints --rig"),
    *("rig play session", "rig play --limits", "rig play --estop", "export session", "import files"),
    *("simulate --headset", "simulate --latencies", "calibrate event recording"),
    *("calibrate extrinsics --plate", "calibrate extrinsics --limits", "calibrate extrinsics --rig-file"),
    *("calibrate servos --calibration", "calibrate servos --limits", "calibrate servos --rig-file"),
    *("calibrate servos --estop", "rig check --calibration", "calibrate show files", "calibrate show --rig-file"),
    *("calibrate latency --calibration", "calibrate latency --limits", "calibrate latency --rig-file"),
    *(
        "calibrate latency --estop",
        "calibrate extrinsics --estop",
        "experiment analyse --counts",
        "experiment analyse --trials",
    ),
    *("experiment plan file", "experiment forget --study", "experiment run --simulate-participant"),
    *("experiment run --rig-file", "experiment run --limits", "experiment run --estop", "experiment run --camera"),
    *("experiment run --calibration", "experiment run --latencies", "experiment run --headset"),
    *(
        "experiment analyse --questionnaire",
        "experiment analyse --exclude",
        "experiment analyse --xdf",
        "experiment analyse study",
        "experiment power file",
        "rig play --calibration",
    ),
}
# A folder or a file, as the format has it, or given by what is read: tested where the command is.
ELSEWHERE = {
    "demo --out": "commands/test_demo.py",
    "export --out": "commands/test_export.py",
    "import --to": "commands/test_import.py",
    "calibrate event --out": "commands/test_calibrate_event.py",
    "experiment plan --out": "commands/test_experiment.py",
    "rig draft folder": "commands/rig/test_draft.py",
    "experiment plan --study": "commands/test_experiment.py",
}
LINKS = {"rig emulate --port-link"}
# Read where they are there, made where they are not: tests/calibration/test_placement_file.py.
KEPT = {"simulate --place", "experiment run --place"}

# Added to, and nothing of it is ever replaced: tests/hil/experiments/test_trial_log.py, datasets/test_collection.py.
# Trainings shared by hosts: tests/hil/evaluation/test_shared_work.py. Inputs by their seed: hil/bench/test_fuzz.py.
ADDED_TO = {"experiment run --study", "experiment collect --out", "evaluate --models", "bench fuzz --out"}


def commands(app: typer.Typer, above: str = "") -> Iterator[tuple[str, object]]:
    for command in app.registered_commands:
        assert command.callback is not None
        yield above + (command.name or command.callback.__name__.replace("_", "-")), command.callback
    for group in app.registered_groups:
        assert group.typer_instance is not None
        yield from commands(group.typer_instance, f"{above}{group.name} " if group.name else above)


def named(hint: object) -> bool:
    """Whether a parameter takes paths."""
    return hint is Path or any(named(part) for part in get_args(hint) if not isinstance(part, str))


def paths() -> Iterator[str]:
    """Every option and argument of every command that takes a path."""
    for command, callback in commands(cli.app):
        hints = get_type_hints(callback, include_extras=True)
        for name in inspect.signature(callback).parameters:  # type: ignore[arg-type]
            base, *extras = get_args(hints[name]) or (hints[name],)
            if named(base):
                about = next(extra for extra in extras if hasattr(extra, "param_decls"))
                said = [about.default, *(about.param_decls or ())]  # in Annotated the first name lands there
                option = next((d for d in said if str(d).startswith("--")), f"--{name.replace('_', '-')}")
                yield f"{command} {name if type(about).__name__ == 'ArgumentInfo' else option}"


def test_no_command_writes_where_this_file_does_not_look() -> None:
    assert set(paths()) == READ | LINKS | KEPT | ADDED_TO | FOLDERS.keys() | FILES.keys() | ELSEWHERE.keys()
    for name, tested in ELSEWHERE.items():
        assert "overwrite" in (Path(__file__).parent.parent / tested).read_text(), name
    for command, callback in commands(cli.app):
        writes = any(name.rpartition(" ")[0] == command for name in FOLDERS | FILES | ELSEWHERE)
        assert ("overwrite" in inspect.signature(callback).parameters) == writes, command  # type: ignore[arg-type]


def refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: object) -> str:
    monkeypatch.setattr("sys.argv", ["highfive", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    out, err = capsys.readouterr()
    assert ended.value.code == 2 and out == "" and err.startswith("error: ") and err.count("\n") == 1, err
    return err


def contents(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("name", FOLDERS)
@pytest.mark.parametrize("held", ["notes.txt", TABLE, "models/mine.safetensors", "report.json", ".hidden"])
@pytest.mark.slow
def test_a_folder_that_holds_something_is_refused_before_anything_else(
    name: str, held: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    mine = tmp_path / "lab" / held
    mine.parent.mkdir(parents=True)
    mine.write_bytes(b"somebody's\n")
    option = name.rpartition(" ")[2]
    said = refused(monkeypatch, capsys, *FOLDERS[name], option, "lab")
    assert "lab holds something already; give another --out, or --overwrite" in said
    assert contents(tmp_path) == {mine: b"somebody's\n"}
    said = refused(monkeypatch, capsys, *FOLDERS[name], option, "lab", "--overwrite")  # now it is the input's turn
    assert "absent" in said or "bored" in said
    assert contents(tmp_path) == {mine: b"somebody's\n"}
    refused(monkeypatch, capsys, *FOLDERS[name], option, "new/folder")
    assert not (tmp_path / "new").exists(), "a folder in which nothing is"


@pytest.mark.parametrize("name", FILES)
@pytest.mark.slow
def test_a_file_that_is_there_is_refused_before_anything_else(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    mine = tmp_path / f"mine{ENDINGS.get(name, '.png')}"
    mine.write_bytes(b"somebody's\n")
    option = name.rpartition(" ")[2]
    said = refused(monkeypatch, capsys, *FILES[name], option, mine)
    assert f"mine{mine.suffix} is there already; give another {option}, or --overwrite" in said
    link = mine.with_name(f"link{mine.suffix}")
    link.symlink_to(tmp_path / "elsewhere")
    assert "is there already" in refused(monkeypatch, capsys, *FILES[name], option, link)
    (tmp_path / f"folder{mine.suffix}").mkdir()
    assert "is a folder" in refused(monkeypatch, capsys, *FILES[name], option, f"folder{mine.suffix}", "--overwrite")
    assert contents(tmp_path) == {mine: b"somebody's\n"} and link.is_symlink()


def test_a_link_that_is_no_port_is_not_replaced(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    link = tmp_path / "arm"
    for target in (tmp_path, tmp_path / "absent"):
        link.symlink_to(target)
        assert "which somebody uses" in refused(monkeypatch, capsys, "rig", "emulate", "--port-link", link)
        assert link.readlink() == target
        link.unlink()


def test_only_one_command_writes_to_a_folder_at_a_time(tmp_path: Path) -> None:
    with (
        results_folder(tmp_path / "out"),
        pytest.raises(HighFiveError, match="another command is writing to"),
        results_folder(tmp_path / "out", overwrite=True),
    ):
        pass
    with results_folder(tmp_path / "out"):
        (tmp_path / "out" / f"{UNFINISHED}1-report.html").write_text("what a killed command left")
    with results_folder(tmp_path / "out"):
        pass
    assert next_folder("out", tmp_path).name == "out-1"


def test_files_that_are_none_are_not_replaced(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(HighFiveError, match="is no file"):
        check_file(tmp_path / "pipe", overwrite=True)
    with pytest.raises(HighFiveError, match="/dev/null is no file"):
        check_file(Path("/dev/null"), overwrite=True)


def test_a_full_disk_and_a_name_that_was_taken_meanwhile_leave_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_bytes(b"old")
    with pytest.raises(FileExistsError):
        write_whole(path, b"new", replace=False)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with pytest.raises(OSError):
            write_whole(path, b"new" * 1000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
    assert contents(tmp_path) == {path: b"old"}
    write_whole(path, b"new")
    assert contents(tmp_path) == {path: b"new"}


def test_whenever_it_is_killed_the_file_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "whole"
    write_whole(path, b"\0" * 400_000)
    rng = np.random.default_rng(0)
    for _ in range(8):
        process = get_context("spawn").Process(target=write_for_ever, args=(path,))
        process.start()
        seen = path.stat().st_ino
        while path.stat().st_ino == seen:
            time.sleep(0.001)
        time.sleep(float(rng.uniform(0.0, 0.02)))
        process.kill()
        process.join()
        content = path.read_bytes()
        assert len(content) == 400_000 and len(set(content)) == 1


def test_what_was_set_aside_is_not_written_over(tmp_path: Path) -> None:
    checkpoint = Checkpoint(tmp_path / "m.checkpoint.npz", {})
    for content in (b"first", b"second", b"third"):
        checkpoint.path.write_bytes(content)
        checkpoint.set_aside()
    assert sorted(contents(tmp_path).values()) == [b"first", b"second", b"third"]


def command(*words: object) -> list[str]:
    return [sys.executable, "-m", "highfive.hil.cli.main", *map(str, words)]


def done(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: object) -> str:
    """What a command in this process, which does what it shall, said on standard error."""
    monkeypatch.setattr("sys.argv", ["highfive", *map(str, words)])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 0
    return capsys.readouterr().err


def stopped(number: signal.Signals, after: float, folder: Path, *words: object) -> int:
    """Ends a command so long, s, after it began to write; its exit code."""
    process = subprocess.Popen(command(*words), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        seen = set(folder.iterdir())
        while process.poll() is None and set(folder.iterdir()) == seen:
            time.sleep(0.005)
        time.sleep(after)
        process.send_signal(number)
        return process.wait(60)
    finally:
        process.kill()
        process.wait()


def stopped_capturing(number: signal.Signals, recordings: int, folder: Path, *words: object) -> int:
    """Ends a capture into ``folder`` once it has so many recordings beside the earlier set; its exit code."""
    left = set(folder.glob(f"{UNFINISHED}*"))  # by one that was killed
    process = subprocess.Popen(command(*words), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        while process.poll() is None:
            beside = [path for path in folder.glob(f"{UNFINISHED}*") if path.is_dir() and path not in left]
            if beside and len(list(beside[0].glob("*.c3d"))) >= recordings:
                process.send_signal(number)
                break
            time.sleep(0.002)
        return process.wait(60)
    finally:
        process.kill()
        process.wait()


def visible(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file() and path.name[0] != "."}


@pytest.mark.slow
def test_a_capture_replaces_its_own_and_nobody_elses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Angry, 2 repetitions; then once: what only the first table names is gone, what no table names stays."""
    monkeypatch.setattr("highfive.hil.sim.people.capture.CELLS", CELLS[:2])  # of nine: a row of the table is a row
    out = tmp_path / "data"

    def captured(*words: object) -> str:
        return done(monkeypatch, capsys, "capture", "--emotion", "angry", "--out", out, *words)

    # A table of somebody else, however like ours: what it names is not touched.
    out.mkdir()
    write_table(out, [("angry_A1_1.c3d", "angry", "A1", "1", "train"), ("angry_A1_7.c3d", "angry", "A1", "7", "train")])
    (out / "angry_A1_7.c3d").write_bytes(b"somebody's")
    captured("--repetitions", 2, "--overwrite")
    first = visible(out)
    assert first["angry_A1_7.c3d"] == b"somebody's"
    (out / "mine.c3d").write_bytes(b"mine")
    output = captured("--repetitions", 1, "--seed", 3, "--overwrite")
    assert (
        "2 recordings of the earlier capture removed" in output
        and "left as they are" in output
        and "mine.c3d" in output
    )
    second = visible(out)
    rows = list(csv.DictReader((out / TABLE).read_text().splitlines()))
    assert set(second) == {row["file"] for row in rows} | {TABLE, "mine.c3d", "angry_A1_7.c3d"} and len(rows) == 2
    assert second["mine.c3d"] == b"mine" and second["angry_A1_1.c3d"] != first["angry_A1_1.c3d"]
    assert second["angry_A1_7.c3d"] == b"somebody's"


@pytest.mark.sweep
@pytest.mark.slow(50)
def test_an_interrupted_capture_leaves_the_earlier_set(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "data"
    words = ("capture", "--emotion", "angry", "--repetitions", 1, "--out", out)
    done(monkeypatch, capsys, *words, "--seed", 1)
    old = visible(out)
    half = (len(old) - 1) // 2  # less the table: the other half takes longer than a signal does
    for number, code, instants in ((signal.SIGINT, 1, (0, half)), (signal.SIGKILL, -signal.SIGKILL, (1, half))):
        for recordings in instants:
            assert stopped_capturing(number, recordings, out, *words, "--seed", 2, "--overwrite") == code
            assert visible(out) == old
            assert number == signal.SIGKILL or not list(out.glob(f"{UNFINISHED}*"))
    fresh = tmp_path / "fresh"
    fresh.mkdir()
    assert stopped_capturing(signal.SIGINT, 1, fresh, *words[:-1], fresh) == 1
    assert list(fresh.iterdir()) == []
    done(monkeypatch, capsys, *words, "--seed", 2, "--overwrite")
    new = visible(out)
    assert set(new) == set(old) and new != old and not list(out.glob(f"{UNFINISHED}*"))


@pytest.fixture(scope="module")
def reach(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of the person of a simulated pair."""
    path = tmp_path_factory.mktemp("reach") / "reach.c3d"
    paper, trial = load_marker_set("paper"), simulate_pair("angry", "B2", 0, np.random.default_rng(0))
    pair = record([("human:", markers_of(trial.person, paper), paper)], CLEAN, np.random.default_rng(1))
    write_c3d(path, pair)
    return path


@pytest.mark.sweep
@pytest.mark.slow(50)
def test_an_interrupted_track_leaves_whole_files(
    tmp_path: Path, reach: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Those that are interrupted are processes; those that may end are commands in this one, which has all loaded."""
    out = tmp_path / "tracked"
    words = ("track", reach, "--out", out, "--marker-set", "paper")
    done(monkeypatch, capsys, *words)
    old = visible(out)
    assert set(old) == {"reach_filled.c3d", "angles.csv", "report.json", "report.html"}
    (out / "notes.txt").write_bytes(b"mine")
    done(monkeypatch, capsys, *words, "--no-fit", "--overwrite")
    new = visible(out)
    assert new.pop("notes.txt") == b"mine" and new["angles.csv"] != old["angles.csv"]
    for number, instants in ((signal.SIGINT, (0.0, 0.1)), (signal.SIGKILL, (0.02, 0.4))):
        for after in instants:
            code = stopped(number, after, out, *words, "--overwrite")
            if any(visible(out)[name] != old[name] for name in old if name.endswith((".c3d", ".csv"))):
                assert code == (1 if number == signal.SIGINT else -number)  # it was not done
            assert number != signal.SIGINT or not list(out.rglob(f"{UNFINISHED}*"))
            for name, content in visible(out).items():
                if name.endswith((".c3d", ".csv")):
                    assert content in (old[name], new[name])
                elif name != "notes.txt":  # times of day are in it
                    assert content.strip().endswith((b"}", b"</html>"))
            read_c3d(out / "reach_filled.c3d")
            done(monkeypatch, capsys, *words, "--no-fit", "--overwrite")


def test_a_file_in_the_place_of_a_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("kept")
    for path in (tmp_path / "notes.txt" / "x.glb", tmp_path / "notes.txt" / "deeper" / "x.glb"):
        with pytest.raises(HighFiveError, match=r"notes\.txt is a file and no folder; give another --out"):
            check_file(path, overwrite=True)
