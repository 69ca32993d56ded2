"""Whole sessions with the arm in virtual time: what ends them, and what is kept of them then."""

import json
import os
import pty
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from live_commands import HIGHFIVE, ended, start, wait_for
from recorded_trials import record_two

from highfive.hil.arm.arm_options import VIRTUAL, ArmOptions
from highfive.hil.arm.arm_trial import played_until_stopped
from highfive.hil.arm.busy import too_busy
from highfive.hil.arm.lifecycle import PLANT, emulator_options, ready_arm, virtual_arm
from highfive.hil.commands.rig.play import PlayOptions, play
from highfive.hil.commands.simulate import SimulateOptions, simulate
from highfive.hil.drivers.emulator.bus_faults import parse_faults
from highfive.hil.drivers.emulator.emulator_process import EmulatorOptions, EmulatorProcess, make_bus
from highfive.hil.drivers.emulator.virtual_rig import VirtualRig
from highfive.hil.recording.recording import read_recording
from highfive.hil.recording.replay_goals import RecordedHighFives
from highfive.hil.recording.session_reader import read_session
from highfive.hil.runtime.console import show_log
from highfive.hil.runtime.threads import SWITCH_S
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.safety.states import State
from highfive.model.errors import HighFiveError

IN_THE_SECOND_S = 7.0
"""From when the arm was switched on into the second of two high fives, s."""

IN_THE_FIRST_BYTES = 50_000
"""So large is ``arm.mcap`` in the first of two high fives, which makes 205,000 bytes; both make 426,000."""


