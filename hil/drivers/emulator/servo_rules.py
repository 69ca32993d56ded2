"""Which register of a servo may be set to what, and when: the manual's rules. No bytes, no clock."""

from __future__ import annotations

from collections.abc import Mapping

from highfive.hil.drivers.bus.control_table import Register, Table, bounds
from highfive.hil.drivers.emulator.servo_motion import POSITION
from highfive.hil.drivers.servo_errors import WATCHDOG_TRIPPED, Error

GOALS = ("goal_pwm", "goal_current", "goal_velocity", "goal_position")


def shut_down(values: Mapping[str, int]) -> bool:
    """Whether a hardware error keeps the torque of a servo with these ``values`` (raw, by name) off."""
    return bool(values["hardware_error_status"] & values["shutdown"])


def refusal(table: Table, values: Mapping[str, int], register: Register, raw: int, shadow: bool) -> Error:
    """Why a register may not be set to a value; no error where it may.

    Args:
        table: of the servo's model.
        values: what its registers hold, raw, by name.
        register, raw: what would be set, and to what.
        shadow: the instruction was meant for the servo that it follows.
    """
    name = register.name
    if not register.writable or (register.eeprom and (shadow or values["torque_enable"])):
        return Error.ACCESS
    if name == "torque_enable" and raw and shut_down(values):
        return Error.RESULT_FAIL
    low, high = bounds(register)
    stopped = values["bus_watchdog"] == WATCHDOG_TRIPPED and (name in GOALS or (name == "bus_watchdog" and raw))
    no_mode = name == "operating_mode" and raw not in table.operating_modes
    if stopped or no_mode or not low <= raw <= high:
        return Error.DATA_RANGE
    if register.limited_by:
        low, high = -values[register.limited_by], values[register.limited_by]
    elif name == "goal_position" and values["operating_mode"] == POSITION:
        low, high = values["min_position_limit"], values["max_position_limit"]
    return Error.NONE if low <= raw <= high else Error.DATA_LIMIT
