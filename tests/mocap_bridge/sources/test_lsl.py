"""LSL over the real library on this machine: our server, and outlets that know nothing of us."""

import itertools
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pylsl
import pytest
from live_frames import PATIENCE_S, live, until

from highfive.mocap_bridge.files.recording import Recording, make_recording
from highfive.mocap_bridge.files.take_file import TakeWriter, take_to_c3d
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.servers.lsl import LslServer
from highfive.mocap_bridge.servers.serving import serve
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.mocap_bridge.sources.lsl import configure, connect_lsl
from highfive.mocap_bridge.sources.tap import tapped
from highfive.mocap_bridge.wire.errors import LinkError
from highfive.model.errors import HighFiveError

NAMES = ("human:RFIN", "human:RMC5", "human:RWRA", "human:LFHD")


@pytest.fixture(scope="module", autouse=True)
def this_machine_alone() -> None:
    configure(local_only=True)


def body(frames: int = 2400) -> Recording:
    points = np.random.default_rng(0).uniform(0.2, 1.6, size=(1, len(NAMES), 3)) + np.zeros((frames, 1, 1))
    valid = np.ones((frames, len(NAMES)), dtype=bool)
    valid[:, 2] = False
    return make_recording(120.0, NAMES, points, valid)


@pytest.fixture
def playing() -> Iterator[LslServer]:
    server, stop = LslServer(NAMES, 120.0, "HighFiveTest"), threading.Event()
    thread = threading.Thread(target=serve, args=(body(), server), kwargs={"stop": stop, "loop": True})
    thread.start()
    yield server
    stop.set()
    thread.join()
    server.close()
    server.close()


def test_frames_arrive_with_their_times_and_hidden_markers(playing: LslServer) -> None:
    assert playing.port > 0
    source = LiveSource("lsl://HighFiveTest", lambda: connect_lsl("HighFiveTest"), "human")
    try:
        frame = source.first(PATIENCE_S)
        numbers, ahead = [], []
        for _ in range(60):
            following = source.wait(frame, PATIENCE_S)
            assert following is not None
            frame = following
            numbers.append(frame.number)
            ahead.append(frame.source_time_ns - frame.arrival_time_ns)
        assert frame.names == ("RFIN", "RMC5", "RWRA", "LFHD")
        assert frame.valid.tolist() == [True, True, False, True]
        assert np.allclose(frame.positions[[0, 1, 3]], body(1).points[0, [0, 1, 3]], atol=1e-6)
        assert source.rate_hz == 120.0
        assert all(after > before for before, after in itertools.pairwise(numbers))
        assert max(ahead) < 5_000_000  # on this process's clock: no frame came before it was sent
        playing.hang_up()
        assert playing.port == 0
        until(lambda: not live(source))
        playing.answer()
        assert source.wait(source.newest(0), PATIENCE_S) is not None
    finally:
        source.close()


def test_an_outlet_of_someone_else_in_millimetres_with_y_up() -> None:
    info = pylsl.StreamInfo("NotOurs", "mocap", 4, 0.0, pylsl.cf_double64, "not ours")
    channels = info.desc().append_child("channels")
    for label in ("FrameNumber", "RFIN_X", "RFIN_Y", "RFIN_Z"):
        channel = channels.append_child("channel")
        channel.append_child_value("label", label)
        channel.append_child_value("unit", "millimeters")
    outlet = pylsl.StreamOutlet(info)
    link = connect_lsl("NotOurs", y_up=True)
    try:
        assert link.rate_hz == 0.0
        frames: list[MarkerFrame] = []
        end = time.monotonic() + PATIENCE_S
        while len(frames) < 3 and time.monotonic() < end:
            outlet.push_sample([41.0 + len(frames), 1000.0, 2000.0, 3000.0])
            frames += link.receive(0.1)
        assert frames[0].number >= 41
        assert np.allclose(frames[0].positions, [[1.0, -3.0, 2.0]])
        del outlet
        with pytest.raises(LinkError, match="lost"):
            for _ in range(50):
                link.receive(0.1)
    finally:
        link.close()
    with pytest.raises(LinkError, match="closed"):
        link.receive(0.0)


