"""``highfive serve`` as a user runs it."""

import json
import signal
import socket
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from command_line import failing
from live_commands import ended, lab_recording, serving, stop, summary
from live_frames import until

from highfive.hil.cli import main as cli
from highfive.hil.commands.serve import ServeOptions, address_of, make_server
from highfive.mocap_bridge.files.c3d import read_c3d
from highfive.mocap_bridge.files.recording import Recording
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.servers.faults import Faults, parse_fault
from highfive.mocap_bridge.servers.serving import Server
from highfive.mocap_bridge.sources.address import open_source
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.mocap_bridge.sources.scheduler import ThreadScheduler


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lab_recording(tmp_path_factory.mktemp("serve") / "lab.c3d")


fails = failing("serve")


def test_bad_input_is_one_line(fails, lab: Path, tmp_path: Path) -> None:
    (tmp_path / "text.c3d").write_text("this is no C3D file\n" * 100)
    assert "--host is empty" in fails("vicon", lab, "--host", "")
    assert "vicon, qtm, natnet, lsl" in fails("vrpn", lab)
    assert "absent.c3d" in fails("vicon", tmp_path / "absent.c3d")
    assert "text.c3d" in fails("vicon", tmp_path / "text.c3d")
    assert "flood" in fails("vicon", lab, "--faults", "flood")
    assert "LELB" in fails("vicon", lab, "--port", 0, "--faults", "occlusion=LELB@5")
    assert "Eve" in fails("vicon", lab, "--person", "Eve")
    assert "--rate" in fails("vicon", lab, "--rate", 0)
    assert "--port" in fails("vicon", lab, "--port", 70000)
    assert "--port" in fails("lsl", lab, "--port", 5)


@pytest.mark.parametrize(("protocol", "kind"), [("vicon", socket.SOCK_STREAM), ("qtm", socket.SOCK_STREAM)])
def test_a_port_that_is_taken(fails, lab: Path, protocol: str, kind: int) -> None:
    with socket.socket(socket.AF_INET, kind) as taken:
        taken.bind(("127.0.0.1", 0))
        if kind == socket.SOCK_STREAM:
            taken.listen()
        assert str(taken.getsockname()[1]) in fails(protocol, lab, "--port", taken.getsockname()[1])


def test_ctrl_c_ends_it_well_and_it_says_how_much_was_sent(lab: Path) -> None:
    process, address, about = serving("vicon", lab, "--loop", "--port", 0)
    try:
        assert address.startswith("vicon://127.0.0.1:")
        code, out, err = ended(process, signal.SIGINT)
        assert code == 0, err
        assert "lab.c3d" in about
        assert "human and avatar" in about
        assert out.splitlines()[-1].endswith(" sent")
    finally:
        stop(process)


