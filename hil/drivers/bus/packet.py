"""Dynamixel Protocol 2.0 in bytes, both ways: pure, and shared by clients and the emulated servos.

A packet on the wire: ``FF FF FD 00 ID LEN_L LEN_H INST PARAM… CRC_L CRC_H``. LEN counts what follows it. Wherever
``FF FF FD`` appears in INST…PARAM an ``FD`` is put after it, so that a header can only be a header. The reply to a fast
read is one status packet from many servos, and has none of that stuffing. Source: the maker's manual,
https://emanual.robotis.com/docs/en/dxl/protocol2/
"""

from __future__ import annotations

import struct
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from highfive.model.errors import HighFiveError

HEADER = b"\xff\xff\xfd\x00"

BROADCAST = 0xFE
"""ID that every servo listens to."""

LAST_ID = 252
"""Largest ID that a servo can have."""

LONGEST = 1024
"""Largest LEN that is taken, as in the maker's SDK; what claims more is noise."""

CLEAR_POSITION = b"\x01\x44\x58\x4c\x22"
"""Parameters of the clear instruction: forget the turns that were counted."""

BEFORE_BODY = 7
"""Bytes of header, ID and LEN."""

_PATTERN, _STUFFED = b"\xff\xff\xfd", b"\xff\xff\xfd\xfd"


class PacketError(HighFiveError):
    """Bytes or parameters that are no packet of this protocol."""


class Instruction(IntEnum):
    """What a packet asks for."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    """Write later, when the action comes."""
    ACTION = 0x05
    FACTORY_RESET = 0x06
    REBOOT = 0x08
    CLEAR = 0x10
    CONTROL_TABLE_BACKUP = 0x20
    STATUS = 0x55
    """A servo's reply."""
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    FAST_SYNC_READ = 0x8A
    BULK_READ = 0x92
    BULK_WRITE = 0x93
    FAST_BULK_READ = 0x9A


class Error(IntEnum):
    """Why a servo did not do what it was asked: bits 0 to 6 of a status packet's error byte."""

    NONE = 0
    RESULT_FAIL = 1
    """It could not be done."""
    INSTRUCTION = 2
    """There is no such instruction, or an action without a reg write."""
    CRC = 3
    """The packet arrived damaged."""
    DATA_RANGE = 4
    """The value is outside what the register takes."""
    DATA_LENGTH = 5
    """Fewer bytes than the register has."""
    DATA_LIMIT = 6
    """The value is outside the limit that another register sets."""
    ACCESS = 7
    """Read only, not there, or EEPROM while torque is on."""


ALERT = 0x80
"""Bit of the error byte: the servo's hardware error status is not 0."""


@dataclass(frozen=True)
class Packet:
    """One packet without header, stuffing and CRC; ``parameters`` of a status packet begin with its error byte."""

    id: int
    instruction: int
    parameters: bytes = b""


@dataclass(frozen=True)
class Status:
    """A servo's reply: ``error`` is one of :class:`Error`; ``alert`` says that it reports a hardware error."""

    id: int
    error: int
    alert: bool
    data: bytes


@dataclass(frozen=True)
class ReadTarget:
    """``length`` bytes from ``address`` are wanted of servo ``id``."""

    id: int
    address: int
    length: int


@dataclass(frozen=True)
class WriteTarget:
    """``data`` is for servo ``id``, from ``address``."""

    id: int
    address: int
    data: bytes


def _crc_tables() -> tuple[array[int], array[int]]:
    """CRC-16 of every byte and of every two: polynomial 0x8005, most significant bit first."""
    crc = np.arange(256, dtype=np.uint32) << 8
    for _ in range(8):
        crc = ((crc << 1) ^ np.where(crc & 0x8000, 0x8005, 0)) & 0xFFFF
    two = np.arange(65_536, dtype=np.uint32)
    for _ in range(2):
        two = ((two << 8) & 0xFF00) ^ crc[two >> 8]
    return array("H", crc.astype(np.uint16).tobytes()), array("H", two.astype(np.uint16).tobytes())


_CRC_BYTE, _CRC_WORD = _crc_tables()


