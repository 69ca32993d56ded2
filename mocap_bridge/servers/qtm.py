"""Plays Qualisys Track Manager: frames over the real-time (RT) protocol, for any number of clients."""

from __future__ import annotations

import contextlib
import select
import socket
import threading
import time
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.servers.serving import LOOPBACK
from highfive.mocap_bridge.wire import qtm as wire
from highfive.mocap_bridge.wire.errors import LinkError

ANNOUNCE_S = 0.25
"""A new order of labels is announced so often at most, s; a client that asks anew takes a moment to do so."""

_MOST_UNSENT = 1 << 20  # bytes of answers; who reads none of them is let go
_SEND_BUFFER = 1 << 16  # bytes that the system keeps for a slow client: no more than some frames


class _Client:
    """One connection: what it asked for, and what has not been sent yet."""

    def __init__(self, sock: socket.socket):
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        self.sock = sock
        self.received = bytearray()
        self.unsent = bytearray()
        self.components: tuple[wire.Component, ...] = ()  # of the stream; none: no stream
        self.divisor = 1
        self.labels: tuple[str, ...] | None = None  # as it was told them; points go out in this order
        self.open = True

    def push(self, message: bytes = b"") -> None:
        """Sends what can be sent now."""
        self.unsent += message
        try:
            while self.unsent:
                del self.unsent[: self.sock.send(self.unsent)]
        except BlockingIOError:
            self.open &= len(self.unsent) <= _MOST_UNSENT
        except OSError:
            self.open = False


