"""A connection to Qualisys Track Manager (QTM), through its real-time protocol."""

from __future__ import annotations

import math
import select
import socket
from collections.abc import Sequence

import numpy as np

from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.scheduler import THREADS, Now, in_seconds
from highfive.mocap_bridge.sources.scheme import Address, Scheme
from highfive.mocap_bridge.wire import qtm as wire
from highfive.mocap_bridge.wire.errors import LinkError
from highfive.mocap_bridge.wire.plausible import plausible, plausible_only

VERSIONS = ("1.25", "1.23", "1.19", "1.13")
"""Versions of the protocol, requested in this order; frames of points are the same in all."""

ASK_AGAIN_S = 0.1
"""Parameters that do not fit the frames are requested so often at most, s."""

ANSWER_S = 2.0
"""A server that leaves a question open for so long is taken for dead, s."""

_MOST_READ = 1 << 20  # bytes at a time, so that a flood cannot hold up the caller
_MOST_HELD = 64  # frames that wait for parameters
_RENAMING = {
    wire.Event.CONNECTED,
    wire.Event.CAPTURE_STARTED,
    wire.Event.RT_FROM_FILE_STARTED,
    wire.Event.SETTINGS_CHANGED,
}


def connect_qtm(host: str, port: int = 22223, timeout_s: float = 2.0, now: Now = THREADS.now) -> QtmLink:
    """Connects, and asks for every frame.

    Args:
        host: name or address of the computer that QTM runs on.
        port: QTM's port for little-endian numbers.
        timeout_s: how long the whole may take, s.
        now: monotonic clock, ns.

    Raises:
        LinkError: it could not be done; the message says what stood in the way.
    """
    title, deadline = f"{host}:{port}", in_seconds(now)() + timeout_s
    if not 0 < port < 1 << 16:  # some systems would take the rest of a division
        raise LinkError(f"cannot connect to {title}: ports go from 1 to 65535")
    try:
        sock = socket.create_connection((host, port), timeout_s)
    except ConnectionRefusedError:
        raise LinkError(f"nothing listens at {title}; is QTM running, with its real-time server on?") from None
    except TimeoutError:
        raise LinkError(f"{title} does not answer within {timeout_s:g} s; is it the right address?") from None
    except (OSError, UnicodeError, OverflowError) as error:
        raise LinkError(f"cannot connect to {title}: {getattr(error, 'strerror', None) or error}") from None
    try:
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return QtmLink(sock, title, deadline, now)
    except BaseException as error:
        sock.close()
        if isinstance(error, LinkError):
            raise LinkError(f"{title}: {error}") from None
        raise


