"""Whole sessions with the emulated arm, as commands; and everything for which nothing moves."""

import json
import math
import os
import pty
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_commands import HIGHFIVE, ended, start, wait_for
from mcap.reader import make_reader
from mcap.writer import Writer
from paths import ROOT
from trial_results import simulated_result

from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.lifecycle import PATIENCE_MS, PLANT, ready_arm
from highfive.hil.cli import main as cli
from highfive.hil.commands.rig.play import PlayOptions, play
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.bus.servo_bus import ServoBus
from highfive.hil.drivers.emulator.emulator_process import EmulatorOptions, EmulatorProcess
from highfive.hil.drivers.priority import may_go_first
from highfive.hil.recording.recording import SessionRecorder, read_recording
from highfive.hil.recording.replay_goals import FORESEEN, recorded_high_fives
from highfive.hil.runtime.console import Advance, show_log
from highfive.hil.session.session import RATE_HZ
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.summary import SessionSettings
from highfive.model.errors import HighFiveError

clockwork = pytest.mark.realtime
EXAMPLE = (ROOT / "docs" / "safety.md").read_text().partition("```toml\n")[2].partition("```")[0]
"""A registration, as the documentation shows it."""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of two high fives: one in which the palms met, and one in which they did not."""
    path = tmp_path_factory.mktemp("recorded") / "session.mcap"
    scene = build_scene()
    with SessionRecorder(path, SessionSettings(seed=5, model="none", trials=2)) as recorder:
        recorder.record_trial(simulated_result(scene, 0, "neutral", "B2"))
        recorder.record_trial(simulated_result(scene, 1, "happy", "A2", away=0.3))
    return path


def refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: object) -> str:
    monkeypatch.setattr("sys.argv", ["highfive", *map(str, words)])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 2
    error = capsys.readouterr().err
    assert "Traceback" not in error
    return " ".join(error.split())


def test_what_cannot_be_played_is_one_line_and_nothing_moves(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], recorded: Path, tmp_path: Path
) -> None:
    def said(*words: object) -> str:
        return refused(monkeypatch, capsys, "rig", "play", *words)

    empty, nonsense = tmp_path / "empty.mcap", tmp_path / "nonsense.toml"
    empty.touch()
    nonsense.write_text("name = 3")
    assert "holds something already; give another --out" in said(recorded, "--out", recorded.parent)
    assert "it is no folder; --out takes the name of a folder" in said(recorded, "--out", recorded)
    assert "only with --arm" in said(recorded, "--port", "/dev/ttyUSB99")
    assert "no such port" in said(recorded, "--port", "/dev/ttyUSB99", "--arm", "--nobody-near")
    assert "not a serial port" in said(recorded, "--port", empty, "--arm", "--slow")
    assert "cannot read the recording" in said(tmp_path / "none")
    assert "is empty" in said(empty)
    assert "no high five 1 in which the palms met; there are 0" in said(recorded, "--trial", "1")
    assert "no high five from 1 on; its last one is 0" in said(recorded, "--from", "1")
    assert "contact.speed is 2 m/s" in said(recorded, "--lower", "contact.speed=2")
    assert "can only be lowered" in said(recorded, "--lower", "motion.retract=0.6")
    assert "nonsense.toml" in said(recorded, "--rig", nonsense)


def test_a_session_whose_arm_cannot_be_used_is_refused_at_once_and_leaves_no_folder(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Before the model is read, which here is none, and so before people are simulated and anything is compiled."""
    model, out, file = tmp_path / "model.safetensors", tmp_path / "session", tmp_path / "file"
    file.write_text("name = 3")

    def said(*words: object) -> str:
        return refused(monkeypatch, capsys, "simulate", "--model", model, "--out", out, "--rig", *words)

    assert "only with --arm" in said("/dev/ttyUSB99")
    assert "no such port" in said("/dev/ttyUSB99", "--arm", "--nobody-near")
    assert "not a serial port" in said(file, "--arm", "--nobody-near")
    assert "contact.speed is 2 m/s" in said("emulated", "--lower", "contact.speed=2")
    assert str(file) in said("emulated", "--rig-file", file)
    assert "is no named pipe" in said("emulated", "--estop", file)
    assert "there is no folder" in said("emulated", "--estop", tmp_path / "none" / "pipe")
    assert "model.safetensors" in said("emulated")  # all is well with the arm
    assert not out.exists()


