"""NatNet's client and server over real sockets: with each other, an independent client, and what is no NatNet."""

import contextlib
import itertools
import socket
import struct
import time

import natnet
import numpy as np
import pytest
from live_frames import NAMES, OWN, RATE, arrived, ends, frame, in_order, live, playing, running, until

from highfive.mocap_bridge.servers.faults import Faults, parse_fault
from highfive.mocap_bridge.servers.natnet import NatNetServer
from highfive.mocap_bridge.servers.serving import LOOPBACK
from highfive.mocap_bridge.sources.address import connector, parse_address
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.mocap_bridge.sources.natnet import connect_natnet
from highfive.mocap_bridge.sources.scheduler import THREADS
from highfive.mocap_bridge.wire.errors import LinkError
from highfive.mocap_bridge.wire.natnet import Kind, ServerInfo, encode, encode_request, encode_server_info
from highfive.mocap_bridge.wire.natnet_frame import Frame, encode_frame, labelled_markers
from highfive.mocap_bridge.wire.natnet_model import MarkerSet, encode_model

GROUP = "239.255.42.99"


@pytest.fixture
def server():
    with contextlib.closing(NatNetServer(port=0, rate_hz=RATE)) as made:
        yield made


@contextlib.contextmanager
def following(server, person=None, **options):
    connect = lambda: connect_natnet(LOOPBACK, server.port, timeout_s=0.5, **options)  # noqa: E731
    with contextlib.closing(LiveSource("natnet", connect, person)) as source:
        yield source


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind((LOOPBACK, 0))
        return sock.getsockname()[1]


