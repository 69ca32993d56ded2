"""The joints of an arm over a servo bus: one packet with all goals, one with all answers, a cycle.

What is read every cycle lies in different places of the control table; each servo is told once to show it in one block
(indirect addresses), goals likewise. Units and directions end here: above are joints, rad and A.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass, field

import numpy as np

from highfive.hil.drivers.bus.control_table import ANSWERS, Register, encode, packing, to_raw, to_si
from highfive.hil.drivers.bus.rig import COUNTS, PROFILE, SET_AT_START, Rig, angle, count, required_registers
from highfive.hil.drivers.bus.servo_bus import NoAnswer, ServoBus, ServoError
from highfive.hil.drivers.bus.servo_clock import ServoClock
from highfive.hil.drivers.servo_errors import WATCHDOG_TRIPPED
from highfive.hil.drivers.values import Array, JointCommand, JointHealth, JointState
from highfive.model.errors import HighFiveError

DEAD_AFTER = 3
"""Questions in a row, put to it alone, without an answer, after which a servo is not asked any more."""

FED_SHARE = 0.25
"""Of the watchdogs' time: so long an instruction that names every servo may be ago while something else goes on."""

DISARM_NS = 1_000_000_000
"""So long servos are told, one after the other, that the bus may fall silent, ns; some may not answer any more."""


@dataclass
class _Servo:
    """What is known of one servo: its last values, raw, when they came, whether in this cycle, how often it was silent,
    and its clock."""

    values: dict[str, int] = field(default_factory=lambda: dict.fromkeys(ANSWERS, 0))
    heard_ns: int = 0
    answered: bool = False
    silent: int = 0
    clock: ServoClock = field(default_factory=ServoClock)


