"""Everything for which nothing moves: recordings, options and ports that cannot be used."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from kept_arm import changed, kept_text
from mcap.reader import make_reader
from mcap.writer import Writer
from recorded_trials import record_trial
from shipped import written
from trial_results import simulated_result

from highfive.hil.arm.lifecycle import PATIENCE_MS
from highfive.hil.cli import main as cli
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.bus.servo_bus import ServoBus
from highfive.hil.drivers.emulator.emulator_process import EmulatorOptions, EmulatorProcess
from highfive.hil.recording.recorder import SessionRecorder
from highfive.hil.recording.recording import read_recording
from highfive.hil.recording.replay_goals import LEAD_TIME, RecordedHighFives
from highfive.hil.recording.session_reader import read_session
from highfive.hil.session.session import RATE_HZ
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.summary import SessionSettings
from highfive.model.errors import HighFiveError


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of two high fives: one in which the palms met, and one in which they did not."""
    path = tmp_path_factory.mktemp("recorded") / "session.mcap"
    scene = build_scene()
    with SessionRecorder(path, SessionSettings(seed=5, model="none", trials=2)) as recorder:
        record_trial(recorder, simulated_result(scene, 0, "neutral", "B2"))
        record_trial(recorder, simulated_result(scene, 1, "happy", "A2", away=0.3))
    return path