class QtmServer:
    """See :class:`highfive.mocap_bridge.servers.serving.Server`.

    Points have no names on the wire: a client asks for the labels once, and points come in their order. If labels
    change, clients are told that settings changed; each gets the old order until it has asked for the new one.
    """

    def __init__(self, host: str = LOOPBACK, port: int = 22223, names: Sequence[str] = (), rate_hz: float = 120.0):
        """Listens.

        Args:
            host: address to listen at.
            port: port for little-endian numbers; 0 takes a free one.
            names: labels before the first frame.
            rate_hz: frames a second, for who asks.

        Raises:
            LinkError: the port is taken.
        """
        self._host, self._rate_hz = host, rate_hz
        self._names, self._newest = tuple(names), None
        self._clients: list[_Client] = []
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._announced = -np.inf
        self._sent_ns = 0
        self._listener = self._bound(port)
        self._port = self._listener.getsockname()[1]
        self._listener.listen()
        self._up = True
        self._thread = threading.Thread(target=self._run, name=f"QTM server {self._port}", daemon=True)
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
        """Sends a frame to every client that streams; one that has not taken the last one misses this one."""
        with self._lock:
            self._names, self._newest = frame.names, frame
            if not self._up:
                return
            messages: dict[object, bytes] = {}
            for client in self._clients:
                client.push()
                if client.components and not client.unsent and frame.number % client.divisor == 0:
                    labels = client.labels or frame.names
                    key = (labels, client.components)
                    if key not in messages:
                        messages[key] = _encode(frame, labels, client.components)
                    self._sent_ns = time.monotonic_ns()
                    client.push(messages[key])
            now = time.monotonic()
            behind = [client for client in self._clients if client.labels not in (None, self._names)]
            # After the frame, not before: there is time until the next one for the client to ask.
            if behind and now - self._announced > ANNOUNCE_S:
                self._announced = now
                for client in behind:
                    client.push(wire.encode(wire.Kind.EVENT, bytes([wire.Event.SETTINGS_CHANGED])))

    def hang_up(self) -> None:
        """Breaks every connection and refuses new ones."""
        with self._lock:
            self._up = False
            self._drop_all()
            self._listener.close()
            with contextlib.suppress(LinkError):  # holds the port without listening; answer() tries again
                self._listener = self._bound(self._port)

    def answer(self) -> None:
        """Takes connections again."""
        with self._lock:
            if self._up or self._closing.is_set():
                return
            if self._listener.fileno() < 0:
                self._listener = self._bound(self._port)
            self._listener.listen()
            self._up = True

    def close(self) -> None:
        """Ends everything; a second call does nothing."""
        self._closing.set()
        self._thread.join(timeout=5.0)
        with self._lock:
            self._drop_all()
            self._listener.close()

    def _bound(self, port: int) -> socket.socket:
        sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            sock.bind((self._host, port))
        except (OSError, OverflowError) as error:
            sock.close()
            raise LinkError(
                f"cannot listen at {self._host}:{port}: {getattr(error, 'strerror', None) or error}"
            ) from None
        return sock

    def _drop_all(self) -> None:
        for client in self._clients:
            client.sock.close()
        self._clients = []

    def _run(self) -> None:
        while not self._closing.is_set():
            with self._lock:
                listener = [self._listener] if self._up else []
                clients = {client.sock: client for client in self._clients}
                unsent = [client.sock for client in self._clients if client.unsent]
            try:
                readable, writable, _ = select.select([*listener, *clients], unsent, [], 0.02)
            except (OSError, ValueError):  # one was closed meanwhile, by hang_up()
                continue
            with self._lock:
                for sock in readable:
                    if sock in clients:
                        self._read(clients[sock])
                    elif self._up:
                        self._accept()
                for sock in writable:
                    clients[sock].push()
                for client in self._clients:
                    if not client.open:
                        client.sock.close()
                self._clients = [client for client in self._clients if client.open]

    def _accept(self) -> None:
        try:
            client = _Client(self._listener.accept()[0])
        except OSError:
            return
        client.push(wire.encode_text(wire.Kind.COMMAND, wire.GREETING))
        self._clients.append(client)

    def _read(self, client: _Client) -> None:
        try:
            chunk = client.sock.recv(65536)
            client.open &= bool(chunk)
            client.received += chunk
            for kind, body in wire.split(client.received):
                if kind == wire.Kind.COMMAND:
                    self._obey(client, wire.decode_text(body))
        except BlockingIOError:
            pass
        except (OSError, LinkError):
            client.open = False

    def _obey(self, client: _Client, command: str) -> None:
        """Does what a client asks for."""
        verb, *words = command.lower().split() or [""]
        first = words[0] if words else ""
        kind, answer = wire.Kind.COMMAND, ""
        if verb == "version" and first.startswith("1."):
            answer = f"Version set to {first[:8]}"
        elif verb == "qtmversion":
            answer = "QTM Version is High Five (a replay)"
        elif verb == "byteorder":
            answer = "Byte order is little endian"
        elif verb == "getparameters" and words:
            kind, answer = wire.Kind.XML, wire.encode_parameters(self._names, self._rate_hz, words)
            if {"3d", "all"} & set(words):
                client.labels = self._names
        elif verb == "getstate":
            client.push(wire.encode(wire.Kind.EVENT, bytes([wire.Event.RT_FROM_FILE_STARTED])))
        elif verb == "getcurrentframe" and self._newest:
            labels = client.labels or self._names
            client.push(_encode(self._newest, labels, _components(words)))
        elif verb == "streamframes" and first == "stop":
            client.components = ()
        elif verb == "streamframes" and _components(words):
            rate, _, number = first.partition(":")
            value = max(1, int(number[:6])) if number.isdecimal() else 1
            client.divisor = {"frequencydivisor": value, "frequency": max(1, round(self._rate_hz / value))}.get(rate, 1)
            client.components = _components(words)
        else:
            kind, answer = wire.Kind.ERROR, "Parse error"
        if answer:
            client.push(wire.encode_text(kind, answer))


def _components(words: Sequence[str]) -> tuple[wire.Component, ...]:
    return tuple(wire.COMPONENT_NAMES[word] for word in dict.fromkeys(words) if word in wire.COMPONENT_NAMES)


def _encode(frame: MarkerFrame, labels: tuple[str, ...], components: Sequence[wire.Component]) -> bytes:
    """A frame with its points in the order of ``labels``; what it has no point of is not seen."""
    with np.errstate(over="ignore"):
        points = np.where(frame.valid[:, None], frame.positions * 1e3, np.nan).astype(np.float32)
        loose: NDArray[np.float32] = (frame.unlabelled * 1e3).astype(np.float32)
    if labels != frame.names:
        column = {name: m for m, name in enumerate(frame.names)}
        missing = len(points)
        points = np.concatenate([points, np.full((1, 3), np.nan, np.float32)])
        points = points[[column.get(name, missing) for name in labels]]
    return wire.encode_data(frame.source_time_ns // 1000, frame.number, points, loose, components)