def torques(emulator: EmulatorProcess) -> set[int]:
    """Of every servo, as it is now."""
    rig = load_rig()
    bus = ServoBus(emulator.port, rig.baud_rate, rig.models, PATIENCE_MS)
    found = {bus.read(servo, "torque_enable") for servo in rig.servos}
    bus.close()
    return found


def test_a_real_port_is_refused_where_nobody_knows_who_is_beside_the_arm(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], recorded: Path, tmp_path: Path
) -> None:
    """A bus that answers, and all is well with it; for the program its pseudo-terminal is a real port."""
    out, old = tmp_path / "out", tmp_path / "room.toml"
    old.write_text(EXAMPLE.replace("2026-11-23", "2026-01-01"))
    with EmulatorProcess(EmulatorOptions()) as emulator:
        play = ("rig", "play", recorded, "--port", emulator.port, "--arm", "--out", out)
        live = ("simulate", "--rig", emulator.port, "--arm", "--source", "vicon://127.0.0.1:1", "--out", out)
        simulated = ("simulate", "--rig", emulator.port, "--arm", "--out", out)
        for words, says in (
            (play, "--nobody-near"),
            (simulated, "--slow"),
            (live, "--registration"),
            ((*live, "--slow"), "--registration"),
            ((*live, "--nobody-near"), "contradicts the live person"),
            ((*live, "--registration", old), "another arm"),
            ((*live, "--registration", tmp_path / "none.toml"), "cannot read the registration"),
            ((*simulated, "--registration", old), "--source"),
        ):
            assert says in refused(monkeypatch, capsys, *words), words
        assert torques(emulator) == {0}  # nothing was switched on
    assert not out.exists()


@pytest.mark.parametrize("share", np.linspace(0.02, 0.98, 13))
def test_a_recording_that_was_cut_short_has_its_first_high_five_or_is_one_line(
    share: float, recorded: Path, tmp_path: Path
) -> None:
    data, path = recorded.read_bytes(), tmp_path / "cut.mcap"
    path.write_bytes(data[: round(share * len(data))])
    try:
        found = recorded_high_fives(read_recording(path), path)
    except HighFiveError as error:
        assert str(path) in str(error) and "\n" not in str(error)
    else:
        assert list(found) == [0]


def test_a_recording_of_another_avatar_is_refused(recorded: Path) -> None:
    recording = read_recording(recorded)
    other = type(recording)(recording.settings, ("hip", "knee"), recording.channels, True)
    with pytest.raises(HighFiveError, match="another avatar: 2 joints"):
        recorded_high_fives(other, recorded)


def rewritten(path: Path, out: Path, topic: str, change: Callable[[dict[str, Any]], dict[str, Any] | None]) -> Path:
    """A valid MCAP file whose messages of a topic were changed; None leaves one out."""
    writer, channels = Writer(str(out)), dict[str, int]()
    writer.start()
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            if channel.topic not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, "json", number)
            data = message.data
            if channel.topic == topic:
                if (changed := change(json.loads(data))) is None:
                    continue
                data = json.dumps(changed).encode()
            writer.add_message(channels[channel.topic], message.log_time, data, message.publish_time)
    writer.finish()
    return out