def quiet(_: str, __: int):
    return lambda *_, **__: None


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of two high fives in which the palms met."""
    return record_two(tmp_path_factory.mktemp("twice") / "session.mcap", "neutral")


def played(recorded: Path, out: Path, *faults: str) -> dict[str, Any]:
    return play(PlayOptions(recorded, ArmOptions(VIRTUAL, faults=faults)), out, quiet)


@pytest.mark.slow
def test_another_arm_plays_a_recording_and_is_shown_as_itself(recorded: Path, tmp_path: Path) -> None:
    """A WidowX, whose last joint limits its duty and not its current."""
    options = PlayOptions(recorded, ArmOptions(VIRTUAL, arm="wx250s"), most=1)
    summary = play(options, out := tmp_path / "widow", quiet)
    assert summary["stopped"] == "" and summary["trials"] == 1 and summary["missed"] == 0, summary
    assert summary["error_mm"]["max"] < 10.0 and summary["unanswered"] == 0
    assert 0.0 < summary["closing_speed"]["wire"] < 0.8
    arm = read_session(out / "arm.mcap")
    assert (arm.settings["arm"], arm.settings["arm_name"]) == (VIRTUAL, "wx250s")


@pytest.mark.slow
def test_a_recording_is_played_whole_and_to_the_same_bits_each_time(recorded: Path, tmp_path: Path) -> None:
    switching = []

    def bar(_: str, __: int):
        return lambda *_, **__: switching.append(sys.getswitchinterval())

    summary = play(PlayOptions(recorded, ArmOptions(VIRTUAL)), out := tmp_path / "once", bar)
    assert switching[-2:] == pytest.approx([SWITCH_S] * 2)  # as in every session; a high five each
    assert summary["stopped"] == "" and summary["from"] is None
    assert summary["trials"] == 2 and summary["missed"] == 0 and summary["error_mm"]["max"] < 5.0, summary
    assert summary["cycles"] > 800 and summary["missed_cycles"] == 0 and summary["unanswered"] == 0
    assert (out / "report.html").is_file()
    played(recorded, tmp_path / "twice")
    first, second = (
        [message.data for message in read_recording(folder / "arm.mcap").channels["/arm"]]
        for folder in (out, tmp_path / "twice")
    )
    assert first == second


@pytest.mark.parametrize(
    ("fault", "why"),
    [
        ("overload=2", "the servo of shoulder reports overload"),
        pytest.param("dead=4", "elbow has not answered for", marks=pytest.mark.slow),
        pytest.param("unplug", "virtual: the port is gone", marks=pytest.mark.slow),
        pytest.param("slip=5:4", "the two servos of elbow have been more than 0.03 rad apart", marks=pytest.mark.slow),
    ],
)
def test_what_breaks_stops_the_arm_keeps_what_was_played_and_says_why(
    fault: str, why: str, recorded: Path, tmp_path: Path
) -> None:
    """The first high five is in the report, and the second as far as it came."""
    summary = played(recorded, out := tmp_path / "again", f"{fault}@{IN_THE_SECOND_S}")
    assert why in summary["stopped"]
    assert_first_is_whole(summary, out, recorded)


def assert_first_is_whole(summary: dict[str, Any], out: Path, recorded: Path) -> None:
    assert summary["trials"] == 2 and summary["broken_off"] == 1 and summary["from"] == 1, summary
    first, second = summary["rows"]
    assert not first["broken_off"] and second["broken_off"] and not second["touched"]
    assert summary["error_mm"]["max"] == first["error_mm"]  # of the one that was whole
    assert summary["stopped"] in (page := (out / "report.html").read_text(encoding="utf-8"))
    assert "1 broken off" in page and (out / "figures" / "arm_joints.png").is_file()
    arm = read_recording(out / "arm.mcap")
    assert arm.settings["trials"] == 2 and arm.settings["source"] == str(recorded)
    assert len(arm.channels["/arm"]) > summary["cycles"]  # the way back to rest is recorded, too, and in no figure
    assert len(arm.channels["/safety"]) > 200
    assert arm.channels["/safety"][-1].data["state"] == "stopped"
    (event,) = arm.channels["/event"]
    assert (event.data["event"], event.data["detail"]) == ("fault", summary["stopped"])
    assert json.loads((out / "report.json").read_text(encoding="utf-8"))["stopped"] == summary["stopped"]


@pytest.mark.slow(15)
def test_a_session_is_recorded_reported_and_can_be_played_again(tmp_path: Path) -> None:
    options = SimulateOptions(
        trials=1, emotions=("neutral",), cells=("B1",), pictures=False, arm=ArmOptions(VIRTUAL), seed=0
    )
    arm = simulate(options, out := tmp_path / "session", quiet)["arm"]
    assert arm["trials"] == 1 and arm["stopped"] == "", arm
    assert arm["cycles"] > 200 and arm["unanswered"] == arm["missed_cycles"] == 0
    assert arm["error_mm"]["max"] < 30.0, arm["rows"]
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "Servo arm" in page and "following error" in page and "virtual time" in page
    recording = read_recording(out / "session.mcap")
    cycles, ticks = recording.channels["/arm"], recording.channels["/safety"]
    assert len(cycles) > arm["cycles"]  # the way back is recorded, too
    assert {message.data["state"] for message in ticks} >= {"tracking"}
    assert sum(message.data["sent"] is not None for message in cycles) > 200
    again = played(out, tmp_path / "again")
    assert again["stopped"] == "" and again["error_mm"]["max"] < 30.0, again
    assert (tmp_path / "again" / "report.html").is_file()


@pytest.mark.slow(20)
def test_what_breaks_during_a_session_stops_the_arm_and_keeps_what_was_played(tmp_path: Path) -> None:
    """The arm stands, one line says why, and the high five before it is in a recording that is whole."""
    why = "the servo of shoulder reports overload"
    process = start("simulate", "--rig", VIRTUAL, "--trials", 2, "--emotion", "neutral", "--no-pictures",
                    "--faults", "overload=2@8", "--out", out := tmp_path / "out", "--json")  # fmt: skip
    code, output, error = ended(process, within=280.0)
    assert code == 1 and error.count(f"the arm was stopped: {why}") == 1, error
    summary = json.loads(output)
    assert why in summary["arm"]["stopped"] and summary["interrupted"]
    recording = read_recording(out / "session.mcap")
    assert recording.complete
    assert len(recording.channels["/contact"]) == summary["trials"] >= 1
    assert {message.data["state"] for message in recording.channels["/safety"]} & {"stopping", "stopped"}
    (row,) = summary["streams"]
    assert row["stream"] == "arm" and row["rate_hz"] == pytest.approx(120.0, rel=0.01)
    assert row["bound_ms"] == row["offset_s"] == row["resets"] == 0


@pytest.mark.slow(15)
@pytest.mark.parametrize("how", ["pipe", "signal"])
def test_an_emergency_stop_ends_the_session_and_keeps_what_was_played(how: str, tmp_path: Path) -> None:
    pipe, out = tmp_path / "stop", tmp_path / "out"
    process = start("simulate", "--rig", VIRTUAL, "--emotion", "neutral", "--no-pictures", "--out", out,
                    "--estop", pipe, "--json")  # fmt: skip
    assert wait_for(out / "session.mcap", 100_000, 250.0)  # the first high five
    if how == "signal":
        os.kill(process.pid, signal.SIGUSR1)
    else:
        subprocess.run(["sh", "-c", f"echo stop > {pipe}"], check=True, timeout=10.0)
    code, said, error = ended(process, within=120.0)
    assert code == 1 and "emergency stop" in error, error
    summary = json.loads(said)
    assert summary["interrupted"] and summary["trials"] >= 1
    assert (out / "report.html").is_file()


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize("how", ["Ctrl-C", "pipe"])
def test_a_stop_while_a_recording_is_played_keeps_what_was_played_and_says_why(
    how: str, recorded: Path, tmp_path: Path
) -> None:
    pipe, out = tmp_path / "stop", tmp_path / "out"
    process = start("rig", "play", recorded, "--port", VIRTUAL, "--estop", pipe, "--out", out, "--json")
    assert wait_for(out / "arm.mcap", IN_THE_FIRST_BYTES, 120.0)
    if how == "pipe":
        pipe.write_text("stop")
    else:
        process.send_signal(signal.SIGINT)
    code, said, error = ended(process, within=120.0)
    summary = json.loads(said)
    whole = sum(not row["broken_off"] for row in summary["rows"])
    assert "emergency stop" in summary["stopped"] and summary["trials"] >= 1
    assert summary["from"] == whole < 2
    assert code == 1 and error.count(f"the arm was stopped: {summary['stopped']}\n") == 1, error
    assert f"The arm was stopped: {summary['stopped']}." in (out / "report.html").read_text(encoding="utf-8")
    assert read_recording(out / "arm.mcap").complete
    options = PlayOptions(recorded, ArmOptions(VIRTUAL), begin=summary["from"])
    rest = play(options, tmp_path / "rest", quiet)
    assert rest["trials"] == 2 - whole and rest["from"] is None and not rest["stopped"]


@pytest.mark.slow
def test_who_presses_ctrl_c_again_and_again_still_gets_the_report(recorded: Path, tmp_path: Path) -> None:
    """Through the arm's way to rest and the drawing of figures."""
    out = tmp_path / "again"
    process = start("rig", "play", recorded, "--port", VIRTUAL, "--out", out, "--json")
    assert wait_for(out / "arm.mcap", IN_THE_FIRST_BYTES, 120.0)
    while process.poll() is None and not (out / "figures").exists():
        process.send_signal(signal.SIGINT)
        process.send_signal(signal.SIGTERM)
        time.sleep(0.05)
    code, said, error = ended(process, within=120.0)
    assert code == 1, error
    assert "emergency stop" in json.loads(said)["stopped"]
    assert (out / "report.html").is_file() and read_recording(out / "arm.mcap").complete


