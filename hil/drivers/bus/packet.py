"""Packets of Dynamixel Protocol 2.0 in bytes: pure, and shared by clients and the emulated servos.

A packet on the wire: ``FF FF FD 00 ID LEN_L LEN_H INST PARAM… CRC_L CRC_H``. LEN counts what follows it. Wherever
``FF FF FD`` appears in INST…PARAM an ``FD`` is put after it, so that a header can only be a header. Source: the maker's
manual, https://emanual.robotis.com/docs/en/dxl/protocol2/
"""

from __future__ import annotations

import struct
from array import array
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


@dataclass(frozen=True)
class Packet:
    """One packet without header, stuffing and CRC; ``parameters`` of a status packet begin with its error byte."""

    id: int
    instruction: int
    parameters: bytes = b""


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
    head = HEADER + bytes((servo,)) + u16(length) + body
    return head + u16(crc16(head))


def u16(value: int) -> bytes:
    """A number of 16 bits as it goes on the wire, little-endian."""
    return value.to_bytes(2, "little")
