"""What holds for every live protocol whose server and client are ours, over real sockets."""

import contextlib
import itertools
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from live_frames import NAMES, OWN, POINTS, RATE, ends, frame, live, playing, until

from highfive.mocap_bridge.servers.natnet import NatNetServer
from highfive.mocap_bridge.servers.qtm import QtmServer
from highfive.mocap_bridge.servers.serving import LOOPBACK
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.mocap_bridge.sources.natnet import connect_natnet
from highfive.mocap_bridge.sources.qtm import connect_qtm
from highfive.mocap_bridge.wire.errors import LinkError


@dataclass(frozen=True)
class Protocol:
    """A server, its client, what its own unit is taken for when points come in the other one, and whether a change of
    markers costs no frame."""

    name: str
    server: Callable[..., Any]
    connect: Callable[..., Any]
    other_unit: float
    lossless: bool

    @contextlib.contextmanager
    def following(self, server, person=None):
        connect = lambda: self.connect(LOOPBACK, server.port, timeout_s=0.5)  # noqa: E731
        with contextlib.closing(LiveSource(self.name, connect, person)) as source:
            yield source


@pytest.fixture(
    params=[
        Protocol("natnet", NatNetServer, connect_natnet, 1e3, True),
        Protocol("qtm", QtmServer, connect_qtm, 1e-3, False),
    ],
    ids=lambda protocol: protocol.name,
)
def protocol(request):
    return request.param


@pytest.fixture
def server(protocol):
    with contextlib.closing(protocol.server(port=0, rate_hz=RATE)) as made:
        yield made


def test_hidden_markers_and_numbers_that_are_none_are_not_valid(protocol, server):
    with protocol.following(server) as source:
        until(lambda: live(source) or server.send(frame(0)) or time.sleep(0.01))
        one = frame(7, hidden=("Anna:M3", "Anna:M5"))
        one.positions[8] = np.nan
        one.positions[9] = [np.inf, -np.inf, 0.0]
        one.positions[10] = 0.0  # at the origin, and seen
        server.send(replace(one, unlabelled=np.array([[np.nan, 0.0, 0.0], [1.0, 2.0, 3.0]])))
        until(lambda: source.newest(0).number == 7)
        got = source.newest(0)
        assert [name for name, seen in zip(OWN, got.valid, strict=True) if not seen] == ["M3", "M5", "M8", "M9"]
        assert np.isfinite(got.positions).all()
        np.testing.assert_allclose(got.unlabelled, [[1.0, 2.0, 3.0]])


def test_a_gap_in_the_numbers_counts_as_lost(protocol, server):
    with protocol.following(server) as source:
        until(lambda: live(source) or server.send(frame(0)) or time.sleep(0.01))
        for number in (1, 2, 15, 16):
            server.send(frame(number))
        until(lambda: source.newest(0).number == 16)
        assert source.health(0).lost == 12


def test_other_markers_than_before(protocol, server):
    """Somebody loads another recording: fewer markers, other names."""
    frames = (frame(k, NAMES if k < 20 else NAMES[6:2:-1]) for k in itertools.count())
    with protocol.following(server) as source, playing(server, frames):
        until(lambda: source.newest(0) is not None and len(source.newest(0).names) == 4)
        got = source.newest(0)
        assert got.names == OWN[6:2:-1]
        np.testing.assert_allclose(got.positions, frame(got.number, NAMES[6:2:-1]).positions, atol=2e-7)
        assert not protocol.lossless or source.health(0).lost == 0


def test_several_persons(protocol, server):
    both = (*NAMES, *(name.replace("Anna", "Bert") for name in NAMES))
    frames = (
        replace(one, names=both, positions=np.tile(one.positions, (2, 1)), valid=np.tile(one.valid, 2))
        for one in (frame(k) for k in itertools.count())
    )
    with protocol.following(server, "Bert") as source, protocol.following(server) as nobody, playing(server, frames):
        assert source.first().names == OWN
        until(lambda: "Anna, Bert" in nobody.health(0).trouble)


def test_a_server_that_goes_and_comes_back(protocol, server):
    with protocol.following(server) as source, playing(server):
        source.first()
        server.hang_up()
        until(lambda: not live(source))
        until(lambda: "nothing listens" in source.health(0).trouble)
        server.answer()
        until(lambda: live(source))


def test_frames_that_stop_are_seen(protocol, server):
    with protocol.following(server) as source:
        with playing(server):
            source.first()
        until(lambda: not live(source))
        until(lambda: "nothing has come" in source.health(0).trouble)


def test_another_unit_is_reported(protocol, server):
    frames = (replace(frame(k), positions=POINTS * protocol.other_unit) for k in itertools.count())
    with protocol.following(server) as source, playing(server, frames):
        until(lambda: "unit" in source.health(0).trouble)


def test_a_slow_reader_gets_the_newest(protocol, server):
    """Of frames that nobody looked at in between the last is there, once it has come, and stays; none is queued."""
    with protocol.following(server) as source:
        until(lambda: live(source) or server.send(frame(0)) or time.sleep(0.01))
        for burst in range(1, 20):
            for number in range(3 * burst - 2, 3 * burst + 1):
                server.send(frame(number))
                time.sleep(0.005)
            until(lambda last=3 * burst: source.health(0).received + source.health(0).lost > last)
            assert source.newest(0).number == 3 * burst


def test_closing_leaves_nothing(protocol):
    before = set(threading.enumerate())
    server = protocol.server(port=0)
    with protocol.following(server) as source, playing(server):
        source.first()
        ends(source.close)
        ends(source.close)
    ends(server.close)
    ends(server.close)
    until(lambda: set(threading.enumerate()) <= before)


def test_a_port_that_is_taken(protocol, server):
    with pytest.raises(LinkError, match="cannot listen"):
        protocol.server(port=server.port)