@pytest.mark.parametrize(
    ("topic", "change", "said"),
    [
        ("/person", {"palm": None}, "/person, message 0 (0.000 s): palm has to be 3 numbers"),
        ("/person", {"palm": [1.0, 0.0]}, "/person, message 0 (0.000 s): palm has to be 3 numbers"),
        ("/person", {"palm": ["a", 0.0, 0.0]}, "palm is not made of numbers"),
        ("/person", {"palm": [math.nan, 0.0, 1.0]}, "palm has a number that is missing or not finite"),
        ("/person", {"palm": [1e9, 0.0, 0.0]}, "1e+09 m from the scene's origin"),
        ("/person", {"palm": [400.0, 300.0, 1200.0]}, "are these millimetres?"),
        ("/person", {"palm_normal": [0.0, 0.0, 0.0]}, "palm_normal has not the length 1"),
        ("/person", {"head": [0.0, 1.7e3, 0.0]}, "head is 1.7e+03 m"),
        ("/person", {"valid": 1}, "valid is neither true nor false"),
        ("/person", None, "0 messages on /person"),
        ("/avatar", {"quaternions": ...}, "/avatar, message 0 (0.000 s): quaternions is missing"),
        ("/avatar", {"quaternions": [[1.0, 0.0, 0.0, 0.0]]}, "quaternions has to be 53 × 4 numbers"),
        ("/avatar", {"root": [0.0, math.inf, 0.0]}, "root has a number that is missing or not finite"),
        ("/trial", {"trial": ...}, "/trial, message 0 (0.000 s): trial is missing"),
        ("/trial", {"emotion": None}, "emotion is no text"),
        ("/contact", {"met": ...}, "met is missing"),
        ("/contact", {"met_time": -1.0}, "met_time is -1 s, which is not within the trial"),
        ("/session", {"joints": ...}, "/session holds no settings and joints"),
    ],
)
def test_a_recording_whose_values_cannot_be_is_refused_in_one_line_before_the_port_is_opened(
    topic: str, change: dict[str, Any] | None, said: str,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], recorded: Path, tmp_path: Path,
) -> None:  # fmt: skip
    def changed(data: dict[str, Any]) -> dict[str, Any] | None:
        return None if change is None else {key: it for key, it in (data | change).items() if it is not ...}

    path = rewritten(recorded, tmp_path / "damaged.mcap", topic, changed)
    # A port that is not there is reported only once somebody opens it.
    error = refused(monkeypatch, capsys, "rig", "play", path, "--port", tmp_path / "no-port", "--arm", "--slow")
    assert error.startswith(f"error: {path}") and said in error, error


def test_what_is_played_is_what_was_recorded(recorded: Path) -> None:
    """The hand's place where the palms met, and the time that is left until then."""
    recording = read_recording(recorded)
    found = recorded_high_fives(recording, recorded)
    assert list(found) == [0]
    reference, (times, _) = found[0], recording.poses()
    judgement = recording.channels["/contact"][0].data
    assert reference.due == round(judgement["met_time"] * RATE_HZ)
    assert len(reference.goals) <= len(times)
    expected = [tick for tick, goal in enumerate(reference.goals) if goal.contact is not None]
    assert expected[0] == reference.due - round(FORESEEN * RATE_HZ)
    first = reference.goals[expected[0]].contact
    assert first is not None
    assert first.time == pytest.approx(FORESEEN, abs=1.0 / RATE_HZ)
    assert np.linalg.norm(first.point - reference.avatar[reference.due]) < 0.02  # the palms met there
    np.testing.assert_allclose(first.point, recording.channels["/person"][reference.due].data["palm"], atol=1e-5)


def test_servos_that_are_not_as_they_have_to_be_are_reported_before_anything_is_switched_on() -> None:
    with (
        pytest.raises(HighFiveError, match=r"servo 4 \(elbow\): no answer.*nothing moves"),
        ready_arm(ArmOptions(faults=("dead=4",))),
    ):
        pytest.fail("it was let through")


