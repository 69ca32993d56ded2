"""QTM's client and server over real sockets, with each other, with the maker's client, and with what is no QTM."""

import asyncio
import contextlib
import itertools
import socket
import time

import numpy as np
import pytest
import qtm_rt
from live_frames import NAMES, OWN, RATE, arrived, ends, frame, in_order, live, playing, running, until

from highfive.mocap_bridge.servers.faults import Faults, parse_fault
from highfive.mocap_bridge.servers.qtm import QtmServer
from highfive.mocap_bridge.servers.serving import LOOPBACK
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.mocap_bridge.sources.qtm import QtmLink, connect_qtm
from highfive.mocap_bridge.wire import qtm as wire
from highfive.mocap_bridge.wire.errors import LinkError
from highfive.mocap_bridge.wire.qtm import Kind


@pytest.fixture
def server():
    with contextlib.closing(QtmServer(port=0, rate_hz=RATE)) as made:
        yield made


@contextlib.contextmanager
def following(server, person=None):
    connect = lambda: connect_qtm(LOOPBACK, server.port, timeout_s=0.5)  # noqa: E731
    with contextlib.closing(LiveSource("qtm", connect, person)) as source:
        yield source


@contextlib.contextmanager
def impostor(*says, answers=()):
    """A TCP server that is no QTM: it says something, and something more after each message that comes."""
    with socket.create_server((LOOPBACK, 0)) as listener:

        def run(ended):
            with contextlib.suppress(OSError), listener.accept()[0] as client:
                client.settimeout(3.0)
                for message in says:
                    client.sendall(message)
                for message in answers:
                    client.recv(4096)
                    client.sendall(message)
                while not ended.is_set() and client.recv(4096):
                    pass

        with running(run):
            try:
                yield listener.getsockname()[1]
            finally:
                with contextlib.suppress(OSError), socket.create_connection((LOOPBACK, listener.getsockname()[1]), 0.1):
                    pass


def test_points_names_times_and_state_arrive(server):
    with following(server) as source, playing(server):
        got, sent = arrived(source)
        assert abs(got.source_time_ns - sent.source_time_ns) < 1000  # QTM counts microseconds
        assert source.rate_hz == RATE
        assert in_order(source)


def test_names_are_the_same_object_from_frame_to_frame(server):
    with contextlib.closing(connect_qtm(LOOPBACK, server.port)) as link, playing(server):
        until(lambda: link.receive(0.1))
        frames = [*link.receive(0.5), *link.receive(0.5), *link.receive(0.5)]
        assert len({id(one.names) for one in frames}) == 1
        assert frames[0].names == NAMES


def test_labels_in_another_order_are_followed(server):
    """In each frame another order, for one second: every point keeps its own name, and nearly every frame is there."""
    faults = Faults([parse_fault("reorder")])
    seen = []
    with following(server) as source, playing(server, (faults.of(frame(k))[0] for k in itertools.count())):
        got = source.first()
        while got.number < 120:
            until(lambda: source.newest(0) is not got)  # noqa: B023
            got = source.newest(0)
            sent = frame(got.number)
            for name, point in zip(got.names, got.positions, strict=True):
                np.testing.assert_allclose(point, sent.positions[OWN.index(name)], atol=2e-7)
            seen.append(got)
        assert len({one.names for one in seen}) > 2
        assert source.health(0).lost <= 6


def test_a_qtm_that_changes_labels_at_once_is_followed_too():
    """The event, frames in the new order at once, and only then the parameters: no point gets another's name."""

    def data(number, *points):
        return wire.encode_data(
            number, number, np.array([[p, 0, 0] for p in points], np.float32), np.zeros((0, 3), np.float32)
        )

    def labels(*names):
        return wire.encode_text(Kind.XML, wire.encode_parameters(names, 100.0))

    opening = (wire.encode_text(Kind.COMMAND, "Version set to 1.25"), labels("a", "b"), data(1, 1000, 2000))
    event = wire.encode(Kind.EVENT, bytes([wire.Event.SETTINGS_CHANGED]))
    changed = event + data(2, 2000, 1000), labels("b", "a") + data(3, 2000, 1000)
    harmless = event + data(4, 2000, 1000), labels("b", "a") + data(5, 2000, 1000)
    more = event + data(6, 2000, 1000, 3000), labels("b", "a", "c") + data(7, 2000, 1000, 3000)
    client, qtm = socket.socketpair()
    with client, qtm, contextlib.closing(_linked(client, qtm, opening)) as link:
        frames = list(link.receive(1.0))
        for before, after in (changed, harmless, more):
            qtm.sendall(before)
            assert not link.receive(1.0)
            assert b"getparameters" in qtm.recv(4096)
            qtm.sendall(after)
            frames += link.receive(1.0)
        assert [one.number for one in frames] == [1, 3, 4, 5, 6, 7]
        for one in frames:
            assert {name: point for name, (point, _, _) in zip(one.names, one.positions, strict=True)}.items() >= {
                ("a", 1.0),
                ("b", 2.0),
            }


def _linked(client, qtm, opening):
    qtm.sendall(wire.encode_text(Kind.COMMAND, wire.GREETING) + b"".join(opening))
    link = QtmLink(client, "pair", time.monotonic() + 1.0)
    qtm.recv(4096)
    return link


