"""What every protocol does with what cannot be meant, and with persons who come later or are too many."""

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from live_frames import PATIENCE_S, until

from highfive.mocap_bridge.files.c3d import read_c3d
from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.files.take_file import TakeWriter, take_to_c3d
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.servers.faults import Faults, parse_fault
from highfive.mocap_bridge.servers.lsl import LslServer
from highfive.mocap_bridge.servers.natnet import NatNetServer
from highfive.mocap_bridge.servers.qtm import QtmServer
from highfive.mocap_bridge.servers.serving import serve
from highfive.mocap_bridge.servers.vicon import ViconServer
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.mocap_bridge.sources.lsl import configure, connect_lsl
from highfive.mocap_bridge.sources.natnet import connect_natnet
from highfive.mocap_bridge.sources.qtm import connect_qtm
from highfive.mocap_bridge.sources.tap import tapped
from highfive.mocap_bridge.sources.vicon import connect_vicon
from highfive.mocap_bridge.wire.plausible import FARTHEST_M, plausible
from highfive.model.errors import HighFiveError

LOCAL = "127.0.0.1"
NAMES = ("Anna:RFIN", "Anna:RMC5", "Anna:RWRA", "Anna:LFHD")
POINTS = np.random.default_rng(0).uniform(0.2, 1.8, size=(4, 3))


@dataclass(frozen=True)
class Protocol:
    """A server that plays a system, and what connects to it."""

    serve: Callable[[str], Any]
    connect: Callable[[Any, str], Any]


PROTOCOLS = {
    "vicon": Protocol(lambda _: ViconServer(port=0), lambda server, _: connect_vicon(LOCAL, server.port)),
    "qtm": Protocol(lambda _: QtmServer(port=0), lambda server, _: connect_qtm(LOCAL, server.port)),
    "natnet": Protocol(lambda _: NatNetServer(port=0), lambda server, _: connect_natnet(LOCAL, server.port)),
    "lsl": Protocol(lambda name: LslServer(NAMES, 120.0, name), lambda _, name: connect_lsl(name)),
}


@pytest.fixture(scope="module", autouse=True)
def this_machine_alone() -> None:
    configure(local_only=True)


@contextlib.contextmanager
def replaying(protocol: str, *faults: str) -> Iterator[Callable[[], Any]]:
    """What connects to a system that sends four markers of Anna, with faults."""
    name = f"Edge {protocol} {time.monotonic_ns()}"
    server, stop = PROTOCOLS[protocol].serve(name), threading.Event()
    recording = make_recording(120.0, NAMES, np.tile(POINTS, (1200, 1, 1)), np.ones((1200, 4), dtype=bool))
    replay = Faults([parse_fault(fault) for fault in faults])
    thread = threading.Thread(target=serve, args=(recording, server, replay, True, stop))
    thread.start()
    try:
        yield lambda: PROTOCOLS[protocol].connect(server, name)
    finally:
        stop.set()
        thread.join()
        server.close()


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_coordinates_that_overflow_are_missing_counted_and_never_recorded(protocol: str, tmp_path: Path) -> None:
    received: list[MarkerFrame] = []
    with replaying(protocol, "overflow=RFIN") as connect:
        source = LiveSource(protocol, tapped(connect, lambda frames, _: received.extend(frames)), "Anna")
        try:
            frame = source.first()
            assert frame.valid.tolist() == [False, True, True, True]
            assert np.allclose(frame.positions[1:], POINTS[1:], atol=1e-5)
            while len(received) < 40:
                assert source.wait(source.newest(0), 1.0) is not None
            health = source.health(time.monotonic_ns())
            assert health.impossible >= 40
            assert health.refused == 0
        finally:
            source.close()
    writer = TakeWriter(tmp_path / "take.part")
    writer.add(received, 120.0)
    writer.close()
    take_to_c3d(tmp_path / "take.part", tmp_path / "take.c3d")
    recording = read_c3d(tmp_path / "take.c3d")
    seen = dict(zip(recording.names, recording.valid.T, strict=True))
    assert not seen["Anna:RFIN"].any()
    assert seen["Anna:RMC5"].sum() == len(received)
    assert np.abs(recording.points).max() < 2.0