@pytest.mark.slow
@clockwork
def test_a_session_with_the_emulated_arm_is_recorded_reported_and_can_be_played_again(tmp_path: Path) -> None:
    out, again = tmp_path / "session", tmp_path / "again"
    process = start("simulate", "--rig", "emulated", "--trials", 1, "--emotion", "neutral", "--cell", "B1",
                    "--no-pictures", "--out", out, "--json")  # fmt: skip
    said, error = process.communicate(timeout=300)
    assert process.returncode in (0, 1), error
    arm = json.loads(said)["arm"]
    assert arm["trials"] == 1 and arm["stopped"] == "", arm
    assert arm["cycles"] > 200 and arm["unanswered"] == 0
    # It went to the hand, from 0.5 m away; how near it comes, and when, is the contact suite's business.
    assert arm["error_mm"]["max"] < 150.0, arm["rows"]
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "Servo arm" in page and "following error" in page
    recording = read_recording(out / "session.mcap")
    cycles, ticks = recording.channels["/arm"], recording.channels["/safety"]
    assert len(cycles) == arm["cycles"]
    assert {message.data["state"] for message in ticks} >= {"tracking"}
    sent = [message.data for message in cycles if message.data["sent"] is not None]
    assert len(sent) > 200
    process = start("rig", "play", out, "--out", again, "--json")
    said, error = process.communicate(timeout=300)
    assert process.returncode in (0, 1), error
    played = json.loads(said)
    assert played["stopped"] == "" and played["error_mm"]["max"] < 150.0, played
    assert (again / "report.html").is_file()


@pytest.mark.slow
@clockwork
@pytest.mark.parametrize("how", ["pipe", "signal"])
def test_an_emergency_stop_ends_the_session_and_keeps_what_was_played(how: str, tmp_path: Path) -> None:
    """A machine that stands still may stop the arm before that: then once more."""
    for attempt in range(3):
        code, said, error = stopped_session(how, out := tmp_path / str(attempt))
        assert code == 1, error  # whatever came first, the signal does not end the program that writes the report
        if "emergency stop" in error:
            break
    assert "emergency stop" in error
    summary = json.loads(said)
    assert summary["interrupted"]
    assert summary["trials"] >= 1
    assert (out / "report.html").is_file()


@pytest.mark.slow
@clockwork
@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("dead=4", r"elbow[\w, ]* not answered for"),
        ("unplug", "not answered for"),
        ("overload=2", "the servo of shoulder reports overload"),
    ],
)
def test_what_breaks_during_a_session_stops_the_arm_and_keeps_what_was_played(
    fault: str, said: str, tmp_path: Path
) -> None:
    """The arm stands, one line says why, and the high five before it is in a recording that is whole.

    A machine that stands still may stop the arm before the fault does: then once more.
    """
    for attempt in range(3):
        code, output, error = broken_session(fault, out := tmp_path / str(attempt))
        if re.search(said, error):
            break
    assert code == 1, error
    assert len(re.findall(f"^the arm was stopped: .*({said})", error, re.MULTILINE)) == 1, error
    summary = json.loads(output)
    assert re.search(said, summary["arm"]["stopped"])
    recording = read_recording(out / "session.mcap")
    assert recording.complete
    assert len(recording.channels["/contact"]) == summary["trials"] >= 1
    assert {message.data["state"] for message in recording.channels["/safety"]} & {"stopping", "stopped"}


def stopped_session(how: str, out: Path) -> tuple[int, str, str]:
    """A session whose emergency stop is pulled in the second high five."""
    pipe = out.with_suffix(".stop")
    process = start("simulate", "--rig", "emulated", "--emotion", "neutral", "--no-pictures", "--out", out,
                    "--estop", pipe, "--json")  # fmt: skip
    if grows(out / "session.mcap", process):
        time.sleep(1.5)  # in the second high five
        if how == "signal":
            os.kill(process.pid, signal.SIGUSR1)
        elif pipe.exists():
            subprocess.run(["sh", "-c", f"echo stop > {pipe}"], check=True, timeout=10.0)
    return ended(process, within=120.0)


