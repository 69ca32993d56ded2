"""Replies of Protocol 2.0: what a servo sends, and what a client makes of it.

The reply to a fast read is one status packet from many servos; it is not stuffed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from highfive.hil.drivers.bus.packet import (
    BEFORE_BODY,
    BROADCAST,
    HEADER,
    LONGEST,
    Instruction,
    Packet,
    PacketError,
    crc16,
    encode,
    u16,
)
from highfive.hil.drivers.servo_errors import ALERT


@dataclass(frozen=True)
class Status:
    """A servo's reply: ``error`` is one of :class:`Error`; ``alert`` says that it reports a hardware error."""

    id: int
    error: int
    alert: bool
    data: bytes


def status(servo: int, error: int, data: bytes = b"") -> bytes:
    """A servo's reply; ``error`` is its whole error byte."""
    return encode(Packet(servo, Instruction.STATUS, bytes((error,)) + data))


class FastStatus:
    """The reply to a fast read while it grows, one part a servo.

    Every part ends in the CRC of all bytes from the header to there; the first one begins with the header, whose LEN
    counts the parts of all servos that were asked.
    """

    def __init__(self, lengths: Sequence[int]) -> None:
        """Nobody has replied yet; ``lengths`` are the bytes of data that each servo was asked for.

        Raises:
            PacketError: together they are too long for a packet.
        """
        total = 1 + sum(4 + length for length in lengths)
        if total > LONGEST:
            raise PacketError(f"a reply of {total} bytes is too long; at most {LONGEST}: ask fewer servos at once")
        self._head = HEADER + bytes((BROADCAST,)) + u16(total) + bytes((Instruction.STATUS,))
        self._crc = 0

    def part(self, servo: int, error: int, data: bytes) -> bytes:
        """What the next servo sends."""
        said = self._head + bytes((error, servo)) + data
        crc = u16(crc16(said, self._crc))
        self._crc = crc16(said + crc, self._crc)
        self._head = b""
        return said + crc


def decode_status(packet: Packet) -> Status:
    """A status packet as a servo's reply.

    Raises:
        PacketError: it is none.
    """
    if packet.instruction != Instruction.STATUS or not packet.parameters:
        raise PacketError(f"expected a servo's reply, got instruction 0x{packet.instruction:02X}")
    return _status(packet.id, packet.parameters[0], packet.parameters[1:])


def decode_fast_status(raw: bytes, lengths: Mapping[int, int]) -> list[Status]:
    """Replies to a fast read, from the header on, as far as they came whole: where a servo is dead, those before it.

    Args:
        raw: bytes from the wire, beginning with the header.
        lengths: bytes of data that were asked of each servo, by ID.

    Raises:
        PacketError: it does not begin as a reply to a fast read.
    """
    start = BEFORE_BODY + 1
    if len(raw) < start or not raw.startswith(HEADER) or raw[4] != BROADCAST or raw[7] != Instruction.STATUS:
        raise PacketError(f"expected the reply to a fast read, got {raw[:start].hex(' ') or 'nothing'}")
    replies: list[Status] = []
    crc = crc16(raw[:start])
    while len(raw) >= start + 2 and raw[start + 1] in lengths:
        end = start + 2 + lengths[raw[start + 1]]
        crc = crc16(raw[start:end], crc)
        if len(raw) < end + 2 or raw[end : end + 2] != u16(crc):
            break
        replies.append(_status(raw[start + 1], raw[start], raw[start + 2 : end]))
        crc = crc16(raw[end : end + 2], crc)
        start = end + 2
    return replies


def _status(servo: int, error: int, data: bytes) -> Status:
    return Status(servo, error & ~ALERT, bool(error & ALERT), data)