def crc16(data: bytes | bytearray, crc: int = 0) -> int:
    """The protocol's CRC of ``data``, going on from ``crc``. Two bytes at a time: it is most of an emulator's work."""
    table = _CRC_WORD
    for word in struct.unpack_from(f">{len(data) // 2}H", data):
        crc = table[crc ^ word]
    if len(data) % 2:
        crc = ((crc << 8) & 0xFF00) ^ _CRC_BYTE[(crc >> 8) ^ data[-1]]
    return crc


def stuff(body: bytes) -> bytes:
    """INST…PARAM as they go on the wire."""
    return body.replace(_PATTERN, _STUFFED)


def unstuff(body: bytes) -> bytes:
    """The inverse of :func:`stuff`."""
    return body.replace(_STUFFED, _PATTERN)


def encode(packet: Packet) -> bytes:
    """A packet as bytes on the wire.

    Raises:
        PacketError: the ID is none, or there are more parameters than a packet holds.
    """
    if not (0 <= packet.id <= LAST_ID or packet.id == BROADCAST):
        raise PacketError(f"{packet.id} is no servo ID; expected 0 to {LAST_ID}, or {BROADCAST} for all")
    return _framed(packet.id, stuff(bytes((packet.instruction,)) + packet.parameters))


def _framed(servo: int, body: bytes) -> bytes:
    length = len(body) + 2
    if length > LONGEST:
        raise PacketError(f"a packet of {length} bytes is too long; at most {LONGEST}: ask fewer servos at once")
    head = HEADER + bytes((servo,)) + _word(length) + body
    return head + _word(crc16(head))


def _word(value: int) -> bytes:
    return value.to_bytes(2, "little")


# What a client sends.


def ping(servo: int = BROADCAST) -> bytes:
    """Who is there? To all, every servo replies, one after another."""
    return encode(Packet(servo, Instruction.PING))


def read(servo: int, address: int, length: int) -> bytes:
    """``length`` bytes from ``address`` of one servo."""
    return encode(Packet(servo, Instruction.READ, _word(address) + _word(length)))


def write(servo: int, address: int, data: bytes) -> bytes:
    """``data`` to ``address`` of one servo, or of all."""
    return encode(Packet(servo, Instruction.WRITE, _word(address) + data))


def reg_write(servo: int, address: int, data: bytes) -> bytes:
    """As :func:`write`, but carried out when :func:`action` comes."""
    return encode(Packet(servo, Instruction.REG_WRITE, _word(address) + data))


def action(servo: int = BROADCAST) -> bytes:
    """Carry out the reg write."""
    return encode(Packet(servo, Instruction.ACTION))


def factory_reset(servo: int, option: int) -> bytes:
    """Back to the factory's values: 0xFF all, 1 all but the ID, 2 all but ID and baud rate."""
    return encode(Packet(servo, Instruction.FACTORY_RESET, bytes((option,))))


def reboot(servo: int) -> bytes:
    """Start again."""
    return encode(Packet(servo, Instruction.REBOOT))


def clear(servo: int) -> bytes:
    """Forget the turns that were counted; only while it stands."""
    return encode(Packet(servo, Instruction.CLEAR, CLEAR_POSITION))


def sync_read(address: int, length: int, servos: Sequence[int], *, fast: bool = False) -> bytes:
    """The same bytes of several servos, who reply in this order; ``fast``: in one packet together."""
    instruction = Instruction.FAST_SYNC_READ if fast else Instruction.SYNC_READ
    return encode(Packet(BROADCAST, instruction, _word(address) + _word(length) + bytes(servos)))


def sync_write(address: int, data: Mapping[int, bytes]) -> bytes:
    """To the same address of several servos, as many bytes each; by ID. Nobody replies.

    Raises:
        PacketError: not as many bytes each.
    """
    lengths = {len(own) for own in data.values()}
    if len(lengths) != 1:
        raise PacketError(f"a sync write has as many bytes for every servo; got {sorted(lengths) or 'none'}")
    body = b"".join(bytes((servo,)) + own for servo, own in data.items())
    return encode(Packet(BROADCAST, Instruction.SYNC_WRITE, _word(address) + _word(lengths.pop()) + body))


def bulk_read(targets: Sequence[ReadTarget], *, fast: bool = False) -> bytes:
    """Different bytes of several servos, who reply in this order; ``fast``: in one packet together."""
    instruction = Instruction.FAST_BULK_READ if fast else Instruction.BULK_READ
    body = b"".join(bytes((t.id,)) + _word(t.address) + _word(t.length) for t in targets)
    return encode(Packet(BROADCAST, instruction, body))


