"""A headset is registered beside a motion capture system, in virtual time, against the truth; drift is said once."""

import json
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from command_line import failing
from live_commands import ended, lab_recording, serving, start, stop
from page_address import page_address
from two_heads import EYES, HAND, SPACE, Moves, messages, recording
from virtual_system import VirtualSystem
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from highfive.calibration.headset_file import KeptRegistration, load_headset, save_headset
from highfive.calibration.headset_fit import HeadsetRegistration
from highfive.calibration.placement import Placement
from highfive.calibration.placement_file import save_placement
from highfive.hil.commands.calibrate_headset import HeadsetCalibration, calibrate_headset
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.trials.head_watch import DriftWatch, HeadWatch
from highfive.hil.trials.live_partner import live_source
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.wire.headset import JOINTS, HeadsetPose, encode_headset
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations

ADDRESS = "vicon://lab"
PAPER = load_marker_set("paper")


calibrating, simulating = failing("calibrate", "headset"), failing("simulate")


@pytest.fixture
def clock() -> Iterator[VirtualClock]:
    with VirtualClock() as clock:
        yield clock


def feed(clock: VirtualClock, come: Sequence[tuple[int, bytes]]) -> Callable[[float], list[bytes]]:
    """Hands each message over when it comes."""
    waiting = list(come)

    def take(timeout_s: float) -> list[bytes]:
        until = clock.now() + round(1e9 * timeout_s)
        clock.wait_until(min(waiting[0][0], until) if waiting else until)
        due = [data for at, data in waiting if at <= clock.now()]
        del waiting[: len(due)]
        return due

    return take


def registered(clock: VirtualClock, out: Path, moves: Moves = Moves(), *faults: str, worn: bool = True, **said) -> dict:  # noqa: B008
    system = VirtualSystem(clock, recording(PAPER, moves), *faults)
    come = messages(clock.now(), 40.0, moves, **said) if worn else []
    options = HeadsetCalibration(ADDRESS, out=out)
    return calibrate_headset(options, lambda *_: lambda *_: None, system.wiring, feed(clock, come))


def hand_off(found) -> float:
    return float(np.linalg.norm(found.apply(HAND) - rotations.rotate(SPACE[0], HAND) - SPACE[1]))


@pytest.mark.slow
def test_nodding_and_turning_find_the_space_and_the_delay(clock: VirtualClock, tmp_path: Path) -> None:
    out = tmp_path / "headset.toml"
    summary = registered(clock, out)
    kept = load_headset(out, "vicon", "paper")
    assert hand_off(kept.registration) < 0.003
    assert summary["delay_ms"] == pytest.approx(35.0, abs=4.0)
    assert 0.5 < summary["residual_mm"] < 8.0 and summary["hand_sigma_mm"] < 3.0
    np.testing.assert_allclose(summary["rotation"], kept.registration.rotation, atol=1e-9)


@pytest.mark.parametrize(
    ("moves", "said", "message"),
    [
        (Moves(nod=0.02), {}, "did not nod enough"),
        pytest.param(Moves(turn=0.02), {}, "did not turn enough", marks=pytest.mark.slow),
        pytest.param(
            Moves(),
            {"lost": 0.6},
            "messages of the headset show its place, expected 70 %: tracking was lost",
            marks=pytest.mark.slow,
        ),
        pytest.param(Moves(), {"recentred_s": 12.0}, "was recentred meanwhile", marks=pytest.mark.slow),
        pytest.param(Moves(), {"worn": False}, "no headset has sent anything", marks=pytest.mark.slow),
    ],
)
@pytest.mark.slow
def test_what_is_too_little_is_refused(
    moves: Moves, said: dict, message: str, clock: VirtualClock, tmp_path: Path
) -> None:
    with pytest.raises(HighFiveError, match=message):
        registered(clock, tmp_path / "headset.toml", moves, **said)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_markers_that_are_hidden_are_refused(clock: VirtualClock, tmp_path: Path) -> None:
    with pytest.raises(HighFiveError, match="show all markers of the head, expected 70 %"):
        registered(clock, tmp_path / "headset.toml", Moves(), "occlusion=LFHD@0-15")


@pytest.mark.slow
def test_a_registration_of_another_system_or_set_or_of_nothing_is_refused(clock: VirtualClock, tmp_path: Path) -> None:
    out = tmp_path / "headset.toml"
    registered(clock, out)
    with pytest.raises(HighFiveError, match="beside a vicon system, the person comes from qtm"):
        load_headset(out, "qtm")
    with pytest.raises(HighFiveError, match="of marker set paper, the person wears full_body"):
        load_headset(out, "vicon", "full_body")
    text = out.read_text(encoding="utf-8")
    for wrong, reason in (
        (text.replace("[headset]", "[world]"), r"\[headset\] is missing"),
        (text.replace("translation_m = [", "translation_m = [800.0, "), "expected 3 numbers"),
        (text.replace("delay_s = ", "delay_s = 9"), "headset.delay_s is 9"),
    ):
        out.write_text(wrong, encoding="utf-8")
        with pytest.raises(HighFiveError, match=f"no registration of a headset: .*{reason}"):
            load_headset(out, "vicon")


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("--source", "headset"), "expected a motion capture system"),
        (("--source", "vicon://lab", "--seconds", "1"), "greater than or equal to 5"),
        (("--source", "vicon://lab", "--out", "headset.json"), "write it as headset.toml"),
    ],
)
def test_the_command_line_says_what_is_wrong(
    words: tuple[str, ...], reason: str, calibrating: Callable[..., str]
) -> None:
    assert reason in calibrating(*words)


