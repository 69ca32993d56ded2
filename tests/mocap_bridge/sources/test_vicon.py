"""The client against the server, over real sockets; and against servers that behave otherwise."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from live_frames import PATIENCE_S, ends, running, until

from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.servers.faults import Faults, parse_fault
from highfive.mocap_bridge.servers.serving import LOOPBACK, frames_of, serve
from highfive.mocap_bridge.servers.vicon import OFFERED, ViconServer
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.mocap_bridge.sources.source import Connection
from highfive.mocap_bridge.sources.vicon import connect_vicon
from highfive.mocap_bridge.wire import vicon as wire
from highfive.mocap_bridge.wire.errors import LinkError
from highfive.mocap_bridge.wire.vicon import Kind, Labelled, Packet, Subject, encode
from highfive.model.errors import HighFiveError

NAMES = ("Anna:LFHD", "Anna:RFIN", "Anna:RWRA", "Anna:RSHO")


def recording(frames=240, names=NAMES, rate=120.0):
    rng = np.random.default_rng(3)
    points = rng.uniform(-1.0, 2.0, size=(frames, len(names), 3))
    return make_recording(rate, names, points, np.ones((frames, len(names)), dtype=bool))


@pytest.fixture
def server():
    with contextlib.closing(ViconServer(port=0)) as made:
        yield made


@contextlib.contextmanager
def following(server, person=None, **options):
    port = server.port if isinstance(server, ViconServer) else server
    source = LiveSource(
        f"vicon://{LOOPBACK}:{port}", lambda: connect_vicon(LOOPBACK, port, timeout_s=0.5, **options), person=person
    )
    with contextlib.closing(source):
        yield source


@contextlib.contextmanager
def playing(server, played, faults=(), loop=True):
    spoilt = Faults([parse_fault(fault) for fault in faults])
    with running(lambda ended: serve(played, server, spoilt, loop, ended)) as thread:
        yield thread


def send_until_seen(server, source, frame):
    """Sends a frame until it has arrived: before that no client may be there."""
    deadline = time.monotonic() + PATIENCE_S
    while True:
        server.send(frame)
        seen = source.wait(None, 0.05)
        if seen is not None:
            return seen
        assert time.monotonic() < deadline


def state(source):
    return source.health(time.monotonic_ns()).connection


@pytest.mark.parametrize("pull", [False, True])
def test_every_frame_arrives_with_its_values(server, pull):
    frames = list(frames_of(recording(60)))
    with following(server, pull=pull) as source:
        last = send_until_seen(server, source, frames[0])
        assert last.names == ("LFHD", "RFIN", "RWRA", "RSHO")
        for frame in frames[1:]:
            time.sleep(0.002)
            loose = replace(frame, unlabelled=frame.positions[:2] + 0.5)
            server.send(loose)
            seen = source.wait(last, PATIENCE_S)
            assert seen is not None
            assert seen.number == frame.number
            assert seen.names is last.names
            np.testing.assert_allclose(seen.positions, frame.positions, atol=1e-9)
            np.testing.assert_allclose(seen.unlabelled, loose.unlabelled, atol=1e-9)
            assert seen.valid.all()
            assert abs(seen.source_time_ns - frame.source_time_ns) <= 1
            last = seen
        assert source.rate_hz == pytest.approx(120.0)
        health = source.health(time.monotonic_ns())
        assert (health.connection, health.received, health.lost, health.trouble) == (Connection.LIVE, 60, 0, "")


def test_a_hidden_marker_is_not_valid_and_one_without_numbers_neither(server):
    frame = next(frames_of(recording(1)))
    with following(server) as source:
        hidden = replace(frame, valid=np.array([True, False, True, True]))
        assert send_until_seen(server, source, hidden).valid.tolist() == [True, False, True, True]
        for bad in (np.nan, np.inf, -np.inf):
            points = frame.positions.copy()
            points[2] = bad
            points[3] = (np.inf, -np.inf, np.nan)
            last = source.newest(0)
            server.send(replace(frame, positions=points, number=last.number + 1))
            seen = source.wait(last, PATIENCE_S)
            assert seen is not None
            assert seen.valid.tolist() == [True, True, False, False]
            assert np.isfinite(seen.positions).all()


def test_frames_that_were_never_sent_are_counted(server):
    frames = list(frames_of(recording(40)))
    with following(server) as source:
        seen = send_until_seen(server, source, frames[0])
        for number in (1, 2, 15, 16):
            server.send(frames[number])
            seen = source.wait(seen, PATIENCE_S)
        assert seen.number == 16
        assert source.health(0).lost == 12


def test_labels_in_another_order_stay_with_their_markers(server):
    played = recording(60)
    by_name = {}
    with following(server) as source, playing(server, played, ["reorder"]):
        seen = source.first()
        names = seen.names
        for _ in range(30):
            seen = source.wait(seen, PATIENCE_S)
            assert seen.names is names
            truth = played.points[seen.number % 60]
            for name, point in zip(seen.names, seen.positions, strict=True):
                by_name.setdefault(name, []).append(np.abs(point - truth[NAMES.index(f"Anna:{name}")]).max())
    assert set(by_name) == {"LFHD", "RFIN", "RWRA", "RSHO"}
    assert max(max(errors) for errors in by_name.values()) < 1e-9
    assert server._version == len(NAMES)  # nothing was declared anew


def test_a_marker_and_a_subject_that_come_later_are_there_from_then_on(server):
    one = MarkerFrame(("Anna:A", "Anna:B"), np.eye(3)[:2], np.ones(2, dtype=bool), 1, 0, 0, np.zeros((0, 3)))
    more = replace(
        one, names=("Anna:B", "Anna:C", "Ben:A"), positions=np.eye(3), valid=np.ones(3, dtype=bool), number=2
    )
    with following(server, person="Anna") as source:
        seen = send_until_seen(server, source, one)
        assert seen.names == ("A", "B")
        server.send(more)
        seen = source.wait(seen, PATIENCE_S)
        assert (seen.names, seen.valid.tolist()) == (("A", "B", "C"), [False, True, True])
        np.testing.assert_allclose(seen.positions[1:], np.eye(3)[:2])


def test_markers_without_a_person_are_of_one_called_subject(server):
    frame = next(frames_of(recording(1, names=("A", "B", "C"))))
    with opened(server.port) as link:
        time.sleep(0.05)
        server.send(frame)
        (seen,) = link.receive(1.0)
    assert seen.names == ("Subject:A", "Subject:B", "Subject:C")


def test_a_person_that_is_not_there_is_reported(server):
    played, refused = playing(server, recording()), pytest.raises(HighFiveError, match=r"Ben.*Anna")
    with following(server, person="Ben") as source, played, refused:
        source.first(0.6)


def test_metres_for_millimetres_are_reported(server):
    played, refused = playing(server, recording(), ["metres"]), pytest.raises(HighFiveError, match="another unit")
    with following(server) as source, played, refused:
        source.first(0.6)


def test_a_server_that_hangs_up_is_seen_and_found_again(server):
    with following(server) as source, playing(server, recording(), ["disconnect@0.4-0.9"]):
        before = source.first()
        until(lambda: state(source) is not Connection.LIVE)
        until(lambda: state(source) is Connection.LIVE)
        after = source.newest(0)
        assert after.number > before.number
        np.testing.assert_allclose(after.positions, recording().points[after.number % 240], atol=1e-9)


def test_a_server_that_is_silent_for_a_while_is_stalled_and_then_live(server):
    with following(server) as source, playing(server, recording(), ["stall@0.3-0.8"]):
        source.first()
        until(lambda: state(source) is not Connection.LIVE)
        until(lambda: state(source) is Connection.LIVE)


def test_a_server_that_is_killed_is_seen_within_a_second_and_a_half():
    code = (
        "import numpy as np\n"
        "from highfive.mocap_bridge.files.recording import make_recording\n"
        "from highfive.mocap_bridge.servers.vicon import ViconServer\n"
        "from highfive.mocap_bridge.servers.serving import serve\n"
        "server = ViconServer(port=0)\n"
        "print(server.port, flush=True)\n"
        "points = np.random.default_rng(0).normal(size=(100, 3, 3))\n"
        "serve(make_recording(120.0, ['P:A', 'P:B', 'P:C'], points, np.ones((100, 3), bool)), server, loop=True)\n"
    )
    environment = os.environ | {"PYTHONPATH": os.getcwd()}
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, env=environment) as process:
        try:
            port = int(process.stdout.readline())
            with following(port) as source:
                source.first()
                process.send_signal(signal.SIGSTOP)  # the connection stays, nothing comes
                until(lambda: state(source) is not Connection.LIVE)
                process.send_signal(signal.SIGCONT)
                until(lambda: state(source) is Connection.LIVE)
                process.kill()
                until(lambda: state(source) is not Connection.LIVE)
                until(lambda: "nothing listens" in source.health(0).trouble)
        finally:
            process.kill()


def test_a_reader_that_is_slow_gets_the_newest(server):
    """Of frames that nobody looked at in between the last is there; none is queued, none lost."""
    frames = list(frames_of(recording(60)))
    with following(server) as source:
        send_until_seen(server, source, frames[0])
        for last in range(3, 60, 3):
            for frame in frames[last - 2 : last + 1]:
                server.send(frame)
                time.sleep(0.005)
            until(lambda last=last: source.health(0).received > last)
            until(lambda last=last: source.newest(0).number >= last)  # it is counted just before it is shown
            assert source.newest(0).number == last
        assert source.health(0).lost == 0


def test_a_client_that_does_not_read_holds_up_nobody(server):
    frames = frames_of(recording(10, names=[f"P:M{m}" for m in range(200)]), loop=True)
    with socket.create_connection((LOOPBACK, server.port)) as deaf, following(server) as source:
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        deaf.sendall(encode(Packet(stream=True)))
        seen = send_until_seen(server, source, next(frames))
        for _ in range(120):
            frame = next(frames)
            ends(lambda frame=frame: server.send(frame))
            seen = source.wait(seen, PATIENCE_S)
            assert seen.number == frame.number
        assert any(client.unsent for client in server._clients)  # one of them was full indeed
        # What it reads in the end is whole messages, and the newest is among the last of them.
        deaf.settimeout(10.0)
        taken, messages = bytearray(), []
        while not messages or messages[-1].number != frame.number:
            taken += deaf.recv(1 << 20)
            messages += whole(taken)
        assert not taken
        assert len(messages) < 120


def whole(taken):
    """The whole messages that bytes begin with, taken out of them."""
    messages = []
    while len(taken) >= wire.HEADER.size and len(taken) >= (end := wire.HEADER.size + wire.body_length(taken)):
        messages.append(wire.decode(bytes(taken[wire.HEADER.size : end])))
        del taken[:end]
    return messages


def read_messages(connection, count):
    taken, messages = bytearray(), []
    connection.settimeout(2.0)
    while len(messages) < count:
        chunk = connection.recv(1 << 16)
        assert chunk
        taken += chunk
        messages += whole(taken)
    assert not taken
    return messages


def test_a_client_is_served_what_it_asks_for_and_its_ping_comes_back(server):
    """What the maker's client does: kinds, one frame, more kinds, a ping, the next frame."""
    frames = frames_of(recording())
    with socket.create_connection((LOOPBACK, server.port)) as client:
        (greeting,) = read_messages(client, 1)
        assert greeting.enums == OFFERED
        basic = frozenset({Kind.CONTENTS, Kind.STREAM_INFO, Kind.SUBJECT_INFO, Kind.FRAME_INFO, 23, 26})
        client.sendall(encode(Packet(enums=basic)) + encode(Packet(stream=False)))
        time.sleep(0.05)
        server.send(next(frames))
        (first,) = read_messages(client, 1)
        assert (first.number, first.labelled, first.period) == (0, None, 1_125_000)
        assert first.subjects == (Subject(1, "Anna", ((1, "LFHD"), (2, "RFIN"), (3, "RWRA"), (4, "RSHO"))),)
        server.send(next(frames))  # not requested
        client.sendall(encode(Packet(enums=basic | {Kind.LABELED_RECONS})) + encode(Packet(ping=2**40 + 1)))
        (echo,) = read_messages(client, 1)
        assert echo == Packet(ping=2**40 + 1)
        client.sendall(encode(Packet(more=2)))
        (second,) = read_messages(client, 1)
        assert second.number == 1  # the newest there is; and all descriptions are sent again
        assert len(second.subjects) == 1
        assert len(second.labelled.ids) == 4
        server.send(next(frames))
        (third,) = read_messages(client, 1)
        assert (third.number, third.subjects) == (2, ())
        assert third.unchanged == {Kind.STREAM_INFO, Kind.SUBJECT_INFO}