def test_a_recording_ends_by_itself(
    lab: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def said(*words: object) -> dict:
        monkeypatch.setattr("sys.argv", ["highfive", "serve", "vicon", str(lab), "--port", "0", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        assert end.value.code == 0
        return json.loads(capsys.readouterr().out)

    faster = said("--rate", 240, "--seed", 1, "--json")
    assert faster["frames_sent"] == 479  # 240 frames at 120 Hz last 239 periods, of two frames each
    assert faster["rate_hz"] == 240.0
    assert 1 <= said("--loop", "--seconds", 0.3, "--json")["frames_sent"] <= 37


PROTOCOLS = ["vicon", *(pytest.param(name, marks=pytest.mark.slow) for name in ("qtm", "natnet", "lsl"))]


def faults_of(protocol: str) -> tuple[str, str]:
    """A channel of LSL stays where it is."""
    return "occlusion=RFIN", "reorder" if protocol != "lsl" else "nan=RWRA"


@pytest.mark.slow
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_what_is_served_is_what_is_seen(lab: Path, protocol: str) -> None:
    port = [] if protocol == "lsl" else ["--port", 0]
    faults = [word for fault in faults_of(protocol) for word in ("--faults", fault)]
    process, address, _ = serving(protocol, lab, "--loop", *port, *faults)
    try:
        said = summary(address, "--person", "human", "--seconds", 2)
    finally:
        stop(process)
    assert said["source"] == address
    assert said["frames"] > 0
    assert said["nominal_rate_hz"] == 120.0
    assert said["markers"]["RFIN"] == 0.0
    assert said["markers"]["RSHO"] > 0.9
    assert said["marker_set"] == "paper"
    assert set(said["age_ms"]) == {"p50", "p99", "max"}


X, STEP_M = np.array([1.0, 0.0, 0.0]), 1e-4
PERIOD_S = 1.0 / 120.0


class Unhurried(ThreadScheduler):
    """By its clock no silence is ever too long."""

    def now(self) -> int:
        return 1


@dataclass
class Followed:
    """A server of a protocol and who follows it; each frame is sent once the one before has come.

    Where everything is tells a frame's number: it goes :data:`STEP_M` along x a frame. LSL sends no numbers.
    """

    server: Server
    recording: Recording
    came: list[MarkerFrame]
    sent: int = 0

    def number(self, frame: MarkerFrame) -> int:
        column, own = frame.names.index("human:RSHO"), self.recording.names.index("human:RSHO")
        return round((frame.positions[column, 0] - self.recording.points[0, own, 0]) / STEP_M)

    def send(self, frames: int, patience_s: float, *faults: str) -> None:
        """Sends so many, no sooner than a period one after another, and waits for each."""
        replay, still = Faults([parse_fault(fault) for fault in faults]), self.recording.frame(0, 0, 120.0)
        for _ in range(frames):
            begun, number = time.monotonic(), self.sent
            time_ns = round(number * 1e9 * PERIOD_S)
            frame = replace(still, positions=still.positions + STEP_M * number * X, number=number)
            for changed in replay.of(replace(frame, source_time_ns=time_ns, arrival_time_ns=time_ns)):
                self.server.send(changed)
                while self.came and self.number(self.came[-1]) < number and time.monotonic() < begun + patience_s:
                    time.sleep(1e-3)
            self.sent += 1
            time.sleep(max(0.0, begun + PERIOD_S - time.monotonic()))


@contextmanager
def followed(protocol: str, lab: Path) -> Iterator[tuple[Followed, LiveSource]]:
    recording, came = read_c3d(lab), list[MarkerFrame]()
    options = ServeOptions(protocol, lab, port=None if protocol == "lsl" else 0)
    with closing(make_server(options, recording)) as server:
        address = address_of(options, server.port)
        tap = lambda frames, _: came.extend(frames)  # noqa: E731
        with closing(open_source(address, "human", tap=tap, scheduler=Unhurried())) as source:
            assert isinstance(source, LiveSource)
            follower = Followed(server, recording, came)
            while not came:
                follower.send(1, 30.0)
            yield follower, source


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_every_frame_that_is_sent_comes_as_it_was_and_those_that_are_not_are_counted(lab: Path, protocol: str) -> None:
    """Nothing here goes by the clock, but that no frame is sent too early."""
    with followed(protocol, lab) as (following, source):
        begun = following.sent
        gap = f"gap=30@{(begun + 59.9) * PERIOD_S}"
        # QTM's client asks for the new order of labels, and leaves out what came meanwhile: that is not waited for.
        following.send(240, 0.1 if protocol == "qtm" else 30.0, gap, *faults_of(protocol))
        came = [frame for frame in following.came if following.number(frame) >= begun]
        until(lambda: source.newest(0) is not None and source.health(0).received == len(following.came))
        numbers, health = [following.number(frame) for frame in came], source.health(0)
    sent = [*range(begun, begun + 60), *range(begun + 90, begun + 240)]
    if protocol == "qtm":
        left_out = [number for number in range(begun, numbers[-1]) if number not in numbers]
        assert set(left_out) >= set(range(begun + 60, begun + 90))
        assert numbers == sorted(set(numbers)) and len(numbers) > 120
    else:
        left_out = list(range(begun + 60, begun + 90))
        assert numbers == sent
    assert (health.lost, health.refused, health.trouble) == (len(left_out), 0, "")
    assert source.rate_hz == 120.0
    whole, hidden = (
        following.recording,
        {"human:RFIN", "avatar:RFIN"} | ({"human:RWRA"} if protocol == "lsl" else set()),
    )
    for number, frame in zip(numbers, came, strict=True):
        columns = [whole.names.index(name) for name in frame.names]
        assert {name for name, seen in zip(frame.names, frame.valid, strict=True) if not seen} == hidden
        where = whole.points[0, columns] + STEP_M * number * X
        np.testing.assert_allclose(frame.positions[frame.valid], where[frame.valid], atol=1e-6)