@pytest.mark.parametrize("protocol", ["vicon", "qtm", "natnet"])  # the channels of an LSL stream are fixed
def test_a_person_who_is_tracked_later_is_waited_for(protocol: str) -> None:
    server, stop = PROTOCOLS[protocol].serve(""), threading.Event()
    frame = MarkerFrame(NAMES, POINTS, np.ones(4, dtype=bool), 0, 0, 0, np.zeros((0, 3)))
    other = replace(frame, names=tuple(name.replace("Anna", "Bert") for name in NAMES))
    both = replace(frame, names=(*other.names, *NAMES), positions=np.tile(POINTS, (2, 1)), valid=np.ones(8, dtype=bool))
    tracked = threading.Event()

    def send() -> None:
        number = 0
        while not stop.wait(1.0 / 120.0):
            number += 1
            server.send(replace(both if tracked.is_set() else other, number=number))

    thread = threading.Thread(target=send)
    thread.start()
    source = LiveSource(protocol, lambda: PROTOCOLS[protocol].connect(server, ""), "Anna")
    try:
        until(lambda: source.health(0).refused > 30)  # Bert alone
        assert source.newest(0) is None
        tracked.set()
        assert source.first(PATIENCE_S).names == ("RFIN", "RMC5", "RWRA", "LFHD")
        assert not source.health(0).hopeless
    finally:
        source.close()
        stop.set()
        thread.join()
        server.close()


def test_where_someone_has_to_choose_nobody_waits() -> None:
    two = ("Anna:RFIN", "Anna:RMC5", "Bert:RFIN", "Bert:RMC5")
    server, stop = ViconServer(port=0), threading.Event()
    recording = make_recording(120.0, two, np.tile(POINTS, (1200, 1, 1)), np.ones((1200, 4), dtype=bool))
    thread = threading.Thread(target=serve, args=(recording, server, None, True, stop))
    thread.start()
    source = LiveSource("vicon://lab", lambda: connect_vicon(LOCAL, server.port))
    try:
        until(lambda: source.health(0).hopeless)
        with pytest.raises(HighFiveError, match=r"Anna, Bert; say which one \(--person"):
            source.first(float("inf"))  # it would wait for ever
    finally:
        source.close()
        stop.set()
        thread.join()
        server.close()


def test_a_system_that_labels_nothing_yet_may_do_so_later() -> None:
    server, stop = ViconServer(port=0), threading.Event()
    nothing = MarkerFrame((), np.zeros((0, 3)), np.zeros(0, dtype=bool), 0, 0, 0, np.zeros((0, 3)))

    def send() -> None:
        for number in range(10_000):
            somebody = replace(nothing, names=NAMES, positions=POINTS, valid=np.ones(4, dtype=bool))
            server.send(replace(nothing if number < 120 else somebody, number=number))
            if stop.wait(1.0 / 120.0):
                return

    thread = threading.Thread(target=send)
    thread.start()
    source = LiveSource("vicon://lab", lambda: connect_vicon(LOCAL, server.port))
    try:
        assert source.first(PATIENCE_S).names == ("RFIN", "RMC5", "RWRA", "LFHD")
    finally:
        source.close()
        stop.set()
        thread.join()
        server.close()


@given(
    st.lists(st.tuples(*[st.floats(allow_nan=True, allow_infinity=True)] * 3), max_size=6),
    st.lists(st.booleans(), min_size=6, max_size=6),
)
def test_every_seen_point_is_plausible_impossible_or_no_number(
    given_points: list[tuple[float, float, float]], flags: list[bool]
) -> None:
    points = np.array(given_points, dtype=float).reshape(-1, 3)
    seen = np.array(flags[: len(points)], dtype=bool)
    kept, valid, impossible = plausible(points, seen)
    assert np.isfinite(kept).all()
    assert (np.abs(kept) <= FARTHEST_M).all()
    assert np.array_equal(kept[valid], points[valid])
    no_number = np.isnan(points).any(axis=1)
    assert valid.sum() + impossible + (seen & no_number).sum() == seen.sum()
