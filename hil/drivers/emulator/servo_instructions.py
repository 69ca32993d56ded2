"""How a servo obeys the instructions of Protocol 2.0 that name it alone, or all servos at once. No bytes, no clock."""

from __future__ import annotations

from highfive.hil.drivers.bus.instruction_packets import CLEAR_POSITION, read_targets, write_targets
from highfive.hil.drivers.bus.packet import Instruction, Packet, PacketError
from highfive.hil.drivers.emulator.emulated_servo import EmulatedServo
from highfive.hil.drivers.servo_errors import Error

FOLLOWED = {Instruction.WRITE, Instruction.REG_WRITE, Instruction.ACTION}
"""Instructions that a servo obeys as well when they go to the ID that it shadows."""

TO_ALL = {*FOLLOWED, Instruction.REBOOT, Instruction.CLEAR, Instruction.FACTORY_RESET}
"""Instructions that may go to all servos at once, who then say nothing. A ping may as well, and all reply."""

RESET_ALL = 0xFF
"""Option of the factory reset that all servos at once do not take: they would all have one ID."""


def level(instruction: int) -> int:
    """Status return level from which on an instruction is replied to."""
    return {int(Instruction.PING): 0, int(Instruction.READ): 1}.get(instruction, 2)


def obey(servo: EmulatedServo, packet: Packet, now_ns: int, *, shadow: bool = False) -> tuple[Error, bytes]:
    """Does what a packet asks, and says the error and the data of the reply; ``shadow``: it was meant for another."""
    error, data = Error.NONE, b""
    try:
        match packet.instruction:
            case Instruction.PING:
                data = servo.table.number.to_bytes(2, "little") + bytes((servo.table.firmware,))
            case Instruction.READ:
                (asked,) = read_targets(packet)
                error, data = servo.read(asked.address, asked.length)
            case Instruction.WRITE:
                (given,) = write_targets(packet)
                error = servo.write(given.address, given.data, now_ns, shadow=shadow)
            case Instruction.REG_WRITE:
                (given,) = write_targets(packet)
                error = servo.reg_write(given.address, given.data, shadow=shadow)
            case Instruction.ACTION:
                error = servo.action(now_ns)
            case Instruction.REBOOT:
                servo.reboot(now_ns)
            case Instruction.CLEAR:
                error = servo.clear() if packet.parameters == CLEAR_POSITION else Error.DATA_RANGE
            case Instruction.FACTORY_RESET if len(packet.parameters) == 1:
                error = servo.factory_reset(packet.parameters[0], now_ns)
            case _:
                error = Error.INSTRUCTION
    except PacketError:
        error = Error.DATA_LENGTH
    return error, data
