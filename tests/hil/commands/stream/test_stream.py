"""``highfive stream`` as a user runs it, on this machine's own network."""

import json
import signal
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import count
from pathlib import Path
from threading import Event, Thread
from typing import Any

import numpy as np
import pytest
from command_line import failing
from live_commands import ended, lab_recording, serving, start, stop, summary, wait_for
from rich.console import Console
from virtual_system import VirtualSystem

from highfive.hil.cli import main as cli
from highfive.hil.commands.stream.arm import ArmView
from highfive.hil.commands.stream.screen import StreamView, plain_line, screen
from highfive.hil.commands.stream.statistics import Histogram, StreamStatistics
from highfive.hil.commands.stream.stream import FIRST_FRAME_S, StreamOptions, stream
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.mocap_bridge.files.c3d import read_c3d
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.servers.vicon import ViconServer
from highfive.mocap_bridge.sources.source import Connection, SourceHealth
from highfive.model.errors import HighFiveError


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lab_recording(tmp_path_factory.mktemp("stream") / "lab.c3d")


@pytest.fixture(scope="module")
def vicon(lab: Path) -> Iterator[str]:
    process, address, _ = serving("vicon", lab, "--loop", "--port", 0)
    yield address
    stop(process)


@pytest.fixture
def clock() -> Iterator[VirtualClock]:
    with VirtualClock() as clock:
        yield clock


def heard(system: VirtualSystem, seconds: float, **options: Any) -> dict[str, Any]:
    """The summary of a stream in virtual time."""
    said = StreamOptions("vicon://lab", "human", seconds, quiet=True, **options)
    return stream(said, lambda line: None, system.wiring)


fails = failing("stream")


def test_bad_input_is_one_line(fails, vicon: str, lab: Path, tmp_path: Path) -> None:
    assert "vicon://" in fails("vrpn://here")
    assert "absent.c3d" in fails(tmp_path / "absent.c3d")
    assert "several persons" in fails(lab, "--seconds", 1)
    assert "human, avatar" in fails(vicon, "--person", "Eve", "--seconds", 1)
    assert "RSHO" in fails(vicon, "--person", "avatar", "--marker-set", "paper", "--seconds", 1)
    assert "no marker set 'mine'" in fails(vicon, "--person", "human", "--marker-set", "mine", "--seconds", 1)
    (tmp_path / "there.c3d").write_bytes(b"kept")
    assert "there already" in fails(vicon, "--record", tmp_path / "there.c3d")
    assert "take.c3d" in fails(vicon, "--record", tmp_path / "take.mcap")
    assert "no folder" in fails(vicon, "--record", tmp_path / "nowhere" / "take.c3d")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["there.c3d"]


@pytest.mark.parametrize("begins_s", [0.0, 0.0027, 2.2041])
def test_a_summary_for_machines(lab: Path, clock: VirtualClock, begins_s: float) -> None:
    """Whenever the system begins: every frame, none late, none lost."""
    said = heard(VirtualSystem(clock, read_c3d(lab), begins_s=begins_s), 1.5)
    assert said["source"] == "vicon://lab:801"
    assert said["connection"] == "live" and said["trouble"] == ""
    assert said["rate_hz"] == pytest.approx(120.0, abs=0.01) and said["nominal_rate_hz"] == 120.0
    assert 180 <= said["frames"] <= 182 and said["lost_frames"] == said["refused_frames"] == 0
    assert 0.0 < said["age_ms"]["p50"] <= said["age_ms"]["p99"] <= said["age_ms"]["max"] < 0.1
    assert set(said["jitter_ms"]) == {"std", "p99"}
    assert said["jitter_ms"]["std"] < 0.02 and said["jitter_ms"]["p99"] == pytest.approx(1e3 / 120.0, rel=0.011)
    assert set(said["markers"].values()) == {1.0}
    assert said["marker_set"] == "paper"
    assert 0.0 <= said["arm"]["elbow_flexion_deg"] < 60.0


def test_of_two_people_one_has_to_be_chosen_at_once(fails, vicon: str, lab: Path, clock: VirtualClock) -> None:
    said = fails(vicon)
    assert "human, avatar" in said
    assert "--person" in said
    system, begun = VirtualSystem(clock, read_c3d(lab)), clock.now()
    with pytest.raises(HighFiveError, match="human, avatar"):
        stream(StreamOptions("vicon://lab", quiet=True), lambda line: None, system.wiring)
    assert clock.now() - begun < 0.3e9


