"""What stops the arm: each rule looks at one thing and answers with a reason, or with nothing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from highfive.hil.drivers.servo_errors import hardware_errors
from highfive.hil.drivers.values import JointHealth, JointState
from highfive.hil.safety.limits import USUAL_VOLTAGE, Ceilings, Limits, Servo, Timing
from highfive.hil.safety.rules import Rule
from highfive.model.geometry.rotations import Array


@dataclass(frozen=True)
class Watch:
    """What has to last before it is a fault.

    Attributes:
        time_ns: of the last tick.
        heard_ns: for each joint, when it last answered.
        strayed_ns: for each joint, since when it has not been where it was commanded to be; None where it is.
        parted_ns: for each joint, since when its two servos have not agreed; None where they do.
        late: ticks in a row that came late.
        gap_s: s between the last two ticks; negative where time ran backwards.
    """

    time_ns: int
    heard_ns: tuple[int, ...]
    strayed_ns: tuple[int | None, ...]
    parted_ns: tuple[int | None, ...]
    late: int = 0
    gap_s: float = 0.0


def watch_from(now_ns: int, joints: int) -> Watch:
    """A watch that begins now."""
    return Watch(now_ns, (now_ns,) * joints, (None,) * joints, (None,) * joints)


def watched(limits: Limits, watch: Watch, arm: JointState | None, reference: Array | None, now_ns: int) -> Watch:
    """The watch one tick later, after a look at the arm, which had a ``reference`` (J,), rad."""
    gap = (now_ns - watch.time_ns) * 1e-9
    late = watch.late + 1 if gap > 1.5 * limits.timing.period_s else 0
    heard, strayed, parted = watch.heard_ns, watch.strayed_ns, watch.parted_ns
    if arm is not None:
        parted = tuple(
            since if not answered else (since or now_ns) if abs(apart) > limits.servo.shadow else None
            for apart, answered, since in zip(arm.apart.tolist(), arm.answered.tolist(), parted, strict=True)
        )
        heard = tuple(
            arm.time_ns if answered else last
            for answered, last in zip(arm.answered.tolist(), watch.heard_ns, strict=True)
        )
    if reference is None:
        strayed = (None,) * len(strayed)
    elif arm is not None:
        strayed = tuple(
            (since or now_ns) if abs(is_at - goal) > limits.servo.following else None
            for is_at, goal, since in zip(arm.positions.tolist(), reference.tolist(), strayed, strict=True)
        )
    return Watch(now_ns, heard, strayed, parted, late, gap)


def not_finite(name: str, array: NDArray[Any], shape: tuple[int, ...]) -> str:
    """Numbers that are none, or not so many as their ``shape`` says."""
    if array.shape != shape:
        return f"{name}: {array.shape} numbers came, {shape} were expected"
    if not all_finite(array):
        return f"{name}: {array.tolist()} are not all numbers"
    return ""


def all_finite(array: NDArray[Any]) -> bool:
    """Every number is one."""
    return all(map(math.isfinite, array.ravel().tolist()))


def servo_error(names: Sequence[str], arm: JointState | None) -> str:
    """Errors that servos report, and watchdogs that have tripped."""
    for joint, bits in enumerate([] if arm is None else arm.errors.tolist()):
        if bits:
            return f"the servo of {names[joint]} reports {', '.join(hardware_errors(bits))}"
    for joint, tripped in enumerate([] if arm is None else arm.tripped.tolist()):
        if tripped:
            return f"the servo of {names[joint]} stopped by itself: its watchdog heard nothing for too long"
    return ""


def silent_servo(names: Sequence[str], servo: Servo, watch: Watch, now_ns: int) -> str:
    """Joints that have not answered for too long."""
    last = min(watch.heard_ns)
    silent = (now_ns - last) * 1e-9
    if silent <= servo.silent_s:
        return ""
    longest = [joint for joint, heard in zip(names, watch.heard_ns, strict=True) if heard == last]
    return f"{', '.join(longest)} {'has' if len(longest) == 1 else 'have'} not answered for {1e3 * silent:.0f} ms"


def following(names: Sequence[str], servo: Servo, watch: Watch, now_ns: int) -> str:
    """Joints that have not been where they were commanded to be for too long."""
    joint, strayed = _longest(names, watch.strayed_ns, now_ns)
    if strayed <= servo.following_s:
        return ""
    return f"{joint} has been more than {servo.following:g} rad off for {1e3 * strayed:.0f} ms"


def shadow_mismatch(names: Sequence[str], servo: Servo, watch: Watch, now_ns: int) -> str:
    """Joints whose two servos have not agreed on where they are for too long."""
    joint, parted = _longest(names, watch.parted_ns, now_ns)
    if parted <= servo.shadow_s:
        return ""
    return f"the two servos of {joint} have been more than {servo.shadow:g} rad apart for {1e3 * parted:.0f} ms"


def _longest(names: Sequence[str], since_ns: Sequence[int | None], now_ns: int) -> tuple[str, float]:
    """The joint for which something has lasted longest, and how long, s; 0 s where it does for none."""
    began = min((one for one in since_ns if one is not None), default=now_ns)
    joint = names[since_ns.index(began)] if began in since_ns else ""
    return joint, (now_ns - began) * 1e-9


def health(servo: Servo, values: JointHealth | None, now_ns: int) -> str:
    """Temperatures and voltages that nobody has read for too long."""
    if values is None:
        return "temperatures and voltages have not been read"
    age = (now_ns - values.time_ns) * 1e-9
    return f"temperatures and voltages are {age:.1f} s old" if age > servo.health_s else ""


def temperature(names: Sequence[str], servo: Servo, values: JointHealth | None) -> str:
    """Servos that are too hot."""
    if values is None:
        return ""
    found = values.temperatures.tolist()
    hottest = max(found)
    if hottest <= servo.temperature:
        return ""
    return f"{names[found.index(hottest)]} has {hottest:.0f} °C, at most {servo.temperature:.0f}"


def voltage(own: Ceilings, servo: Servo, values: JointHealth | None) -> str:
    """Servos with too low or too high a voltage, beside what they are for."""
    for joint, found in enumerate([] if values is None else values.voltages.tolist()):
        share = own.voltages[joint] / USUAL_VOLTAGE
        low, high = share * servo.voltage_low, share * servo.voltage_high
        if not low <= found <= high:
            return f"{own.names[joint]} has {found:.1f} V, not {low:.1f} to {high:.1f}"
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
    limits: Limits, watch: Watch, arm: JointState | None, values: JointHealth | None, now_ns: int
) -> dict[Rule, str]:
    """Every reason to stop; all numbers are finite, see :func:`not_finite`."""
    names = limits.names
    reasons = {
        Rule.SERVO_ERROR: servo_error(names, arm),
        Rule.SILENT_SERVO: silent_servo(names, limits.servo, watch, now_ns),
        Rule.FOLLOWING: following(names, limits.servo, watch, now_ns),
        Rule.SHADOW_MISMATCH: shadow_mismatch(names, limits.servo, watch, now_ns),
        Rule.HEALTH: health(limits.servo, values, now_ns),
        Rule.TEMPERATURE: temperature(names, limits.servo, values),
        Rule.VOLTAGE: voltage(limits.ceilings, limits.servo, values),
        Rule.DEADLINE: deadline(limits.timing, watch),
    }
    return {rule: reason for rule, reason in reasons.items() if reason}