def grows(recording: Path, process: subprocess.Popen[str]) -> bool:
    """Whether the first high five was recorded before the session ended."""
    end = time.monotonic() + 120.0
    while process.poll() is None and time.monotonic() < end:
        if wait_for(recording, 100_000, 0.1):
            return True
    return False


def broken_session(fault: str, out: Path) -> tuple[int, str, str]:
    """A session of two high fives, with a fault of the bus in the second."""
    with EmulatorProcess(EmulatorOptions(plant=PLANT)) as emulator:
        process = start(
            "simulate", "--rig", emulator.port, "--arm", "--nobody-near", "--trials", 2, "--emotion", "neutral",
            "--no-pictures", "--out", out, "--json",
        )  # fmt: skip
        if grows(out / "session.mcap", process):
            time.sleep(1.5)  # in the second high five
            emulator.set_faults(fault)
        return ended(process, within=120.0)


@pytest.fixture(scope="module")
def recorded_twice(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of two high fives in which the palms met."""
    path = tmp_path_factory.mktemp("twice") / "session.mcap"
    scene = build_scene()
    with SessionRecorder(path, SessionSettings(seed=5, model="none", trials=2)) as recorder:
        for number in range(2):
            recorder.record_trial(simulated_result(scene, number, "neutral", "B2"))
    return path


@pytest.mark.slow
@clockwork
@pytest.mark.parametrize("how", ["Ctrl-C", "pipe", "fault"])
def test_a_stop_while_a_recording_is_played_keeps_what_was_played_and_says_why(
    how: str, recorded_twice: Path, tmp_path: Path
) -> None:
    """The first high five is in the report, and the second as far as it came.

    A machine that stands still may stop the arm before that: then once more.
    """
    why = "not answered for" if how == "fault" else "emergency stop"
    for attempt in range(3):
        summary = stopped_play(how, recorded_twice, out := tmp_path / str(attempt))
        if summary["trials"] == 2 and why in summary["stopped"]:
            break
    assert why in summary["stopped"]
    assert summary["trials"] == 2 and summary["broken_off"] == 1, summary
    first, second = summary["rows"]
    assert not first["broken_off"] and second["broken_off"] and not second["touched"]
    assert summary["error_mm"]["max"] == first["error_mm"]  # of the one that was whole
    assert summary["stopped"] in (page := (out / "report.html").read_text(encoding="utf-8"))
    assert "1 broken off" in page and (out / "figures" / "arm_joints.png").is_file()
    arm = read_recording(out / "arm.mcap")
    assert arm.settings["trials"] == 2 and arm.settings["source"] == str(recorded_twice)
    assert len(arm.channels["/arm"]) == summary["cycles"]
    assert len(arm.channels["/safety"]) > 200
    assert json.loads((out / "report.json").read_text(encoding="utf-8"))["stopped"] == summary["stopped"]


def stopped_play(how: str, recording: Path, out: Path) -> dict[str, Any]:
    """What is said of a recording of two high fives that is stopped in the second."""
    pipe, timers = out.with_suffix(".stop"), list[threading.Timer]()
    with EmulatorProcess(EmulatorOptions(plant=PLANT)) as emulator:
        stops = {
            "Ctrl-C": lambda: os.kill(os.getpid(), signal.SIGINT),
            "pipe": lambda: pipe.write_text("stop"),
            "fault": lambda: emulator.set_faults(("dead=4",)),
        }

        def bar(label: str, _total: int) -> Advance:
            def advance(note: str = "", done: int | None = None) -> None:
                if label == "high fives":
                    timers.append(threading.Timer(1.0, stops[how]))  # the first is done: into the second
                    timers[-1].start()

            return advance

        options = ArmOptions(emulator.port, armed=True, nobody_near=True) if how == "fault" else ArmOptions(estop=pipe)
        try:
            return play(PlayOptions(recording, options), out, bar)
        except KeyboardInterrupt:
            pytest.fail("Ctrl-C was more than a stop of the arm")
        finally:
            for timer in timers:
                timer.cancel()


@pytest.mark.slow
@clockwork
def test_a_stop_while_playing_is_one_line_and_exit_code_1(recorded: Path, tmp_path: Path) -> None:
    pipe, out = tmp_path / "stop", tmp_path / "again"
    process = start("rig", "play", recorded, "--out", out, "--estop", pipe, "--json")
    assert wait_for(pipe, 0, 60.0)
    pipe.write_text("stop")
    code, said, error = ended(process, within=120.0)
    assert code == 1, error
    assert error.count("the arm was stopped: the emergency stop was pulled\n") == 1, error
    assert json.loads(said)["stopped"] == "the emergency stop was pulled"
    assert "The arm was stopped: the emergency stop was pulled." in (out / "report.html").read_text(encoding="utf-8")


@pytest.mark.slow
@clockwork
def test_who_presses_ctrl_c_again_and_again_still_gets_the_report(recorded_twice: Path, tmp_path: Path) -> None:
    """Through the arm's way to rest and the drawing of figures."""
    out = tmp_path / "again"
    process = start("rig", "play", recorded_twice, "--out", out, "--json")
    assert wait_for(out / "arm.mcap", 50_000, 120.0)
    while process.poll() is None and not (out / "figures").exists():
        process.send_signal(signal.SIGINT)
        process.send_signal(signal.SIGTERM)
        time.sleep(0.05)
    code, said, error = ended(process, within=120.0)
    assert code == 1, error
    assert "emergency stop" in json.loads(said)["stopped"]
    assert (out / "report.html").is_file() and read_recording(out / "arm.mcap").complete


@pytest.fixture
def slipped() -> Iterator[Callable[..., EmulatorProcess]]:
    """Emulated arms whose horns have slipped."""
    with ExitStack() as stack:
        yield lambda *faults: stack.enter_context(EmulatorProcess(EmulatorOptions(plant=PLANT, faults=faults)))


@clockwork
@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("slip=5:2", r"elbow: servos 4 and 5 stand 2\d counts apart, at most 8.*write shadow_offset = -2\d into"),
        ("slip=2+3:10", "shoulder says 8[123]°, beyond its stops"),
        ("slip=2+3:-10", "shoulder: where it says that it is, at 6[123]°, gravity asks for -[45]"),
        ("slip=4+5:90", "inside floor, mount or itself"),
    ],
)
def test_an_arm_that_cannot_stand_where_it_says_is_not_switched_on(
    fault: str, said: str, slipped: Callable[..., EmulatorProcess], capsys: pytest.CaptureFixture[str]
) -> None:
    emulator = slipped(fault)
    with (
        pytest.raises(HighFiveError, match=said),
        ready_arm(ArmOptions(emulator.port, armed=True, nobody_near=True)) as loop,
    ):
        loop.begin()
    assert "torque is on" not in capsys.readouterr().err
    rig = load_rig()
    bus = ServoBus(emulator.port, rig.baud_rate, rig.models, 60.0)
    assert not any(bus.read(servo, "torque_enable") for servo in rig.servos)
    bus.close()