def test_a_client_that_talks_nonsense_is_hung_up_on_and_others_are_not(server):
    with following(server) as source, socket.create_connection((LOOPBACK, server.port)) as client:
        read_messages(client, 1)
        client.sendall(b"GET / HTTP/1.1\r\n\r\n")
        client.settimeout(2.0)
        with contextlib.suppress(ConnectionResetError):
            assert client.recv(100) == b""
        assert send_until_seen(server, source, next(frames_of(recording()))).number == 0


@contextlib.contextmanager
def scripted(*said, hold=True):
    """A server that says something to whoever connects, and no more; its port."""

    def run(ended):
        held = []
        with listener:
            while not ended.is_set():
                with contextlib.suppress(TimeoutError):
                    connection, _ = listener.accept()
                    for piece in said:
                        connection.sendall(piece)
                        time.sleep(0.01)
                    if hold:
                        held.append(connection)
                    else:
                        connection.close()
        for connection in held:
            connection.close()

    listener = socket.create_server((LOOPBACK, 0))
    listener.settimeout(0.05)
    with running(run):
        yield listener.getsockname()[1]


def refusal(port, **options):
    with pytest.raises(LinkError) as refused:
        connect_vicon(LOOPBACK, port, timeout_s=0.5, **options)
    assert "\n" not in str(refused.value)
    assert str(port) in str(refused.value)
    return str(refused.value)