@pytest.mark.parametrize("lost_every", [0, 97])
def test_an_outlet_that_stamps_at_push_and_is_late_at_times(tmp_path: Path, lost_every: int) -> None:
    """One sample in 30 is 25 ms late, and those that are due meanwhile follow at once: as a busy sender does."""
    info = pylsl.StreamInfo("LateAtTimes", "MoCap", 3, 120.0, pylsl.cf_float32, "late at times")
    channels = info.desc().append_child("channels")
    for label in ("RFIN_X", "RFIN_Y", "RFIN_Z"):
        channels.append_child("channel").append_child_value("label", label)
    outlet, count = pylsl.StreamOutlet(info, chunk_size=1), 600
    received: list[MarkerFrame] = []
    source = LiveSource(
        "lsl://LateAtTimes", tapped(lambda: connect_lsl("LateAtTimes"), lambda f, _: received.extend(f))
    )
    try:
        assert outlet.wait_for_consumers(5.0)
        pushed = start = pylsl.local_clock() - count / 120.0
        for k in range(count):
            held_up = 0.025 if k % 30 == 11 else 0.0
            pushed = max(pushed + 1e-5, start + k / 120.0 + held_up)
            if not lost_every or k % lost_every != lost_every // 2:
                outlet.push_sample([float(k), 1.0, 2.0], pushed)
            if k % 30 == 29 and k > 60:  # no more than the inlet holds, however busy its reader is
                until(lambda last=k: received and received[-1].positions[0, 0] == last)
        until(lambda: received and received[-1].positions[0, 0] == count - 1)
    finally:
        source.close()
    writer = TakeWriter(tmp_path / "take.part")
    writer.add(received, 120.0)
    writer.close()
    due = round(received[-1].positions[0, 0] - received[0].positions[0, 0]) + 1
    assert take_to_c3d(tmp_path / "take.part", tmp_path / "take.c3d") == (due, len(received))
    lost, shown = due - len(received), received[-1].number - received[0].number + 1 - len(received)
    assert lost - 2 <= shown <= lost  # what was lost in the last second may not be known yet


def test_streams_that_are_none() -> None:
    with pytest.raises(LinkError, match="no stream called 'NotThere'"):
        connect_lsl("NotThere", 0.2)
    with pytest.raises(LinkError, match="quotation"):
        connect_lsl("it's")
    for kind, fmt, says in (
        ("EEG", pylsl.cf_float32, "EEG"),
        ("MoCap", pylsl.cf_string, "text"),
        ("MoCap", pylsl.cf_float32, "no marker"),
    ):
        outlet = pylsl.StreamOutlet(pylsl.StreamInfo("Strange", kind, 3, 120.0, fmt, f"strange {kind} {fmt}"))
        with pytest.raises(LinkError, match=says):
            connect_lsl("Strange", 2.0)
        del outlet
    with pytest.raises(HighFiveError, match="markers"):
        LslServer((), 120.0, "Empty")


@pytest.mark.parametrize("stated", [True, False])
def test_stamps_that_are_put_back_are_when_the_cameras_saw(stated: bool) -> None:
    name = f"Put back {stated}"
    info = pylsl.StreamInfo(name, "MoCap", 3, 100.0, pylsl.cf_double64, name)
    channels = info.desc().append_child("channels")
    for axis in "XYZ":
        channels.append_child("channel").append_child_value("label", f"RFIN_{axis}")
    if stated:
        info.desc().append_child("acquisition").append_child_value("compensated_lag", "0.05")
    outlet, late_ns = pylsl.StreamOutlet(info), list[int]()
    source = LiveSource(name, lambda: connect_lsl(name))
    try:
        frame, until = None, time.monotonic() + 8.0
        while len(late_ns) < 20 and time.monotonic() < until:
            outlet.push_sample([0.1, 0.2, 1.0], pylsl.local_clock() - 0.05)
            newer = source.wait(frame, 0.01)
            if newer is not None:
                frame = newer
                late_ns.append(frame.arrival_time_ns - source.captured(frame))
    finally:
        source.close()
    assert len(late_ns) == 20
    assert (float(np.median(late_ns)) > 45e6) is stated