@clockwork
def test_servos_that_come_apart_while_the_arm_is_driven_stop_it(
    slipped: Callable[..., EmulatorProcess], recorded: Path
) -> None:
    emulator = slipped()
    (reference,) = recorded_high_fives(read_recording(recorded), recorded).values()
    with ready_arm(ArmOptions(emulator.port, armed=True, nobody_near=True)) as loop:
        timer = threading.Timer(3.0, emulator.set_faults, ["slip=5:4"])
        timer.start()
        loop.play(reference.goals)
        timer.join()
        assert "the two servos of elbow have been more than 0.03 rad apart" in loop.trouble


@clockwork
def test_a_session_that_leaves_torque_on_says_how_to_let_go_and_the_next_one_takes_over(
    slipped: Callable[..., EmulatorProcess], capsys: pytest.CaptureFixture[str]
) -> None:
    show_log()  # as the command line does
    """Whether it ends by itself, by an error or by a stop; servos that hold are switched on no second time."""
    emulator = slipped()
    advice = f"torque is on; to let it go, hold the arm, then: highfive rig release {emulator.port}"
    with ready_arm(ArmOptions(emulator.port, armed=True, nobody_near=True)):
        pass
    assert "torque" not in capsys.readouterr().err  # it was never switched on
    with ready_arm(ArmOptions(emulator.port, armed=True, nobody_near=True)) as loop:
        loop.begin()
    assert advice in " ".join(capsys.readouterr().err.split())
    with pytest.raises(KeyboardInterrupt), ready_arm(ArmOptions(emulator.port, armed=True, nobody_near=True)) as loop:
        loop.begin()
        signal.raise_signal(signal.SIGINT)
    assert advice in " ".join(capsys.readouterr().err.split())
    with ready_arm(ArmOptions(emulator.port, armed=True, nobody_near=True)) as loop:
        loop.begin()
        emulator.set_faults("dead=4")
        loop.rest(2.0)
    assert "MAY STILL HOLD, with torque on (servo 4" in " ".join(capsys.readouterr().err.split())


