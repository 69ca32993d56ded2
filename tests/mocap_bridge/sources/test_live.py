"""A live source against real servers: it keeps in touch, never waits, never grows old, and says what is wrong."""

import socket
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from live_frames import PATIENCE_S, ends, until

from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.servers.faults import Faults, parse_fault
from highfive.mocap_bridge.servers.serving import serve
from highfive.mocap_bridge.servers.vicon import ViconServer
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.mocap_bridge.sources.source import Connection
from highfive.mocap_bridge.sources.tap import tapped
from highfive.mocap_bridge.sources.vicon import connect_vicon
from highfive.model.errors import HighFiveError

NAMES = ("human:RFIN", "human:RMC5", "human:RWRA", "other:RFIN")
Serving = Callable[..., ViconServer]


@pytest.fixture
def serving() -> Iterator[Serving]:
    stop, threads, servers = threading.Event(), [], []

    def start(*faults: str, names: tuple[str, ...] = NAMES) -> ViconServer:
        points = np.random.default_rng(0).uniform(0.2, 1.6, size=(1, len(names), 3)) + np.zeros((1200, 1, 1))
        recording = make_recording(120.0, names, points, np.ones((1200, len(names)), dtype=bool))
        server = ViconServer(port=0)
        replay = Faults([parse_fault(fault) for fault in faults])
        thread = threading.Thread(target=serve, args=(recording, server, replay, True, stop))
        thread.start()
        threads.append(thread)
        servers.append(server)
        return server

    yield start
    stop.set()
    for thread in threads:
        thread.join()
    for server in servers:
        server.close()


@pytest.fixture
def listen() -> Iterator[Callable[..., LiveSource]]:
    sources = []

    def start(port: int, person: str | None = "human") -> LiveSource:
        source = LiveSource(f"vicon://127.0.0.1:{port}", lambda: connect_vicon("127.0.0.1", port), person)
        sources.append(source)
        return source

    yield start
    for source in sources:
        source.close()
        source.close()


def health(source: LiveSource):
    return source.health(time.monotonic_ns())


def test_frames_of_one_person_without_the_prefix(serving, listen) -> None:
    source = listen(serving().port)
    frame = source.first(PATIENCE_S)
    assert frame.names == ("RFIN", "RMC5", "RWRA")
    assert frame.arrival_time_ns <= time.monotonic_ns()
    assert health(source).connection is Connection.LIVE
    after = source.wait(frame, PATIENCE_S)
    assert after is not None
    assert after.number > frame.number
    assert source.newest(0) is not None


def test_a_slow_reader_passes_over_what_it_had_no_time_for(serving, listen) -> None:
    """How old what it reads may be is tested in virtual time."""
    source = listen(serving().port)
    first = seen = source.first(PATIENCE_S)
    for _ in range(20):
        time.sleep(0.03)
        frame = source.newest(time.monotonic_ns())
        assert frame.number >= seen.number
        seen = frame
    assert seen.number - first.number > 20  # more than were read


def test_lost_frames_are_counted(serving, listen) -> None:
    source = listen(serving("gap=12@1").port)
    until(lambda: health(source).lost)
    assert health(source).lost == 12


def test_a_server_that_dies_is_seen_and_one_that_is_back_is_found(serving, listen) -> None:
    server = serving()
    source = listen(server.port)
    source.first(PATIENCE_S)
    server.hang_up()
    until(lambda: health(source).connection is not Connection.LIVE)
    until(lambda: health(source).trouble)
    before = source.newest(0)
    server.answer()
    assert source.wait(before, PATIENCE_S) is not None
    assert health(source).connection is Connection.LIVE


def test_a_stall_ends_the_connection_and_nothing_else(serving, listen) -> None:
    source = listen(serving("stall@0.7-2.4").port)
    source.first(PATIENCE_S)
    until(lambda: health(source).connection is not Connection.LIVE)
    until(lambda: health(source).connection is Connection.LIVE)


def test_no_number_that_is_none_is_called_valid(serving, listen) -> None:
    source = listen(serving("nan=RFIN").port)
    frame = source.first(PATIENCE_S)
    assert frame.valid.tolist() == [False, True, True]
    assert np.isfinite(frame.positions).all()


@pytest.mark.parametrize(
    ("faults", "person", "says"),
    [((), None, "human, other"), ((), "Eve", "'Eve'.*human, other"), (("metres",), "human", "unit")],
)
def test_frames_that_cannot_be_used_say_why(serving, listen, faults, person, says) -> None:
    source = listen(serving(*faults).port, person)
    with pytest.raises(HighFiveError, match=says):
        source.first(1.0)
    until(lambda: health(source).received)


def test_nothing_there_and_nothing_said(listen) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = silent.getsockname()[1]
        source = listen(port)
        with pytest.raises(HighFiveError, match="no frame came"):
            source.first(0.3)
        ends(source.close)
    absent = listen(port)
    until(lambda: "127.0.0.1" in health(absent).trouble)
    assert absent.wait(None, 0.05) is None
    assert absent.newest(0) is None
    assert health(absent).age_ns == -1
    absent.close()
    assert health(absent).connection is Connection.ENDED


def test_whatever_goes_wrong_in_a_connection_the_next_one_is_made(serving) -> None:
    server, tries = serving(), []

    def connect():
        tries.append(time.monotonic())
        if len(tries) < 3:
            raise OverflowError("a number from the wire")
        return connect_vicon("127.0.0.1", server.port)

    source = LiveSource("vicon://somewhere", connect, "human")
    try:
        assert source.first(PATIENCE_S).names == ("RFIN", "RMC5", "RWRA")
    finally:
        source.close()


@pytest.mark.parametrize("host", ["a..b", "x" * 70, "\udc80"])
def test_what_is_no_address_is_our_own_error(host: str) -> None:
    with pytest.raises(HighFiveError):
        connect_vicon(host, 801, timeout_s=0.5)


def test_a_tap_is_told_of_every_frame_of_everyone(serving) -> None:
    port, received = serving().port, []

    def tap(frames: list[MarkerFrame], rate_hz: float) -> None:
        received.extend((frame, rate_hz) for frame in frames)

    source = LiveSource("tapped", tapped(lambda: connect_vicon("127.0.0.1", port), tap), "human")
    try:
        source.first(PATIENCE_S)
        until(lambda: len(received) > 30)
        assert received[0][0].names == NAMES
        assert received[-1][1] == 120.0
        numbers = [frame.number for frame, _ in received]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    finally:
        source.close()
