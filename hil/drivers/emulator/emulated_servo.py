"""One emulated servo: its registers and who may write what, its watchdog, its protection. No bytes, no clock.

Time is passed in, in ns of one clock. Rules are the manual's; where it is silent, what is taken is said in
``docs/rig.md``.
"""

from __future__ import annotations

from collections.abc import Mapping

from highfive.hil.drivers.bus.control_table import BAUD_RATES, Register, Table
from highfive.hil.drivers.bus.packet import LAST_ID
from highfive.hil.drivers.emulator.servo_memory import ServoMemory
from highfive.hil.drivers.emulator.servo_motion import (
    CURRENT,
    CURRENT_POSITION,
    EXTENDED,
    FULL_DUTY,
    POSITION,
    PWM,
    VELOCITY,
    Motion,
)  # fmt: skip
from highfive.hil.drivers.emulator.servo_rules import GOALS, refusal, shut_down
from highfive.hil.drivers.servo_errors import OVERHEATING, OVERLOAD, VOLTAGE_ERROR, WATCHDOG_TRIPPED, Error

REVERSE, SLAVE, TORQUE_BY_GOAL = 0x01, 0x02, 0x08
"""Bits of the drive mode."""

WATCHDOG_NS = 20_000_000
"""Of one count of the bus watchdog."""

BOOT_NS = 200_000_000
"""So long a servo hears nothing after it was started, ns (an assumption)."""

LOWEST_SHARE = 0.5
"""A servo is off when it has less than this share of its motor's voltage (an assumption)."""

OVERLOAD_SHARE, OVERLOAD_S = 0.8, 2.0
"""It is overloaded when it draws this share of its stall current for so long, s (an assumption)."""

_GAINS = ("velocity_i_gain", "velocity_p_gain", "position_d_gain", "position_i_gain", "position_p_gain")
_TO_POSITION = {POSITION, EXTENDED, CURRENT_POSITION}
_COUNTING = {"drive_mode", "homing_offset", "operating_mode"}
_TURN = 4096
_IN_POSITION, _FOLLOWING = 20, 100  # counts: closer than that it is there; further than that it does not follow