def test_where_nothing_listens_that_is_reported():
    with socket.create_server((LOOPBACK, 0)) as listener:
        port = listener.getsockname()[1]
    assert "nothing listens" in refusal(port)


def test_a_host_that_is_not_there_is_reported():
    with pytest.raises(LinkError, match=r"no\.such\.host\.invalid:801"):
        connect_vicon("no.such.host.invalid", timeout_s=0.5)


def test_a_server_that_says_nothing_is_reported():
    with scripted() as port:
        assert "says nothing" in refusal(port)
        with following(port) as source, pytest.raises(HighFiveError, match="says nothing"):
            source.first(0.8)


def test_another_protocol_is_reported():
    with scripted(b"SSH-2.0-", b"OpenSSH_9.6\r\n") as port:
        assert "b'SSH-2.0-" in refusal(port)
    with scripted(b"220 mail ready\r\n", hold=False) as port:
        assert "b'220 mail" in refusal(port)


def test_a_server_that_hangs_up_at_once_is_reported():
    with scripted(hold=False) as port:
        assert "closed the connection" in refusal(port)


def test_a_server_without_markers_is_reported():
    with scripted(encode(Packet(enums=frozenset({Kind.CONTENTS, Kind.FRAME_INFO})))) as port:
        assert "no labelled markers" in refusal(port)


