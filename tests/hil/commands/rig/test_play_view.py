"""``rig play --view``: the page has people as recorded, the arm as it is, and the arm's emergency stop."""

import json
import socket
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
from live_commands import ended, start
from page_address import page_address
from recorded_trials import record_two
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from highfive.hil.arm.arm_options import VIRTUAL, ArmOptions
from highfive.hil.arm.arm_trial import played_until_stopped
from highfive.hil.arm.lifecycle import emulator_options, virtual_arm
from highfive.hil.arm.loop import ArmTick
from highfive.hil.commands.rig.play import Kept, PlayOptions, play
from highfive.hil.commands.rig.play_view import PlayView
from highfive.hil.commands.simulate_options import PageOptions
from highfive.hil.drivers.bus.cycle_ring import Cycle
from highfive.hil.drivers.emulator.emulator_process import make_bus
from highfive.hil.drivers.emulator.virtual_rig import VirtualRig
from highfive.hil.drivers.latch import Cause, Latch
from highfive.hil.recording.background import BackgroundRecorder
from highfive.hil.recording.recorder import SessionRecorder
from highfive.hil.recording.recording import read_recording
from highfive.hil.recording.replay_goals import RecordedHighFives
from highfive.hil.recording.session_reader import read_session
from highfive.hil.runtime.console import progress_bars
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.summary import SessionSettings
from highfive.hil.view.arm_cast import ArmCast
from highfive.hil.view.live_page import LivePage
from highfive.hil.view.recorded import RecordedTrials
from highfive.hil.view.wire import PoseMessage, decode_poses
from highfive.model.errors import HighFiveError


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of two high fives in which the palms met."""
    return record_two(tmp_path_factory.mktemp("twice") / "session.mcap", "happy")


def looks_on(address: str) -> ClientConnection:
    return connect(address.replace("http", "ws", 1).replace("/?", "/live?"), compression=None)


def until_asked(link: ClientConnection) -> Iterator[dict[str, object] | PoseMessage]:
    """What came before the answer to a question that is put now."""
    link.send('{"kind": "time", "asked": 1}')
    while True:
        message = link.recv(20.0)
        if isinstance(message, bytes):
            link.send(message[4:8])
            yield decode_poses(message)
        elif (text := json.loads(message))["kind"] == "time":
            return
        else:
            yield text


@pytest.mark.slow
def test_the_page_has_people_as_recorded_and_the_arm_as_it_is(recorded: Path) -> None:
    session = read_session(recorded)
    trials, goals = RecordedTrials(session, build_scene()), RecordedHighFives(session)
    cast, people = ArmCast(), trials[0].bodies.shape[1]
    with (
        VirtualClock() as clock,
        virtual_arm(VirtualRig(clock, make_bus(emulator_options(ArmOptions())))) as loop,
        LivePage({"mode": "played", "title": "", "arm": True, "rig": "vx300s"}, port=0) as page,
        looks_on(page.address) as link,
    ):
        view = PlayView(page, trials, loop, "vx300s", 2)
        view.begin(1)
        planned: list[np.ndarray] = []
        measured: list[np.ndarray] = []

        def seen(tick, cycles) -> None:
            view.watch(tick)
            assert loop.measured is not None
            planned.append(tick.planned)
            measured.append(loop.measured.copy())

        trial = played_until_stopped(goals[1], loop, seen)
        assert trial is not None and not loop.trouble and len(planned) == len(trial.ticks) + len(trial.back.ticks)
        view.judged(trial)
        got = list(until_asked(link))
        poses = [one for one in got if isinstance(one, PoseMessage)]
        assert poses and poses[-1].rate == 1.0
        for one in poses:  # number 1 is of the first tick
            at = min(one.number - 1, len(trials[1].times) - 1)
            assert one.time_s == pytest.approx(trials[1].times[at], abs=1e-5)
            assert np.allclose(one.bodies[:people], trials[1].bodies[at], atol=1e-5)
            arm = cast.poses(measured[one.number - 1], planned[one.number - 1])
            assert np.allclose(one.bodies[people:], arm, atol=1e-5)
        texts = [one for one in got if isinstance(one, dict)]
        states = [one for one in texts if one["kind"] == "state"]
        assert {(one["trial"], one["trials"], one["style"], one["stopped"]) for one in states} == {
            (0, 2, "happy", False)
        }
        distances = [float(str(one["palms_m"])) for one in states if one["palms_m"] is not None]
        assert min(distances) < 0.05 and max(distances) > 0.3
        assert any(one["time_to_contact_s"] is not None for one in states)
        assert [one["met"] for one in texts if one["kind"] == "contact"] == [True]

        # A pause holds the next one back until it is let go, or the arm is stopped; the end is after this one.
        link.send('{"kind": "command", "name": "pause", "value": true}')
        link.send('{"kind": "command", "name": "end"}')
        list(until_asked(link))
        view.begin(0)
        assert view.ends


@pytest.mark.slow
def test_what_is_played_is_in_the_file_as_it_comes(recorded: Path, tmp_path: Path) -> None:
    goals, path, killed = RecordedHighFives(read_session(recorded)), tmp_path / "arm.mcap", tmp_path / "killed.mcap"
    about, given, lost_s = SessionSettings(seed=0, model="none", trials=2), list[int](), list[float]()
    with (
        VirtualClock() as clock,
        virtual_arm(VirtualRig(clock, make_bus(emulator_options(ArmOptions())))) as loop,
        BackgroundRecorder(SessionRecorder(path, about), paced=False) as recorder,
    ):
        for number in (0, 1):
            kept = Kept(recorder, None)

            def seen(tick: ArmTick, cycles: Sequence[Cycle], kept: Kept = kept) -> None:
                kept(tick, cycles)
                given.append(tick.frame_ns)
                if len(given) % 90 == 0:  # the file as a kill would leave it now
                    killed.write_bytes(path.read_bytes())
                    missing = given[len(read_recording(killed).channels["/safety"]) :]
                    lost_s.append(1e-9 * (missing[-1] - missing[0]) if missing else 0.0)

            trial = played_until_stopped(goals[number], loop, seen)
            assert trial is not None and given[-1] == trial.back.ticks[-1].frame_ns
    assert len(lost_s) >= 6 and max(lost_s) <= 0.5
    found = read_recording(path)
    times = [message.time_ns for message in found.channels["/safety"]]
    assert found.complete and len(times) == len(given) and times == sorted(times)
    assert np.diff(times).max() > 0.9e9  # a second between the two


@pytest.mark.slow
def test_a_stop_lets_nobody_wait_in_a_pause(recorded: Path) -> None:
    trials, about = RecordedTrials(read_session(recorded), build_scene()), {"mode": "played", "title": ""}
    with (
        VirtualClock() as clock,
        virtual_arm(VirtualRig(clock, make_bus(emulator_options(ArmOptions()))), estop=(estop := Latch(clock))) as loop,
        LivePage(about, port=0) as page,
        looks_on(page.address) as link,
    ):
        view = PlayView(page, trials, loop, "vx300s", 2)
        loop.begin()
        link.send('{"kind": "command", "name": "pause", "value": true}')
        list(until_asked(link))
        clock.start("hand", lambda: (clock.wait_until(clock.now() + 1_000_000_000), estop.pull(Cause.KEY)))
        view.begin(0)
        assert "emergency stop" in loop.trouble
        states = [one for one in until_asked(link) if isinstance(one, dict) and one["kind"] == "state"]
        assert len(states) >= 15 and all(one["paused"] and not one["stopped"] for one in states[:-1])


@pytest.mark.slow
def test_what_is_not_at_the_pace_of_the_clock_is_not_shown(recorded: Path, tmp_path: Path) -> None:
    with progress_bars() as bar, pytest.raises(HighFiveError, match="--port virtual does not"):
        play(PlayOptions(recorded, ArmOptions(VIRTUAL), view=PageOptions()), tmp_path / "out", bar)


@pytest.mark.slow
@pytest.mark.realtime
def test_the_page_stops_what_the_arm_plays(recorded: Path, tmp_path: Path) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    out, page = tmp_path / "out", ("--view", "--page-port", port, "--no-open")
    process = start("rig", "play", recorded, *page, "--out", out, "--json")
    address, _ = page_address(process)
    assert f":{port}/" in address
    texts, command = list[dict](), "estop"
    with looks_on(address) as link:
        try:
            while True:
                message = link.recv(60.0)
                if isinstance(message, bytes):
                    link.send(message[4:8])
                    continue
                texts.append(text := json.loads(message))
                if text["kind"] == "state" and text["trial"] == 0 and text["time_s"] > 0.5 and command:
                    link.send(json.dumps({"kind": "command", "name": command}))
                    command = ""
        except ConnectionClosed:
            pass
    code, said, error = ended(process, within=120.0)
    summary = json.loads(said)
    over = texts[-1]
    assert code == 1 and over["kind"] == "over" and (out / "report.html").is_file(), error
    assert summary["stopped"] in over["message"] and over["report"] == str(out / "report.html")
    stopped = [text["stopped"] for text in texts if text["kind"] == "state"]
    assert "emergency stop" in summary["stopped"] and stopped[-1] and not stopped[0]
