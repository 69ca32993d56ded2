"""Plays OptiTrack's Motive: frames over NatNet, to each client by itself or to a multicast group."""

from __future__ import annotations

import contextlib
import select
import socket
import struct
from collections.abc import Sequence

import numpy as np

from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.servers.live_server import LiveServer
from highfive.mocap_bridge.servers.serving import LOOPBACK
from highfive.mocap_bridge.sources.scheduler import THREADS, Now
from highfive.mocap_bridge.wire.errors import LinkError
from highfive.mocap_bridge.wire.natnet import Kind, ServerInfo, Version, decode, encode, encode_server_info
from highfive.mocap_bridge.wire.natnet_frame import (
    HAS_MODEL,
    MEASURED,
    OCCLUDED,
    UNLABELLED,
    Frame,
    encode_frame,
    labelled_markers,
    y_up,
)
from highfive.mocap_bridge.wire.natnet_model import MarkerSet, encode_model

FORGET_S = 10.0
"""A client that has not been heard of for so long gets no more frames, s."""

_ANNOUNCED = 3  # frames that say that the descriptions changed, as one may get lost
_MOST_CLIENTS = 64


class NatNetServer(LiveServer):
    """See :class:`highfive.mocap_bridge.servers.serving.Server`.

    Every person is a marker set; a hidden marker is zero and flagged. The set 'all' is there as well, as in Motive.
    """

    def __init__(
        self,
        host: str = LOOPBACK,
        port: int = 1510,
        names: Sequence[str] = (),
        rate_hz: float = 120.0,
        multicast: str | None = None,
        data_port: int = 1511,
        y_up: bool = True,
        version: Version = (4, 1),
        now: Now = THREADS.now,
    ):
        """Listens.

        Args:
            host: address to listen at, and to send from.
            port: command port; 0 takes a free one.
            names: markers before the first frame.
            rate_hz: frames per second, for who asks.
            multicast: group to send frames to; None sends to each client that asks.
            data_port: the group's port.
            y_up: send points with y up, as Motive does unless set otherwise, instead of z up.
            version: of NatNet.
            now: monotonic clock, ns.

        Raises:
            LinkError: the port is taken, or the group is none.
        """
        self._rate_hz, self._y_up, self._version = rate_hz, y_up, version
        self._group, self._data_port = multicast, data_port
        self._clients: dict[tuple[str, int], int] = {}  # address -> when heard of last, ns
        self._frame_names: tuple[str, ...] = ()
        self._name(tuple(names))
        super().__init__(host, port, "NatNet", now)

    def send(self, frame: MarkerFrame) -> None:
        """Sends a frame; what a client does not take at once is lost, as datagrams are."""
        with self._lock:
            if frame.names != self._frame_names:
                self._rename(frame.names)
            if not self._up:
                return
            datagram = encode_frame(self._wire_frame(frame), self._version)
            self._announce = max(0, self._announce - 1)
            now = self._now()
            self._clients = {who: heard for who, heard in self._clients.items() if now - heard < FORGET_S * 1e9}
            for address in [(self._group, self._data_port)] if self._group else list(self._clients):
                self._sent_ns = self._now()
                with contextlib.suppress(OSError):
                    self._sock.sendto(datagram, address)

    def _socket(self) -> socket.socket:
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        if self._group:
            try:
                socket.inet_aton(self._group)
                sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(self._host or "0.0.0.0"))
                sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 1)
            except OSError as error:
                sock.close()
                raise LinkError(f"cannot send to multicast group {self._group}: {error}") from None
        return sock

    def _drop_all(self) -> None:
        self._clients = {}

    def _rename(self, names: tuple[str, ...]) -> None:
        """Takes the names of a frame; the same in another order are no other sets."""
        if set(names) != set(self._set_names) or len(names) != len(self._set_names):
            self._name(names)
        self._frame_names = names
        column = {name: m for m, name in enumerate(names)}
        self._order = np.array([column[name] for name in self._set_names], dtype=np.intp)
        number = {name: self._numbers[k] for k, name in enumerate(self._set_names)}
        self._ids = np.array([number[name] for name in names], dtype=np.uint32)

    def _name(self, names: tuple[str, ...]) -> None:
        """Makes marker sets of names with a person before the colon."""
        sets: dict[str, list[str]] = {}
        for name in names:
            sets.setdefault(name.rpartition(":")[0], []).append(name)
        self._set_names = tuple(name for group in sets.values() for name in group)
        self._numbers = [k << 16 | m for k, group in enumerate(sets.values(), 1) for m in range(1, len(group) + 1)]
        self._sizes = [(person, len(group)) for person, group in sets.items()]
        described = [
            MarkerSet(person, tuple(name.rpartition(":")[2] for name in group)) for person, group in sets.items()
        ]
        everything = MarkerSet("all", tuple(name.replace(":", "_") for name in self._set_names))
        self._model = encode_model([*described, everything], self._version)
        self._order, self._ids = np.zeros(0, np.intp), np.zeros(0, np.uint32)
        self._announce = _ANNOUNCED

    def _wire_frame(self, frame: MarkerFrame) -> Frame:
        with np.errstate(over="ignore"):
            points = np.where(frame.valid[:, None], frame.positions, 0.0)
            points = (y_up(points) if self._y_up else points).astype(np.float32)
            loose = (y_up(frame.unlabelled) if self._y_up else frame.unlabelled).astype(np.float32)
        flags = HAS_MODEL | np.where(frame.valid, MEASURED, OCCLUDED).astype(np.uint16)
        labelled = np.concatenate(
            [
                labelled_markers(self._ids, points, flags),
                labelled_markers(
                    np.arange(50_000, 50_000 + len(loose)) & 0xFFFF,  # Motive numbers those without a label so
                    loose,
                    np.full(len(loose), UNLABELLED | MEASURED),
                ),
            ]
        )
        ordered, sets, start = points[self._order], [], 0
        for person, count in self._sizes:
            sets.append((person, ordered[start : start + count]))
            start += count
        sets.append(("all", ordered))
        time_s = frame.source_time_ns * 1e-9
        return Frame(frame.number, tuple(sets), loose, labelled, time_s, self._announce > 0)

    def _run(self) -> None:
        while not self._closing.is_set():
            with self._lock:
                sock = self._sock
            try:
                ready = select.select([sock], [], [], 0.05)[0]
            except (OSError, ValueError):  # closed by hang_up()
                self._closing.wait(0.02)
                continue
            with self._lock:
                if ready and self._up and sock is self._sock:
                    with contextlib.suppress(OSError, LinkError):  # what is not of the protocol is not answered
                        datagram, sender = sock.recvfrom(1 << 16)
                        self._obey(*decode(datagram), sender)

    def _obey(self, kind: int, body: bytes, sender: tuple[str, int]) -> None:
        """Does what a client asks for."""
        if kind == Kind.DISCONNECT:
            self._clients.pop(sender, None)
            return
        if sender in self._clients or (kind == Kind.CONNECT and len(self._clients) < _MOST_CLIENTS):
            self._clients[sender] = self._now()
        answer = b""
        if kind == Kind.CONNECT:
            answer = encode_server_info(ServerInfo("High Five", self._version, self._group or "", self._data_port))
        elif kind == Kind.REQUEST_MODEL:
            answer = self._model
        elif kind == Kind.REQUEST:
            known = body.partition(b"\0")[0] == b"FrameRate"
            answer = encode(Kind.RESPONSE, struct.pack("<f", self._rate_hz)) if known else b""
            answer = answer or encode(Kind.UNRECOGNISED)
        if answer:
            self._sock.sendto(answer, sender)