def test_a_server_that_goes_mad_is_reported():
    greeting, too_long = encode(Packet(enums=OFFERED)), b"\x01\x00\x2b\x1a\xff\xff\xff\xff"
    refused = pytest.raises(LinkError, match="4294967295")
    with scripted(greeting, too_long) as port, opened(port) as link, refused:
        for _ in range(10):
            link.receive(0.1)


def opened(port):
    return contextlib.closing(connect_vicon(LOOPBACK, port))


def frames_from(*packets):
    """Frames that the client makes of messages after a greeting that was followed by a ping."""
    greeting = encode(Packet(enums=OFFERED)) + encode(Packet(ping=1))
    messages = b"".join(encode(packet) for packet in packets)
    cut = len(messages) // 3  # so that messages come in parts
    with scripted(greeting, messages[:cut], messages[cut:]) as port, opened(port) as link:
        frames = []
        for _ in range(10):
            frames += link.receive(0.05)
        return frames, link.rate_hz


BEN = Subject(9, "Ben", ((4, "RFIN"), (7, "RWRA")))


def recons(*items):
    ids = np.array([item[:2] for item in items], dtype=np.uint32).reshape(-1, 2)
    return Labelled(ids, np.array([item[2:] for item in items], dtype=float).reshape(-1, 3))