def test_what_does_not_come_is_not_waited_for_longer_than_was_said(lab: Path, clock: VirtualClock) -> None:
    system, begun = VirtualSystem(clock, read_c3d(lab), begins_s=100.0), clock.now()
    said = heard(system, 1.0)
    assert said["frames"] == 0 and said["connection"] == "connecting" and said["trouble"]
    assert clock.now() - begun == pytest.approx(1e9 * FIRST_FRAME_S, abs=0.2e9)


@contextmanager
def joined_later(after_s: float) -> Iterator[str]:
    """A Vicon that tracks Bert, and Anna too from so long after its first client came."""
    server, stop = ViconServer(port=0), Event()
    points = np.random.default_rng(0).uniform(0.2, 1.6, size=(3, 3))

    def send() -> None:
        served = 0
        for number in count():
            served += server.sent_ns > 0
            people = ("Bert", "Anna") if served > 120.0 * after_s else ("Bert",)
            names = tuple(f"{person}:M{m}" for person in people for m in range(3))
            both = np.tile(points, (len(people), 1)), np.ones(len(names), dtype=bool)
            server.send(MarkerFrame(names, *both, number, 0, 0, np.zeros((0, 3))))
            if stop.wait(1.0 / 120.0):
                return

    thread = Thread(target=send)
    thread.start()
    try:
        yield f"vicon://127.0.0.1:{server.port}"
    finally:
        stop.set()
        thread.join()
        server.close()


@pytest.mark.slow
def test_a_person_who_comes_later_is_waited_for() -> None:
    with joined_later(2.5) as address:
        said = summary(address, "--person", "Anna", "--seconds", 1)
    assert said["frames"] > 60
    assert said["refused_frames"] > 150
    assert set(said["markers"]) == {"M0", "M1", "M2"}


def test_frames_that_were_refused_neither_raise_nor_lower_the_rate(lab: Path, clock: VirtualClock) -> None:
    """The unit goes wrong: those frames come, in their time, and are counted apart."""
    said = heard(VirtualSystem(clock, read_c3d(lab), "metres@5-6", "metres@7-8", "metres@9-60"), 12)
    assert said["refused_frames"] == pytest.approx(120 * 5, abs=2)
    assert said["frames"] == pytest.approx(120 * 7, abs=2)
    assert said["rate_hz"] == pytest.approx(120.0, abs=0.01)
    assert said["lost_frames"] == 0 and "unit" in said["trouble"]


@pytest.mark.slow
def test_what_is_recorded_is_whole_after_ctrl_c_and_after_a_kill(vicon: str, tmp_path: Path) -> None:
    take = tmp_path / "take.c3d"
    raw = tmp_path / "take.c3d.part"
    killed = start("stream", vicon, "--person", "human", "--record", take)
    assert wait_for(raw, 20_000)
    other = start("stream", vicon, "--person", "human", "--record", take, "--seconds", 1)
    code, _, err = ended(other)
    assert code == 2
    assert "another process" in err
    killed.kill()
    killed.communicate()
    assert not take.exists()
    again = start("stream", vicon, "--person", "human", "--record", take)
    assert wait_for(tmp_path / "take-recovered.c3d", 20_000)
    assert wait_for(raw, 40_000)
    code, _, err = ended(again, signal.SIGINT)
    assert code == 0
    assert "had not been finished" in err
    assert "gaps" in err
    for path in (take, tmp_path / "take-recovered.c3d"):
        recording = read_c3d(path)
        assert len(recording) > 30
        assert recording.rate_hz == 120.0
        assert set(recording.prefixes) == {"human", "avatar"}
        assert recording.valid.mean() > 0.9
    assert not raw.exists()


def test_a_file_is_shown_until_its_end(
    lab: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["highfive", "stream", str(lab), "--person", "human", "--json"])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 0
    said = json.loads(capsys.readouterr().out)
    assert said["connection"] == "ended"
    assert said["frames"] == 240
    assert said["markers"]["RFIN"] == 1.0


