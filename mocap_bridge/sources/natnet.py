"""A connection to OptiTrack's Motive, through NatNet."""

from __future__ import annotations

import contextlib
import ipaddress
import select
import socket
import struct
from collections.abc import Mapping, Sequence
from types import MappingProxyType

from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.natnet_columns import Columns, marker_frame
from highfive.mocap_bridge.sources.scheduler import THREADS, Now, in_seconds
from highfive.mocap_bridge.sources.scheme import UP, Address, Scheme
from highfive.mocap_bridge.wire.errors import LinkError
from highfive.mocap_bridge.wire.natnet import Kind, decode, decode_server_info, encode_request
from highfive.mocap_bridge.wire.natnet_frame import Frame, decode_frame
from highfive.mocap_bridge.wire.natnet_model import decode_model

DATA_PORT = 1511
"""Where Motive sends frames by multicast, unless it is set otherwise."""

ASK_AGAIN_S = 0.25
"""What has not been answered is requested again after so long, s: datagrams get lost."""

ANSWER_S = 2.0
"""A server that leaves a question open for so long is taken for dead, s."""

KEEP_ALIVE_S = 0.5
"""So often the server is notified that someone listens, s; otherwise it stops to send."""

_RATES_HZ = (10.0, 2000.0)  # of cameras; an answer outside was damaged on its way, and is requested again
_STRANGE_S = 0.8  # without a frame, after which what could not be read is reported

_MOST_READ = 512  # datagrams at a time, so that a flood cannot hold up the caller
_MOST_HELD = 64  # frames that wait for descriptions
_RECEIVE_BUFFER = 1 << 20  # bytes


