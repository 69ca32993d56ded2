"""A connection to OptiTrack's Motive, through NatNet."""

from __future__ import annotations

import contextlib
import ipaddress
import select
import socket
import struct
import time
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.scheme import UP, Address, Scheme
from highfive.mocap_bridge.wire import natnet as wire
from highfive.mocap_bridge.wire.errors import LinkError
from highfive.mocap_bridge.wire.plausible import plausible, plausible_only

DATA_PORT = 1511
"""Where Motive sends frames by multicast, unless it is set otherwise."""

ASK_AGAIN_S = 0.25
"""What has not been answered is asked for again after so long, s: datagrams get lost."""

ANSWER_S = 2.0
"""A server that leaves a question open for so long is taken for dead, s."""

KEEP_ALIVE_S = 0.5
"""So often the server is told that someone listens, s; otherwise it stops to send."""

_RATES_HZ = (10.0, 2000.0)  # of cameras; an answer outside was damaged on its way, and is asked for again
_STRANGE_S = 0.8  # without a frame, after which what could not be read is told

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

    Raises:
        LinkError: it could not be done; the message says what stood in the way.
    """
    title, deadline = f"{host}:{port}", time.monotonic() + timeout_s
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
        return NatNetLink(sockets, server, title, y_up, deadline, options)
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
    ):
        """Introduces itself, until ``deadline`` (monotonic, s); use :func:`connect_natnet`."""
        self._options = options
        self._sockets, self._server, self._title, self._y_up = sockets, server, title, y_up
        self._rate_hz = 0.0
        self._heard = False
        self._strange = ""  # what could not be read, and why, since the last frame that could
        self._unread: list[bytes] = []  # what came with the last answer of the opening
        self._held: list[wire.Frame] = []  # whose markers are in doubt until the descriptions come
        self._changed = False  # what the last frame said
        info = self._ask_until(wire.Kind.CONNECT, "Ping", wire.Kind.SERVER_INFO, deadline)
        self._info = wire.decode_server_info(info)
        model = self._ask_until(wire.Kind.REQUEST_MODEL, "", wire.Kind.MODEL, deadline)
        self._model = wire.decode_model(model, self._info.version)
        self._columns = Columns(self._model)
        self._asked = self._waiting = 0.0  # when the descriptions were asked for: last, and first (0: not waiting)
        self._alive = self._last = time.monotonic()
        self._send(wire.Kind.REQUEST, "FrameRate")
        self._send(wire.Kind.KEEP_ALIVE)

    @property
    def rate_hz(self) -> float:
        """Frames a second as Motive says; 0 where it does not say."""
        return self._rate_hz

    def receive(self, timeout_s: float) -> Sequence[MarkerFrame]:
        """Whole frames that have come; see :class:`highfive.mocap_bridge.sources.live.Link`."""
        frames: list[MarkerFrame] = []
        try:
            datagrams, self._unread = self._unread, []
            for datagram in datagrams or self._read(timeout_s):
                try:
                    self._take(*wire.decode(datagram), frames)
                except LinkError as error:  # anyone may send to a port: one that cannot be read ends nothing
                    self._strange = str(error)
            self._look_after()
        except LinkError as error:
            raise LinkError(f"{self._title}: {error}") from None
        return frames

    def close(self) -> None:
        """Says good-bye, and lets go of the connection."""
        with contextlib.suppress(LinkError):
            self._send(wire.Kind.DISCONNECT)
        for sock in self._sockets:
            sock.close()

    def _look_after(self) -> None:
        """Keeps the connection alive, and asks again for what has not come."""
        now = time.monotonic()
        if now - self._alive > KEEP_ALIVE_S:
            self._alive = now
            self._send(wire.Kind.KEEP_ALIVE)
            if not self._rate_hz:
                self._send(wire.Kind.REQUEST, "FrameRate")
        if self._waiting and now - self._waiting > ANSWER_S:
            raise LinkError(f"it has not described what it tracks within {ANSWER_S:g} s")
        if self._waiting and now - self._asked > ASK_AGAIN_S:
            self._ask()
        if self._strange and now - self._last > _STRANGE_S:
            raise LinkError(self._strange)
        if len(self._sockets) == 1 and self._info.group and now - self._last > 0.8:
            raise LinkError(
                f"it sends to multicast group {self._info.group}:{self._info.data_port}, not here; "
                + _multicast_advice(self._info.group, self._info.data_port, self._options)
            )

    def _ask_until(self, kind: wire.Kind, text: str, wanted: wire.Kind, deadline: float) -> bytes:
        """Asks again and again until the answer comes."""
        while (left := deadline - time.monotonic()) > 0.0:
            self._send(kind, text)
            again = time.monotonic() + min(left, ASK_AGAIN_S)
            while (wait := again - time.monotonic()) > 0.0:
                datagrams = self._read(wait)
                for k, datagram in enumerate(datagrams):
                    try:
                        came, body = wire.decode(datagram)
                    except LinkError as error:
                        self._strange = str(error)
                        continue
                    if came == wanted:
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
        """Finds out whether the port is closed; only a connected socket is told."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.settimeout(0.05)
            try:
                probe.connect(self._server)
                probe.send(wire.encode_request(wire.Kind.KEEP_ALIVE))
                probe.recv(1)
            except ConnectionRefusedError:
                raise LinkError("nothing listens there; is Motive running, with NatNet streaming on?") from None
            except OSError:
                return

    def _send(self, kind: wire.Kind, text: str = "") -> None:
        try:
            self._sockets[0].sendto(wire.encode_request(kind, text), self._server)
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
        if kind == wire.Kind.FRAME:
            frame = wire.decode_frame(body, self._info.version)
            self._last, self._strange = time.monotonic(), ""
            news, self._changed = frame.models_changed and not self._changed, frame.models_changed
            if news or not (self._waiting or self._columns.fit(frame)):
                self._ask()
            if self._waiting:
                self._held = [*self._held[1 - _MOST_HELD :], frame]
            else:
                frames.append(marker_frame(frame, self._columns, self._y_up))
        elif kind == wire.Kind.MODEL:
            self._waiting = 0.0
            model = wire.decode_model(body, self._info.version)
            if model != self._model:
                self._model, self._columns = model, Columns(model)
            held, self._held = self._held, []
            frames += [marker_frame(frame, self._columns, self._y_up) for frame in held if self._columns.fit(frame)]
        elif kind == wire.Kind.SERVER_INFO:
            self._info = wire.decode_server_info(body)
        elif kind == wire.Kind.RESPONSE and len(body) == 4:
            rate = struct.unpack("<f", body)[0]
            self._rate_hz = rate if _RATES_HZ[0] <= rate <= _RATES_HZ[1] else self._rate_hz

    def _ask(self) -> None:
        """Asks for the descriptions; until they come no name is certain."""
        self._asked = time.monotonic()
        self._waiting = self._waiting or self._asked
        self._send(wire.Kind.REQUEST_MODEL)


