"""A half-duplex bus with emulated servos, in time: what a host's bytes bring about and when the replies have come.

Nothing here reads a clock: times are ns since the bus began. A byte takes ten bits at the host's baud rate. The line
has one speaker at a time; who speaks into another's packet spoils both.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from highfive.hil.drivers.bus.instruction_packets import read_targets, write_targets
from highfive.hil.drivers.bus.packet import BROADCAST, Instruction, Packet, PacketError
from highfive.hil.drivers.bus.packet_decoder import Damaged, Decoder
from highfive.hil.drivers.bus.status_packets import FastStatus, status
from highfive.hil.drivers.emulator.bus_faults import BusFault
from highfive.hil.drivers.emulator.emulated_servo import EmulatedServo
from highfive.hil.drivers.emulator.servo_instructions import FOLLOWED, RESET_ALL, TO_ALL, level, obey
from highfive.hil.drivers.emulator.simple_plant import SimplePlant
from highfive.hil.drivers.servo_errors import ALERT, OVERLOAD, Error
from highfive.hil.drivers.values import Array, Plant

TURNAROUND_NS = 50_000
"""A servo begins to reply so long after the instruction, with a return delay of 0 (an assumption)."""

STEP_NS = 1_000_000
"""Servos and their body are stepped so often."""

LONGEST_CATCH_UP_NS = 1_000_000_000
"""What is missed beyond this, because nobody called, is left out."""

SILENCE_NS = 20_000_000
"""After so long without a byte half a packet is forgotten."""

_READS = {Instruction.SYNC_READ, Instruction.BULK_READ}
_FAST = {Instruction.FAST_SYNC_READ, Instruction.FAST_BULK_READ}
_WRITES = {Instruction.SYNC_WRITE, Instruction.BULK_WRITE}
_NAMES = {int(one): one.name.lower() for one in Instruction}


@dataclass(frozen=True)
class Piece:
    """Bytes to the host, the last of which is through at ``time_ns``."""

    time_ns: int
    data: bytes


@dataclass
class BusCounts:
    """What has happened so far."""

    instructions: dict[str, int] = field(default_factory=dict)
    """Instructions that arrived whole, by name."""
    damaged: int = 0
    """Instructions that did not."""
    errors: int = 0
    """Replies that said an error."""
    collisions: int = 0
    """Instructions that came while servos were speaking."""


class EmulatedBus:
    """Servos on one line, the body that they move, and what goes wrong.

    Attributes:
        servos: all of them.
        counts: what has happened.
        pending: what is still to go to the host, in time's order.
    """

    def __init__(
        self,
        servos: Sequence[EmulatedServo],
        joints: Sequence[int] | None = None,
        plant: Plant | None = None,
        *,
        paced: bool = True,
        seed: int = 0,
    ) -> None:
        """A bus that has just been switched on.

        Args:
            servos: in any order.
            joints: for each of them the joint that it drives; without, each has one of its own.
            plant: what moves; without, an inertia a joint. A step of 0 s tells where it begins.
            paced: bytes take their time; otherwise none.
            seed: of what is random in faults.
        """
        self.servos = list(servos)
        self._joints = list(range(len(self.servos))) if joints is None else list(joints)
        count = max(self._joints) + 1
        self._plant = plant or SimplePlant(count)
        self._paced = paced
        self._rng = np.random.default_rng(seed)
        self.counts = BusCounts()
        self.pending: list[Piece] = []
        self._faults: list[BusFault] = []
        self._begun: set[tuple[BusFault, int]] = set()
        self._ids: list[int] = []  # of who heard the last instruction
        self._troubled = self._halved = False
        self._decoder = Decoder()
        self._time = self._line_free = self._last_byte = 0
        self._positions, self._velocities = self._plant.step(np.zeros(count), 0.0)
        for servo, joint in zip(self.servos, self._joints, strict=True):
            servo.place(float(self._positions[joint]))

    @property
    def faults(self) -> tuple[BusFault, ...]:
        """What goes wrong, with times that count from the bus's beginning."""
        return tuple(self._faults)

    @property
    def ids(self) -> set[int]:
        """Of the servos, as they are now."""
        return {servo.id for servo in self.servos}

    def set_faults(self, faults: Iterable[BusFault], now_ns: int = 0) -> None:
        """From now on only these, and their times count from now."""
        self._faults = [fault.after(now_ns * 1e-9) for fault in faults]

    def add_faults(self, faults: Iterable[BusFault], now_ns: int) -> None:
        """These, too; their times count from ``now_ns``."""
        self._faults += [fault.after(now_ns * 1e-9) for fault in faults]

    def unplugged(self, now_ns: int) -> bool:
        """Whether the cable is out."""
        return any(fault.kind == "unplug" and fault.on(now_ns * 1e-9) for fault in self._faults)

    @property
    def body(self) -> tuple[Array, Array]:
        """Where the joints really are and how fast they move: (J,) rad, (J,) rad/s."""
        return self._positions, self._velocities

    @property
    def watchdog_trips(self) -> int:
        """How often a servo's watchdog has stopped it."""
        return sum(servo.watchdog_trips for servo in self.servos)

    def receive(self, data: bytes, now_ns: int, baud: int | None = None) -> None:
        """Bytes of the host, whose first one goes on the line now; ``baud`` is the host's, None for the servos' own.

        What the servos reply is in :attr:`pending` afterwards.
        """
        byte_ns = self._byte_ns(baud)
        start = max(now_ns, self._line_free)
        end = self._line_free = start + len(data) * byte_ns
        if start - self._last_byte > SILENCE_NS:
            self._take(self._decoder.idle(), start, baud)
        self._last_byte = end
        spoilt = self._spoken_into(start)
        if self._on("echo", start * 1e-9):
            self._send(Piece(end, data))
        if spoilt:
            self._decoder.idle()
        else:
            self._take(self._decoder.feed(data), end, baud)

    def advance(self, now_ns: int) -> None:
        """Lets the servos and their body move until now."""
        if now_ns - self._time > LONGEST_CATCH_UP_NS:
            self._time = now_ns - LONGEST_CATCH_UP_NS
        while self._time + STEP_NS <= now_ns:
            self._happen(self._time)
            positions, velocities = self._positions.tolist(), self._velocities.tolist()
            torques = [0.0] * len(positions)
            for servo, joint in zip(self.servos, self._joints, strict=True):
                torques[joint] += servo.step(positions[joint], velocities[joint], self._time, STEP_NS * 1e-9)
            self._positions, self._velocities = self._plant.step(np.array(torques), STEP_NS * 1e-9)
            self._time += STEP_NS

    def due(self, now_ns: int) -> list[Piece]:
        """What has come through to the host by now."""
        ready: list[Piece] = []
        while self.pending and self.pending[0].time_ns <= now_ns:
            ready.append(self.pending.pop(0))
        return ready

    # The line.

    def _byte_ns(self, baud: int | None) -> int:
        return 10_000_000_000 // (baud or self.servos[0].baud_rate) if self._paced else 0

    def _spoken_into(self, start: int) -> bool:
        """Whether servos were still to speak when the host began; what was left of their words is spoilt."""
        left = [piece for piece in self.pending if piece.time_ns > start]
        if not self._paced or not left:
            return False
        self.counts.collisions += 1
        said = [piece for piece in self.pending if piece.time_ns <= start]
        self.pending = said + [Piece(piece.time_ns, garbled(piece.data)) for piece in left]
        return True

    def _send(self, piece: Piece) -> None:
        self.pending.append(piece)
        self.pending.sort(key=lambda piece: piece.time_ns)

    def _take(self, found: list[Packet | Damaged], time: int, baud: int | None) -> None:
        """What has been heard, whole or not."""
        byte_ns = self._byte_ns(baud)
        for one in found:
            self.advance(time)
            hearing = [servo for servo in self.servos if self._hears(servo, time, baud)]
            self._ids = [servo.id for servo in hearing]
            if isinstance(one, Packet):
                self._count(one)
                if one.instruction != Instruction.STATUS:
                    named = addressed(one)
                    for servo in hearing:
                        if named is None or servo.id in named:
                            servo.heard(time)
                    self._carry_out(one, hearing, time, byte_ns)
            else:
                self.counts.damaged += 1
                for servo in hearing:
                    if servo.id == one.id and not one.cut and servo.values["status_return_level"] == 2:
                        self._speak(servo, one.id, self._status(servo, one.id, Error.CRC, b""), time, byte_ns)

    def _hears(self, servo: EmulatedServo, time: int, baud: int | None) -> bool:
        same = baud is None or abs(baud - servo.baud_rate) <= 0.03 * servo.baud_rate
        return same and servo.listening(time) and not (self._faults and self._on("dead", time * 1e-9, servo.id))

    def _count(self, packet: Packet) -> None:
        name = _NAMES.get(packet.instruction) or f"0x{packet.instruction:02x}"
        self.counts.instructions[name] = self.counts.instructions.get(name, 0) + 1

    # Instructions.

    def _carry_out(self, packet: Packet, hearing: list[EmulatedServo], time: int, byte_ns: int) -> None:
        try:
            if packet.instruction in _READS | _FAST:
                self._read_several(packet, hearing, time, byte_ns)
            elif packet.instruction in _WRITES:
                given = {target.id: target for target in write_targets(packet)}
                for servo in hearing:
                    own = servo.id
                    for target in (given.get(own), given.get(servo.shadow_id) if servo.shadow_id is not None else None):
                        if target:
                            servo.write(target.address, target.data, time, shadow=target.id != own)
            elif packet.id == BROADCAST:
                self._tell_all(packet, hearing, time, byte_ns)
            else:
                self._tell_one(packet, hearing, time, byte_ns)
        except PacketError:
            self.counts.errors += 1  # it went to several, and nobody replies to that

    def _tell_one(self, packet: Packet, hearing: list[EmulatedServo], time: int, byte_ns: int) -> None:
        for servo in [servo for servo in hearing if servo.id == packet.id]:  # the action itself may change an ID
            speaks = servo.values["status_return_level"] >= level(packet.instruction)
            error, data = obey(servo, packet, time)
            if speaks:
                self._speak(servo, packet.id, self._status(servo, packet.id, error, data), time, byte_ns)
        if packet.instruction in FOLLOWED:
            for servo in hearing:
                if servo.shadow_id == packet.id:
                    obey(servo, packet, time, shadow=True)

    def _tell_all(self, packet: Packet, hearing: list[EmulatedServo], time: int, byte_ns: int) -> None:
        if packet.instruction == Instruction.PING:
            end = time
            for servo in sorted(hearing, key=lambda servo: servo.id):
                end = self._speak(
                    servo, servo.id, self._status(servo, servo.id, *obey(servo, packet, time)), end, byte_ns
                )
        elif packet.instruction in TO_ALL and packet.parameters != bytes((RESET_ALL,)):
            for servo in hearing:
                obey(servo, packet, time)

    def _read_several(self, packet: Packet, hearing: list[EmulatedServo], time: int, byte_ns: int) -> None:
        """Each replies when it has heard the one before it, so where one is silent, so are all after it."""
        targets = read_targets(packet)
        fast = packet.instruction in _FAST
        together = FastStatus([target.length for target in targets]) if fast else None
        first, end = True, time
        for target in targets:
            servo = next((servo for servo in hearing if servo.id == target.id), None)
            if servo is None or servo.values["status_return_level"] < 1:
                return
            error, data = servo.read(target.address, target.length)
            if together is None:
                said = self._status(servo, servo.id, error, data)
            else:
                said = together.part(servo.id, self._error_byte(servo, error), data or bytes(target.length))
            end = self._speak(servo, servo.id, said, end, byte_ns, seamless=fast and not first)
            first = False
            if self._halved:
                return

    # Replies.

    def _status(self, servo: EmulatedServo, identity: int, error: Error, data: bytes) -> bytes:
        return status(identity, self._error_byte(servo, error), data)

    def _error_byte(self, servo: EmulatedServo, error: Error) -> int:
        self.counts.errors += bool(error)
        return error | (ALERT if servo.alert else 0)

    def _speak(
        self, servo: EmulatedServo, identity: int, data: bytes, after: int, byte_ns: int, *, seamless: bool = False
    ) -> int:
        """A servo says something, as soon as it may, with all that goes wrong; gives the time when it is through."""
        start = after if seamless or not byte_ns else after + TURNAROUND_NS + servo.return_delay_ns
        if self._ids.count(identity) > 1:
            data = garbled(data)
        self._halved = False
        if self._faults:
            data, start = self._spoil(data, start, identity)
        end = start + len(data) * byte_ns
        self._send(Piece(end, data))
        return end

    def _spoil(self, data: bytes, start: int, identity: int) -> tuple[bytes, int]:
        """A servo's words with what goes wrong on the line, and when they begin."""
        now = start * 1e-9
        start += sum(round(fault.amount * 1e6) for fault in self._on("late", now, identity))
        if self._on("twice", now, identity):
            data = garbled(data)
        if self._chance("crc", now, identity):
            data = data[:-3] + bytes((data[-3] ^ 0x01,)) + data[-2:]
        self._halved = self._chance("half", now, identity)
        if self._halved:
            data = data[: len(data) // 2]
        if self._chance("noise", now, identity):
            data = self._rng.integers(0, 256, size=self._rng.integers(1, 9), dtype=np.uint8).tobytes() + data
        return data, start

    def _on(self, kind: str, now: float, servo: int | None = None) -> list[BusFault]:
        return [fault for fault in self._faults if fault.kind == kind and fault.on(now, servo)]

    def _chance(self, kind: str, now: float, servo: int) -> bool:
        return any(self._rng.random() < fault.amount for fault in self._on(kind, now, servo))

    # What happens to servos.

    def _happen(self, time: int) -> None:
        """Faults that are not of the line: overload, heat, slips, voltage."""
        if not self._faults and not self._troubled:
            return
        now = time * 1e-9
        for servo in self.servos:
            for fault in self._on("overload", now, servo.id):
                if (fault, servo.id) not in self._begun:
                    self._begun.add((fault, servo.id))
                    servo.fail(OVERLOAD)
            heat = self._on("hot", now, servo.id)
            limit = servo.values["temperature_limit"] + 5.0
            servo.hot = (limit if math.isnan(heat[0].amount) else heat[0].amount) if heat else None
            servo.slip = math.radians(sum(fault.amount for fault in self._on("slip", now, servo.id)))
            dim = self._on("brownout", now, servo.id)
            volts = dim[0].amount if dim else servo.table.motor.voltage
            if volts != servo.voltage:
                servo.power(volts, time)
        self._troubled = bool(self._faults)


def addressed(packet: Packet) -> set[int] | None:
    """IDs of the servos that an instruction names; None for all of them.

    The manual says that all instruction packets count for the watchdog, not whether those to others do. A host is held
    to the less: here only those that name a servo keep its watchdog quiet.
    """
    try:
        if packet.instruction in _READS | _FAST:
            return {target.id for target in read_targets(packet)}
        if packet.instruction in _WRITES:
            return {target.id for target in write_targets(packet)}
    except PacketError:
        return set()
    return None if packet.id == BROADCAST else {packet.id}


def garbled(data: bytes) -> bytes:
    """What two servos make of the same words, half a bit apart: the line is low where one of them pulls it low."""
    return bytes(byte & (byte << 1 | 1) & 0xFF for byte in data)
