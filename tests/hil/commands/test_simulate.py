"""The whole of ``highfive simulate``: figures, files, options, and what is left when it is stopped."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from disk import files_no_larger_than
from paths import ROOT

from highfive.hil.cli import main as cli
from highfive.hil.commands.session_lines import print_session
from highfive.hil.commands.simulate import SimulateOptions, simulate
from highfive.hil.recording.recording import SessionRecording, read_recording
from highfive.hil.runtime.console import progress_bars
from highfive.hil.sim.people.actors import simulate_pair
from highfive.hil.sim.people.capture import Defects, record_pair
from highfive.hil.trials.summary import SessionSettings, summarise, without_timings
from highfive.mocap_bridge.files.c3d import write_c3d
from highfive.model.errors import HighFiveError

HIGH_FIVE = "high_five/cmu_20_21_11_high_five.c3d"
PAIR: dict[str, Any] = {"trials": 2, "seed": 1, "emotions": ("happy", "angry"), "cells": ("B2",)}
PROMISED = {
    "trials", "contact_error_mm", "uncorrected_error_mm", "palm_angle_deg", "unwanted_contacts", "out_of_reach",
    "tick_ms", "seed", "model",
}  # fmt: skip


def session(folder: Path, **options: Any) -> tuple[dict[str, Any], SessionRecording]:
    """Summary and recording of a session without pictures."""
    with progress_bars() as bar:
        summary = simulate(SimulateOptions(pictures=False, **options), folder, bar)
    return summary, read_recording(folder / "session.mcap")


def trajectories(recording: SessionRecording) -> dict[str, np.ndarray]:
    """All numbers of what was answered, played and seen."""
    found = {topic: np.array([_numbers(m.data) for m in recording.channels[topic]]) for topic in ("/person",)}
    for topic in ("/generated", "/avatar"):
        found[topic] = np.array([[*p.root_in_world, *p.quaternions.ravel()] for p in recording.poses(topic)[1]])
    return found


def _numbers(values: Any) -> list[float]:
    if isinstance(values, dict):
        values = list(values.values())
    return [x for value in values for x in _numbers(value)] if isinstance(values, list) else [float(values)]


@pytest.fixture(scope="module")
def captured_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A C3D file of one high five, as a lab would have recorded it: nothing has to be simulated to replay it."""
    rng = np.random.default_rng(4)
    path = tmp_path_factory.mktemp("lab") / "pair.c3d"
    write_c3d(path, record_pair(simulate_pair("happy", "B2", 0, rng), Defects(), rng))
    return path


@pytest.fixture(scope="module")
def corrected(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], SessionRecording]:
    return session(tmp_path_factory.mktemp("corrected") / "new" / "folder", **PAIR)


def test_palms_meet_and_the_recording_tells_the_same(corrected: tuple[dict[str, Any], SessionRecording]) -> None:
    summary, recording = corrected
    assert summary["trials"] == summary["planned"] == 2 and not summary["interrupted"]
    assert summary["missed"] == 0 and summary["out_of_reach"] == 0
    assert summary["contact_error_mm"]["max"] <= 5.0 and summary["palm_angle_deg"]["max"] <= 5.0
    assert summary["uncorrected_error_mm"]["median"] > summary["contact_error_mm"]["max"]
    assert recording.complete and recording.settings["seed"] == 1
    for row, contact in zip(summary["rows"], recording.channels["/contact"], strict=True):
        assert 1e3 * contact.data["distance"] == pytest.approx(row["contact_error_mm"], abs=0.02)
        assert contact.data["met"] == row["met"]


@pytest.mark.slow
def test_a_seed_gives_the_same_session_bit_for_bit(
    corrected: tuple[dict[str, Any], SessionRecording], tmp_path: Path
) -> None:
    first, again = corrected, session(tmp_path / "again", **PAIR)
    assert without_timings(again[0]) == without_timings(first[0])
    ours, theirs = trajectories(again[1]), trajectories(first[1])
    for topic in ours:
        np.testing.assert_array_equal(ours[topic], theirs[topic])
    contacts = [[m.data for m in recording.channels["/contact"]] for _, recording in (first, again)]
    assert contacts[0] == contacts[1]


@pytest.mark.slow
def test_another_seed_is_another_person_and_without_correction_palms_are_further_apart(
    corrected: tuple[dict[str, Any], SessionRecording], tmp_path: Path
) -> None:
    summary, recording = session(tmp_path / "raw", **{**PAIR, "seed": 2, "trials": 1}, correct=False)
    assert summary["corrected"] is False
    assert summary["contact_error_mm"]["max"] == pytest.approx(summary["uncorrected_error_mm"]["max"], rel=1e-4)
    assert summary["contact_error_mm"]["max"] > 10.0 * corrected[0]["contact_error_mm"]["max"]
    played = trajectories(recording)
    np.testing.assert_allclose(played["/avatar"], played["/generated"], atol=1e-9)
    count = min(len(played["/person"]), 60)
    other = trajectories(corrected[1])["/person"][:count]
    assert np.abs(played["/person"][:count] - other).max() > 1e-3