@pytest.mark.slow
def test_a_client_that_reads_nothing_holds_nobody_up(server):
    with socket.create_connection((LOOPBACK, server.port)) as lazy, following(server) as source:
        lazy.sendall(wire.encode_text(Kind.COMMAND, "StreamFrames AllFrames 3DRes"))
        until(lambda: live(source) or server.send(frame(0)) or time.sleep(0.01))

        def send():
            for number in range(1, 4_000):
                server.send(frame(number) if number % 1000 else frame(number, loose=12))

        ends(send)
        assert any(client.unsent for client in server._clients)  # it was full indeed
        until(lambda: source.newest(0).number > 3_000)


def test_where_nothing_listens():
    with socket.create_server((LOOPBACK, 0)) as free:
        port = free.getsockname()[1]
    with pytest.raises(LinkError, match=f"nothing listens at {LOOPBACK}:{port}"):
        connect_qtm(LOOPBACK, port)


@pytest.mark.parametrize(("host", "port"), [("no-such-host.invalid", 22223), (LOOPBACK, 99999), ("x" * 80, 1)])
def test_addresses_that_cannot_be(host, port):
    with pytest.raises(LinkError, match="cannot connect"):
        connect_qtm(host, port, timeout_s=0.5)


@pytest.mark.parametrize(
    ("says", "answers", "message"),
    [
        ((), (), "sends no answer"),
        ((b"SSH-2.0-OpenSSH_9.6\r\n",), (), "not QTM's real-time protocol: it sent b'SSH-2.0"),
        ((), (b"HTTP/1.1 400 Bad Request\r\n\r\n",), "it sent b'HTTP/1.1 400"),
        ((b"\0\0\0\x23\0\0\0\1QTM RT Interface connected\0",), (), "22223"),
        ((wire.encode_text(Kind.COMMAND, wire.GREETING),), (), "sends no answer"),
        ((), [wire.encode_text(Kind.ERROR, "Version NOT supported")] * 4, "no version"),
        ((), (wire.encode_text(Kind.COMMAND, "Version set to 1.25"),), "no parameters"),
        ((), (wire.encode_text(Kind.COMMAND, "Version set"), wire.encode_text(Kind.ERROR, "No data")), "No data"),
    ],
)
def test_what_is_no_qtm_is_reported_in_one_line(says, answers, message):
    with impostor(*says, answers=answers) as port:
        with pytest.raises(LinkError, match=message) as error:
            connect_qtm(LOOPBACK, port, timeout_s=0.4)
        assert "\n" not in str(error.value)
        assert f"{LOOPBACK}:{port}" in str(error.value)


def test_damage_on_the_way_is_our_own_error():
    broken = wire.encode(Kind.DATA, bytes(12) + b"\xff\xff\xff\xff")
    opening = (wire.encode_text(Kind.COMMAND, "Version set to 1.25"), wire.encode_text(Kind.XML, "<a/>"), broken)
    with impostor(*opening) as port:
        link = connect_qtm(LOOPBACK, port)
        with contextlib.closing(link), pytest.raises(LinkError, match="components"):
            link.receive(1.0)


def test_the_makers_client_gets_the_same_points(server):
    """`qtm_rt` asks for the labels once; whatever order comes later, points stay in that one."""
    sent = [frame(k, NAMES if k < 10 else NAMES[::-1], hidden=("Anna:M2",)) for k in range(40)]
    server.send(sent[0])

    async def client():
        ended, got = asyncio.Event(), []
        connection = await qtm_rt.connect(LOOPBACK, server.port, on_disconnect=lambda _: ended.set())
        assert connection is not None
        xml = await connection.get_parameters(["3d", "general"])
        assert await connection.byte_order() == b"Byte order is little endian"
        assert await connection.get_state() is not None
        current = await connection.get_current_frame(["3d"])
        assert current.framenumber == 0
        with pytest.raises(qtm_rt.QRTCommandException):
            await connection.take_control("password")
        streaming = asyncio.create_task(connection.stream_frames("allframes", ["3dres", "3dnolabels"], got.append))
        await asyncio.sleep(0.1)
        for one in sent:
            server.send(one)
            await asyncio.sleep(0.002)
        assert await streaming == b"Ok"
        server.hang_up()
        await asyncio.wait_for(ended.wait(), 1.0)
        return wire.decode_parameters(xml), got

    parameters, got = asyncio.run(client())
    assert parameters == wire.Parameters(NAMES, RATE)
    assert [packet.framenumber for packet in got] == list(range(40))
    for packet, one in zip(got, sent, strict=True):
        points = np.array([point[:3] for point in packet.get_3d_markers_residual()[1]]) * 1e-3
        expected = frame(one.number).positions
        np.testing.assert_allclose(np.delete(points, 2, axis=0), np.delete(expected, 2, axis=0), atol=2e-7)
        assert np.isnan(points[2]).all()
        loose = np.array([point[:3] for point in packet.get_3d_markers_no_label()[1]]) * 1e-3
        np.testing.assert_allclose(loose, one.unlabelled, atol=2e-7)
