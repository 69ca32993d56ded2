"""What moves an emulated servo: its controllers and its motor. Angles as its registers count them, in SI units.

The manual says which gain acts on what and that they divide by 128, 65 536 and 16; it does not say how often the
controllers run, nor the feedforward's units. Here they run as often as the emulator steps (1 ms), and the feedforward
gains have no effect. In current-based position mode the position controller gives a voltage, as in position mode, which
is then held back so that the current stays within the goal current.
"""

from __future__ import annotations

from collections.abc import Mapping

from highfive.hil.drivers.bus.control_table import Table
from highfive.hil.drivers.emulator.servo_profile import STEP, Profile, to_position, to_velocity

CURRENT, VELOCITY, POSITION, EXTENDED, CURRENT_POSITION, PWM = 0, 1, 3, 4, 5, 16
"""Operating modes."""

TIMED = 0x04
"""Bit of the drive mode: profiles are given by their times."""

FULL_DUTY = 885
"""Goal PWM at which the motor has all of the voltage."""

_POSITION_P, _POSITION_I, _POSITION_D = 128.0, 65_536.0, 16.0
_VELOCITY_P, _VELOCITY_I = 128.0, 65_536.0
_HEAT_K = 300.0
"""So much warmer than its surroundings a motor would become at stall current, K (an assumption; so is the next)."""
_HEAT_S = 600.0
_SURROUNDINGS = 25.0  # °C


class Motion:
    """The course that a servo follows, its controllers' memory, and what its motor does.

    Attributes:
        position, velocity: rad and rad/s, as they were when the last step began.
        current: A, which the motor draws; positive pushes towards larger angles.
        duty: share of the voltage that the motor has, −1 to 1.
        temperature: °C.
        profile: the course to the last goal, begun at ``begun``, s.
    """

    def __init__(self, table: Table) -> None:
        """At rest at 0, without a goal."""
        self._motor = table.motor
        self._scales = {name: table[name].scale for name in ("goal_position", "goal_velocity", "profile_acceleration")}
        self._ampere = table["goal_current"].scale if "goal_current" in table else 0.0
        self._pulse, self._resistance = self._scales["goal_position"], table.motor.voltage / table.motor.stall_current
        self.position = self.velocity = self.current = self.duty = 0.0
        self.temperature = _SURROUNDINGS + 5.0
        self.begun = 0.0
        self.profile = Profile(STEP, 0.0, 0.0, (), 0.0)
        self._integral = self._error = 0.0

    def reference(self, time: float) -> tuple[float, float]:
        """Position and velocity of the course."""
        return self.profile.at(time - self.begun)

    def ongoing(self, time: float) -> bool:
        """Whether the course has not come to its end."""
        return time - self.begun < self.profile.duration

    def hold(self, time: float) -> None:
        """Stay here."""
        self.profile, self.begun = Profile(STEP, self.position, 0.0, (), self.position), time
        self._integral = self._error = 0.0

    def go(self, values: Mapping[str, int], time: float) -> None:
        """Begin the course to the goal in the registers ``values``, from where the one before it is."""
        position, velocity = self.reference(time)
        timed = bool(values["drive_mode"] & TIMED)
        acceleration = values["profile_acceleration"] * (1e-3 if timed else self._scales["profile_acceleration"])
        if values["operating_mode"] == VELOCITY:
            goal = values["goal_velocity"] * self._scales["goal_velocity"]
            self.profile = to_velocity(position, velocity, goal, acceleration, timed=timed)
        else:
            goal = values["goal_position"] * self._scales["goal_position"]
            fastest = values["profile_velocity"]
            fastest = (
                fastest * 1e-3 if timed else min(fastest, values["velocity_limit"]) * self._scales["goal_velocity"]
            )
            self.profile = to_position(position, velocity, goal, fastest, acceleration, timed=timed)
        self.begun = time

    def torque(self, values: Mapping[str, int], time: float, seconds: float, voltage: float) -> float:
        """N·m on the output shaft for the next ``seconds``, at ``voltage`` V; mode, goals, gains are in ``values``."""
        if not values["torque_enable"]:
            self.current = self.duty = 0.0
            self._warm(seconds)
            return 0.0
        motor, mode = self._motor, values["operating_mode"]
        resistance = self._resistance
        generated = motor.voltage * self.velocity / motor.no_load_speed
        if mode == PWM:
            duty = values["goal_pwm"] / FULL_DUTY
        elif mode == CURRENT:
            duty = (values["goal_current"] * self._ampere * resistance + generated) / voltage
        elif mode == VELOCITY:
            duty = self._velocity_control(values, time, seconds)
        else:
            duty = self._position_control(values, time, seconds)
        most = abs(values["pwm_limit"] if mode == PWM else values["goal_pwm"]) / FULL_DUTY
        duty = min(most, max(-most, duty))
        current = (duty * voltage - generated) / resistance
        if mode == CURRENT_POSITION:
            strongest = min(abs(values["goal_current"]), values["current_limit"]) * self._ampere
            current = min(strongest, max(-strongest, current))
            duty = (current * resistance + generated) / voltage
        self.current, self.duty = current, duty
        self._warm(seconds)
        return current * motor.stall_torque / motor.stall_current

    def _position_control(self, values: Mapping[str, int], time: float, seconds: float) -> float:
        reference, _ = self.reference(time)
        error = (reference - self.position) / self._pulse
        steps = seconds * 1e3
        change, self._error = (error - self._error) / steps, error
        gain = values["position_i_gain"] / _POSITION_I
        self._integral = min(FULL_DUTY, max(-FULL_DUTY, self._integral + gain * error * steps)) if gain else 0.0
        output = values["position_p_gain"] / _POSITION_P * error + values["position_d_gain"] / _POSITION_D * change
        return (output + self._integral) / FULL_DUTY

    def _velocity_control(self, values: Mapping[str, int], time: float, seconds: float) -> float:
        _, reference = self.reference(time)
        error = (reference - self.velocity) / self._scales["goal_velocity"]
        gain = values["velocity_i_gain"] / _VELOCITY_I
        self._integral = min(FULL_DUTY, max(-FULL_DUTY, self._integral + gain * error * seconds * 1e3))
        return (values["velocity_p_gain"] / _VELOCITY_P * error + self._integral) / FULL_DUTY

    def _warm(self, seconds: float) -> None:
        share = self.current / self._motor.stall_current
        heat = _HEAT_K * share * share - (self.temperature - _SURROUNDINGS)
        self.temperature += heat * seconds / _HEAT_S