@pytest.mark.parametrize("source", [(), ("--source", "headset")])
def test_a_session_refuses_a_registration_without_a_system(
    source: tuple[str, ...], simulating: Callable[..., str], tmp_path: Path
) -> None:
    said = simulating("--headset", tmp_path / "headset.toml", "--out", tmp_path / "session", *source)
    assert "beside a motion capture system" in said and not (tmp_path / "session").exists()


@pytest.mark.parametrize("moved_m", [pytest.param(0.0, marks=pytest.mark.slow), 0.04])
@pytest.mark.slow
def test_drift_is_said_once_and_its_absence_not_at_all(moved_m: float, clock: VirtualClock, tmp_path: Path) -> None:
    """The head as both see it, for ten seconds; the headset's space lies where it was registered, or elsewhere."""
    registered(clock, tmp_path / "headset.toml")
    kept = load_headset(tmp_path / "headset.toml", "vicon")
    away = SPACE[0], SPACE[1] + [moved_m, 0.0, 0.0]
    system = VirtualSystem(clock, recording(PAPER, Moves(), seed=3, space=away))
    take, said = feed(clock, messages(clock.now(), 12.0, Moves(), seed=4)), list[str]()
    with closing(live_source(ADDRESS, None, system.wiring)) as source:
        head = HeadWatch(source, PAPER, take, clock.now, keep_s=3.0)
        drift = DriftWatch(head, kept.registration, clock.now, said.append)
        end = clock.now() + 10_000_000_000
        while clock.now() < end:
            clock.wait_until(clock.now() + 8_000_000)
            drift.look()
    assert len(said) == (1 if moved_m else 0)
    if moved_m:
        assert "register it anew" in said[0] and "highfive calibrate headset" in said[0]


@pytest.mark.slow(25)
@pytest.mark.parametrize("off_m", [0.0, 0.05])
def test_a_session_over_the_wire_says_when_the_headset_is_not_where_it_was_registered(
    off_m: float, tmp_path: Path
) -> None:
    """Somebody stands still before a server of ours; the page sends her eyes where they were registered, or beside."""
    one = np.array([1.0, 0.0, 0.0, 0.0])
    file, place = tmp_path / "headset.toml", tmp_path / "place.toml"
    found = HeadsetRegistration(*SPACE, *EYES, 0.0, 0.003, 0.005, 0.002)
    save_headset(file, KeptRegistration(found, "vicon", "paper", datetime.now(UTC)))
    save_placement(place, Placement(one, np.zeros(3), ()), "vicon", datetime.now(UTC))
    eyes = np.array(PAPER.segments["head"].centre) + [0.4, 0.2, 0.0] + EYES[1] + [0.0, off_m, 0.0]
    pose = HeadsetPose(
        0, 0, 0.0, np.concatenate([eyes, EYES[0]]), True, np.zeros((2, JOINTS, 3)), np.zeros((2, JOINTS), dtype=bool),
        np.zeros((4, 3)), np.zeros(4, dtype=bool),
    )  # fmt: skip
    server, address, _ = serving("vicon", lab_recording(tmp_path / "lab.c3d"), "--loop", "--port", 0)
    words = ("--source", address, "--human", "human", "--headset", file, "--place", place, "--out", tmp_path / "s")
    session = start("simulate", *words, "--trials", 1, "--no-open", "--no-pictures")
    try:
        page, said = page_address(session)
        with connect(page.replace("http", "ws", 1).replace("/?", "/live?", 1), compression=None) as link:
            hello = json.loads(link.recv(10.0))
            np.testing.assert_allclose(hello["space"]["rotation"], SPACE[0], atol=1e-6)
            np.testing.assert_allclose(hello["space"]["translation"], SPACE[1], atol=1e-6)
            number = 0
            while session.poll() is None:
                number += 1
                try:
                    link.send(encode_headset(replace(pose, number=number, holds_ms=1e3 * time.monotonic())))
                except ConnectionClosed:
                    break
                time.sleep(1.0 / 72.0)
        _, _, rest = ended(session)
        told = "".join([*said, rest]).count("register it anew")
        assert told == (1 if off_m else 0)
    finally:
        stop(session)
        stop(server)
