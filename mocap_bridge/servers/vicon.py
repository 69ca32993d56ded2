"""A server that plays a Vicon system: for our own client, and for the maker's SDK."""

from __future__ import annotations

import contextlib
import selectors
import socket
import threading
import time
from dataclasses import replace

import numpy as np

from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.servers.serving import LOOPBACK
from highfive.mocap_bridge.wire import vicon as wire
from highfive.mocap_bridge.wire.vicon import Kind, Labelled, Packet, Subject
from highfive.model.errors import HighFiveError

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
_SEND_BUFFER = 1 << 16  # bytes; a larger one would hold frames back for a client that is slow
_MOST_REQUESTS = 1000  # frames that a client may ask for ahead


class ViconServer:
    """Sends frames to any number of clients that ask for all or for one at a time (see
    :mod:`highfive.mocap_bridge.servers.serving`).

    :meth:`send` writes to the sockets itself and never waits: whoever has not taken the last frame yet misses this one.
    A thread takes connections and requests, and goes on where a socket was full.
    """

    def __init__(self, host: str = LOOPBACK, port: int = wire.PORT, rate_hz: float = 120.0):
        """Listens at once.

        Args:
            host: address to listen at; '' or '0.0.0.0' lets in the whole network.
            port: 0 takes any that is free.
            rate_hz: frames a second, as clients are told.

        Raises:
            HighFiveError: the port is taken or not allowed.
        """
        self._rate_hz, self._host = rate_hz, host
        self._lock = threading.RLock()
        self._ids: dict[str, tuple[int, int]] = {}  # numbers of subject and marker of every name that was sent so far
        self._subjects: dict[str, list[tuple[int, str]]] = {}
        self._names: tuple[str, ...] = ()  # of the last frame, and their numbers
        self._numbers = np.zeros((0, 2), dtype=np.uint32)
        self._version = 0  # grows with each new name
        self._frame: Packet | None = None
        self._encoded: dict[tuple[frozenset[int], bool], bytes] = {}  # the last frame, for each kind of client
        self._clients: list[_Client] = []
        self._closing = False
        self._sent_ns = 0
        self._listener: socket.socket | None = _listen(host, port)
        self._port = self._listener.getsockname()[1]
        self._awake, self._alarm = socket.socketpair()
        for end in (self._awake, self._alarm):
            end.setblocking(False)
        self._thread = threading.Thread(target=self._run, name=f"vicon server {self._port}", daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """The port that it listens at."""
        return self._port

    @property
    def sent_ns(self) -> int:
        """When the last frame went out; see :class:`highfive.mocap_bridge.servers.serving.Server`."""
        return self._sent_ns

    def send(self, frame: MarkerFrame) -> None:
        """Sends a frame to every client that asked for frames; see
        :meth:`highfive.mocap_bridge.servers.serving.Server.send`.
        """
        with self._lock:
            self._frame = self._packet(frame)
            self._encoded.clear()
            held_up = False
            for client in list(self._clients):
                client.fresh = True
                self._serve(client)
                held_up |= bool(client.unsent)
        if held_up:
            self._wake()

    def hang_up(self) -> None:
        """Breaks every connection and takes no new one, until :meth:`answer`."""
        with self._lock:
            for client in list(self._clients):
                self._drop(client)
            if self._listener is not None:
                self._listener.close()
                self._listener = None
        self._wake()

    def answer(self) -> None:
        """Takes connections again, at the same port."""
        with self._lock:
            if self._listener is None and not self._closing:
                self._listener = _listen(self._host, self._port)
        self._wake()

    def close(self) -> None:
        """Ends everything; a second call does nothing."""
        with self._lock:
            self._closing = True
        self.hang_up()
        self._thread.join(timeout=5.0)

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

    def _message(self, wanted: frozenset[int], static: bool) -> bytes:
        """The last frame for a client that wants so much, with or without what stays the same."""
        message = self._encoded.get((wanted, static))
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
            message = self._encoded[wanted, static] = wire.encode(packet, wanted)
        return message or b""

    def _serve(self, client: _Client) -> None:
        """Sends a client what it has asked for, as far as its socket takes it."""
        try:
            if not client.flush() or not client.fresh or self._frame is None or not (client.stream or client.requests):
                return
            client.unsent = self._message(client.wanted, client.version != self._version)
            client.fresh, client.version = False, self._version
            client.requests = max(0, client.requests - 1)
            self._sent_ns = time.monotonic_ns()
            client.flush()
        except OSError:
            self._drop(client)

    def _take(self, client: _Client) -> None:
        """Takes what a client has sent."""
        try:
            packets, pings = client.receive(), b""
        except (OSError, wire.ViconWireError):
            self._drop(client)
            return
        for packet in packets:
            if packet.enums is not None:
                client.wanted, client.version = packet.enums & OFFERED, -1
            if packet.stream is not None:
                client.stream = packet.stream
                client.requests += not packet.stream
            client.requests = min(client.requests + packet.more, _MOST_REQUESTS)
            if packet.ping is not None:
                pings += wire.encode(Packet(ping=packet.ping))
        if not client.unsent:
            client.unsent = pings
        self._serve(client)

    def _drop(self, client: _Client) -> None:
        if client in self._clients:
            self._clients.remove(client)
        client.socket.close()

    def _wake(self) -> None:
        with contextlib.suppress(OSError):  # full: it wakes anyway; closed: it has ended
            self._alarm.send(b"!")

    def _run(self) -> None:
        with self._awake, self._alarm:
            while not self._closing:
                self._turn()

    def _turn(self) -> None:
        """Waits until there is something to do, and does it."""
        with selectors.DefaultSelector() as selector:
            with self._lock:
                selector.register(self._awake, selectors.EVENT_READ)
                if self._listener is not None:
                    selector.register(self._listener, selectors.EVENT_READ)
                for client in self._clients:
                    full = selectors.EVENT_WRITE if client.unsent else 0
                    selector.register(client.socket, selectors.EVENT_READ | full, client)
            ready = selector.select()
        with self._lock:
            for key, events in ready:
                if key.fileobj is self._awake:
                    self._awake.recv(4096)
                elif key.fileobj is self._listener:
                    self._accept()
                elif key.data in self._clients:
                    if events & selectors.EVENT_WRITE:
                        self._serve(key.data)
                    if events & selectors.EVENT_READ and key.data in self._clients:
                        self._take(key.data)

    def _accept(self) -> None:
        """Takes a new client and says what is offered."""
        try:
            connection, _ = self._listener.accept() if self._listener is not None else (None, None)
        except OSError:
            return
        if connection is not None:
            client = _Client(connection)
            self._clients.append(client)
            client.unsent = wire.encode(Packet(enums=OFFERED))
            self._serve(client)


class _Client:
    """One client: its connection, and what it has asked for."""

    def __init__(self, connection: socket.socket):
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        self.socket = connection
        self.wanted = OFFERED
        self.stream = False
        self.requests = 0  # frames that it asked for one by one and has not been sent
        self.fresh = False  # there is a frame that it has not been sent
        self.version = -1  # of the names that it was told
        self.unsent: bytes | memoryview = b""
        self._buffer = bytearray()

    def flush(self) -> bool:
        """Sends what was left over; whether nothing is left."""
        while self.unsent:
            try:
                self.unsent = memoryview(self.unsent)[self.socket.send(self.unsent) :]
            except BlockingIOError:
                return False
        return True

    def receive(self) -> list[Packet]:
        """Messages that have come whole.

        Raises:
            OSError: the connection is lost.
            ViconWireError: what came is not of the protocol.
        """
        chunk = self.socket.recv(1 << 16)
        if not chunk:
            raise ConnectionResetError
        self._buffer += chunk
        packets = []
        while len(self._buffer) >= wire.HEADER.size:
            end = wire.HEADER.size + wire.body_length(self._buffer)
            if len(self._buffer) < end:
                break
            packets.append(wire.decode(bytes(self._buffer[wire.HEADER.size : end])))
            del self._buffer[:end]
        return packets


def _listen(host: str, port: int) -> socket.socket:
    try:
        listener = socket.create_server((host, port))
    except (OSError, OverflowError) as error:
        raise HighFiveError(
            f"cannot listen at {host or '0.0.0.0'}:{port} ({error}); name another port, such as --port 8801"
        ) from None
    listener.setblocking(False)
    return listener