class JointBus:
    """The arm's servos. One owner, one thread."""

    def __init__(self, bus: ServoBus, rig: Rig):
        """Goes by the clock of the bus."""
        self._bus, self._rig, self._clock = bus, rig, bus.clock.now
        self._servos = {servo: _Servo() for servo in rig.servos}
        tables = {servo: bus.table(servo) for servo in self._servos}
        self._goal_registers = {joint.id: tables[joint.id].goals for joint in rig.joints}
        self._answer_registers: dict[int, dict[str, Register]] = {
            joint.id: dict(zip(ANSWERS, tables[joint.id].answers, strict=True)) for joint in rig.joints
        }
        self._packings = {servo: packing(table.answers) for servo, table in tables.items()}
        self._places = {servo: table.places for servo, table in tables.items()}
        self._alike = len({(own.goals, own.answers) for own in self._places.values()}) == 1
        self._answers_size = next(iter(self._packings.values())).size
        self._fast = True
        self._fallbacks = 0
        self._named_ns = 0  # when all servos were last named in one instruction

    @property
    def dead(self) -> tuple[int, ...]:
        """Servos that have gone silent; they are not asked again before :meth:`prepare`."""
        return tuple(servo for servo, state in self._servos.items() if state.silent >= DEAD_AFTER)

    @property
    def fallbacks(self) -> int:
        """Cycles in which the one answer of all servos did not come whole, and each was asked for its own."""
        return self._fallbacks

    def prepare(self) -> None:
        """Tells every servo which registers to show together, how stiff to be, and to go without a profile.

        A servo whose torque is on is commanded nothing: what holds an arm is not changed under it. After an earlier
        session it holds all of this already.

        Raises:
            NoAnswer, ServoError, PortError: a servo did not take it.
            HighFiveError: torque is on, and a register is not as it has to be. Nothing was written then.
        """
        required = {servo: self._required(servo) for servo in self._servos}
        live = [servo for servo in self._servos if self._bus.read(servo, "torque_enable")]
        for servo in live:
            self._refuse_other(servo, required[servo])
        for servo, state in self._servos.items():
            for name, raw in required[servo].items() if servo not in live else ():
                self._bus.write(servo, name, raw)
            state.silent, state.clock = 0, ServoClock()

    def _required(self, servo: int) -> dict[str, int]:
        """What is set at the start of a session: raw, by the register's name."""
        own = required_registers(self._rig)[servo]
        shown = [one.address + byte for one in self._places[servo].shown for byte in range(one.size)]
        addresses = {f"indirect_address_{number}": address for number, address in enumerate(shown, 1)}
        return addresses | {name: own[name] for name in SET_AT_START}

    def _refuse_other(self, servo: int, required: dict[str, int]) -> None:
        for name, raw in required.items():
            if (holds := self._bus.read(servo, name)) != raw:
                where = f"servo {servo} ({self._rig.servos[servo].name})"
                raise HighFiveError(
                    f"{where}: its torque is on and {name} is {holds}, not {raw}; "
                    f"hold the arm, let it go with {self._rig.command('release', self._bus.path)}, and start again"
                )

    def engage(self) -> JointState:
        """Holds the arm where it is: the goal is where each joint stands, then torque on. Servos that their watchdogs
        have stopped are freed for that. The watchdogs are armed last, by :meth:`arm_watchdog`.

        Raises:
            NoAnswer, ServoError, PortError: a servo did not take it; those that did hold on.
            HighFiveError: a servo is missing.
        """
        for servo in self._servos.values():  # who was silent before may be back
            servo.silent = 0
        state = self.read()
        for _ in range(DEAD_AFTER):  # one packet that did not come whole is nobody's death
            state = state if state.answered.all() else self.read()
        if not state.answered.all():
            silent = [j.name for j, there in zip(self._rig.joints, state.answered, strict=True) if not there]
            raise HighFiveError(f"{', '.join(silent)}: no answer; nothing is switched on")
        self._stay(state)
        for servo in self._servos:  # one that an earlier session has armed would trip meanwhile
            self._quiet(servo, self._rig.current_limits)
        for servo in self._servos:
            self._bus.write(servo, "torque_enable", 1)
        return state

    def arm_watchdog(self) -> None:
        """Arms every servo's own watchdog, or arms it again after it tripped; from then on they have to be fed.

        Raises:
            NoAnswer, ServoError, PortError: a servo did not take it.
        """
        for servo in self._servos:
            register = self._bus.table(servo)["bus_watchdog"]
            self._free(servo)
            self.feed()
            self._bus.write(servo, register.name, to_raw(register, self._rig.settings.watchdog))
            self.feed()

    def feed(self) -> None:
        """Keeps the watchdogs quiet while servos are asked one by one: names all of them in one instruction, unless one
        did a moment ago. Whether an instruction to another servo counts, too, the manual does not say.

        Raises:
            PortError: the port is gone.
        """
        if self._clock() - self._named_ns > FED_SHARE * 1e9 * self._rig.settings.watchdog > 0.0:
            self.read()

    def disarm_watchdog(self, currents: Array | None = None) -> None:
        """Switches the watchdogs off, so that the arm holds on when the bus falls silent. The dead are left.

        Args:
            currents: (J,) A, most that servos hold with whose watchdogs have stopped them; None for the rig's limits.

        Raises:
            PortError: the port is gone.
        """
        most = self._rig.current_limits if currents is None else currents
        self.read()
        begun = self._clock()
        for servo in self._servos:
            if servo not in self.dead and self._clock() - begun < DISARM_NS:
                with contextlib.suppress(NoAnswer, ServoError):
                    self._quiet(servo, most)
        if self._clock() - begun > 1e9 * self._rig.settings.watchdog > 0.0:  # some may have been stopped meanwhile
            self.write(JointCommand(self.read().positions, most))

    def _quiet(self, servo: int, currents: Array) -> None:
        """Switches one watchdog off. A servo that it had stopped has refused goals since: it shall not go on to an old
        one."""
        self._free(servo)
        if self._servos[servo].values["bus_watchdog"] == WATCHDOG_TRIPPED:
            self.write(JointCommand(self._state(self._clock()).positions, currents))

    def _free(self, servo: int) -> None:
        """Switches one watchdog off. The trip of a watchdog takes the servo's profile away (the manual): it is written
        again before any goal."""
        self._bus.write(servo, "bus_watchdog", 0)
        if self._servos[servo].values["bus_watchdog"] == WATCHDOG_TRIPPED:
            for name in PROFILE:
                self._bus.write(servo, name, required_registers(self._rig)[servo][name])

    def stands(self, slower: float, goals: Array | None = None, nearer: float = np.inf) -> bool:
        """Every joint was slower than that, rad/s, and nearer than that, rad, to its goal (J,), when last heard."""
        state = self._state(self._clock())
        off = 0.0 if goals is None else np.abs(state.positions - goals).max()
        return bool(np.abs(state.velocities).max() < slower and off < nearer)

    def hold(self) -> JointCommand:
        """Sends each joint's last known position as its goal.

        Raises:
            PortError: the port is gone.
        """
        return self._stay(self._state(self._clock()))

    def lower_currents(self, held: JointCommand, currents: Array) -> JointCommand:
        """Sends goal currents (J,), A, alone to an arm that holds what is ``held``; returns what it holds from now on.

        Raises:
            HighFiveError: a current is nothing that a register takes. Nothing is sent.
            PortError: the port is gone.
        """
        data, lowered = {}, []
        for joint, before, current in zip(self._rig.joints, held.currents, currents, strict=True):
            register = self._goal_registers[joint.id][0]
            share = self._duty_share(joint.id)
            raw = to_raw(register, share * min(max(current, 0.0), before))
            data[joint.id] = encode(register, raw)
            lowered.append(to_si(register, raw) / share)
        self._send(data)
        return JointCommand(held.positions, np.array(lowered))

    def _stay(self, state: JointState) -> JointCommand:
        """Sends as goals where the joints are."""
        return self.write(JointCommand(state.positions, self._rig.current_limits))

    def release(self) -> list[int]:
        """Switches torque off: the arm falls. The servos that did not confirm it."""
        failed = []
        for servo in self._servos:
            try:
                self._bus.write(servo, "bus_watchdog", 0)
                self._bus.write(servo, "torque_enable", 0)
            except (NoAnswer, ServoError):
                failed.append(servo)
        return failed

    def cycle(self, command: JointCommand | None) -> tuple[JointState, JointCommand | None]:
        """Sends goals, if there are any, and reads everything; what was really sent comes back.

        Raises:
            PortError: the port is gone.
        """
        sent = None if command is None else self.write(command)
        return self.read(), sent

    def write(self, command: JointCommand) -> JointCommand:
        """Sends goals to all servos in one packet, which none answers; as what they arrive, to a count.

        Raises:
            HighFiveError: a goal is no number, or is nothing that a register takes. Nothing is sent.
            PortError: the port is gone.
        """
        data, positions, currents = {}, [], []
        for joint, position, current in zip(self._rig.joints, command.positions, command.currents, strict=True):
            if not (math.isfinite(position) and math.isfinite(current)):
                raise HighFiveError(f"{joint.name}: {position:g} rad and {current:g} A are no goals")
            current_register, position_register = self._goal_registers[joint.id]
            share = self._duty_share(joint.id)
            raw = to_raw(current_register, share * min(max(current, 0.0), joint.current_limit)), count(joint, position)
            try:
                between = bytes(self._places[joint.id].between)
                data[joint.id] = encode(current_register, raw[0]) + between + encode(position_register, raw[1])
            except HighFiveError as error:
                raise HighFiveError(f"{joint.name}: {error}") from None
            positions.append(angle(joint, raw[1]))
            currents.append(to_si(current_register, raw[0]) / share)
        self._send(data)
        return JointCommand(np.array(positions), np.array(currents))

    def _duty_share(self, servo: int) -> float:
        """By what the duty is less of a servo that limits its duty, where it has more than its motor's voltage; 1 for
        others: with less it pushes less hard."""
        table = self._bus.table(servo)
        volts = to_si(table["present_input_voltage"], self._servos[servo].values["present_input_voltage"])
        return 1.0 if table.limits_current else min(1.0, table.motor.voltage / max(volts, 1e-3))

    def _send(self, data: dict[int, bytes]) -> None:
        """Goals, from where each servo takes them."""
        if self._alike:
            self._bus.sync_write(next(iter(self._places.values())).goals, data)
        else:
            self._bus.bulk_write({servo: (self._places[servo].goals, own) for servo, own in data.items()})

    def read(self) -> JointState:
        """Everything of all servos that answer.

        Raises:
            PortError: the port is gone.
        """
        queried = [servo for servo, state in self._servos.items() if state.silent < DEAD_AFTER]
        self._named_ns = self._clock()
        found = self._answers(queried) if queried else {}
        now_ns = self._clock()
        for servo, state in self._servos.items():
            state.answered = servo in found
            if state.answered:
                state.values, state.heard_ns = found[servo], now_ns
        return self._state(now_ns)

    def _answers(self, queried: list[int]) -> dict[int, dict[str, int]]:
        """Raw values by servo and name, from one answer for all while everyone is there; after a gap each for itself,
        until nobody is silent or the silent are dead: one of them costs a wait a cycle, and not the others."""
        if self._fast:
            with contextlib.suppress(NoAnswer):
                if len(found := self._fresh(queried, fast=True)) == len(queried):
                    return found
            self._fast = False
            self._fallbacks += 1
            return {}
        found = self._fresh(queried)
        for servo in queried[len(found) + 1 :]:  # after the first silent one
            found |= self._fresh([servo])
        for servo in queried:
            self._servos[servo].silent = 0 if servo in found else self._servos[servo].silent + 1
        self._fast = all(self._servos[servo].silent in (0, DEAD_AFTER) for servo in queried)
        return found

    def _fresh(self, queried: list[int], *, fast: bool = False) -> dict[int, dict[str, int]]:
        """The answers to a question, up to the first that came late to an earlier one."""
        bus, size, places = self._bus, self._answers_size, {servo: self._places[servo].answers for servo in queried}
        queried_ns = self._clock()
        if self._alike:
            answers = (bus.fast_sync_read if fast else bus.sync_read)(places[queried[0]], size, queried)
        else:
            answers = (bus.fast_bulk_read if fast else bus.bulk_read)(places, size)
        heard_ns = self._clock()
        found = {}
        for servo, data in answers.items():
            values = dict(zip(ANSWERS, self._packings[servo].unpack(data), strict=True))
            if not self._servos[servo].clock.fresh(values["realtime_tick"], queried_ns, heard_ns):
                break
            found[servo] = values
        return found

    def _state(self, now_ns: int) -> JointState:
        joints = self._rig.joints
        of = [[self._servos[servo] for servo in joint.ids] for joint in joints]
        return JointState(
            time_ns=now_ns,
            positions=np.array(
                [angle(joint, own[0].values["present_position"]) for joint, own in zip(joints, of, strict=True)]
            ),
            velocities=self._mean("present_velocity", of),
            currents=self._mean("present_current", of),
            errors=np.array([_bits(own) for own in of], dtype=np.int64),
            answered=np.array([all(servo.answered for servo in own) for own in of]),
            tripped=np.array([any(servo.values["bus_watchdog"] == WATCHDOG_TRIPPED for servo in own) for own in of]),
            apart=np.array([_apart(own) for own in of]),
        )

    def _mean(self, name: str, of: list[list[_Servo]]) -> Array:
        registers = [self._answer_registers[joint.id][name] for joint in self._rig.joints]
        return np.array(
            [
                sum(to_si(register, servo.values[name]) for servo in own) / len(own)
                for register, own in zip(registers, of, strict=True)
            ]
        )

    def health(self) -> JointHealth:
        """What the servos said of themselves last."""
        hot, low = [], []
        for joint in self._rig.joints:
            table, own = self._bus.table(joint.id), [self._servos[servo].values for servo in joint.ids]
            hot.append(max(to_si(table["present_temperature"], v["present_temperature"]) for v in own))
            low.append(min(to_si(table["present_input_voltage"], v["present_input_voltage"]) for v in own))
        heard_ns = min(servo.heard_ns for servo in self._servos.values())
        return JointHealth(heard_ns, np.array(hot), np.array(low))


def _apart(own: list[_Servo]) -> float:
    first, last = own[0], own[-1]
    return (last.values["present_position"] - first.values["present_position"]) * math.tau / COUNTS


def _bits(own: list[_Servo]) -> int:
    errors = 0
    for servo in own:
        errors |= servo.values["hardware_error_status"]
    return errors
