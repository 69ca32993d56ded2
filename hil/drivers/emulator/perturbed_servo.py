"""An emulated servo that is not as its maker says: play, torque, and goals that it is late to act on."""

from __future__ import annotations

from collections import deque
from typing import Any

from highfive.hil.drivers.emulator.emulated_servo import EmulatedServo
from highfive.hil.drivers.servo_errors import Error


class PerturbedServo(EmulatedServo):
    """A servo with play in its joint, another torque, and goals that it is late to act on."""

    def __init__(self, *arguments: Any, **more: Any) -> None:
        """As the base class, in order."""
        self.play, self.factor, self.delay_ns = 0.0, 1.0, 0
        self._horn: float | None = None
        self._late: deque[tuple[int, int, bytes, bool]] = deque()
        super().__init__(*arguments, **more)

    def step(self, position: float, velocity: float, now_ns: int, seconds: float) -> float:
        """As the base class; the horn, whose angle the servo knows, follows the joint within the play."""
        half = 0.5 * self.play
        horn = position if self._horn is None else min(max(self._horn, position - half), position + half)
        self._horn = horn
        while self._late and self._late[0][0] <= now_ns:
            _, address, data, shadow = self._late.popleft()
            super().write(address, data, now_ns, shadow=shadow)
        return self.factor * super().step(horn, velocity, now_ns, seconds)

    def write(self, address: int, data: bytes, now_ns: int, *, shadow: bool = False) -> Error:
        """As the base class; goals of a servo with torque wait."""
        registers, error = self._check(address, data, shadow)
        goal = any(register.name == "goal_position" for register, _ in registers)
        if error or not goal or not self.delay_ns or not self.values["torque_enable"]:
            return super().write(address, data, now_ns, shadow=shadow)
        self._late.append((now_ns + self.delay_ns, address, data, shadow))
        return Error.NONE
