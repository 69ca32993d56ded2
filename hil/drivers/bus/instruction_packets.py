"""Instructions of Protocol 2.0: what a client sends, and what a servo makes of it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from highfive.hil.drivers.bus.packet import BROADCAST, Instruction, Packet, PacketError, encode, u16

CLEAR_POSITION = b"\x01\x44\x58\x4c\x22"
"""Parameters of the clear instruction: forget the turns that were counted."""


@dataclass(frozen=True)
class ReadTarget:
    """``length`` bytes from ``address`` are requested of servo ``id``."""

    id: int
    address: int
    length: int


@dataclass(frozen=True)
class WriteTarget:
    """``data`` is for servo ``id``, from ``address``."""

    id: int
    address: int
    data: bytes


# What a client sends.


def ping(servo: int = BROADCAST) -> bytes:
    """Who is there? To all, every servo replies, one after another."""
    return encode(Packet(servo, Instruction.PING))


def read(servo: int, address: int, length: int) -> bytes:
    """``length`` bytes from ``address`` of one servo."""
    return encode(Packet(servo, Instruction.READ, u16(address) + u16(length)))


def write(servo: int, address: int, data: bytes) -> bytes:
    """``data`` to ``address`` of one servo, or of all."""
    return encode(Packet(servo, Instruction.WRITE, u16(address) + data))


def reg_write(servo: int, address: int, data: bytes) -> bytes:
    """As :func:`write`, but carried out when :func:`action` comes."""
    return encode(Packet(servo, Instruction.REG_WRITE, u16(address) + data))


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
    return encode(Packet(BROADCAST, instruction, u16(address) + u16(length) + bytes(servos)))


def sync_write(address: int, data: Mapping[int, bytes]) -> bytes:
    """To the same address of several servos, as many bytes each; by ID. Nobody replies.

    Raises:
        PacketError: not as many bytes each.
    """
    lengths = {len(own) for own in data.values()}
    if len(lengths) != 1:
        raise PacketError(f"a sync write has as many bytes for every servo; got {sorted(lengths) or 'none'}")
    body = b"".join(bytes((servo,)) + own for servo, own in data.items())
    return encode(Packet(BROADCAST, Instruction.SYNC_WRITE, u16(address) + u16(lengths.pop()) + body))


def bulk_read(targets: Sequence[ReadTarget], *, fast: bool = False) -> bytes:
    """Different bytes of several servos, who reply in this order; ``fast``: in one packet together."""
    instruction = Instruction.FAST_BULK_READ if fast else Instruction.BULK_READ
    body = b"".join(bytes((t.id,)) + u16(t.address) + u16(t.length) for t in targets)
    return encode(Packet(BROADCAST, instruction, body))


def bulk_write(targets: Sequence[WriteTarget]) -> bytes:
    """Different bytes to several servos. Nobody replies."""
    body = b"".join(bytes((t.id,)) + u16(t.address) + u16(len(t.data)) + t.data for t in targets)
    return encode(Packet(BROADCAST, Instruction.BULK_WRITE, body))


# What a servo makes of it.


def read_targets(packet: Packet) -> tuple[ReadTarget, ...]:
    """What is requested by a read, a sync read, a bulk read or a fast one, in the order of the replies.

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