@pytest.mark.slow
def test_where_no_frame_comes_one_line_says_why(vicon: str) -> None:
    """Nothing there; a server that accepts and says nothing; another protocol."""
    with socket.create_server(("127.0.0.1", 0)) as silent, socket.create_server(("127.0.0.1", 0)) as gone:
        quiet, nothing = silent.getsockname()[1], gone.getsockname()[1]
        gone.close()
        addresses = [f"vicon://127.0.0.1:{nothing}", f"vicon://127.0.0.1:{quiet}", vicon.replace("vicon", "qtm")]
        processes = [start("stream", address, "--seconds", 1, "--json") for address in addresses]
        for address, process in zip(addresses, processes, strict=True):
            code, out, err = ended(process)
            assert code == 1, err
            assert json.loads(out)["frames"] == 0
            assert json.loads(out)["trouble"]
            assert len(err.strip().splitlines()) == 1
            assert err.startswith(f"no frame came from {address}: ")


def test_a_system_that_goes_and_comes_back(lab: Path, clock: VirtualClock, tmp_path: Path) -> None:
    """It is found again at the next attempt to connect; what was recorded has its gap where it was."""
    said = heard(VirtualSystem(clock, read_c3d(lab), "disconnect@3-5"), 7, record=tmp_path / "a.c3d")
    assert said["connection"] == "live" and said["trouble"] == ""
    recording = read_c3d(tmp_path / "a.c3d")
    assert len(recording) == pytest.approx(120 * 7, abs=2)  # seven seconds, with a gap
    there = recording.valid.any(axis=1)
    assert there[:360].all() and not there[360:600].any() and there[600 + 120 * 2 :].all()
    assert said["lost_frames"] == (~there).sum()
    assert 0 <= there.sum() - said["frames"] <= 1  # one more may come before the source is closed


def test_percentiles_are_right_to_a_hundredth() -> None:
    rng, histogram = np.random.default_rng(0), Histogram()
    values = rng.lognormal(1.0, 1.0, 5000)
    for value in values:
        histogram.add(float(value))
    for share in (0.5, 0.99):
        assert histogram.percentile(share) == pytest.approx(np.quantile(values, share), rel=0.02)
    assert histogram.max == values.max()
    assert histogram.std == pytest.approx(values.std())
    assert Histogram().percentile(0.5) == Histogram().std == 0.0


def statistics(frames: int = 240) -> StreamStatistics:
    kept = StreamStatistics()
    names = tuple(f"M{m}" for m in range(40))
    for k in range(frames):
        valid = np.ones(40, dtype=bool)
        valid[3] = k < 60
        valid[4] = False
        arrival = round(k * 1e9 / 120)
        kept.add(MarkerFrame(names, np.zeros((40, 3)), valid, k, arrival, arrival, np.zeros((2, 3))), arrival + 500_000)
    return kept


@pytest.mark.slow
def test_markers_are_counted_in_the_last_second_and_altogether() -> None:
    seen = statistics().snapshot(2_000_000_000)
    assert seen.frames == 240
    assert 119 <= seen.rate_hz <= 121
    assert seen.share[[2, 3, 4]].tolist() == [1.0, 0.25, 0.0]
    assert seen.recent[[2, 3, 4]].tolist() == [1.0, 0.0, 0.0]
    assert seen.last_seen_s[3] == pytest.approx(1.5, abs=0.02)
    assert np.isinf(seen.last_seen_s[4])
    assert seen.age_ms[0] == pytest.approx(0.5, rel=0.01)
    assert seen.jitter_ms[0] < 0.01


@pytest.mark.parametrize(("width", "height"), [(100, 30), (60, 12), (200, 50)])
@pytest.mark.slow
def test_the_screen_fits_and_shows_the_worst_markers(width: int, height: int) -> None:
    arm = ArmView(1.0, 0.5, np.array([0.5, 0.1, 1.2]), True, ("M1", "M2"))
    health = SourceHealth(Connection.STALLED, 1_200_000_000, 240, 7, "nothing [came]")
    view = StreamView("lsl://x", health, 120.0, statistics().snapshot(2_000_000_000), "paper", arm, ("recording",))
    console = Console(width=width, height=height, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    console.print(screen(view, width, height))
    shown = console.export_text()
    assert len(shown.splitlines()) <= height
    for text in ("lsl://x", "stalled", "nothing [came]", "M3", "M4", "never", "elbow 57°"):
        assert text in shown
    assert "not believed: M1 M2" in plain_line(view)
    assert "hidden" not in plain_line(view)  # nothing comes
    live = replace(view, health=SourceHealth(Connection.LIVE, 0, 240, 7, ""))
    assert "hidden: M3 M4" in plain_line(live)
