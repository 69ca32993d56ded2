"""Finds the packets of Protocol 2.0 in a stream of bytes that may hold anything: no sockets, no clocks."""

from __future__ import annotations

from dataclasses import dataclass

from highfive.hil.drivers.bus.packet import (
    BEFORE_BODY,
    BROADCAST,
    HEADER,
    LAST_ID,
    LONGEST,
    Instruction,
    Packet,
    crc16,
    unstuff,
)


@dataclass(frozen=True)
class Damaged:
    """What began like a packet and was none: cut short by the next one, or of wrong CRC. What it says may be wrong."""

    id: int
    instruction: int
    cut: bool
    """It ended too early; otherwise all of it came, and its CRC is wrong."""


class Decoder:
    """Finds packets in what comes in, in pieces of any size, and finds back after noise.

    A length is never trusted: one that no packet has is noise, and a header within what should be a packet's body says
    that the packet was cut. So what is kept is never more than one packet, and one damaged packet never hides the next.
    How the bytes are cut into pieces makes no difference.
    """

    def __init__(self) -> None:
        """Nothing has come in yet."""
        self._buffer = bytearray()
        self.skipped = 0
        """Bytes that belonged to no packet, so far."""

    @property
    def pending(self) -> int:
        """Bytes that wait for the rest of their packet."""
        return len(self._buffer)

    def feed(self, data: bytes) -> list[Packet | Damaged]:
        """What has become complete with these bytes. The reply to a fast read keeps its CRCs in its parameters."""
        self._buffer += data
        found: list[Packet | Damaged] = []
        while self._aligned() and (one := self._first()) is not None:
            found.append(one)
        return found

    def idle(self) -> list[Packet | Damaged]:
        """Nothing has come for long: what was half there will not become complete. What that hid is found."""
        found: list[Packet | Damaged] = []
        while self._buffer.startswith(HEADER):
            if len(self._buffer) > BEFORE_BODY:
                found.append(Damaged(self._buffer[4], self._buffer[7], cut=True))
            self._drop(len(HEADER))
            found += self.feed(b"")
        self._drop(len(self._buffer))
        return found

    def _aligned(self) -> bool:
        """Whether the buffer now begins with what could be a packet, known to its instruction; drops what could not."""
        buffer = self._buffer
        while True:
            start = buffer.find(HEADER)
            self._drop(start if start >= 0 else max(0, len(buffer) - len(HEADER) + 1))
            if start < 0 or len(buffer) <= BEFORE_BODY:
                return False
            if (buffer[4] <= LAST_ID or buffer[4] == BROADCAST) and 3 <= self._length() <= LONGEST:
                return True
            self._drop(len(HEADER))

    def _length(self) -> int:
        return self._buffer[5] | self._buffer[6] << 8

    def _first(self) -> Packet | Damaged | None:
        """What the aligned buffer begins with; None where more bytes are needed to tell."""
        buffer, end = self._buffer, BEFORE_BODY + self._length()
        servo, instruction = buffer[4], buffer[7]
        fast = servo == BROADCAST and instruction == Instruction.STATUS
        cut = not fast and buffer.find(HEADER, 1, end - 2) >= 0
        if not cut and len(buffer) < end:
            return None
        if cut or crc16(buffer[: end - 2]) != buffer[end - 2] | buffer[end - 1] << 8:
            self._drop(len(HEADER))
            return Damaged(servo, instruction, cut)
        body = bytes(buffer[BEFORE_BODY : end - 2])
        del buffer[:end]
        body = body if fast else unstuff(body)
        return Packet(servo, instruction, body[1:])

    def _drop(self, count: int) -> None:
        self.skipped += count
        del self._buffer[:count]
