"""Plays Qualisys Track Manager: frames over the real-time (RT) protocol, for any number of clients."""

from __future__ import annotations

import socket
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.servers.live_server import Client, TcpServer
from highfive.mocap_bridge.servers.serving import LOOPBACK
from highfive.mocap_bridge.sources.scheduler import THREADS, Now
from highfive.mocap_bridge.wire import qtm as wire

ANNOUNCE_S = 0.25
"""A new order of labels is announced so often at most, s; a client that asks anew takes a moment to do so."""


class _Client(Client):
    """One connection: what it requested."""

    def __init__(self, sock: socket.socket) -> None:
        super().__init__(sock)
        self.received = bytearray()
        self.components: tuple[wire.Component, ...] = ()  # of the stream; none: no stream
        self.divisor = 1
        self.labels: tuple[str, ...] | None = None  # as they were sent to it; points go out in this order


class QtmServer(TcpServer[_Client]):
    """See :class:`highfive.mocap_bridge.servers.serving.Server`.

    Points have no names on the wire: a client asks for the labels once, and points come in their order. If labels
    change, clients are notified that settings changed; each gets the old order until it has requested the new one.
    """

    def __init__(
        self,
        host: str = LOOPBACK,
        port: int = 22223,
        names: Sequence[str] = (),
        rate_hz: float = 120.0,
        now: Now = THREADS.now,
    ):
        """Listens.

        Args:
            host: address to listen at.
            port: port for little-endian numbers; 0 takes a free one.
            names: labels before the first frame.
            rate_hz: frames per second, for who asks.
            now: monotonic clock, ns.

        Raises:
            LinkError: the port is taken.
        """
        self._rate_hz = rate_hz
        self._names, self._newest = tuple(names), None
        self._announced = -np.inf
        super().__init__(host, port, "QTM", now)

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
                    self._sent_ns = self._now()
                    client.push(messages[key])
            now = self._now()
            behind = [client for client in self._clients if client.labels not in (None, self._names)]
            # After the frame, not before: there is time until the next one for the client to ask.
            if behind and now - self._announced > ANNOUNCE_S * 1e9:
                self._announced = now
                for client in behind:
                    client.push(wire.encode(wire.Kind.EVENT, bytes([wire.Event.SETTINGS_CHANGED])))
            self._send_to_all()

    def _welcomed(self, sock: socket.socket) -> _Client:
        client = _Client(sock)
        client.push(wire.encode_text(wire.Kind.COMMAND, wire.GREETING))
        return client

    def _take(self, client: _Client, chunk: bytes) -> None:
        client.received += chunk
        for kind, body in wire.split(client.received):
            if kind == wire.Kind.COMMAND:
                self._obey(client, wire.decode_text(body))

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
