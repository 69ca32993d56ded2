"""What passes between the servo arm, its driver and whatever stands in for it: one number a joint, in SI units.

Joints stand in the order of the rig's description (:mod:`highfive.hil.drivers.bus.rig`). A joint driven by two servos
is one number.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class JointCommand:
    """What the arm is commanded in one cycle.

    Attributes:
        positions: (J,) rad, where the joints shall be.
        currents: (J,) A, most that each servo may draw: the goal current of the current-based position mode.
    """

    positions: Array
    currents: Array


@dataclass(frozen=True)
class JointState:
    """What the arm said in one cycle.

    Attributes:
        time_ns: this process's monotonic clock when the last reply had come.
        positions: (J,) rad.
        velocities: (J,) rad/s.
        currents: (J,) A, positive where the joint pushes towards larger angles.
        errors: (J,) int, hardware error status, bits as in the servo's register; of two servos, all their bits.
        answered: (J,) bool, every servo of the joint answered in this cycle; where not, the numbers are its last ones.
        tripped: (J,) bool, the watchdog of one of its servos has stopped it, and it takes no goals.
        apart: (J,) rad, by how much the joint's second servo says more than its first; 0 where there is one.
    """

    time_ns: int
    positions: Array
    velocities: Array
    currents: Array
    errors: NDArray[np.int64]
    answered: NDArray[np.bool_]
    tripped: NDArray[np.bool_]
    apart: Array


class Plant(Protocol):
    """The body that emulated servos move."""

    def step(self, torques: Array, seconds: float) -> tuple[Array, Array]:
        """Positions (J,), rad, and velocities (J,), rad/s, ``seconds`` later, with ``torques`` (J,), N·m, on them."""
        ...


@dataclass(frozen=True)
class JointHealth:
    """What the servos said of themselves.

    Attributes:
        time_ns: this process's monotonic clock when the oldest of these numbers had come.
        temperatures: (J,) °C; of two servos, the hotter one's.
        voltages: (J,) V at the servo; of two servos, the lower one's.
    """

    time_ns: int
    temperatures: Array
    voltages: Array
