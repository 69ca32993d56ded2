"""The twin behind plain servos, in simulated time: to the loop what the driver is, without bus and without clock.

A servo gives a voltage in proportion to its error, and its motor has a torque–speed line and a largest current.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from highfive.calibration.arm_file import load_arm
from highfive.hil.arm.arm_files import resting_pose
from highfive.hil.arm.calibrated import known_arm
from highfive.hil.arm_model.arm_folder import DEFAULT_ARM, ArmFolder, find_arm
from highfive.hil.drivers.bus.cycle_ring import Cycle, Mode
from highfive.hil.drivers.values import JointCommand, JointHealth, JointState
from highfive.hil.runtime.clock import Event
from highfive.hil.sim.arm_as_calibrated import correct
from highfive.hil.sim.arm_plant import ArmPlant
from highfive.model.geometry.rotations import Array

SUBSTEPS = 8
LEAST_NS = 1_000_000
WARM = 35.0
"""°C that its servos say."""


class SimulatedDriver:
    """An arm that is driven as :class:`highfive.hil.drivers.bus.arm_process.ArmProcess` is. It is its own clock: time
    goes on while somebody waits.
    """

    trouble = ""

    def __init__(self, plant: ArmPlant, full: Array, now_ns: int = 1, folder: ArmFolder | None = None) -> None:
        """At rest.

        Args:
            plant: the body.
            full: (J,) rad, error at which each servo gives its full voltage.
            now_ns: what its clock says first.
            folder: which arm; None for the default one.
        """
        self._plant, self._full = plant, full
        folder = folder or find_arm()
        (self._stall, self._no_load), self._stall_currents = folder.each, folder.stall_currents
        self._supply = folder.voltages
        self._positions, self._velocities = plant.step(np.zeros(len(full)), 0.0)
        self._torques = np.zeros(len(full))
        self._command: JointCommand | None = None
        self._now, self._number = now_ns, 0
        self._cycles: list[Cycle] = []
        self._cycle(0)

    @property
    def mode(self) -> Mode:
        """What it is doing."""
        return Mode.HOLDING if self._command is None else Mode.DRIVING

    def now(self) -> int:
        """ns"""
        return self._now

    def drive(self, command: JointCommand) -> None:
        """What its servos are commanded from now on."""
        self._command = command

    def newest(self) -> Cycle | None:
        """The last cycle."""
        return self._cycles[-1]

    def unread(self) -> list[Cycle]:
        """The cycles since the last call."""
        found, self._cycles = self._cycles, self._cycles[-1:]
        return found[1:]

    def pass_over(self) -> None:
        """Leaves out the cycles since the last call."""
        self._cycles = self._cycles[-1:]

    def wait_until(self, time_ns: int) -> None:
        """Lets time pass; a millisecond at least, so that whoever waits for something gets there."""
        self._advance(max(time_ns - self._now, LEAST_NS))

    def wait_for(self, event: Event, until_ns: int) -> bool:
        """Lets time pass until then; nothing happens meanwhile. Had it happened before?"""
        if event.due_ns is None:
            self.wait_until(until_ns)
        return event.due_ns is not None

    def _advance(self, nanoseconds: int) -> None:
        goal = self._positions if self._command is None else self._command.positions
        current = self._stall_currents if self._command is None else self._command.currents
        most = self._stall * np.minimum(1.0, current / self._stall_currents)
        for _ in range(SUBSTEPS):
            voltage = np.clip((goal - self._positions) / self._full, -1.0, 1.0)
            self._torques = np.clip(self._stall * (voltage - self._velocities / self._no_load), -most, most)
            self._positions, self._velocities = self._plant.step(self._torques, 1e-9 * nanoseconds / SUBSTEPS)
        self._now += nanoseconds
        self._cycle(nanoseconds)

    def _cycle(self, nanoseconds: int) -> None:
        joints = len(self._full)
        state = JointState(
            self._now, self._positions.copy(), self._velocities.copy(),
            self._torques / self._stall * self._stall_currents,
            np.zeros(joints, dtype=np.int64), np.ones(joints, dtype=bool), np.zeros(joints, dtype=bool),
            np.zeros(joints),
        )  # fmt: skip
        begun = self._now - nanoseconds
        health = JointHealth(self._now, np.full(joints, WARM), self._supply)
        self._cycles.append(Cycle(self._number, self.mode, begun, begun, nanoseconds, self._command, state, health))
        self._number += 1


def mounted_arm(arm: str = DEFAULT_ARM) -> ArmPlant:
    """An arm, by its name or folder, on its mount, where it rests; after ``::`` the file of its calibration."""
    name, _, file = arm.partition("::")
    folder = find_arm(name)
    if not file:
        return ArmPlant(folder.mount, resting_pose(folder), folder=folder)
    known = known_arm(folder, load_arm(Path(file)))
    assert known.corrections is not None
    change = partial(correct, folder=folder, base=known.packed.base_axes, by=known.corrections)
    return ArmPlant(known.mount, resting_pose(folder), change, folder=folder)