class EmulatedServo:
    """A servo with its horn on a joint.

    Attributes:
        values: what every register holds, by name, raw, but for those that are measured.
        changes: how often a register was set, but for what is measured.
        watchdog_trips: how often its watchdog has stopped it.
        voltage: V, that it has now.
        hot: °C that its temperature is held at; None for what its motor makes of it.
        slip: rad that it says more of its joint than is so.
        astray: rad, by which its joint is further than it says because its horn was put on so; faults leave it alone.
    """

    def __init__(
        self, table: Table, registers: Mapping[str, int] | None = None, *, sign: int = 1, zero: int = _TURN // 2
    ) -> None:
        """A servo with the factory's values and, in place of them, ``registers`` (raw, by name).

        Args:
            table: of its model.
            registers: those that are not as from the factory; EEPROM ones stay so through a reboot.
            sign: −1 where its horn turns the other way than the joint.
            zero: count at joint angle 0, once its drive mode makes up for ``sign``.
        """
        self.table, self.changes = table, 0
        self._sign, self._zero = sign, zero
        self._memory = ServoMemory(table)
        self.values, self._measured_at = self._memory.values, -1
        self._pulse, self._speed = table["present_position"].scale, table["present_velocity"].scale
        ampere = table["present_current"].scale if "present_current" in table else None
        self._load = ampere or table.motor.stall_current * table["present_load"].scale  # A, of one count
        self._heavy = OVERLOAD_SHARE * table.motor.stall_current
        self.watchdog_trips = 0
        self.voltage = table.motor.voltage
        self.hot: float | None = None
        self.slip = self.astray = 0.0
        self._heard_ns = self._silent_until = 0
        self._now = 0
        self._joint = self._joint_velocity = 0.0
        self._learn_counting()
        self._start(dict(registers or {}))

    # What the bus asks it.

    @property
    def id(self) -> int:
        """Its ID."""
        return self.values["id"]

    @property
    def shadow_id(self) -> int | None:
        """ID of whose commands it follows as well; None for nobody's."""
        shadow = self.values["shadow_id"]
        return shadow if shadow <= LAST_ID and shadow != self.id else None

    @property
    def baud_rate(self) -> int:
        """Baud that it listens at."""
        return BAUD_RATES[self.values["baud_rate"]]

    @property
    def return_delay_ns(self) -> int:
        """How long it waits before it replies."""
        return self.values["return_delay_time"] * 2_000

    @property
    def alert(self) -> bool:
        """Its hardware error status is not 0."""
        return bool(self.values["hardware_error_status"])

    @property
    def let_down(self) -> bool:
        """It has switched its torque off by itself, by its shutdown register or for want of power."""
        return shut_down(self.values) or not self._powered(self.voltage)

    def listening(self, now_ns: int) -> bool:
        """Whether it hears anything: it has power and has finished starting."""
        return self._powered(self.voltage) and now_ns >= self._silent_until

    def heard(self, now_ns: int) -> None:
        """An instruction named it: its watchdog counts from here."""
        self._heard_ns = max(self._heard_ns, now_ns)

    def read(self, address: int, length: int) -> tuple[Error, bytes]:
        """``length`` bytes from ``address``; none with an error."""
        places = self._memory.places(address, length)
        if places is None:
            return Error.ACCESS, b""
        self._measure()
        return Error.NONE, self._memory.bytes_at(places)

    def write(self, address: int, data: bytes, now_ns: int, *, shadow: bool = False) -> Error:
        """Writes ``data`` from ``address`` on, all of it or nothing; ``shadow``: it was meant for whom it follows."""
        writes, error = self._check(address, data, shadow)
        if error:
            return error
        for register, raw in writes:
            self._put(register.name, raw)
        self._react({register.name for register, _ in writes}, now_ns)
        return Error.NONE

    def reg_write(self, address: int, data: bytes, *, shadow: bool = False) -> Error:
        """Keeps a write until :meth:`action`; what it would refuse then, it refuses now."""
        if error := self._check(address, data, shadow)[1]:
            return error
        self._registered = (address, data)
        self._put("registered_instruction", 1)
        return Error.NONE

    def action(self, now_ns: int) -> Error:
        """Carries out what was kept."""
        if self._registered is None:
            return Error.INSTRUCTION
        (address, data), self._registered = self._registered, None
        self._put("registered_instruction", 0)
        return self.write(address, data, now_ns)

    def reboot(self, now_ns: int) -> None:
        """Starts again: RAM as from the factory, EEPROM as it is; it hears nothing for a while."""
        self._start({name: raw for name, raw in self.values.items() if self.table[name].eeprom})
        self._now = self._heard_ns = now_ns
        self._silent_until = now_ns + BOOT_NS

    def factory_reset(self, option: int, now_ns: int) -> Error:
        """Back to the factory's values but for, by option, nothing (0xFF), its ID (1), its ID and its baud rate (2)."""
        kept = {0xFF: (), 0x01: ("id",), 0x02: ("id", "baud_rate")}.get(option)
        if kept is None:
            return Error.DATA_RANGE
        self._start({name: self.values[name] for name in kept})
        self._now = self._heard_ns = now_ns
        self._silent_until = now_ns + BOOT_NS
        return Error.NONE

    def clear(self) -> Error:
        """Forgets the turns that it has counted; only while it stands."""
        self._measure()
        if self.values["moving"]:
            return Error.RESULT_FAIL
        self._forget_turns()
        return Error.NONE

    # What happens to it in time.

    def place(self, position: float) -> None:
        """Its joint is at ``position``, rad, when it is switched on."""
        self._joint = position
        self._forget_turns()
        self._stay(self._now)

    def power(self, voltage: float, now_ns: int) -> None:
        """It has ``voltage`` V from now on; when that is enough again after it was not, it starts."""
        was, self.voltage = self.voltage, voltage
        if self._powered(voltage) and not self._powered(was):
            self.reboot(now_ns)
        elif not self._powered(voltage):
            self._put("torque_enable", 0)

    def _powered(self, voltage: float) -> bool:
        return voltage >= LOWEST_SHARE * self.table.motor.voltage

    def fail(self, bits: int) -> None:
        """Sets bits of its hardware error status; those that its shutdown register names switch its torque off."""
        self._put("hardware_error_status", self.values["hardware_error_status"] | bits)
        if bits & self.values["shutdown"]:
            self._put("torque_enable", 0)

    def step(self, position: float, velocity: float, now_ns: int, seconds: float) -> float:
        """One step of its controllers: N·m on the joint for the next ``seconds``.

        Args:
            position, velocity: of the joint, rad and rad/s.
            now_ns: the time at which the step begins.
            seconds: how long it is.
        """
        self._now, self._joint, self._joint_velocity, self._measured_at = now_ns, position, velocity, -1
        direction, motion = self._direction, self.motion
        motion.position, motion.velocity = self._angle(position), direction * velocity
        self._watch(now_ns)
        torque = motion.torque(self.values, now_ns * 1e-9, seconds, self.voltage)
        self._protect(seconds)
        return direction * torque

    def _watch(self, now_ns: int) -> None:
        """The bus watchdog: the servo stops when no instruction has come for too long, and forgets its profile."""
        values = self.values
        count = values["bus_watchdog"]
        if count > 0 and values["torque_enable"] and now_ns - self._heard_ns > count * WATCHDOG_NS:
            self.watchdog_trips += 1
            self._put("bus_watchdog", WATCHDOG_TRIPPED)
            mode = values["operating_mode"]
            if driving := {CURRENT: "goal_current", VELOCITY: "goal_velocity", PWM: "goal_pwm"}.get(mode):
                self._put(driving, 0)
            self._put("profile_velocity", 0)
            self._put("profile_acceleration", 0)
            self._stay(now_ns)

    def _protect(self, seconds: float) -> None:
        """Voltage, temperature and load against their limits."""
        values, motion = self.values, self.motion
        bits = 0
        if not values["min_voltage_limit"] <= round(self.voltage * 10) <= values["max_voltage_limit"]:
            bits |= VOLTAGE_ERROR
        if self.hot is not None:
            motion.temperature = self.hot
        if motion.temperature > values["temperature_limit"]:
            bits |= OVERHEATING
        heavy = abs(motion.current) > self._heavy
        self._loaded_s = self._loaded_s + seconds if heavy else 0.0
        if self._loaded_s > OVERLOAD_S:
            bits |= OVERLOAD
        if bits & ~values["hardware_error_status"]:
            self.fail(bits)

    # Registers.

    def _start(self, kept: dict[str, int]) -> None:
        self.motion = Motion(self.table)
        self._loaded_s = 0.0
        self._turns = 0
        self._registered: tuple[int, bytes] | None = None
        for register in self.table:
            self._put(register.name, kept.get(register.name, register.initial or 0))
        self._put("torque_enable", kept.get("torque_enable", self.values["startup_configuration"] & 1))
        self._reset_goals()
        self._memory.forget_places()
        self._forget_turns()
        self._stay(self._now)

    def _reset_goals(self) -> None:
        self._put("goal_pwm", self.values["pwm_limit"])
        if "goal_current" in self.values:
            self._put("goal_current", self.values["current_limit"])

    def _put(self, name: str, raw: int) -> None:
        self._memory.put(name, raw)
        self.changes, self._measured_at = self.changes + 1, -1
        if name in _COUNTING:
            self._learn_counting()

    def _check(self, address: int, data: bytes, shadow: bool) -> tuple[list[tuple[Register, int]], Error]:
        """The registers that a write would set, and to what; or why it may not."""
        writes = self._memory.decoded(address, data)
        if isinstance(writes, Error):
            return [], writes
        for register, raw in writes:
            if error := refusal(self.table, self.values, register, raw, shadow):
                return [], error
        return writes, Error.NONE

    def _react(self, names: set[str], now_ns: int) -> None:
        """What follows from registers having been written."""
        values = self.values
        if any(name.startswith("indirect_address") for name in names):
            self._memory.forget_places()
        if "operating_mode" in names:
            self._change_mode()
        if names & {"operating_mode", "drive_mode", "homing_offset"}:
            self._stay(now_ns)
        if "torque_enable" in names:
            self._switch_torque(now_ns)
        if "bus_watchdog" in names:
            self._heard_ns = now_ns
        goals = names & set(GOALS)
        by_goal = values["drive_mode"] & TORQUE_BY_GOAL and not values["torque_enable"]
        if goals and by_goal and not shut_down(self.values):
            kept = {name: values[name] for name in goals}
            self._put("torque_enable", 1)
            self._switch_torque(now_ns)
            for name, raw in kept.items():
                self._put(name, raw)
        moves = "goal_velocity" if values["operating_mode"] == VELOCITY else "goal_position"
        if moves in names and values["torque_enable"]:
            self.motion.go(values, now_ns * 1e-9)

    def _change_mode(self) -> None:
        """A new operating mode brings gains, profile and goals back to where they start."""
        for name in _GAINS:
            self._put(name, self.table[name].initial or 0)
        self._put("profile_velocity", 0)
        self._put("profile_acceleration", 0)
        self._put("goal_velocity", 0)
        self._reset_goals()
        if self.values["operating_mode"] == POSITION:
            self._forget_turns()

    def _switch_torque(self, now_ns: int) -> None:
        """Torque was switched on or off: it stays where it is."""
        if self.values["torque_enable"] and self.values["operating_mode"] == POSITION:
            self._forget_turns()
        self._heard_ns = now_ns
        self._stay(now_ns)

    def _stay(self, now_ns: int) -> None:
        """Its goal is where it is."""
        self.motion.position = self._angle(self._joint)
        self.motion.velocity = self._direction * self._joint_velocity
        self.motion.hold(now_ns * 1e-9)
        self._put("goal_position", round(self.motion.position / self._pulse))

    # Angles.

    def _learn_counting(self) -> None:
        """Which way it counts, and the homing offset; in position mode one of more than a quarter turn is none."""
        values = self.values
        self._direction = -self._sign if values["drive_mode"] & REVERSE else self._sign
        offset = values["homing_offset"]
        self._offset = 0 if values["operating_mode"] == POSITION and abs(offset) > _TURN // 4 else offset

    def _count(self, position: float) -> float:
        """Count of its encoder, offset included, at a joint's position."""
        turned = (position + self.slip - self.astray) / self._pulse + self._zero - _TURN // 2
        return _TURN // 2 + self._direction * turned + self._turns * _TURN + self._offset

    def _angle(self, position: float) -> float:
        return self._count(position) * self._pulse

    def _forget_turns(self) -> None:
        """Its count is within one turn, but for the homing offset."""
        self._turns, self._measured_at = 0, -1
        self._turns = -int((self._count(self._joint) - self._offset) // _TURN)

    def _measure(self) -> None:
        """Brings what it measures up to date in its memory."""
        if self._measured_at == self._now:
            return
        self._measured_at = self._now
        values, motion, pulse = self.values, self.motion, self._pulse
        reference, reference_velocity = motion.reference(self._now * 1e-9)
        ongoing = bool(values["torque_enable"]) and motion.ongoing(self._now * 1e-9)
        velocity, count = round(motion.velocity / self._speed), round(self._count(self._joint))
        course = round(reference / pulse)
        status = motion.profile.kind << 4 | ongoing << 1
        if values["operating_mode"] in _TO_POSITION:
            status |= (abs(values["goal_position"] - count) <= _IN_POSITION) | (abs(course - count) > _FOLLOWING) << 3
        values["moving"] = int(ongoing or abs(velocity) > values["moving_threshold"])
        self._memory.put_measured(
            self._now // 1_000_000 % 32_768,
            values["moving"],
            status,
            _word(motion.duty * FULL_DUTY),
            _word(motion.current / self._load),
            velocity,
            count,
            round(reference_velocity / self._speed),
            course,
            round(self.voltage * 10),
            min(255, max(0, round(motion.temperature))),
        )


def _word(value: float) -> int:
    return min(32_767, max(-32_768, round(value)))