def test_what_is_unchanged_is_kept_and_a_label_that_was_never_told_is_a_point_without_one():
    frames, rate = frames_from(
        Packet(period=1_350_000, subjects=(BEN,)),
        Packet(number=10, labelled=recons((9, 7, 1, 2, 3), (9, 5, 4, 5, 6), (9, 4, 7, 8, 9))),
        Packet(number=11, unchanged=frozenset({Kind.LABELED_RECONS, Kind.SUBJECT_INFO})),
        Packet(number=12),
        Packet(number=13, labelled=recons((9, 4, 1, 1, 1)), unlabelled=np.array([[2.0, 2.0, 2.0]])),
    )
    assert rate == 100.0
    assert [frame.number for frame in frames] == [10, 11, 12, 13]
    assert all(frame.names is frames[0].names for frame in frames)
    assert frames[0].names == ("Ben:RFIN", "Ben:RWRA")
    for frame in frames[:2]:
        np.testing.assert_allclose(frame.positions, [[7, 8, 9], [1, 2, 3]])
        np.testing.assert_allclose(frame.unlabelled, [[4, 5, 6]])
    assert not frames[2].valid.any()
    assert frames[3].valid.tolist() == [True, False]
    np.testing.assert_allclose(frames[3].unlabelled, [[2, 2, 2]])
    assert [frame.source_time_ns for frame in frames] == [100_000_000, 110_000_000, 120_000_000, 130_000_000]


def test_a_system_with_y_up_is_turned():
    (frame,), _ = frames_from(
        Packet(y_up=True, subjects=(BEN,), number=1, labelled=recons((9, 4, 1, 2, 3)), unlabelled=np.eye(3)[1:2])
    )
    np.testing.assert_allclose(frame.positions[0], [1, -3, 2])
    np.testing.assert_allclose(frame.unlabelled, [[0, 0, 1]], atol=1e-15)


def test_the_latency_is_taken_off_and_its_jitter_is_not():
    stages = [(("cameras", 0.002), ("labels", 0.001 + 0.001 * (k % 2))) for k in range(50)]
    frames, rate = frames_from(
        *(Packet(number=k, rates=(("system", 200.0),), latencies=stage) for k, stage in enumerate(stages))
    )
    assert rate == 200.0
    times = np.array([frame.source_time_ns for frame in frames])
    assert times[0] == -3_000_000
    assert np.abs(np.diff(times) - 5_000_000).max() < 20_000
    assert np.abs(times - np.arange(50) * 5_000_000 + 3_250_000).max() < 250_001


def test_closing_leaves_no_thread(server):
    before = threading.active_count()
    with following(server) as source, playing(server, recording()):
        source.first()
        ends(source.close)
        assert state(source) is Connection.ENDED
    assert threading.active_count() == before
    other = ViconServer(port=0)
    ends(other.close)
    ends(other.close)
    assert threading.active_count() == before
    with pytest.raises(LinkError, match="nothing listens"):
        connect_vicon(LOOPBACK, other.port, timeout_s=0.5)


def test_a_port_that_is_taken_is_reported(server):
    with pytest.raises(HighFiveError, match=f"{server.port}.*another port, such as --port 8801"):
        ViconServer(port=server.port)


def test_where_the_port_that_is_proposed_is_taken_another_one_is() -> None:
    with socket.socket() as taken:
        with contextlib.suppress(OSError):  # somebody else has it: it is taken, too
            taken.bind((LOOPBACK, 8801))
            taken.listen()
        with pytest.raises(HighFiveError, match=r":8801: .*another port, such as --port 8802"):
            ViconServer(port=8801)