def bulk_write(targets: Sequence[WriteTarget]) -> bytes:
    """Different bytes to several servos. Nobody replies."""
    body = b"".join(bytes((t.id,)) + _word(t.address) + _word(len(t.data)) + t.data for t in targets)
    return encode(Packet(BROADCAST, Instruction.BULK_WRITE, body))


# What a servo makes of it.


def read_targets(packet: Packet) -> tuple[ReadTarget, ...]:
    """What is wanted by a read, a sync read, a bulk read or a fast one, in the order of the replies.

    Raises:
        PacketError: the parameters do not fit the instruction.
    """
    parameters = packet.parameters
    match packet.instruction:
        case Instruction.READ if len(parameters) == 4:
            return (ReadTarget(packet.id, _word_at(parameters, 0), _word_at(parameters, 2)),)
        case Instruction.SYNC_READ | Instruction.FAST_SYNC_READ if len(parameters) > 4:
            address, length = _word_at(parameters, 0), _word_at(parameters, 2)
            targets = tuple(ReadTarget(servo, address, length) for servo in parameters[4:])
        case Instruction.BULK_READ | Instruction.FAST_BULK_READ if parameters and len(parameters) % 5 == 0:
            rows = [parameters[n : n + 5] for n in range(0, len(parameters), 5)]
            targets = tuple(ReadTarget(row[0], _word_at(row, 1), _word_at(row, 3)) for row in rows)
        case _:
            raise PacketError(f"{len(parameters)} parameters do not fit instruction 0x{packet.instruction:02X}")
    _each_once(target.id for target in targets)
    return targets


def write_targets(packet: Packet) -> tuple[WriteTarget, ...]:
    """What is to be written by a write, a reg write, a sync write or a bulk write.

    Raises:
        PacketError: the parameters do not fit the instruction.
    """
    parameters = packet.parameters
    match packet.instruction:
        case Instruction.WRITE | Instruction.REG_WRITE if len(parameters) > 2:
            return (WriteTarget(packet.id, _word_at(parameters, 0), parameters[2:]),)
        case Instruction.SYNC_WRITE if len(parameters) > 4:
            address, length = _word_at(parameters, 0), _word_at(parameters, 2)
            rows = [parameters[n : n + 1 + length] for n in range(4, len(parameters), 1 + length)]
            if not length or len(rows[-1]) != 1 + length:
                raise PacketError("a sync write ends in the middle of a servo's data")
            targets = tuple(WriteTarget(row[0], address, row[1:]) for row in rows)
        case Instruction.BULK_WRITE if parameters:
            targets = tuple(_bulk_rows(parameters))
        case _:
            raise PacketError(f"{len(parameters)} parameters do not fit instruction 0x{packet.instruction:02X}")
    _each_once(target.id for target in targets)
    return targets


def _word_at(data: bytes, start: int) -> int:
    return int.from_bytes(data[start : start + 2], "little")


def _bulk_rows(parameters: bytes) -> Iterator[WriteTarget]:
    start = 0
    while start < len(parameters):
        address, length = _word_at(parameters, start + 1), _word_at(parameters, start + 3)
        data = parameters[start + 5 : start + 5 + length]
        if not length or len(data) < length:
            raise PacketError("a bulk write ends in the middle of a servo's data")
        yield WriteTarget(parameters[start], address, data)
        start += 5 + length


def _each_once(servos: Iterable[int]) -> None:
    named = list(servos)
    if len(set(named)) < len(named):
        raise PacketError("a servo is named twice; each may be named once")


# Replies.


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
        self._head = HEADER + bytes((BROADCAST,)) + _word(total) + bytes((Instruction.STATUS,))
        self._crc = 0

    def part(self, servo: int, error: int, data: bytes) -> bytes:
        """What the next servo sends."""
        said = self._head + bytes((error, servo)) + data
        crc = _word(crc16(said, self._crc))
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
        if len(raw) < end + 2 or raw[end : end + 2] != _word(crc):
            break
        replies.append(_status(raw[start + 1], raw[start], raw[start + 2 : end]))
        crc = crc16(raw[end : end + 2], crc)
        start = end + 2
    return replies


def _status(servo: int, error: int, data: bytes) -> Status:
    return Status(servo, error & ~ALERT, bool(error & ALERT), data)