def connect_natnet(
    host: str,
    port: int = 1510,
    data_port: int = DATA_PORT,
    multicast: str | None = None,
    y_up: bool = True,
    timeout_s: float = 2.0,
    options: Mapping[str, str] = MappingProxyType({}),
    now: Now = THREADS.now,
) -> NatNetLink:
    """Connects, and asks what is tracked.

    Args:
        host: name or address of the computer that Motive runs on.
        port: Motive's command port.
        data_port: the port that frames come to by multicast; not used without.
        multicast: address of the group that Motive sends to; None asks for frames to be sent here alone (unicast).
        y_up: Motive's setting "up axis"; frames do not say which it is, and y is what Motive is delivered with.
        timeout_s: how long the whole may take, s.
        options: what follows the address's question mark; only for advice on what to write there.
        now: monotonic clock, ns.

    Raises:
        LinkError: it could not be done; the message says what stood in the way.
    """
    title, deadline = f"{host}:{port}", in_seconds(now)() + timeout_s
    sockets: list[socket.socket] = []
    try:
        server = (socket.gethostbyname(host), port)
        sockets.append(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        sockets[0].bind(("", 0))
        if multicast:
            sockets.append(_member(multicast, data_port, server))
        for sock in sockets:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
            sock.setblocking(False)
        return NatNetLink(sockets, server, title, y_up, deadline, options, now)
    except BaseException as error:
        for sock in sockets:
            sock.close()
        if isinstance(error, (OSError, UnicodeError, OverflowError, LinkError)):
            raise LinkError(f"{title}: {getattr(error, 'strerror', None) or error}") from None
        raise


def _member(group: str, data_port: int, server: tuple[str, int]) -> socket.socket:
    """A socket that hears what is sent to a multicast group, on the way that leads to the server."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as way:
        way.connect(server)
        local = way.getsockname()[0]
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            sock.bind((group, data_port))  # so that nothing else that comes to this port is heard
        except OSError:
            sock.bind(("", data_port))  # Windows knows it only so
        member = socket.inet_aton(group) + socket.inet_aton(local)
        sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
    except OSError as error:
        sock.close()
        raise LinkError(f"cannot join multicast group {group}:{data_port}: {error.strerror or error}") from None
    return sock


class NatNetLink:
    """One connection to Motive; see :class:`highfive.mocap_bridge.sources.live.Link`. Names are
    ``'MarkerSet:Marker'``."""

    def __init__(
        self,
        sockets: list[socket.socket],
        server: tuple[str, int],
        title: str,
        y_up: bool,
        deadline: float,
        options: Mapping[str, str],
        now: Now,
    ):
        """Introduces itself, until ``deadline`` (s of the clock ``now``); use :func:`connect_natnet`."""
        self._options, self._clock = options, in_seconds(now)
        self._sockets, self._server, self._title, self._y_up = sockets, server, title, y_up
        self._rate_hz = 0.0
        self._heard = False
        self._strange = ""  # what could not be read, and why, since the last frame that could
        self._unread: list[bytes] = []  # what came with the last answer of the opening
        self._held: list[Frame] = []  # whose markers are in doubt until the descriptions come
        self._changed = False  # what the last frame said
        info = self._ask_until(Kind.CONNECT, "Ping", Kind.SERVER_INFO, deadline)
        self._info = decode_server_info(info)
        model = self._ask_until(Kind.REQUEST_MODEL, "", Kind.MODEL, deadline)
        self._model = decode_model(model, self._info.version)
        self._columns = Columns(self._model)
        self._requested = self._waiting = 0.0  # when the descriptions were requested: last, and first (0: not waiting)
        self._alive = self._last = self._clock()
        self._send(Kind.REQUEST, "FrameRate")
        self._send(Kind.KEEP_ALIVE)

    @property
    def rate_hz(self) -> float:
        """Frames per second as Motive says; 0 where it does not say."""
        return self._rate_hz

    def receive(self, timeout_s: float) -> Sequence[MarkerFrame]:
        """Whole frames that have come; see :class:`highfive.mocap_bridge.sources.live.Link`."""
        frames: list[MarkerFrame] = []
        try:
            datagrams, self._unread = self._unread, []
            for datagram in datagrams or self._read(timeout_s):
                try:
                    self._take(*decode(datagram), frames)
                except LinkError as error:  # anyone may send to a port: one that cannot be read ends nothing
                    self._strange = str(error)
            self._look_after()
        except LinkError as error:
            raise LinkError(f"{self._title}: {error}") from None
        return frames

    def close(self) -> None:
        """Says good-bye, and lets go of the connection."""
        with contextlib.suppress(LinkError):
            self._send(Kind.DISCONNECT)
        for sock in self._sockets:
            sock.close()

    def _look_after(self) -> None:
        """Keeps the connection alive, and asks again for what has not come."""
        now = self._clock()
        if now - self._alive > KEEP_ALIVE_S:
            self._alive = now
            self._send(Kind.KEEP_ALIVE)
            if not self._rate_hz:
                self._send(Kind.REQUEST, "FrameRate")
        if self._waiting and now - self._waiting > ANSWER_S:
            raise LinkError(f"it has not described what it tracks within {ANSWER_S:g} s")
        if self._waiting and now - self._requested > ASK_AGAIN_S:
            self._ask()
        if self._strange and now - self._last > _STRANGE_S:
            raise LinkError(self._strange)
        if len(self._sockets) == 1 and self._info.group and now - self._last > 0.8:
            raise LinkError(
                f"it sends to multicast group {self._info.group}:{self._info.data_port}, not here; "
                + _multicast_advice(self._info.group, self._info.data_port, self._options)
            )

    def _ask_until(self, kind: Kind, text: str, expected: Kind, deadline: float) -> bytes:
        """Asks again and again until the answer comes."""
        while (left := deadline - self._clock()) > 0.0:
            self._send(kind, text)
            again = self._clock() + min(left, ASK_AGAIN_S)
            while (wait := again - self._clock()) > 0.0:
                datagrams = self._read(wait)
                for k, datagram in enumerate(datagrams):
                    try:
                        came, body = decode(datagram)
                    except LinkError as error:
                        self._strange = str(error)
                        continue
                    if came == expected:
                        self._unread = datagrams[k + 1 :]
                        return body
            if not self._heard:
                self._check_there()
        if self._strange:
            raise LinkError(self._strange)
        if self._heard:
            raise LinkError("it is there, but does not answer what NatNet servers answer; is it Motive's command port?")
        raise LinkError("no answer; does Motive stream, and may UDP pass the firewalls?")

    def _check_there(self) -> None:
        """Finds out whether the port is closed; only a connected socket is notified."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.settimeout(0.05)
            try:
                probe.connect(self._server)
                probe.send(encode_request(Kind.KEEP_ALIVE))
                probe.recv(1)
            except ConnectionRefusedError:
                raise LinkError("nothing listens there; is Motive running, with NatNet streaming on?") from None
            except OSError:
                return

    def _send(self, kind: Kind, text: str = "") -> None:
        try:
            self._sockets[0].sendto(encode_request(kind, text), self._server)
        except BlockingIOError:
            pass
        except (OSError, OverflowError) as error:
            raise LinkError(getattr(error, "strerror", None) or str(error)) from None

    def _read(self, timeout_s: float) -> list[bytes]:
        """Datagrams of the server that have come; waits up to ``timeout_s`` for the first."""
        datagrams: list[bytes] = []
        try:
            for sock in select.select(self._sockets, [], [], max(timeout_s, 0.0))[0]:
                with contextlib.suppress(BlockingIOError):
                    for _ in range(_MOST_READ):
                        datagram, sender = sock.recvfrom(1 << 16)
                        if sender[0] == self._server[0]:
                            datagrams.append(datagram)
        except (OSError, ValueError) as error:
            raise LinkError(getattr(error, "strerror", None) or str(error)) from None
        self._heard |= bool(datagrams)
        return datagrams

    def _take(self, kind: int, body: bytes, frames: list[MarkerFrame]) -> None:
        if kind == Kind.FRAME:
            frame = decode_frame(body, self._info.version)
            self._last, self._strange = self._clock(), ""
            news, self._changed = frame.models_changed and not self._changed, frame.models_changed
            if news or not (self._waiting or self._columns.fit(frame)):
                self._ask()
            if self._waiting:
                self._held = [*self._held[1 - _MOST_HELD :], frame]
            else:
                frames.append(marker_frame(frame, self._columns, self._y_up, self._info.clock_hz))
        elif kind == Kind.MODEL:
            self._waiting = 0.0
            model = decode_model(body, self._info.version)
            if model != self._model:
                self._model, self._columns = model, Columns(model)
            held, self._held = self._held, []
            frames += [
                marker_frame(frame, self._columns, self._y_up, self._info.clock_hz)
                for frame in held
                if self._columns.fit(frame)
            ]
        elif kind == Kind.SERVER_INFO:
            self._info = decode_server_info(body)
        elif kind == Kind.RESPONSE and len(body) == 4:
            rate = struct.unpack("<f", body)[0]
            self._rate_hz = rate if _RATES_HZ[0] <= rate <= _RATES_HZ[1] else self._rate_hz

    def _ask(self) -> None:
        """Asks for the descriptions; until they come no name is certain."""
        self._requested = self._clock()
        self._waiting = self._waiting or self._requested
        self._send(Kind.REQUEST_MODEL)


def _multicast_advice(group: str, port: int, options: Mapping[str, str]) -> str:
    """What to write so that a group and its port are heard, behind an address that has some ``options`` already."""
    more, change = f"{'&' if options else '?'}multicast={group}", ""
    if port != int(options.get("data_port", DATA_PORT)):
        if "data_port" in options:
            change = f"set its data_port to {port} and "
        else:
            more += f"&data_port={port}"
    return f"{change}put {more} behind the address, all in quotation marks"


def _connect(address: Address, now: Now = THREADS.now) -> NatNetLink:
    options = address.options
    data_port, y_up = int(options.get("data_port", DATA_PORT)), options.get("up", "y") == "y"
    return connect_natnet(
        address.host, address.port, data_port, options.get("multicast"), y_up, options=options, now=now
    )


def _wrong(option: str, value: str) -> str:
    """What is wrong with an option's value; '' where nothing is."""
    if option == "data_port" and not (value.isdecimal() and 1 <= int(value) <= 65535):
        return f"data_port is {value!r}; expected 1 to 65535"
    if option == "multicast":
        try:
            good = ipaddress.ip_address(value).is_multicast
        except ValueError:
            good = False
        return "" if good else f"{value!r} is no multicast group, such as 239.255.42.99"
    return ""


SCHEME = Scheme(
    "natnet://192.168.10.1?up=z&multicast=239.255.42.99",
    _connect,
    port=1510,
    options={**UP, "multicast": (), "data_port": ()},
    check=_wrong,
    timed=True,
)
"""Addresses of Motive."""