@pytest.mark.slow
def test_physics_feels_the_palms_meet_in_a_mixed_style(tmp_path: Path, captured_file: Path) -> None:
    style = {"angry": 0.5, "neutral": 0.5}
    summary, recording = session(
        tmp_path / "physics", source=str(captured_file), human="human", physics=True, style=style
    )
    assert summary["physics"] is True and summary["style"] == style and summary["trials"] == 1
    assert summary["peak_force_n"]["max"] > 0.0
    assert recording.settings["style"] == style


def test_style_on_the_command_line_and_nonsense_in_it() -> None:
    assert cli._style("angry=0.5,neutral=0.5") == {"angry": 0.5, "neutral": 0.5}
    assert cli._style("sad") == {"sad": 1.0}
    with pytest.raises(HighFiveError, match=r"half.*angry=0\.5"):
        cli._style("angry=half")


@pytest.mark.slow
def test_a_disk_that_fills_up_ends_the_recording_and_not_the_session(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path, captured_file: Path
) -> None:
    words = ["--source", str(captured_file), "--human", "human", "--no-pictures", "--out", str(tmp_path / "full")]
    monkeypatch.setattr("sys.argv", ["highfive", "simulate", *words])
    with files_no_larger_than(600_000), pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 1
    err = capsys.readouterr().err
    lines = [line for line in err.splitlines() if "make room" in line]
    assert "Traceback" not in err
    assert len(lines) == 1  # as it happens
    assert "session.mcap" in lines[0] and "no more is recorded" in lines[0]
    recording = read_recording(tmp_path / "full" / "session.mcap")
    assert not recording.complete and len(recording.channels["/avatar"]) > 0
    report = json.loads((tmp_path / "full" / "report.json").read_text())
    assert report["trials"] == report["planned"] and "session.mcap" in report["unrecorded"]
    assert report["unrecorded"] in report["warnings"]