@contextlib.contextmanager
def impostor(answer):
    """A UDP server that is not ours: ``answer`` gives the datagrams that it sends back for one that comes."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind((LOOPBACK, 0))
        sock.settimeout(0.05)

        def run(ended):
            while not ended.is_set():
                with contextlib.suppress(TimeoutError):
                    datagram, sender = sock.recvfrom(65536)
                    for back in answer(datagram):
                        sock.sendto(back, sender)

        with running(run):
            yield sock.getsockname()[1]


def motive(version=(3, 0), after=()):
    """Answers as a server of some version does, and sends ``after`` with the descriptions."""

    def answer(datagram):
        if datagram[0] == Kind.CONNECT:
            return [encode_server_info(ServerInfo("Motive", version))]
        return (
            [encode_model([MarkerSet("Anna", ("a", "b"))], version), *after]
            if datagram[0] == Kind.REQUEST_MODEL
            else []
        )

    return answer


@pytest.mark.parametrize("version", [(3, 0), (3, 1), (4, 0), (4, 1)])
@pytest.mark.parametrize("y_up", [True, False])
def test_points_names_times_and_state_arrive(version, y_up):
    server = NatNetServer(port=0, rate_hz=100.0, version=version, y_up=y_up)
    with contextlib.closing(server), following(server, y_up=y_up) as source, playing(server):
        got, sent = arrived(source)
        assert abs(got.source_time_ns - sent.source_time_ns) <= 1
        until(lambda: source.rate_hz == 100.0)
        assert in_order(source)


def test_y_up_on_the_wire_is_what_motive_means(server):
    """An independent reader sees y up."""
    client = natnet.NatNetClient(command_port=server.port, use_multicast=False)
    got = []
    client.on_data_frame_received_event.handlers.append(got.append)
    with client, playing(server):
        until(lambda: client.update_sync() or got)
    x, y, z = got[-1].labeled_markers[0].pos
    np.testing.assert_allclose([x, -z, y], frame(got[-1].prefix.frame_number).positions[0], atol=2e-7)


def test_by_multicast():
    port = free_port()
    server = NatNetServer(port=0, multicast=GROUP, data_port=port)
    with contextlib.closing(server), following(server, multicast=GROUP, data_port=port) as source, playing(server):
        got = source.first()
        np.testing.assert_allclose(got.positions, frame(got.number).positions, atol=2e-7)
    with (
        contextlib.closing(NatNetServer(port=0, multicast=GROUP, data_port=port)) as server,
        following(server) as source,
    ):
        until(lambda: f"put ?multicast={GROUP}&data_port={port} behind the address" in source.health(0).trouble)
    with pytest.raises(LinkError, match="cannot join multicast group"):
        connect_natnet(LOOPBACK, port, multicast="10.0.0.1")


@pytest.mark.parametrize(
    ("query", "advice"),
    [
        ("", f"; put ?multicast={GROUP}&data_port={{port}} behind the address"),
        ("?up=z", f"; put &multicast={GROUP}&data_port={{port}} behind the address"),
        ("?up=y&data_port={port}", f"; put &multicast={GROUP} behind the address"),
        ("?data_port=1511", f"; set its data_port to {{port}} and put &multicast={GROUP} behind the address"),
    ],
)
def test_advice_to_listen_to_a_group_goes_with_the_address_as_it_is(query, advice):
    """Written as it says, the address is one that can be read and hears the group."""
    port = free_port()
    with contextlib.closing(NatNetServer(port=0, multicast=GROUP, data_port=port)) as server:
        written = f"natnet://{LOOPBACK}:{server.port}{query.format(port=port)}"
        ahead_ns = 0
        with contextlib.closing(connector(parse_address(written), lambda: THREADS.now() + ahead_ns)()) as link:
            ahead_ns = 1_000_000_000  # nothing came for so long
            with pytest.raises(LinkError) as error:
                link.receive(0.0)
    assert advice.format(port=port) in str(error.value)
    added = str(error.value).partition("put ")[2].partition(" behind")[0]
    heard = parse_address(written.replace("data_port=1511", f"data_port={port}") + added).options
    assert heard["multicast"] == GROUP and heard["data_port"] == str(port)


def test_names_are_the_same_object_from_frame_to_frame(server):
    with playing(server), contextlib.closing(connect_natnet(LOOPBACK, server.port)) as link:
        frames = [*link.receive(0.5), *link.receive(0.5), *link.receive(0.5), *link.receive(0.5)]
        assert len({id(one.names) for one in frames}) == 1
        assert frames[0].names == NAMES


def test_labels_in_another_order_are_followed(server):
    """In each frame another order, with markers hidden: every point keeps its own name, and no frame is lost."""
    faults = Faults([parse_fault("reorder"), parse_fault("occlusion=0.3")])
    sent = {}

    def frames():
        for k in itertools.count():
            sent[k] = faults.of(frame(k))[0]
            yield sent[k]

    with following(server) as source, playing(server, frames()):
        got = source.first()
        while got.number < 100:
            until(lambda: source.newest(0) is not got)  # noqa: B023
            got = source.newest(0)
            one = sent[got.number]
            seen = {name for name, valid in zip(one.names, one.valid, strict=True) if valid}
            assert {f"Anna:{name}" for name, valid in zip(got.names, got.valid, strict=True) if valid} == seen
            expected = frame(got.number).positions[[OWN.index(name) for name in got.names]]
            np.testing.assert_allclose(got.positions[got.valid], expected[got.valid], atol=2e-7)
        assert source.health(0).lost == 0


@pytest.mark.slow
def test_a_client_that_reads_nothing_holds_nobody_up(server):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as lazy, following(server) as source:
        lazy.sendto(encode_request(Kind.CONNECT, "Ping"), (LOOPBACK, server.port))
        until(lambda: live(source) or server.send(frame(0)) or time.sleep(0.01))

        def send():
            for number in range(1, 1_000):
                server.send(frame(number))
                time.sleep(0.0002)

        ends(send)
        until(lambda: source.newest(0).number > 900)


def test_where_nothing_listens():
    with pytest.raises(LinkError, match="nothing listens there"):
        connect_natnet(LOOPBACK, free_port(), timeout_s=1.0)


@pytest.mark.parametrize(("host", "port"), [("no-such-host.invalid", 1510), (LOOPBACK, 99999), ("x" * 80, 1)])
def test_addresses_that_cannot_be(host, port):
    with pytest.raises(LinkError, match=f"{host}:{port}: "):
        connect_natnet(host, port, timeout_s=0.5)


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (lambda _: [], "no answer"),
        (lambda _: [b"SIP/2.0 400 Bad Request"], "not NatNet.*sent b'SIP/2.0"),
        (lambda datagram: [datagram], "does not answer what NatNet servers answer"),
        (motive((2, 10)), "NatNet 2.10; 3.0 to 4.x"),
        (motive((5, 0)), "NatNet 5.0"),
        (lambda datagram: motive()(datagram) if datagram[0] == Kind.CONNECT else [], "does not answer"),
    ],
)
def test_what_is_no_natnet_is_reported_in_one_line(answer, message):
    with impostor(answer) as port:
        with pytest.raises(LinkError, match=message) as error:
            connect_natnet(LOOPBACK, port, timeout_s=0.4)
        assert "\n" not in str(error.value)
        assert f"{LOOPBACK}:{port}" in str(error.value)


BROKEN = encode(Kind.FRAME, b"\1\0\0\0\xff\xff\xff\xff")


def test_nothing_but_damage_is_our_own_error():
    with impostor(motive(after=[BROKEN])) as port:
        link = connect_natnet(LOOPBACK, port)
        with contextlib.closing(link), pytest.raises(LinkError, match="4294967295"):
            until(lambda: link.receive(0.1) and False)


def test_a_datagram_that_cannot_be_read_ends_nothing():
    points = np.array([[1, 0, 0], [2, 0, 0]], np.float32)
    good = encode_frame(Frame(1, (("Anna", points),), points[:0], labelled_markers([], points[:0], []), 1.0), (4, 1))
    with impostor(motive((4, 1), [b"junk", BROKEN, good, bytes(40)])) as port:
        link = connect_natnet(LOOPBACK, port)
        with contextlib.closing(link):
            until(lambda: any(frame.number == 1 for frame in link.receive(0.1)))
            assert not link.receive(0.1)


def test_descriptions_that_get_lost_are_requested_again():
    """The frame says that models changed; the first answer never comes."""
    points = np.array([[1, 0, 0], [2, 0, 0]], np.float32)
    data = Frame(1, (("Anna", points),), points[:0], labelled_markers([], points[:0], []), 1.0, True)
    requests = []

    def answer(datagram):
        if datagram[0] != Kind.REQUEST_MODEL:
            return motive()(datagram)
        requests.append(datagram)
        before, after = (MarkerSet("Anna", names) for names in (("a", "b"), ("b", "a")))
        changed = [encode_frame(data, (3, 0))]
        return {1: [encode_model([before], (3, 0)), *changed], 2: []}.get(
            len(requests), [encode_model([after], (3, 0))]
        )

    with impostor(answer) as port, contextlib.closing(connect_natnet(LOOPBACK, port)) as link:
        frames = []
        until(lambda: frames.extend(link.receive(0.05)) or frames)
        assert frames[0].names == ("Anna:b", "Anna:a")
        assert len(requests) == 3


@pytest.mark.parametrize("damaged", [1e-40, 1e-3, 0.0, -120.0, 1e9, float("inf"), float("nan")])
def test_a_frame_rate_that_no_camera_has_is_requested_again(damaged):
    requests = []

    def answer(datagram):
        if datagram[0] == Kind.REQUEST and b"FrameRate" in datagram:
            requests.append(datagram)
            return [encode(Kind.RESPONSE, struct.pack("<f", damaged if len(requests) < 3 else 100.0))]
        return motive()(datagram)

    with impostor(answer) as port, contextlib.closing(connect_natnet(LOOPBACK, port)) as link:
        link.receive(0.1)
        assert link.rate_hz == 0.0
        until(lambda: link.receive(0.05) or link.rate_hz)
        assert link.rate_hz == 100.0


def test_only_the_server_is_listened_to(server):
    """A datagram from another computer than the server's is passed over, whatever it is."""
    link = connect_natnet(LOOPBACK, server.port)
    with contextlib.closing(link):
        link._server = ("127.0.0.2", server.port)
        server.send(frame(1))
        assert not link.receive(0.2)