@np.errstate(invalid="ignore")  # a NaN may be of the signalling kind
def marker_frame(frame: wire.Frame, columns: Columns, y_up: bool) -> MarkerFrame:
    """A frame of the wire that fits ``columns``, z up."""
    turn = wire.z_up if y_up else _as_it_is
    points, valid, loose = columns.place(frame)
    points, valid, impossible = plausible(turn(points), valid)
    return MarkerFrame(
        columns.names,
        points,
        valid,
        frame.number,
        round(frame.time * 1e9),
        0,
        plausible_only(turn(loose)),
        impossible=int(impossible),
    )


def _as_it_is(points: NDArray[np.floating]) -> NDArray[np.float64]:
    return points.astype(np.float64)


class Columns:
    """Where each marker of a frame belongs.

    A set's points come in the order of its description; there a hidden marker is zero, or filled in from the asset's
    shape. What was seen is said by the labelled markers, which have numbers instead of names: the asset's, and the
    place in its set. Only rigid bodies, skeletons and assets have their number in the descriptions. Which number a mere
    set has shows in a frame: its points are the same in both places.
    """

    def __init__(self, model: wire.Model):
        """Nothing is known of numbers that the descriptions do not have."""
        names: list[str] = []
        self._spans: dict[str, tuple[int, int]] = {}  # set -> first column and number of markers
        for one in model.sets:
            if one.name.lower() != "all":
                self._spans[one.name] = (len(names), len(one.markers))
                names += [_full_name(one.name, marker) for marker in one.markers]
        self.names = tuple(names)
        self._starts = np.zeros(len(names), dtype=np.intp)  # of each column's set
        for start, count in self._spans.values():
            self._starts[start : start + count] = start
        self._span_of = {number: self._spans[name] for name, number in model.ids.items() if name in self._spans}
        self._base: dict[int, int] = {}  # asset -> place that its markers are counted from
        self._ids: bytes | None = None  # those that the columns below are of
        self._rows = self._columns = np.zeros(0, dtype=np.intp)
        self._covered = np.zeros(len(names), dtype=bool)

    def fit(self, frame: wire.Frame) -> bool:
        """Whether the descriptions are those of a frame."""
        return all(
            name.lower() == "all" or self._spans.get(name, (0, -1))[1] == len(points) for name, points in frame.sets
        )

    def place(self, frame: wire.Frame) -> tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.float32]]:
        """Points (M, 3) m in the order of ``names``, which of them were seen (M,), and those without a label (U, 3)."""
        points, valid = np.zeros((len(self.names), 3), np.float32), np.zeros(len(self.names), dtype=bool)
        for name, given in frame.sets:
            if name in self._spans:
                start, count = self._spans[name]
                points[start : start + count] = given
                valid[start : start + count] = given.any(axis=1)
        markers, flags = frame.labelled, frame.labelled["flags"]
        if not len(markers):
            return points, valid, frame.others
        if markers["id"].tobytes() != self._ids:
            self._find(markers, points, valid)
        # Filled in from the asset's shape, and not measured, is not seen either.
        hidden = (flags & wire.OCCLUDED).astype(bool) | ((flags & (wire.FILLED | wire.MEASURED)) == wire.FILLED)
        valid[self._covered] = False
        valid[self._columns] = ~hidden[self._rows]
        points[self._columns] = markers["point"][self._rows]
        return points, valid, _without_label(frame, (flags & wire.UNLABELLED).astype(bool) & ~hidden)

    def _find(self, markers: NDArray[np.void], points: NDArray[np.float32], valid: NDArray[np.bool_]) -> None:
        """Finds the column of each labelled marker."""
        ids, labelled = markers["id"], (markers["flags"] & wire.UNLABELLED) == 0
        assets, places = ids >> 16, (ids & 0xFFFF).astype(np.intp)
        columns, sure = np.full(len(ids), -1, dtype=np.intp), True
        taken = set(self._span_of.values())
        guesses = [] if valid.any() else [span for span in self._spans.values() if span not in taken]
        given = {point: column for column, point in enumerate(map(tuple, points.tolist())) if any(point)}
        for asset in np.unique(assets[labelled]).tolist():
            rows = np.flatnonzero(labelled & (assets == asset))
            base = self._base.setdefault(asset, int(places[rows].min() > 0))
            found = np.array([given.get(tuple(point), -1) for point in markers["point"][rows].tolist()])
            span = self._span_of.get(asset) or self._recognised(found, places[rows] - base)
            if span:
                self._span_of[asset] = span
            else:
                sure = False  # look again in the next frame; until then the order of the descriptions
                span = guesses.pop(0) if guesses else (0, 0)
            inside = rows[(places[rows] >= base) & (places[rows] - base < span[1])]
            columns[inside] = span[0] + places[inside] - base
            # Points are named by their set; should the numbers say otherwise, it is them that are misunderstood.
            other = (found >= span[0]) & (found < span[0] + span[1]) & (found != columns[rows])
            columns[rows[other]], sure = found[other], sure and not other.any()
        self._rows = np.flatnonzero(columns >= 0)
        self._columns = columns[self._rows]
        self._covered = np.isin(self._starts, self._starts[self._columns])
        self._ids = ids.tobytes() if sure else None

    def _recognised(self, columns: NDArray[np.intp], places: NDArray[np.intp]) -> tuple[int, int] | None:
        """The set in which most markers of an asset have the same point in the same place.

        Args:
            columns: (n,) where each marker's point is among the sets' points; -1 for nowhere.
            places: (n,) each marker's place in its asset.
        """
        same = columns[(columns >= 0) & (self._starts[columns] + places == columns)]
        if not len(same):
            return None
        starts, votes = np.unique(self._starts[same], return_counts=True)
        span = next(span for span in self._spans.values() if span[0] == starts[votes.argmax()] and span[1])
        return None if span in self._span_of.values() else span