class QtmLink:
    """One connection to QTM; see :class:`highfive.mocap_bridge.sources.live.Link`. Labels are QTM's own."""

    def __init__(self, sock: socket.socket, title: str, deadline: float, now: Now = THREADS.now):
        """Agrees on a version and on what is sent, until ``deadline`` (s of the clock ``now``); use
        :func:`connect_qtm`."""
        self._sock, self._title, self._clock = sock, title, in_seconds(now)
        self._buffer = bytearray()
        self._unread: list[tuple[int, bytes]] = []  # messages of the opening that were not requested
        self._ended = ""
        self._requested = -math.inf  # when the parameters were last requested (s of the clock)
        self._waiting = self._outdated = False  # for parameters; those that come will be out of date
        self._held: list[wire.Data] = []  # whose labels are in doubt until the parameters come
        sock.setblocking(False)
        self._agree(deadline)
        self._send("getparameters 3d general")
        self._parameters = wire.decode_parameters(self._answer(wire.Kind.XML, deadline, "parameters"))
        self._send("streamframes allframes 3dres 3dnolabelsres")

    @property
    def rate_hz(self) -> float:
        """Frames per second as QTM says; 0 where it does not say."""
        return self._parameters.rate_hz

    def receive(self, timeout_s: float) -> Sequence[MarkerFrame]:
        """Whole frames that have come; see :class:`highfive.mocap_bridge.sources.live.Link`."""
        frames: list[MarkerFrame] = []
        messages, self._unread = self._unread, []
        try:
            for kind, body in messages or self._read(timeout_s):
                self._take(kind, body, frames)
            if self._waiting and self._clock() - self._requested > ANSWER_S:
                raise LinkError(f"it sent no parameters within {ANSWER_S:g} s")
        except LinkError as error:
            raise LinkError(f"{self._title}: {error}") from None
        return frames

    def close(self) -> None:
        """Lets go of the connection."""
        self._sock.close()

    def _agree(self, deadline: float) -> None:
        """Agrees on a version; sent before the greeting has come, for servers that wait for a request first."""
        said = ""
        for version in VERSIONS:
            self._send(f"version {version}")
            while True:
                kind, body = self._next(deadline, "answer")
                said = wire.decode_text(body)
                if kind == wire.Kind.ERROR or (kind == wire.Kind.COMMAND and not said.startswith(wire.GREETING)):
                    break
            if kind == wire.Kind.COMMAND:
                return
        raise LinkError(
            f"it speaks no version of QTM's protocol from {VERSIONS[-1]} to {VERSIONS[0]}; it says {said[:80]!r}"
        )

    def _answer(self, expected: wire.Kind, deadline: float, what: str) -> bytes:
        while True:
            kind, body = self._next(deadline, what)
            if kind == expected:
                return body
            if kind == wire.Kind.ERROR:
                raise LinkError(f"it says {wire.decode_text(body)[:80]!r} where {what} were requested")

    def _next(self, deadline: float, what: str) -> tuple[int, bytes]:
        """The next message of the opening."""
        while (left := deadline - self._clock()) > 0.0 and not self._unread:
            self._unread = self._read(left)
        if left <= 0.0:  # however much else it sends
            raise LinkError(f"it takes connections but sends no {what}; is it QTM's port?")
        return self._unread.pop(0)

    def _read(self, timeout_s: float) -> list[tuple[int, bytes]]:
        """Whole messages that have come; waits up to ``timeout_s`` for the first bytes."""
        if self._ended:
            raise LinkError(self._ended)
        try:
            if not select.select([self._sock], [], [], max(timeout_s, 0.0))[0]:
                return []
            start = len(self._buffer)
            while len(self._buffer) - start < _MOST_READ:
                chunk = self._sock.recv(65536)
                if not chunk:
                    self._ended = "the connection was closed by the other side"
                    break
                self._buffer += chunk
        except BlockingIOError:
            pass
        except (OSError, ValueError) as error:
            raise LinkError(getattr(error, "strerror", None) or str(error)) from None
        return wire.split(self._buffer)

    def _send(self, command: str) -> None:
        try:
            self._sock.sendall(wire.encode_text(wire.Kind.COMMAND, command))
        except OSError as error:
            raise LinkError(error.strerror or str(error)) from None

    def _take(self, kind: int, body: bytes, frames: list[MarkerFrame]) -> None:
        if kind == wire.Kind.DATA:
            data = wire.decode_data(body)
            if data.labelled is None:
                return
            if not self._waiting and len(data.labelled) != len(self._parameters.labels):
                self._ask()
            if self._waiting:
                self._held = [*self._held[1 - _MOST_HELD :], data]
            elif len(data.labelled) == len(self._parameters.labels):
                frames.append(marker_frame(data, self._parameters))
        elif kind == wire.Kind.EVENT:
            if wire.decode_event(body) in _RENAMING:
                self._outdated = self._waiting  # an answer that is on its way may be older than the event
                self._ask(at_once=not self._waiting)
        elif kind == wire.Kind.XML and self._waiting:
            if self._outdated:
                self._outdated = False
                self._ask(at_once=True)
            else:
                self._rename(wire.decode_parameters(body), frames)
        elif kind == wire.Kind.ERROR:
            raise LinkError(f"it says {wire.decode_text(body)[:80]!r}")

    def _ask(self, at_once: bool = False) -> None:
        """Asks for the parameters; until they come no label is certain."""
        now = self._clock()
        if at_once or now - self._requested > ASK_AGAIN_S:
            self._send("getparameters 3d general")
            self._requested, self._waiting = now, True

    def _rename(self, parameters: wire.Parameters, frames: list[MarkerFrame]) -> None:
        """Takes new parameters, and those frames that waited for them whose labels they settle."""
        before, self._waiting = self._parameters.labels, False
        if parameters != self._parameters:
            self._parameters = parameters
        held, self._held = self._held, []
        for data in held:
            count = 0 if data.labelled is None else len(data.labelled)
            # As many points as labels before and now, but other labels: they may be in either order.
            if count == len(parameters.labels) and (parameters.labels == before or count != len(before)):
                frames.append(marker_frame(data, self._parameters))


@np.errstate(invalid="ignore")  # a NaN may be of the signalling kind
def marker_frame(data: wire.Data, parameters: wire.Parameters) -> MarkerFrame:
    """A frame of the wire in metres, z up. It holds as many labelled points as there are labels."""
    points = parameters.metres(np.zeros((0, 3), np.float32) if data.labelled is None else data.labelled)
    loose = parameters.metres(data.unlabelled)
    points, valid, impossible = plausible(points, np.ones(len(points), dtype=bool))
    return MarkerFrame(
        parameters.labels,
        points,
        valid,
        data.number,
        data.time_us * 1000,
        0,
        plausible_only(loose),
        impossible=int(impossible),
    )


def _connect(address: Address, now: Now = THREADS.now) -> QtmLink:
    return connect_qtm(address.host, address.port, now=now)


SCHEME = Scheme("qtm://192.168.10.1:22223", _connect, port=22223, timed=True)
"""Addresses of QTM."""
