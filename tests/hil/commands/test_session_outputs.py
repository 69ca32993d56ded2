"""A session that other programs hear and that records theirs; what of ``--publish`` and ``--record-lsl`` is wrong."""

import json
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from command_line import failing
from lsl_company import Hearing, Stimuli

from highfive.calibration.latency_file import KeptLatency, save_latencies
from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.commands.session_outputs import check_output_options, nominal_rates, published
from highfive.hil.commands.simulate import simulate
from highfive.hil.commands.simulate_options import SimulateOptions
from highfive.hil.publish.vmc import BONES
from highfive.hil.recording.recording import read_recording
from highfive.hil.runtime.console import progress_bars
from highfive.mocap_bridge.sources.lsl import configure
from highfive.model.errors import HighFiveError

fails = failing("simulate", "--no-pictures")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--publish", "ros"], "there are lsl, vmc or vmc://HOST:PORT, foxglove"),
        (["--publish", "lsl,lsl"], "lsl is there twice"),
        (["--publish", "vmc://127.0.0.1:99999"], "a port of 1 to 65535"),
        (["--publish", "vmc://no.such.invalid"], "cannot publish to vmc://no.such.invalid:39539"),
        (["--publish-network"], "add --publish"),
        (["--publish", "vmc", "--rig", "virtual"], "--rig emulated"),
        (["--record-lsl", "A", "--record-lsl", "A"], "A is there twice"),
        (["--record-lsl", "it's"], "without quotation marks"),
    ],
)
def test_what_is_wrong_is_said_in_one_line_before_anything_begins(
    words: list[str], says: str, fails, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert says in fails("--trials", 1, "--emotion", "happy", "--cell", "B2", *words)
    assert not list(tmp_path.rglob("session.mcap"))


@pytest.mark.skipif(find_spec("foxglove") is not None, reason="foxglove-sdk is installed")
def test_a_package_that_is_missing_is_named(fails, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert "pip install 'high-five[foxglove]'" in fails("--trials", 1, "--publish", "lsl,foxglove")


def test_virtual_time_has_no_listeners() -> None:
    for options in ({"publish": published("lsl")}, {"record_lsl": ("EEG",)}):
        with pytest.raises(HighFiveError, match="the pace of the clock"):
            check_output_options(SimulateOptions(arm=ArmOptions(port="virtual"), **options))  # type: ignore[arg-type]


def test_a_person_who_is_measured_to_be_too_late_is_refused(tmp_path: Path) -> None:
    kept = tmp_path / "kept.toml"
    save_latencies(kept, {"person": KeptLatency(190.0, 2.0, 9, "arm", "a.mcap", "2026-11-25")}, replace=True)
    known = SimulateOptions(source="vicon://lab", latencies=kept, latency_ms=10.0)
    check_output_options(known)
    check_output_options(replace(known, source=None, latency_ms=0.0))  # of other streams in the file there is use
    for wrong, said in (
        ({"latency_ms": 10.5}, "190 ms late, 200.5 with --latency"),
        ({"source": "webcam"}, "take person"),
    ):
        with pytest.raises(HighFiveError, match=said):
            check_output_options(replace(known, **wrong))


def test_a_session_that_is_played_again_has_no_listeners_either() -> None:
    check_output_options(SimulateOptions(), again=True)
    for options in ({"publish": published("vmc")}, {"record_lsl": ("EEG",)}):
        with pytest.raises(HighFiveError, match="as fast as it goes"):
            check_output_options(SimulateOptions(**options), again=True)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("source_hz", "person_hz", "avatar_hz"),
    [(30.0, 30.0, 0.0), (100.0, 100.0, 100.0), (119.88, 119.88, 119.88), (120.0, 120.0, 120.0), (500.0, 0.0, 0.0)],
)
def test_nominal_rates_are_those_at_which_samples_come(source_hz: float, person_hz: float, avatar_hz: float) -> None:
    assert nominal_rates(source_hz) == (person_hz, avatar_hz)


@pytest.mark.slow(15)
def test_a_session_is_heard_and_records_what_others_say(tmp_path: Path) -> None:
    configure(local_only=True)
    hearing, stimuli = Hearing(), Stimuli()
    options = SimulateOptions(
        trials=2, emotions=("happy",), cells=("B2",), pictures=False, record_lsl=("TestStimuli", "TestNobody"),
        publish=published(f"lsl,vmc://127.0.0.1:{hearing.receiver.getsockname()[1]}"),
    )  # fmt: skip
    with progress_bars() as bar:
        summary = simulate(options, tmp_path / "out", bar)
    said = stimuli.finish()
    heard = hearing.finish()
    recording = read_recording(tmp_path / "out" / "session.mcap")
    assert summary["trials"] == 2 and summary["missed"] == 0 and not summary["unrecorded"]

    # From when somebody listens on, every pose, at its time, and as it was recorded.
    shown = {m.data["at_ns"]: i for i, m in enumerate(recording.channels["/tick"])}
    at = np.array(list(shown))
    poses = heard["HighFive-Avatar"]
    places = [int(np.argmin(np.abs(1e-9 * at - stamp))) for _, stamp in poses]
    assert places == list(range(len(at) - len(poses), len(at))) and len(poses) > 100
    assert max(abs(1e-9 * at[place] - stamp) for place, (_, stamp) in zip(places, poses, strict=True)) < 1e-4
    recorded = recording.arrays("/avatar")["quaternions"][places].reshape(len(poses), -1)
    np.testing.assert_allclose(np.array([values[3:] for values, _ in poses], dtype=float), recorded, atol=2e-5)

    events = [(json.loads(str(values[0])), stamp) for values, stamp in heard["HighFive-Events"]]
    names = [event["event"] for event, _ in events if not event["event"].startswith("lsl_")]
    whole = ["trial_start", "hand_raised", "contact", "released", "trial_end"]
    expected = ["session_start", *whole, *whole, "session_end"]
    assert names == expected[-len(names) :] and names.count("contact") >= 1
    stamps = {stamp for _, stamp in poses}
    for event, stamp in events:
        if event["event"] in whole and stamp >= min(stamps):
            assert stamp in stamps  # to the bit that of the pose with which it happened

    frames = [datagram for datagram in hearing.datagrams() if b"/VMC/Ext/T\0" in datagram]
    assert len(frames) > 10 and len(BONES) == 52

    rows = [(m.data["values"][0], m.time_ns) for m in recording.channels["/lsl/TestStimuli"]]
    assert len(rows) > 10
    first = said.index(rows[0][0])
    assert [text for text, _ in rows] == said[first : first + len(rows)]  # from when it was found on, without a gap
    assert all(time_ns >= 0 for _, time_ns in rows) and "/lsl/TestNobody" not in recording.channels
    assert "lsl_found" in [m.data["event"] for m in recording.channels["/event"]]
