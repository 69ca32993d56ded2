"""What really happens on an emulated rig, every millisecond: what the servos were commanded, and where the body is."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from highfive.hil.drivers.bus.control_table import to_si
from highfive.hil.drivers.bus.rig import Rig, angle
from highfive.hil.drivers.emulator.emulated_bus import EmulatedBus
from highfive.hil.drivers.values import Array

STANDS = 0.05
"""rad/s: a slower joint stands."""

HERE = 0.012
"""rad: a goal so near is where a joint is, which stands or brakes."""


@dataclass
class BlackBox:
    """Rows of what was; :meth:`look` is the watch of a :class:`~highfive.hil.drivers.emulator.virtual_rig.VirtualRig`.

    Attributes:
        bus, rig: what is looked at.
        times: ns of the clock.
        goals: (J,) rad, of the first servo of each joint.
        allowed: (J,) A, goal currents.
        currents: (J,) A, the largest that a servo of the joint draws.
        positions, velocities: (J,) rad and rad/s of the body.
        said: (J,) rad, where the first servo of each joint has it: off by its horn.
        powered: (J,) bool, torque is on in every servo of the joint.
        sound: (J,) bool, no servo of the joint has shut down, or lost its power, since it was last switched on.
        released: (J,) bool, in a servo of the joint that has not, torque went off since the row before.
        trips: watchdogs that have tripped; a servo whose watchdog trips makes its place its goal.
        watched: servos with torque on whose watchdog runs.
    """

    bus: EmulatedBus
    rig: Rig
    times: list[int] = field(default_factory=list)
    goals: list[list[float]] = field(default_factory=list)
    allowed: list[list[float]] = field(default_factory=list)
    currents: list[Array] = field(default_factory=list)
    positions: list[Array] = field(default_factory=list)
    velocities: list[Array] = field(default_factory=list)
    said: list[Array] = field(default_factory=list)
    powered: list[list[bool]] = field(default_factory=list)
    sound: list[list[bool]] = field(default_factory=list)
    released: list[list[bool]] = field(default_factory=list)
    trips: list[int] = field(default_factory=list)
    watched: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Finds the servos."""
        by_id = {servo.id: servo for servo in self.bus.servos}
        self._servos = [by_id[joint.id] for joint in self.rig.joints]
        self._all = [[by_id[servo] for servo in joint.ids] for joint in self.rig.joints]
        self._registers: list[float] = []
        self._down, self._on = set[int](), set[int]()  # IDs: let down since they were last on; with torque

    def look(self, now_ns: int) -> None:
        """Adds a row."""
        self.times.append(now_ns)
        self._look_at_registers()
        self.trips.append(self.bus.watchdog_trips)
        self.currents.append(np.array([max(abs(servo.motion.current) for servo in joint) for joint in self._all]))
        positions, velocities = self.bus.body
        self.positions.append(np.array(positions))
        self.velocities.append(np.array(velocities))
        self.said.append(self.positions[-1] + [servo.slip - servo.astray for servo in self._servos])

    def _look_at_registers(self) -> None:
        """Goals and torque; where no register was set, as in most rows, they are those of the row before."""
        registers = [value for servo in self.bus.servos for value in (servo.changes, servo.voltage)]
        if registers == self._registers and self.goals:
            self.goals.append(self.goals[-1])
            self.allowed.append(self.allowed[-1])
            self.powered.append(self.powered[-1])
            self.watched.append(self.watched[-1])
            self.sound.append(self.sound[-1])
            self.released.append([False] * len(self._all))
            return
        self._registers = registers
        self.goals.append(
            [angle(joint, s.values["goal_position"]) for joint, s in zip(self.rig.joints, self._servos, strict=True)]
        )
        self.allowed.append([to_si(s.table["goal_current"], s.values["goal_current"]) for s in self._servos])
        self.powered.append([all(s.values["torque_enable"] for s in servos) for servos in self._all])
        running = [s.values["torque_enable"] and s.values["bus_watchdog"] > 0 for servos in self._all for s in servos]
        self.watched.append(sum(map(bool, running)))
        self._look_at_torque()

    def _look_at_torque(self) -> None:
        """Who has it, and who lost it by itself: a servo that starts again after that is not sound before it is on."""
        servos = [servo for joint in self._all for servo in joint]
        on = {servo.id for servo in servos if servo.values["torque_enable"]}
        self._down = (self._down | {servo.id for servo in servos if servo.let_down}) - on
        off = self._on - on - self._down
        self._on = on
        self.sound.append([all(s.id not in self._down for s in joint) for joint in self._all])
        self.released.append([any(s.id in off for s in joint) for joint in self._all])

    def clear(self) -> None:
        """Forgets what was."""
        rows_of = (self.times, self.goals, self.allowed, self.currents, self.positions, self.velocities, self.said)
        for rows in (*rows_of, self.powered, self.sound, self.released, self.trips, self.watched):
            rows.clear()

    def last_change_ns(self, since_ns: int) -> int:
        """When a goal last changed; ``since_ns`` where none has since then."""
        goals, times = np.array(self.goals), np.array(self.times)
        changed = times[1:][(np.diff(goals, axis=0) != 0.0).any(axis=1)]
        return int(max(changed.max(initial=since_ns), since_ns))

    def commanded_after_ms(self, since_ns: int, until_ns: int | None = None, holds: int = 1) -> float:
        """When a servo last had another goal, ms after ``since_ns``, at the latest at ``until_ns``; 0 for never.

        What servos make their goal by themselves, as they are switched on or their watchdog trips, does not count, nor
        what one without torque is told, nor does a joint that is commanded to stay where its servo has it: ``holds``
        times for each joint, once for everything that has the arm held; a creep is not excused.
        """
        times, powered = np.array(self.times), np.array(self.powered)
        own = (np.diff(self.trips) > 0) | (powered[1:] != powered[:-1]).any(axis=1)
        goals = np.array(self.goals)
        stays = np.abs(goals - np.array(self.said)) < HERE
        within = (times[1:] > since_ns) & (times[1:] <= (times[-1] if until_ns is None else until_ns))
        moved = (np.diff(goals, axis=0) != 0.0) & within[:, None] & ~own[:, None] & powered[1:]
        held = moved & stays[1:]
        changed = (moved & ~(held & (np.cumsum(held, axis=0) <= holds))).any(axis=1)
        return 1e-6 * float(times[1:][changed].max(initial=since_ns) - since_ns)

    def stopped_after_ms(self, since_ns: int) -> float | None:
        """When the last servo that was driven had been stopped by its own watchdog, ms after ``since_ns``; None where
        no watchdog ran then, NaN where one runs still."""
        times, watched = np.array(self.times), np.array(self.watched)
        after = times >= since_ns
        if not after.any() or not watched[after][0]:
            return None
        stopped = np.flatnonzero(watched[after] == 0)
        return 1e-6 * float(times[after][stopped[0]] - since_ns) if len(stopped) else np.nan

    def stands_since_ns(self, slower: float = STANDS) -> int:
        """Since when every joint of the body has been slower than that, rad/s."""
        moves = (np.abs(np.array(self.velocities)) > slower).any(axis=1)
        return self.times[min(int(np.flatnonzero(moves)[-1]) + 1, len(self.times) - 1)] if moves.any() else 0