@pytest.mark.slow
def test_ctrl_z_at_a_terminal_stops_the_arm_and_suspends_nobody(recorded: Path, tmp_path: Path) -> None:
    out = tmp_path / "again"
    child, terminal = pty.fork()
    if child == 0:
        os.execv(sys.executable, [*HIGHFIVE, "rig", "play", str(recorded), "--port", VIRTUAL, "--out", str(out)])
    said = list[bytes]()

    def listen() -> None:
        with suppress(OSError):
            while data := os.read(terminal, 4096):
                said.append(data)

    listener = threading.Thread(target=listen)
    listener.start()
    assert wait_for(out / "arm.mcap", IN_THE_FIRST_BYTES, 120.0)
    os.write(terminal, b"\x1a")
    _, status = os.waitpid(child, os.WUNTRACED)
    listener.join()
    os.close(terminal)
    text = " ".join(b"".join(said).decode().split())
    assert os.WIFEXITED(status) and os.WEXITSTATUS(status) == 1, text  # a suspended one had been reported as stopped
    assert "Ctrl-Z stops the arm" in text, text
    assert "the arm was stopped: " in text and "emergency stop" in text, text
    assert text.index("the arm was stopped: ") < text.index("played on virtual until the arm was stopped"), text
    assert "2 high fives, about" in text and ("--from 1" in text or "--from 2" in text)
    assert (out / "report.html").is_file() and read_recording(out / "arm.mcap").complete