@pytest.mark.parametrize("version", [(3, 0), (4, 1)])
@pytest.mark.parametrize("multicast", [None, GROUP])
def test_an_independent_client_gets_the_same_points(version, multicast):
    port = free_port()
    server = NatNetServer(port=0, version=version, multicast=multicast, data_port=port, y_up=False)
    client = natnet.NatNetClient(
        command_port=server.port, data_port=port, use_multicast=bool(multicast), multicast_address=multicast or GROUP
    )
    sent, got, described = [frame(k, hidden=("Anna:M2",)) for k in range(20)], [], []
    client.on_data_frame_received_event.handlers.append(got.append)
    client.on_data_description_received_event.handlers.append(described.append)
    server.send(frame(0))
    with contextlib.closing(server), client:
        assert client.server_info.application_name == "High Five"
        client.run_async()
        client.request_modeldef()
        until(lambda: described)
        for one in sent:
            server.send(one)
            time.sleep(0.002)
        until(lambda: len(got) == len(sent))
    assert (described[0].marker_sets[0].name, described[0].marker_sets[0].marker_names) == ("Anna", OWN)
    for packet, one in zip(got, sent, strict=True):
        assert packet.prefix.frame_number == one.number
        assert packet.suffix.timestamp == pytest.approx(one.source_time_ns * 1e-9)
        labelled = [marker for marker in packet.labeled_markers if not marker.unlabeled]
        assert [marker.occluded for marker in labelled] == [name == "Anna:M2" for name in NAMES]
        points = np.array([marker.pos for marker in labelled if not marker.occluded])
        np.testing.assert_allclose(points, one.positions[one.valid], atol=2e-7)
        np.testing.assert_allclose(
            np.array(packet.marker_sets[0].marker_pos_list)[one.valid], one.positions[one.valid], atol=2e-7
        )
        np.testing.assert_allclose(np.array(packet.unlabeled_marker_pos), one.unlabelled, atol=2e-7)
