"""What stops the arm: each rule looks at one thing and answers with a reason, or with nothing."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hil.drivers.values import JointHealth, JointState
from hil.safety.limits import JOINTS, Limits, Servo, Timing
from hil.safety.rules import Rule
from model.rotations import Array

ERROR_BITS = {0: "input voltage", 2: "overheating", 3: "motor encoder", 4: "electrical shock", 5: "overload"}
"""Of the servo's register Hardware Error Status (the maker's manual)."""


@dataclass(frozen=True)
class Watch:
    """What has to last before it is a fault.

    Attributes:
        time_ns: of the last tick.
        heard_ns: (J,) when each joint last answered.
        strayed_ns: (J,) since when each joint has not been where it was told to be; 0 where it is.
        late: ticks in a row that came late.
        gap_s: s between the last two ticks; negative where time ran backwards.
    """

    time_ns: int
    heard_ns: NDArray[np.int64]
    strayed_ns: NDArray[np.int64]
    late: int = 0
    gap_s: float = 0.0


def watch_from(now_ns: int) -> Watch:
    """A watch that begins now."""
    joints = len(JOINTS)
    return Watch(now_ns, np.full(joints, now_ns, dtype=np.int64), np.zeros(joints, dtype=np.int64))


def ticked(timing: Timing, watch: Watch, now_ns: int) -> Watch:
    """The watch one tick later."""
    gap = (now_ns - watch.time_ns) * 1e-9
    late = watch.late + 1 if gap > 1.5 * timing.period_s else 0
    return replace(watch, time_ns=now_ns, gap_s=gap, late=late)


def looked(servo: Servo, watch: Watch, arm: JointState, told: Array | None, now_ns: int) -> Watch:
    """The watch after a look at the arm, which had been ``told`` (J,), rad, to be somewhere."""
    heard = np.where(arm.answered, arm.time_ns, watch.heard_ns)
    if told is None:
        return replace(watch, heard_ns=heard, strayed_ns=np.zeros_like(watch.strayed_ns))
    strays = np.abs(arm.positions - told) > servo.following
    strayed = np.where(strays, np.where(watch.strayed_ns == 0, now_ns, watch.strayed_ns), 0)
    return replace(watch, heard_ns=heard, strayed_ns=strayed)


def not_finite(named: Iterable[tuple[str, Array, tuple[int, ...]]]) -> str:
    """Numbers, by name and with the shape they must have, that are none, or not so many."""
    for name, array, shape in named:
        if array.shape != shape:
            return f"{name}: {array.shape} numbers came, {shape} were expected"
        if not np.isfinite(array).all():
            return f"{name}: {array.tolist()} are not all numbers"
    return ""


def servo_error(arm: JointState | None) -> str:
    """Errors that servos report."""
    if arm is None or not arm.errors.any():
        return ""
    joint = int(np.flatnonzero(arm.errors)[0])
    bits = int(arm.errors[joint])
    names = [ERROR_BITS.get(bit, f"bit {bit}") for bit in range(8) if bits >> bit & 1]
    return f"the servo of {JOINTS[joint]} reports {', '.join(names)}"


def silent_servo(servo: Servo, watch: Watch, now_ns: int) -> str:
    """Joints that have not answered for too long."""
    silent = (now_ns - watch.heard_ns) * 1e-9
    joint = int(silent.argmax())
    if silent[joint] <= servo.silent_s:
        return ""
    return f"{JOINTS[joint]} has not answered for {1e3 * silent[joint]:.0f} ms"


def following(servo: Servo, watch: Watch, arm: JointState | None, told: Array | None, now_ns: int) -> str:
    """Joints that have not been where they were told to be for too long."""
    if arm is None or told is None or not watch.strayed_ns.any():
        return ""
    strayed = np.where(watch.strayed_ns == 0, 0.0, (now_ns - watch.strayed_ns) * 1e-9)
    joint = int(strayed.argmax())
    if strayed[joint] <= servo.following_s:
        return ""
    off = abs(float(arm.positions[joint] - told[joint]))
    return f"{JOINTS[joint]} has been {off:.2f} rad off for {1e3 * strayed[joint]:.0f} ms"


def health(servo: Servo, values: JointHealth | None, now_ns: int) -> str:
    """Temperatures and voltages that nobody has read for too long."""
    if values is None:
        return "temperatures and voltages have not been read"
    age = (now_ns - values.time_ns) * 1e-9
    return f"temperatures and voltages are {age:.1f} s old" if age > servo.health_s else ""


def temperature(servo: Servo, values: JointHealth | None) -> str:
    """Servos that are too hot."""
    if values is None:
        return ""
    joint = int(values.temperatures.argmax())
    found = float(values.temperatures[joint])
    return f"{JOINTS[joint]} has {found:.0f} °C, at most {servo.temperature:.0f}" if found > servo.temperature else ""


def voltage(servo: Servo, values: JointHealth | None) -> str:
    """Servos with too low or too high a voltage."""
    if values is None:
        return ""
    for joint in (int(values.voltages.argmin()), int(values.voltages.argmax())):
        found = float(values.voltages[joint])
        if not servo.voltage_low <= found <= servo.voltage_high:
            return f"{JOINTS[joint]} has {found:.1f} V, not {servo.voltage_low:.1f} to {servo.voltage_high:.1f}"
    return ""


def deadline(timing: Timing, watch: Watch) -> str:
    """A loop that is late again and again, or that paused for longer than the servos' watchdog waits."""
    if watch.gap_s < 0.0:
        return f"time ran {-1e3 * watch.gap_s:.1f} ms backwards"
    if watch.gap_s >= timing.watchdog_s:
        return (
            f"the loop paused for {1e3 * watch.gap_s:.0f} ms, the servos' watchdog waits {1e3 * timing.watchdog_s:.0f}"
        )
    if watch.late >= timing.late_run:
        return f"{watch.late} commands in a row were late"
    return ""


def faults(
    limits: Limits,
    watch: Watch,
    arm: JointState | None,
    told: Array | None,
    values: JointHealth | None,
    now_ns: int,
) -> dict[Rule, str]:
    """Every reason to stop; all numbers are finite, see :func:`not_finite`."""
    reasons = {
        Rule.SERVO_ERROR: servo_error(arm),
        Rule.SILENT_SERVO: silent_servo(limits.servo, watch, now_ns),
        Rule.FOLLOWING: following(limits.servo, watch, arm, told, now_ns),
        Rule.HEALTH: health(limits.servo, values, now_ns),
        Rule.TEMPERATURE: temperature(limits.servo, values),
        Rule.VOLTAGE: voltage(limits.servo, values),
        Rule.DEADLINE: deadline(limits.timing, watch),
    }
    return {rule: reason for rule, reason in reasons.items() if reason}
