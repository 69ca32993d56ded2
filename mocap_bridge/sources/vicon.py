"""A Vicon system (Nexus, Tracker, Shogun) followed over its DataStream."""

from __future__ import annotations

import selectors
import socket
import time
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.scheduler import THREADS, Now, in_seconds
from highfive.mocap_bridge.sources.scheme import Address, Scheme
from highfive.mocap_bridge.wire import vicon as wire
from highfive.mocap_bridge.wire.errors import LinkError
from highfive.mocap_bridge.wire.plausible import plausible, plausible_only
from highfive.mocap_bridge.wire.vicon import Kind, Packet, Subject
from highfive.model.geometry.rotations import Array

REQUESTED = frozenset(
    {
        Kind.CONTENTS,
        Kind.STREAM_INFO,
        Kind.SUBJECT_INFO,
        Kind.APPLICATION_INFO,
        Kind.FRAME_INFO,
        Kind.LABELED_RECONS,
        Kind.UNLABELED_RECONS,
        Kind.LATENCY_INFO,
        Kind.FRAME_RATE_INFO,
    }
)
"""What is requested, as far as the system offers it."""

_CHUNK = 1 << 18  # bytes taken from the socket at once
_DRAINED = wire.LONGEST  # bytes taken by one call, so that a sender without end cannot hold it
_REPEATED_S = 1e-3  # pause before the next request where a system answers with the frame that it sent before
_SMOOTHING = 0.01  # share of a frame in the latency that is taken off


def connect_vicon(
    host: str, port: int = wire.PORT, pull: bool = False, timeout_s: float = 2.0, now: Now = THREADS.now
) -> ViconLink:
    """Connects to a Vicon system.

    Args:
        host: name or address.
        port: 801 unless the system says otherwise.
        pull: ask for each frame by itself, where the system cannot push.
        timeout_s: for the connection and the greeting together, s.
        now: monotonic clock, ns.

    Raises:
        LinkError: nothing listens there, or what listens is no DataStream.
    """
    where, deadline = f"{host}:{port}", in_seconds(now)() + timeout_s
    try:
        connection = socket.create_connection((host, port), timeout_s)
    except TimeoutError:
        raise LinkError(f"{where} did not answer within {timeout_s:g} s; is it on, and in this network?") from None
    except (UnicodeError, OverflowError) as error:
        raise LinkError(f"{where} is no address ({error})") from None
    except OSError as error:
        raise LinkError(
            f"nothing listens at {where} ({error.strerror or error}); switch the DataStream on or correct the address"
        ) from None
    return ViconLink(connection, where, pull, deadline, now)


