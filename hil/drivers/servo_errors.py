"""What a servo says is wrong, as data (the maker's manual): the error of a reply, and its hardware error status."""

from __future__ import annotations

from enum import IntEnum


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

_SAID = {
    Error.RESULT_FAIL: "it could not carry out the instruction",
    Error.INSTRUCTION: "it does not know the instruction",
    Error.CRC: "the packet came damaged",
    Error.DATA_RANGE: "the value is out of the register's range",
    Error.DATA_LENGTH: "the data has the wrong length",
    Error.DATA_LIMIT: "the value is beyond a limit that is set",
    Error.ACCESS: "the register cannot be written now (read-only, or torque is on)",
}

VOLTAGE_ERROR, OVERHEATING, ENCODER_ERROR, SHOCK, OVERLOAD = 0x01, 0x04, 0x08, 0x10, 0x20
"""Bits of the registers Hardware Error Status and Shutdown."""

_HARDWARE = {
    VOLTAGE_ERROR: "input voltage",
    OVERHEATING: "overheating",
    ENCODER_ERROR: "motor encoder",
    SHOCK: "electrical shock",
    OVERLOAD: "overload",
}

WATCHDOG_TRIPPED = -1
"""What the register Bus Watchdog shows once it has stopped the servo: goals are refused until it is written 0."""


def error_text(error: int) -> str:
    """One of :class:`Error` in words."""
    return _SAID[Error(error)] if error in _SAID else f"error {error}"


def hardware_errors(status: int) -> list[str]:
    """The bits of a hardware error status in words."""
    return [_HARDWARE.get(1 << bit, f"bit {bit}") for bit in range(8) if status >> bit & 1]