def start(*words: object, **environment: str) -> subprocess.Popen[str]:
    """``highfive`` as a process of its own, in a group of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "highfive.hil.cli.main", *map(str, words)],
        cwd=ROOT,
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # A process started in the background ignores Ctrl-C, and so would ours if the tests run in one.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
    )


def stop(process: subprocess.Popen[str], number: signal.Signals, started: Callable[[], bool]) -> tuple[str, str]:
    """Sends a signal, as a terminal does to the whole group, once it has ``started``; what it wrote."""
    with process:
        while process.poll() is None and not started():
            time.sleep(0.01)
        assert process.poll() is None, process.communicate()
        os.killpg(process.pid, number)
        return process.communicate()


@pytest.mark.slow(15)
def test_ctrl_c_leaves_a_finished_report_and_a_kill_leaves_whole_chunks(tmp_path: Path, captured_file: Path) -> None:
    emotions = [word for emotion in ("happy", "sad") * 20 for word in ("--emotion", emotion)]
    words = ["--source", captured_file, "--human", "human", "--no-pictures", "--json", *emotions]
    folders = [tmp_path / "interrupted", tmp_path / "killed"]
    processes = [start("simulate", "--out", folder, *words) for folder in folders]  # both at once: a core each
    (out, err), _ = (
        stop(process, number, lambda path=folder / "session.mcap": path.exists() and path.stat().st_size > 2_000_000)
        for process, folder, number in zip(processes, folders, (signal.SIGINT, signal.SIGKILL), strict=True)
    )
    assert processes[0].returncode == 1
    assert "Traceback" not in err and "Traceback" not in out
    summary = json.loads(out)
    assert summary["interrupted"] is True
    assert 1 <= summary["trials"] < summary["planned"] == 40
    assert json.loads((folders[0] / "report.json").read_text())["trials"] == summary["trials"]
    assert "interrupted" in (folders[0] / "report.html").read_text(encoding="utf-8")
    assert len(read_recording(folders[0] / "session.mcap").channels["/contact"]) >= summary["trials"]
    killed = read_recording(folders[1] / "session.mcap")
    assert not killed.complete
    assert len(killed.channels["/contact"]) >= 1
    times, poses = killed.poses()
    assert len(poses) == len(times) and np.all(np.diff(times) > 0.0)


@pytest.mark.slow
def test_ctrl_c_while_other_processes_work_is_one_line(tmp_path: Path) -> None:
    process = start("capture", "--emotion", "angry", "--out", tmp_path / "data")
    out, err = stop(process, signal.SIGINT, lambda: any((tmp_path / "data").rglob("*.c3d")))
    assert process.returncode == 1 and out == ""
    assert "Traceback" not in err
    assert err.splitlines()[-1] == "interrupted"
    assert not (tmp_path / "data").exists()


def test_ctrl_c_while_a_session_compiles_leaves_nothing_in_the_way(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, captured_file: Path
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("highfive.hil.commands.simulate._session", interrupted)
    with pytest.raises(KeyboardInterrupt):
        session(tmp_path / "out", source=str(captured_file), human="human")
    assert not (tmp_path / "out").exists()


def test_a_session_in_which_nothing_was_finished_is_reported_without_figures(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    print_session(
        summarise([], SessionSettings(seed=0, model="m", trials=8, source="qtm://here"), interrupted=True), tmp_path
    )
    said = capsys.readouterr().out
    assert "0 high fives with a live person" in said and "interrupted" in said


def test_figures_of_the_arm_stand_below_those_of_the_session(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    summary = summarise([], SessionSettings(seed=0, model="m", trials=2, source="qtm://here"))
    arm = {
        "trials": 3, "broken_off": 1, "unreachable": ["B2"], "missed": 1, "missed_trials": ["sad A1"], "hand_lost": [],
        "cycles": 90, "missed_cycles": 0,
        "stopped": "told to", "error_mm": {"median": 2.0, "max": 3.0}, "time_error_ms": {"median": 2.0, "max": 3.0},
    }  # fmt: skip
    print_session({**summary, "arm": arm}, tmp_path)
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("  ")]
    assert len(lines) == 7
    assert all(line[27] == " " and line[28] != " " for line in lines), lines


@pytest.mark.slow
def test_without_opengl_it_runs_as_promised_and_says_that_pictures_were_left_out(
    tmp_path: Path, captured_file: Path
) -> None:
    folder = tmp_path / "blind"
    words = ("--source", captured_file, "--human", "human", "--trials", 1, "--out", folder, "--json")
    with start("simulate", *words, MUJOCO_GL="disable") as process:
        out, err = process.communicate()
    assert process.returncode == 0 and "Traceback" not in err
    summary = json.loads(out)
    assert out.count("\n") == 1 and set(summary) >= PROMISED
    for name in ("contact_error_mm", "uncorrected_error_mm"):
        assert set(summary[name]) >= {"median", "max", "by_emotion"}
    assert set(summary["tick_ms"]) >= {"p50", "p99", "max"}
    assert summary["trials"] == 1 and summary["source"] == "pair.c3d" and not summary["simulated"]
    assert json.loads((folder / "report.json").read_text())["contact_error_mm"] == summary["contact_error_mm"]
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "MUJOCO_GL=disable switches OpenGL off" in page and "pair.c3d" in page and 'src="http' not in page
    assert not list(folder.glob("*.mp4"))


@pytest.mark.data
@pytest.mark.parametrize(("human", "other"), [("A", "B"), pytest.param("B", "A", marks=pytest.mark.slow)])
@pytest.mark.slow
def test_a_real_hand_is_met_or_said_to_be_out_of_reach(
    recordings: Path, tmp_path: Path, human: str, other: str
) -> None:
    summary, recording = session(tmp_path / "real", source=str(recordings / HIGH_FIVE), human=human)
    assert summary["trials"] == 4 and not summary["simulated"]
    far = {entry["trial"]: entry["distance_mm"] for entry in summary["out_of_reach_trials"]}
    for row in summary["rows"]:
        assert row["contact_error_mm"] <= 5.0 or far[row["trial"]] == row["contact_error_mm"]
        # The two real palms touched; their centres are nearer than two hands are wide.
        assert 0.0 < row["other_error_mm"] < 150.0
        assert row["notes"]
    assert len(recording.channels["/contact"]) == 4


@pytest.mark.data
def test_a_recording_without_an_arm_says_what_is_missing_and_what_there_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], recordings: Path, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    path = str(recordings / "markers" / "markers_analogs.c3d")
    cases = {
        (): ("boite, Daphnee", "say which"),
        ("--human", "boite"): ("no marker set fits", "gauche_ext", "paper", "plug_in_gait"),
        ("--human", "Daphnee", "--marker-set", "paper"): ("needs", "RFIN", "RMC5", "has", "ASISr"),
    }
    for words, said in cases.items():
        monkeypatch.setattr("sys.argv", ["highfive", "simulate", "--source", path, *words])
        with pytest.raises(SystemExit) as end:
            cli.main()
        out, err = capsys.readouterr()
        assert end.value.code == 2 and out == ""
        lines = [line for line in err.splitlines() if line.strip()]
        assert len(lines) == 1 and all(part in lines[0] for part in said)
    assert not list(tmp_path.iterdir())
