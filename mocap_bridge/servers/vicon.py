"""A server that plays a Vicon system: for our own client, and for the maker's SDK."""

from __future__ import annotations

import socket
from dataclasses import replace

import numpy as np

from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.servers.live_server import Client, TcpServer
from highfive.mocap_bridge.servers.serving import LOOPBACK
from highfive.mocap_bridge.sources.scheduler import THREADS, Now
from highfive.mocap_bridge.wire import vicon as wire
from highfive.mocap_bridge.wire.vicon import Kind, Labelled, Packet, Subject

OFFERED: frozenset[int] = frozenset(Kind) - {
    Kind.OBJECTS,
    Kind.OBJECT_ENUMS,
    Kind.REQUEST_FRAME,
    Kind.REQUEST_NEXT_FRAME,
    Kind.PING,
}
"""What a client may ask for."""

NAMELESS = "Subject"
"""Subject of the markers that have none."""

_STAGE = "High Five replay"
_MOST_REQUESTS = 1000  # frames that a client may ask for ahead


class _Client(Client):
    """One client: its connection, and what it has requested."""

    def __init__(self, sock: socket.socket) -> None:
        super().__init__(sock)
        self.requested = OFFERED
        self.stream = False
        self.requests = 0  # frames that it requested one by one and has not been sent
        self.fresh = False  # there is a frame that it has not been sent
        self.version = -1  # of the names that were sent to it
        self._buffer = bytearray()

    def whole(self, chunk: bytes) -> list[Packet]:
        """Messages that have come whole with this ``chunk``.

        Raises:
            ViconWireError: what came is not of the protocol.
        """
        self._buffer += chunk
        packets = []
        while len(self._buffer) >= wire.HEADER.size:
            end = wire.HEADER.size + wire.body_length(self._buffer)
            if len(self._buffer) < end:
                break
            packets.append(wire.decode(bytes(self._buffer[wire.HEADER.size : end])))
            del self._buffer[:end]
        return packets


class ViconServer(TcpServer[_Client]):
    """Sends frames to any number of clients that ask for all or for one at a time (see
    :mod:`highfive.mocap_bridge.servers.serving`).
    """

    def __init__(self, host: str = LOOPBACK, port: int = wire.PORT, rate_hz: float = 120.0, now: Now = THREADS.now):
        """Listens at once.

        Args:
            host: address to listen at; '' or '0.0.0.0' lets in the whole network.
            port: 0 takes any that is free.
            rate_hz: frames per second, as announced to clients.
            now: monotonic clock, ns.

        Raises:
            LinkError: the port is taken or not allowed.
        """
        self._rate_hz = rate_hz
        self._ids: dict[str, tuple[int, int]] = {}  # numbers of subject and marker of every name that was sent so far
        self._subjects: dict[str, list[tuple[int, str]]] = {}
        self._names: tuple[str, ...] = ()  # of the last frame, and their numbers
        self._numbers = np.zeros((0, 2), dtype=np.uint32)
        self._version = 0  # grows with each new name
        self._frame: Packet | None = None
        self._encoded: dict[tuple[frozenset[int], bool], bytes] = {}  # the last frame, for each kind of client
        super().__init__(host, port, "vicon", now)

    def send(self, frame: MarkerFrame) -> None:
        """Sends a frame to every client that requested frames; see
        :meth:`highfive.mocap_bridge.servers.serving.Server.send`.
        """
        with self._lock:
            self._frame = self._packet(frame)
            self._encoded.clear()
            for client in self._clients:
                client.fresh = True
                self._go_on(client)
            self._send_to_all()

    def _packet(self, frame: MarkerFrame) -> Packet:
        """What is sent of a frame."""
        if frame.names is not self._names and frame.names != self._names:
            self._numbers = np.array([self._number(name) for name in frame.names], dtype=np.uint32).reshape(-1, 2)
        self._names = frame.names
        return Packet(
            number=frame.number & 0xFFFFFFFF,
            labelled=Labelled(self._numbers[frame.valid], frame.positions[frame.valid]),
            unlabelled=frame.unlabelled,
            latencies=((_STAGE, 0.0),),
            rates=((_STAGE, self._rate_hz),),
            posed=tuple(range(1, len(self._subjects) + 1)),
        )

    def _number(self, name: str) -> tuple[int, int]:
        """Numbers of the subject and the marker of a name, given to it when it comes up first."""
        if name not in self._ids:
            prefix, _, marker = name.rpartition(":")
            markers = self._subjects.setdefault(prefix or NAMELESS, [])
            markers.append((len(markers) + 1, marker))
            self._ids[name] = (list(self._subjects).index(prefix or NAMELESS) + 1, len(markers))
            self._version += 1
        return self._ids[name]

    def _message(self, requested: frozenset[int], static: bool) -> bytes:
        """The last frame for a client that wants so much, with or without what stays the same."""
        message = self._encoded.get((requested, static))
        if message is None and self._frame is not None:
            if static:
                packet = replace(
                    self._frame,
                    period=round(wire.TICKS_HZ / self._rate_hz),
                    y_up=False,
                    subjects=tuple(
                        Subject(number, name, tuple(markers))
                        for number, (name, markers) in enumerate(self._subjects.items(), start=1)
                    ),
                )
            else:
                packet = replace(self._frame, unchanged=wire.STATIC)
            message = self._encoded[requested, static] = wire.encode(packet, requested)
        return message or b""

    def _go_on(self, client: _Client) -> None:
        """Sends a client what it has requested, as far as its socket takes it."""
        client.push()
        if client.unsent or not client.fresh or self._frame is None or not (client.stream or client.requests):
            return
        message = self._message(client.requested, client.version != self._version)
        client.fresh, client.version = False, self._version
        client.requests = max(0, client.requests - 1)
        self._sent_ns = self._now()
        client.push(message)

    def _welcomed(self, sock: socket.socket) -> _Client:
        client = _Client(sock)
        client.push(wire.encode(Packet(enums=OFFERED)))
        return client

    def _take(self, client: _Client, chunk: bytes) -> None:
        pings = b""
        for packet in client.whole(chunk):
            if packet.enums is not None:
                client.requested, client.version = packet.enums & OFFERED, -1
            if packet.stream is not None:
                client.stream = packet.stream
                client.requests += not packet.stream
            client.requests = min(client.requests + packet.more, _MOST_REQUESTS)
            if packet.ping is not None:
                pings += wire.encode(Packet(ping=packet.ping))
        if not client.unsent:
            client.push(pings)
        self._go_on(client)