@pytest.fixture(scope="module")
def met(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of one high five, in which the palms met: half as long to read and to write."""
    path = tmp_path_factory.mktemp("met") / "session.mcap"
    with SessionRecorder(path, SessionSettings(seed=5, model="none", trials=1)) as recorder:
        record_trial(recorder, simulated_result(build_scene(), 0, "neutral", "B2"))
    return path


def refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: object) -> str:
    monkeypatch.setattr("sys.argv", ["highfive", *map(str, words)])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 2
    error = capsys.readouterr().err
    assert "Traceback" not in error
    return " ".join(error.split())


@pytest.mark.slow
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
    assert "no high five 2 in which the palms met; there are 1" in said(recorded, "--trial", "2")
    assert "no high five from 2 on; its last one is 1" in said(recorded, "--from", "2")
    assert "contact.speed is 2 m/s" in said(recorded, "--lower", "contact.speed=2")
    assert "can only be lowered" in said(recorded, "--lower", "motion.retract=0.6")
    assert "nonsense.toml" in said(recorded, "--rig", nonsense)
    assert "go wrong on an emulated arm" in said(recorded, "--port", "/dev/ttyUSB99", "--arm", "--faults", "dead=4")
    assert "no fault 'tired'" in said(recorded, "--port", "virtual", "--faults", "tired")
    assert "no servo 99; there are 1, 2," in said(recorded, "--port", "virtual", "--faults", "dead=99@1")


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
    assert "no live person is" in said("virtual", "--source", "vicon://127.0.0.1:1")
    assert "model.safetensors" in said("emulated")  # all is well with the arm
    assert not out.exists()


def torques(emulator: EmulatorProcess) -> set[int]:
    """Of every servo, as it is now."""
    rig = load_rig()
    bus = ServoBus(emulator.port, rig.baud_rate, rig.models, PATIENCE_MS)
    found = {bus.read(servo, "torque_enable") for servo in rig.servos}
    bus.close()
    return found


@pytest.mark.slow
def test_a_real_port_is_refused_where_nobody_knows_who_is_beside_the_arm(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], recorded: Path, tmp_path: Path
) -> None:
    """A bus that answers, and all is well with it; for the program its pseudo-terminal is a real port."""
    out, old = tmp_path / "out", tmp_path / "room.toml"
    old.write_text(changed(kept_text(), date="2026-01-01T09:30:00Z"))
    with EmulatorProcess(EmulatorOptions()) as emulator:
        play = ("rig", "play", recorded, "--port", emulator.port, "--arm", "--out", out)
        live = ("simulate", "--rig", emulator.port, "--arm", "--source", "vicon://127.0.0.1:1", "--out", out)
        simulated = ("simulate", "--rig", emulator.port, "--arm", "--out", out)
        for words, says in (
            (play, "--nobody-near"),
            (simulated, "--slow"),
            (live, "--calibration"),
            ((*live, "--slow"), "--calibration"),
            ((*live, "--nobody-near"), "contradicts the live person"),
            ((*live, "--calibration", old), "another arm"),
            ((*live, "--calibration", tmp_path / "none.toml"), "cannot read the calibration"),
            ((*simulated, "--nobody-near", "--calibration", old), "another arm"),
            ((*live, "--registration", old), "another arm"),
        ):
            assert says in refused(monkeypatch, capsys, *words), words
        assert torques(emulator) == {0}  # nothing was switched on
    assert not out.exists()


@pytest.mark.parametrize("share", np.linspace(0.02, 0.98, 13))
@pytest.mark.slow
def test_a_recording_that_was_cut_short_has_its_first_high_five_or_is_one_line(
    share: float, recorded: Path, tmp_path: Path
) -> None:
    data, path = recorded.read_bytes(), tmp_path / "cut.mcap"
    path.write_bytes(data[: round(share * len(data))])
    try:
        found = RecordedHighFives(read_session(path))
    except HighFiveError as error:
        assert str(path) in str(error) and "\n" not in str(error)
    else:
        assert list(found) == [0]


def test_a_recording_of_another_avatar_is_refused(recorded: Path) -> None:
    other = written(replace(read_recording(recorded), joints=("hip", "knee")))
    with pytest.raises(HighFiveError, match="another avatar: 2 joints"):
        RecordedHighFives(read_session(other))


def rewritten(path: Path, out: Path, topic: str, change: Callable[[dict[str, Any]], dict[str, Any] | None]) -> Path:
    """A valid MCAP file whose messages of a topic were changed; None leaves one out."""
    writer, channels = Writer(str(out)), dict[str, int]()
    writer.start()
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            if channel.topic not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, channel.message_encoding, number)
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
        ("/trial", {"emotion": None}, "emotion is no text"),
        ("/contact", {"met": ...}, "met is missing"),
        ("/contact", {"met_time": -1.0}, "met_time is -1 s, which is not within the trial"),
        ("/session", {"joints": ...}, "/session holds no settings and joints"),
    ],
)
@pytest.mark.slow
def test_a_recording_whose_values_cannot_be_is_refused_in_one_line_before_the_port_is_opened(
    topic: str, change: dict[str, Any] | None, said: str,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], met: Path, tmp_path: Path,
) -> None:  # fmt: skip
    def changed(data: dict[str, Any]) -> dict[str, Any] | None:
        return None if change is None else {key: it for key, it in (data | change).items() if it is not ...}

    path = rewritten(met, tmp_path / "damaged.mcap", topic, changed)
    # A port that is not there is reported only once somebody opens it.
    error = refused(monkeypatch, capsys, "rig", "play", path, "--port", tmp_path / "no-port", "--arm", "--slow")
    assert error.startswith(f"error: {path}") and said in error, error


def test_what_is_played_is_what_was_recorded(recorded: Path) -> None:
    """The hand's place where the palms met, and the time that is left until then."""
    recording = read_recording(recorded)
    found = RecordedHighFives(read_session(recorded))
    assert list(found) == [0]
    reference, (times, _) = found[0], recording.poses()
    judgement = recording.channels["/contact"][0].data
    assert reference.due == round(judgement["met_time"] * RATE_HZ)
    assert len(reference.goals) <= len(times)
    expected = [tick for tick, goal in enumerate(reference.goals) if goal.contact is not None]
    assert expected[0] == reference.due - round(LEAD_TIME * RATE_HZ)
    first = reference.goals[expected[0]].contact
    assert first is not None
    assert first.time == pytest.approx(LEAD_TIME, abs=1.0 / RATE_HZ)
    assert np.linalg.norm(first.point - reference.avatar[reference.due]) < 0.02  # the palms met there
    np.testing.assert_allclose(first.point, recording.channels["/person"][reference.due].data["palm"], atol=1e-5)