@pytest.mark.slow
@clockwork
def test_ctrl_z_at_a_terminal_stops_the_arm_and_suspends_nobody(recorded_twice: Path, tmp_path: Path) -> None:
    out = tmp_path / "again"
    child, terminal = pty.fork()
    if child == 0:
        os.execv(sys.executable, [*HIGHFIVE, "rig", "play", str(recorded_twice), "--out", str(out)])
    said = list[bytes]()

    def listen() -> None:
        with suppress(OSError):
            while data := os.read(terminal, 4096):
                said.append(data)

    listener = threading.Thread(target=listen)
    listener.start()
    assert wait_for(out / "arm.mcap", 50_000, 120.0)
    os.write(terminal, b"\x1a")
    _, status = os.waitpid(child, os.WUNTRACED)
    listener.join()
    os.close(terminal)
    text = " ".join(b"".join(said).decode().split())
    assert os.WIFEXITED(status) and os.WEXITSTATUS(status) == 1, text  # a suspended one had been reported as stopped
    assert "Ctrl-Z stops the arm" in text, text
    assert "the arm was stopped: " in text and "emergency stop" in text, text
    assert "2 high fives, about" in text and "--from 1" in text
    assert (out / "report.html").is_file() and read_recording(out / "arm.mcap").complete


@pytest.mark.slow
@clockwork
def test_a_computer_that_is_too_busy_is_reported_with_what_helps_and_where_to_go_on(
    recorded_twice: Path, tmp_path: Path
) -> None:
    """The program gets no processor for a moment, as where others take it; the arm's process goes on."""
    out, again = tmp_path / "busy", tmp_path / "again"
    process = start("rig", "play", recorded_twice, "--out", out, "--json")
    assert wait_for(out / "arm.mcap", 50_000, 120.0)
    time.sleep(1.0)  # in the second high five
    process.send_signal(signal.SIGSTOP)
    time.sleep(0.2)
    process.send_signal(signal.SIGCONT)
    code, said, error = ended(process, within=120.0)
    summary, error = json.loads(said), " ".join(error.split())
    assert code == 1 and "the loop paused for" in summary["stopped"]
    assert "the computer was too busy: end other programs" in error and summary["remedy"] in error
    assert ("rtprio 20' | sudo tee /etc/security/limits.d/highfive.conf" in error) != may_go_first()
    assert summary["from"] == 1 and "--from 1" in error
    code, said, error = ended(start("rig", "play", recorded_twice, "--out", again, "--from", 1, "--json"), within=120.0)
    assert code == 0 and json.loads(said)["trials"] == 1 and json.loads(said)["from"] is None, error
    assert "1 high five, about 10 s" in error
