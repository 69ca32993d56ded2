"""What to do where the computer was too busy for the arm."""

from __future__ import annotations

import getpass
import re
from collections.abc import Sequence

from highfive.hil.arm.arm_trial import ArmTrial
from highfive.hil.drivers.bus.cycle_ring import Cycle
from highfive.hil.drivers.priority import PRIORITY, may_go_first
from highfive.hil.safety.rules import Rule

LATE_NS = 20_000_000
"""A cycle of the bus that begins so late, ns, says that its process did not get the processor."""

_PAUSED = re.compile(r"the loop paused for \d|\d commands in a row were late")  # as hil.safety.faults.deadline says it
_SILENT = re.compile(r"ha(s|ve) not answered for \d")  # as hil.safety.faults.silent_servo does
_AT_THE_END = 30  # cycles: a quarter of a second


def too_busy(trial: ArmTrial | None, cycles: Sequence[Cycle] = (), why: str = "") -> str:
    """What to do, in one line, if the arm was stopped because loop or bus came too late; '' if for anything else.

    Args:
        trial: the high five in which it was stopped, or after which; None where that was too short to be one.
        cycles: of the bus, those after the trial's.
        why: the reason it was stopped for, in words: between two high fives no tick of a trial has it.
    """
    acted = set() if trial is None else {rule for tick in trial.ticks for rule in tick.report.acted}
    last = [*(() if trial is None else trial.cycles[-_AT_THE_END:]), *cycles[:_AT_THE_END]]
    late = any(cycle.begun_ns - cycle.due_ns > LATE_NS for cycle in last)
    paused = Rule.DEADLINE in acted or _PAUSED.search(why)
    silent = Rule.SILENT_SERVO in acted or _SILENT.search(why)
    if not paused and not (late and silent):
        return ""
    advice = "the computer was too busy: end other programs"
    if not may_go_first():
        line = f"{getpass.getuser()} - rtprio {PRIORITY}"
        advice += (
            ", or let this one go before them (real-time priority), once: "
            f"echo '{line}' | sudo tee /etc/security/limits.d/highfive.conf, then log in again"
        )
    return advice
