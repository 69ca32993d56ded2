"""``highfive experiment run``: from the command line, against kills, two at once, and with an avatar."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import failing
from helpers.experiments import study, written
from lsl_company import Hearing, Stimuli

from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.commands.experiment_options import RunOptions
from highfive.hil.commands.experiment_run import run
from highfive.hil.commands.session_outputs import published
from highfive.hil.commands.shown_again import RecordedMotion, recorded_motion
from highfive.hil.commands.simulate_options import PageOptions, SimulateOptions
from highfive.hil.commands.typed_commands import command_of
from highfive.hil.experiments.study import stored_plan
from highfive.hil.experiments.trial_log import read_session
from highfive.hil.recording.recording import SessionRecording, read_recording
from highfive.hil.view.commands import Command
from highfive.mocap_bridge.sources.lsl import configure
from highfive.model.errors import HighFiveError

OBSERVER = "seed = 1\n[interactive]\nright = 0.8\n[replay]\nright = 0.7\n"
COMMAND = [sys.executable, "-m", "highfive.hil.cli.main", "experiment", "run", "--no-avatar", "--json"]

fails = failing("experiment", "run")


def no_bar(label: str, total: int):
    return lambda note="", done=None: None


@pytest.fixture
def observer(tmp_path: Path) -> Path:
    path = tmp_path / "observer.toml"
    path.write_text(OBSERVER, encoding="utf-8")
    return path


def options(folder: Path, observer: Path | None, **more: object) -> RunOptions:
    return RunOptions(folder, "P01", simulated=observer, dry=observer is not None, **more)  # pyright: ignore


def test_a_simulated_participant_takes_part_and_her_rows_are_marked(tmp_path: Path, observer: Path) -> None:
    folder = study(tmp_path)
    result = run(options(folder, observer), no_bar)
    rows = read_session(folder, "P01", 1).rows
    assert result["left"] == 0 and result["asked"] == len(rows) == len(stored_plan(folder, "P01").trials)
    assert all(row.simulated and row.software != "unknown" for row in rows)


def test_what_is_wrong_is_said_before_anything_is_asked(tmp_path: Path, observer: Path) -> None:
    folder = study(tmp_path)
    (tmp_path / "morph").mkdir()
    acts = study(tmp_path / "morph", "morph", {"participants = 16": "participants = 1"})
    for given, words in (
        (options(acts, None, consent="2"), "signed consent form 2, expected version 1"),
        (options(acts, None), "signed consent form none"),
        (options(folder, observer, language="fr"), "instructions in de, en"),
        (RunOptions(folder, "P09", simulated=observer, dry=True), "P09 has no plan"),
        (RunOptions(tmp_path, "P01", simulated=observer, dry=True), "is no study"),
        (RunOptions(folder, "P01", dry=True, consent="1"), "--simulate-participant"),
        (options(folder, observer, resume=True), "no session 1 to resume"),
        (RunOptions(folder, "P01", consent="1"), "shows clips: give --clips DIR"),
    ):
        with pytest.raises(HighFiveError, match=words):
            run(given, no_bar)
    assert not list(tmp_path.rglob("trials.jsonl"))


def test_a_second_start_is_refused_and_resume_asks_nothing_more(tmp_path: Path, observer: Path) -> None:
    folder = study(tmp_path)
    run(options(folder, observer), no_bar)
    with pytest.raises(HighFiveError, match=r"has session 1 already.*--resume"):
        run(options(folder, observer), no_bar)
    assert run(options(folder, observer, resume=True), no_bar)["asked"] == 0


@pytest.mark.slow
def test_a_killed_run_is_resumed_with_nothing_lost_and_two_at_once_are_refused(tmp_path: Path, observer: Path) -> None:
    folder = study(tmp_path)
    command = [*COMMAND, "--study", str(folder), "--participant", "P01", "--simulate-participant", str(observer)]
    log = folder / "participants/P01/session-1/trials.jsonl"
    rng, resume, killed = np.random.default_rng(5), list[str](), 0
    said: set[int] = set()
    while killed < 4:
        before = log.stat().st_size if log.is_file() else 0
        process = subprocess.Popen([*command, *resume], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        while process.poll() is None and (log.stat().st_size if log.is_file() else 0) <= before:
            time.sleep(0.01)
        if killed == 0:  # somebody else begins while it runs, which is from its first line on
            os.kill(process.pid, signal.SIGSTOP)
            with pytest.raises(HighFiveError, match="another run is writing"):
                run(options(folder, observer, resume=True), no_bar)
            os.kill(process.pid, signal.SIGCONT)
        time.sleep(float(rng.uniform(0.0, 0.15)))
        process.kill()
        process.communicate()
        killed += 1
        content = read_session(folder, "P01", 1)
        assert said <= {row.ask for row in content.finished}
        said = {row.ask for row in content.finished}
        resume = ["--resume"]
    done = subprocess.run([*command, "--resume"], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout)["left"] == 0
    content = read_session(folder, "P01", 1)
    names = [row.trial for row in content.standing]
    assert sorted(names) == sorted(trial.name for trial in stored_plan(folder, "P01").trials)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--publish", "ros"], "there are lsl, vmc or vmc://HOST:PORT, foxglove"),
        (["--publish-network"], "add --publish"),
        (["--record-lsl", "A", "--record-lsl", "A"], "A is there twice"),
        (["--no-avatar", "--record-lsl", "A"], "leave out --publish and --record-lsl"),
        (["--no-avatar", "--rig", "emulated"], "leave out --rig"),
        (["--rig", "virtual"], "--rig virtual does not: --rig emulated"),
        (["--rig", "/dev/ttyUSB0"], "only with --arm"),
        (["--rig", "/dev/ttyUSB0", "--source", "headset"], "nothing says where the arm's base stands"),
        (["--rig", "emulated", "--source", "webcam"], "no arm answers a webcam"),
        (["--nobody-near"], "add --rig emulated, or --rig PORT"),
        (["--camera", "film.y4m"], "add --source webcam"),
        (["--height", "1.7"], "add --source webcam"),
        (["--source", "webcam", "--fov", "500"], "--fov"),
        (["--source", "webcam", "--marker-set", "paper"], "leave out --marker-set"),
        (["--source", "headset", "--place", "place.toml"], "puts the avatar before a headset anew"),
        (["--place", "place.toml"], "add --source ADDRESS"),
        (["--latency", "30"], "add --source ADDRESS"),
        (["--headset", "headset.toml"], "add --source ADDRESS"),
        (["--latencies", "absent.toml"], "absent.toml"),
    ],
)
def test_what_does_not_go_together_is_said_in_one_line(
    words: list[str], says: str, fails, tmp_path: Path, observer: Path
) -> None:
    folder = study(tmp_path, "high_five", {"participants = 12": "participants = 1"})
    assert says in fails(
        "--study", folder, "--participant", "P00", "--simulate-participant", observer, "--no-open", *words
    )
    assert not list(folder.rglob("*.mcap"))


@pytest.mark.parametrize("refused", ["model", "style", "source", "port"])
def test_a_run_that_is_refused_leaves_no_session_that_would_have_to_be_resumed(
    refused: str, tmp_path: Path, observer: Path
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1] if refused == "port" else None
        chain = SimulateOptions(view=PageOptions(port=port, open_browser=False))
        changes = {"participants = 12": "participants = 1"}
        says = "already in use|is taken|in use"
        if refused == "model":
            chain, says = replace(chain, model=tmp_path / "absent.safetensors"), "absent.safetensors"
        if refused == "source":
            chain, says = replace(chain, source=str(tmp_path / "absent.c3d")), "people take part live"
        if refused == "style":
            changes['consent_version = "1"'] = (
                'consent_version = "1"\nemotions = ["happy", "angry", "sad", "neutral", "bored"]'
            )
            changes['name = "happy"'] = 'name = "happy"\nweights = { bored = 1.0 }'
            says = "shows 'bored'; the model knows"
        folder = study(tmp_path, "high_five", changes)
        with pytest.raises(HighFiveError, match=says):
            run(RunOptions(folder, "P00", simulated=observer, chain=chain), no_bar)
    assert not list(folder.glob("participants/*/session-*"))
    assert run(RunOptions(folder, "P00", simulated=observer, dry=True), no_bar)["left"] == 0  # begun, not resumed


@pytest.mark.parametrize(
    ("line", "command"),
    [
        ("1", ("answer", {"key": "1", "at_ms": None})),
        ("  angry\n", ("answer", {"key": "angry", "at_ms": None})),
        ("/go", ("ready", None)),
        ("/pause", ("pause", True)),
        ("/continue", ("pause", False)),
        ("/break", ("break_off", None)),
        ("/stop", ("stop", None)),
        ("/done", ("done", None)),
        ("/note she coughed", ("note", "she coughed")),
        ("/rate natural 4", ("rate", {"name": "natural", "value": 4.0})),
        *((line, None) for line in ("", "/nonsense", "?", "/note", "/rate natural much", "/stop now", "x" * 100)),
    ],
)
def test_what_is_typed(line: str, command: tuple[str, object] | None) -> None:
    assert command_of(line) == (None if command is None else Command(*command))


SMALL = {
    'cells = ["A1", "A2", "A3", "B1", "B2", "B3", "C1", "C2", "C3"]': 'cells = ["B2"]',
    "participants = 12": "participants = 1",
    '[[styles]]\nname = "happy"\n\n': "", '[[styles]]\nname = "sad"\n': "", '[[styles]]\nname = "neutral"\n\n': "",
    'labels = ["neutral", "happy", "angry", "sad"]': 'labels = ["neutral", "angry"]',
    'keys = ["1", "2", "3", "4"]': 'keys = ["1", "2"]',
    "[practice]\nrepetitions = 1\n": "",
}  # fmt: skip


def small(folder: Path) -> Path:
    """One style, one place: acts twice, sees the first again, and acts once more to the recorded answer."""
    from highfive.hil.experiments.plan import draw_plans  # noqa: PLC0415
    from highfive.hil.experiments.protocol_file import read_protocol  # noqa: PLC0415
    from highfive.hil.experiments.study import check_plans, write_study  # noqa: PLC0415

    path = written(folder, "high_five", SMALL)
    text = path.read_text(encoding="utf-8")
    head, rest = text[: text.index("[[blocks]]")], text[text.index("[replay]") :]
    blocks = "".join(
        f'[[blocks]]\nname = "{name}"\nmode = "{mode}"\n{more}\n'
        for name, mode, more in (
            ("I1", "interactive", "repetitions = 1"), ("I2", "interactive", "repetitions = 1"),
            ("R1", "own_replay", 'of = "I1"'), ("N1", "no_contingency", 'of = "I2"\nwhose = "own"'),
        )
    )  # fmt: skip
    path.write_text(head + blocks + rest.replace("alike = 2", "alike = 9"), encoding="utf-8")
    asked = read_protocol(path)
    write_study(folder / "study", path, asked, check_plans(folder / "study", draw_plans(asked)))
    return folder / "study"


def _check_company(
    said: list[str], heard: dict[str, list[tuple[list[float | str], float]]], blocks: list[SessionRecording]
) -> None:
    """One run is one session to those who hear it and whom it records, though each block has a recording."""
    rows = [(m.data["values"][0], m.data.get("labels")) for one in blocks for m in one.channels["/lsl/TestStimuli"]]
    first = said.index(rows[0][0])
    assert [text for text, _ in rows] == said[first : first + len(rows)] and len(rows) > 10  # none lost, none twice
    assert all(one.channels["/lsl/TestStimuli"][0].data["labels"] == ["shown"] for one in blocks)
    at = np.array([m.data["at_ns"] for one in blocks for m in one.channels["/tick"]])
    stamps = np.array([stamp for _, stamp in heard["HighFive-Avatar"]])
    assert len(stamps) > 100 and np.abs(1e-9 * at[-len(stamps) :] - stamps).max() < 1e-4
    names = [json.loads(str(values[0]))["event"] for values, _ in heard["HighFive-Events"]]
    assert names[-1] == "session_end" and names.count("session_end") == 1 and names.count("trial_end") >= 3
    for one in blocks:
        recorded = [m.data["event"] for m in one.channels["/event"]]
        assert recorded[0] == "session_start" and recorded.count("session_end") == 1


@pytest.mark.slow(50)
def test_trials_are_played_recorded_and_shown_again_as_they_were(tmp_path: Path, observer: Path) -> None:
    configure(local_only=True)
    folder, hearing, stimuli = small(tmp_path), Hearing(4), Stimuli()
    chain = SimulateOptions(
        view=PageOptions(port=None, open_browser=False), record_lsl=("TestStimuli",),
        publish=published(f"lsl,vmc://127.0.0.1:{hearing.receiver.getsockname()[1]}"),
    )  # fmt: skip
    result = run(RunOptions(folder, "P01", simulated=observer, chain=chain), no_bar)
    said, heard = stimuli.finish(), hearing.finish()
    rows = {row.trial: row for row in read_session(folder, "P01", 1).rows}
    assert result["left"] == 0 and list(rows) == ["I1-01", "I2-01", "R1-01", "N1-01"]
    assert all(row.answer and not row.broken_off for row in rows.values())
    session = folder / "participants/P01/session-1"
    _check_company(said, heard, [read_recording(session / row.recording) for row in rows.values()])
    assert sum(b"/VMC/Ext/T\0" in datagram for datagram in hearing.datagrams()) > 10

    def motion(name: str) -> RecordedMotion:
        row = rows[name]
        return recorded_motion(session / row.recording, f"{row.trial}, asked as {row.ask}")

    for again, source in (("R1-01", "I1-01"), ("N1-01", "I2-01")):
        shown, first = motion(again), motion(source)
        assert abs(shown.times_ns[-1] - first.times_ns[-1]) < 20_000_000  # the same length
        for place in range(0, len(shown.poses), 7):  # the same poses, at the same times
            wanted, _ = first.at(int(shown.times_ns[place]))
            assert np.abs(shown.poses[place].hinges - wanted.hinges).max() < 1e-3
            assert np.abs(shown.poses[place].root_in_world - wanted.root_in_world).max() < 1e-4
        own, then = rows[again], rows[source]
        assert own.ended_ns and then.ended_ns and own.cue_ns and then.cue_ns
        assert own.cue_ns < own.ended_ns and then.cue_ns < then.ended_ns
    assert rows["I1-01"].contact_ns and rows["I1-01"].frame and (rows["I1-01"].peak_speed or 0.0) > 0.5
    assert (rows["R1-01"].peak_speed or 0.0) < 0.2 and rows["N1-01"].contact_ns is None  # she only watched; nobody met

    def meets_ns(name: str) -> int:
        """By the stamps of the frames: a machine that stalls shows both later, and not alike."""
        played = motion(name)
        row = played.row_played(rows[name].contact_ns)
        assert row is not None
        return int(played.times_ns[row])

    assert meets_ns("R1-01") == pytest.approx(meets_ns("I1-01"), abs=20_000_000)  # as it is shown again
    assert all(row.longest_gap_s and row.motion_s and row.language == "en" for row in rows.values())
    assert (rows["N1-01"].peak_speed or 0.0) > 0.5  # she acted


def test_an_arm_that_does_not_answer_is_not_near_who_acts(tmp_path: Path, observer: Path) -> None:
    chain = SimulateOptions(view=PageOptions(open_browser=False), arm=ArmOptions())
    with pytest.raises(HighFiveError, match=r"no_contingency.*leave out --rig"):
        run(RunOptions(small(tmp_path), "P01", simulated=observer, chain=chain), no_bar)


def test_an_answer_that_comes_too_late_is_none_to_the_next_trial(tmp_path: Path) -> None:
    """A simulated participant who takes longer than she may; it counted as the answer to what was asked meanwhile."""
    folder, slow = study(tmp_path), tmp_path / "slow.toml"
    slow.write_text("[interactive]\nright = 1.0\n[replay]\nright = 1.0\n[reaction]\nmedian_s = 20.0\nspread = 0.02\n")
    run(options(folder, slow), no_bar)
    rows = read_session(folder, "P01", 1).rows
    assert rows and all(not row.answer and "no answer within 15 s" in row.excluded_why for row in rows)