@pytest.mark.slow
def test_a_computer_that_is_too_busy_is_reported_with_what_helps(recorded: Path) -> None:
    """The program gets no processor for a moment, as where others take it; the arm's driver goes on."""
    reference = RecordedHighFives(read_session(recorded))[0]
    with VirtualClock() as clock, virtual_arm(VirtualRig(clock, make_bus(emulator_options(ArmOptions())))) as loop:
        host = clock.first

        def stall() -> None:
            while loop.state is not State.TRACKING:
                clock.wait_until(clock.now() + 1_000_000)
            clock.wait_until(clock.now() + 200_000_000)
            host.hold(clock.now() + 200_000_000)

        clock.start("stall", stall)
        trial = played_until_stopped(reference, loop)
        assert "the loop paused for 20" in loop.trouble
        said = too_busy(trial, loop.cycles(), loop.stopped_by)
    assert "the computer was too busy: end other programs" in said


def torques(virtual: VirtualRig) -> set[int]:
    return {servo.values["torque_enable"] for servo in virtual.bus.servos}


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("dead=4", r"servo 4 \(elbow\): no answer.*nothing moves"),
        (
            "slip=5:2",
            r"elbow: servos 4 and 5 stand 2\d counts apart \(2\.\d°\).*horns first.*shadow_offset = -2\d into",
        ),
        ("slip=2+3:10", "shoulder says 8[123]°, beyond its stops"),
        ("slip=2+3:-10", "shoulder: where it says that it is, at 6[123]°, gravity asks for -[45]"),
        ("slip=4+5:90", "inside floor, mount or itself"),
    ],
)
def test_an_arm_that_cannot_stand_where_it_says_is_not_switched_on(fault: str, said: str) -> None:
    with VirtualClock() as clock:
        virtual = VirtualRig(clock, make_bus(emulator_options(ArmOptions())))
        virtual.bus.set_faults(parse_faults([fault]), virtual.now())
        with pytest.raises(HighFiveError, match=said), virtual_arm(virtual) as loop:
            loop.begin()
        assert torques(virtual) == {0}


@pytest.fixture
def emulator() -> Iterator[EmulatorProcess]:
    with EmulatorProcess(EmulatorOptions(plant=PLANT)) as emulator:
        yield emulator


@pytest.mark.realtime
def test_a_session_that_leaves_torque_on_says_how_to_let_go_and_the_next_one_takes_over(
    emulator: EmulatorProcess, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whether it ends by itself, by an error or by a stop; servos that hold are switched on no second time."""
    show_log()  # as the command line does
    options = ArmOptions(emulator.port, armed=True, nobody_near=True)
    advice = f"torque is on; to let it go, hold the arm, then: highfive rig release {emulator.port}"
    with ready_arm(options):
        pass
    assert "torque" not in capsys.readouterr().err  # it was never switched on
    with ready_arm(options) as loop:
        loop.begin()
    assert advice in " ".join(capsys.readouterr().err.split())
    with pytest.raises(KeyboardInterrupt), ready_arm(options) as loop:
        loop.begin()
        signal.raise_signal(signal.SIGINT)
    assert advice in " ".join(capsys.readouterr().err.split())
    with ready_arm(options) as loop:
        loop.begin()
        emulator.set_faults("dead=4")
        loop.rest(2.0)
    assert "MAY STILL HOLD, with torque on (servo 4" in " ".join(capsys.readouterr().err.split())