def _multicast_advice(group: str, port: int, options: Mapping[str, str]) -> str:
    """What to write so that a group and its port are heard, behind an address that has some ``options`` already."""
    more, change = f"{'&' if options else '?'}multicast={group}", ""
    if port != int(options.get("data_port", DATA_PORT)):
        if "data_port" in options:
            change = f"set its data_port to {port} and "
        else:
            more += f"&data_port={port}"
    return f"{change}put {more} behind the address, all in quotation marks"


def _full_name(group: str, marker: str) -> str:
    """``'MarkerSet:Marker'``, whether or not the marker's own name begins with the set's."""
    for mark in ":_":
        marker = marker.removeprefix(group + mark) or marker
    return f"{group}:{marker}" if group else marker


def _without_label(frame: wire.Frame, flagged: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Points without a label: those that say so, and those that are not among the markers with a number.

    Motive's list of other markers has held labelled ones too, depending on its version.
    """
    loose = frame.labelled["point"][flagged]
    if not len(frame.others):
        return loose
    known = set(map(tuple, frame.labelled["point"].tolist()))
    others = [point for point in frame.others.tolist() if tuple(point) not in known]
    return np.concatenate([loose, np.array(others, np.float32).reshape(-1, 3)])


def _connect(address: Address) -> NatNetLink:
    options = address.options
    data_port, y_up = int(options.get("data_port", DATA_PORT)), options.get("up", "y") == "y"
    return connect_natnet(address.host, address.port, data_port, options.get("multicast"), y_up, options=options)


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
)
"""Addresses of Motive."""