class ViconLink:
    """One connection to a Vicon system (see :class:`highfive.mocap_bridge.sources.live.Link`)."""

    def __init__(self, connection: socket.socket, where: str, pull: bool, deadline: float, now: Now = THREADS.now):
        """Takes the greeting and says what is requested.

        Args:
            connection: an open TCP connection.
            where: its other end, for messages.
            pull: ask for each frame by itself.
            deadline: when the greeting must have come, s of the clock.
            now: monotonic clock, ns.
        """
        self._now = now
        self._socket, self._where, self._pull = connection, where, pull
        self._buffer = bytearray()
        self._requested = False
        self._rate_hz, self._period_ns, self._latency_ns = 0.0, 0.0, -1.0
        self._y_up = False
        self._subjects: tuple[Subject, ...] = ()
        self._names: tuple[str, ...] = ()
        self._keys, self._columns = np.zeros(0, dtype=np.uint64), np.zeros(0, dtype=np.intp)
        self._ids = b""  # of the last labelled points, and what was found for them
        self._found = np.zeros(0, dtype=np.intp), np.zeros(0, dtype=bool)
        self._last: Packet | None = None
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setblocking(False)
        self._selector = selectors.DefaultSelector()
        self._selector.register(connection, selectors.EVENT_READ)
        try:
            self._greet(deadline)
        except BaseException:
            self.close()
            raise

    @property
    def rate_hz(self) -> float:
        """Frames per second as the system says; 0 where it does not say."""
        return self._rate_hz

    def receive(self, timeout_s: float) -> Sequence[MarkerFrame]:
        """Frames that have come, oldest first, named ``Subject:Marker``; waits up to ``timeout_s`` for the first bytes.

        Raises:
            LinkError: the connection is lost, or what came is not of the protocol.
        """
        if self._pull and not self._requested:
            self._ask()
        if not self._fill(timeout_s):
            return ()
        frames: list[MarkerFrame] = []
        while (packet := self._packet()) is not None:
            if packet.number is None:
                self._learn(packet)
                continue
            repeated = self._last is not None and self._last.number == packet.number
            self._requested = False
            frames.append(self._frame(packet))
            if self._pull and repeated:
                time.sleep(min(_REPEATED_S, timeout_s))
        if self._pull and not self._requested:
            self._ask()
        return frames

    def close(self) -> None:
        """Lets go of the connection."""
        self._selector.close()
        self._socket.close()

    def _greet(self, deadline: float) -> None:
        offered = None
        while offered is None:
            left = deadline - in_seconds(self._now)()
            if left <= 0.0:
                raise LinkError(
                    f"{self._where} takes connections but says nothing; a DataStream speaks first: is the port right?"
                )
            self._fill(left)
            while offered is None and (packet := self._packet()) is not None:
                offered = packet.enums
        if Kind.LABELED_RECONS not in offered:
            raise LinkError(f"{self._where} offers no labelled markers; switch them on in its DataStream settings")
        self._send(wire.encode(Packet(enums=REQUESTED & offered)))
        if not self._pull:
            self._send(wire.encode(Packet(stream=True)))

    def _ask(self) -> None:
        self._send(wire.encode(Packet(stream=False)))
        self._requested = True

    def _send(self, message: bytes) -> None:
        try:
            sent = self._socket.send(message)
        except OSError as error:
            raise LinkError(f"{self._where} closed the connection ({error.strerror or error})") from None
        if sent < len(message):  # a few bytes, into an empty socket
            raise LinkError(f"{self._where} does not take what is sent to it")

    def _fill(self, timeout_s: float) -> bool:
        """Takes all that is there from the socket; whether anything came within ``timeout_s``."""
        if not self._selector.select(max(0.0, timeout_s)):
            return False
        taken = 0
        while taken < _DRAINED:
            try:
                chunk = self._socket.recv(_CHUNK)
            except BlockingIOError:
                break
            except OSError as error:
                raise LinkError(f"{self._where} broke the connection ({error.strerror or error})") from None
            if not chunk:
                if taken:  # what came before the end counts; the next call finds the end again
                    break
                raise LinkError(f"{self._where} closed the connection")
            self._buffer += chunk
            taken += len(chunk)
            if len(chunk) < _CHUNK:
                break
        return taken > 0

    def _packet(self) -> Packet | None:
        """What is in the next whole message; None where there is none yet."""
        buffer, start = self._buffer, wire.HEADER.size
        if len(buffer) < start:
            return None
        try:
            end = start + wire.body_length(buffer)
            if len(buffer) < end:
                return None
            body = bytes(memoryview(buffer)[start:end])
            del buffer[:end]
            return wire.decode(body)
        except wire.ViconWireError as error:
            raise LinkError(f"{self._where}: {error}") from None

    def _learn(self, packet: Packet) -> None:
        """Keeps what stays the same from frame to frame."""
        if rate := wire.rate_of(packet):
            if packet.period or not self._period_ns:
                self._rate_hz = rate
            self._period_ns = 1e9 / self._rate_hz
        if packet.y_up is not None:
            self._y_up = packet.y_up
        if packet.subjects and packet.subjects != self._subjects:
            self._subjects = packet.subjects
            markers = [(s.number, number, f"{s.name}:{name}") for s in packet.subjects for number, name in s.markers]
            self._names = tuple(name for _, _, name in markers)
            keys = np.array([subject << 32 | marker for subject, marker, _ in markers], dtype=np.uint64)
            self._columns = np.argsort(keys, kind="stable")
            self._keys, self._ids = keys[self._columns], b""

    def _frame(self, packet: Packet) -> MarkerFrame:
        """The frame of a message that has one."""
        self._learn(packet)
        if self._last is not None and packet.unchanged:
            if Kind.LABELED_RECONS in packet.unchanged and packet.labelled is None:
                packet.labelled = self._last.labelled
            if Kind.UNLABELED_RECONS in packet.unchanged and packet.unlabelled is None:
                packet.unlabelled = self._last.unlabelled
        self._last = packet
        positions, valid = np.zeros((len(self._names), 3)), np.zeros(len(self._names), dtype=bool)
        loose = np.zeros((0, 3)) if packet.unlabelled is None else packet.unlabelled
        if packet.labelled is not None and len(packet.labelled.ids):
            points = packet.labelled.points
            columns, known = self._find(packet.labelled.ids)
            if not known.all():  # of no subject that was announced: a point, but whose?
                loose = np.concatenate([loose, points[~known]])
                points, columns = points[known], columns[known]
            positions[columns], valid[columns] = points, True
        positions, valid, impossible = plausible(self._upright(positions), valid)
        arrival = self._now()
        return MarkerFrame(
            names=self._names,
            positions=positions,
            valid=valid,
            number=packet.number or 0,
            source_time_ns=self._source_time(packet, arrival),
            arrival_time_ns=arrival,
            unlabelled=plausible_only(self._upright(loose)),
            impossible=int(impossible),
            latency_ns=max(0, round(self._latency_ns)),
        )

    def _find(self, ids: NDArray[np.uint32]) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        """Columns (N,) of points by number of subject and marker (N, 2), and whether there is such a marker (N,)."""
        if not len(self._keys):
            return np.zeros(len(ids), dtype=np.intp), np.zeros(len(ids), dtype=bool)
        if (now := ids.tobytes()) != self._ids:  # the same markers are seen in most frames
            keys = ids[:, 0].astype(np.uint64) << np.uint64(32) | ids[:, 1]
            at = np.minimum(np.searchsorted(self._keys, keys), len(self._keys) - 1)
            self._ids, self._found = now, (self._columns[at], self._keys[at] == keys)
        return self._found

    def _upright(self, points: Array) -> Array:
        """Points (N, 3) with z up."""
        return points[:, [0, 2, 1]] * (1.0, -1.0, 1.0) if self._y_up else points

    def _source_time(self, packet: Packet, arrival: int) -> int:
        """When the cameras saw a frame, ns on a clock that starts with the system's frame 0."""
        latency = 1e9 * sum(seconds for _, seconds in packet.latencies)
        if 0.0 <= latency <= 1e10:
            # Stages take longer in one frame than in the next, but the cameras stay in step: taken off as it came,
            # the latency would make times, and with them speeds, jitter.
            before = latency if self._latency_ns < 0.0 else self._latency_ns
            self._latency_ns = before + _SMOOTHING * (latency - before)
        time_ns = (packet.number or 0) * self._period_ns if self._period_ns else arrival
        return round(time_ns - max(0.0, self._latency_ns))


def _connect(address: Address, now: Now = THREADS.now) -> ViconLink:
    return connect_vicon(address.host, address.port, pull=address.options.get("mode") == "pull", now=now)


SCHEME = Scheme(
    "vicon://192.168.10.1:801?mode=pull",
    _connect,
    port=wire.PORT,
    options={"mode": ("push", "pull")},
    timed=True,
)
"""Addresses of Vicon systems."""
