"""What to do where the computer was too busy for the arm."""

from __future__ import annotations

import getpass
from collections.abc import Collection, Sequence

from highfive.hil.arm.arm_trial import ArmTrial
from highfive.hil.drivers.bus.cycle_ring import Cycle
from highfive.hil.drivers.priority import PRIORITY, may_go_first
from highfive.hil.safety.rules import Rule

LATE_NS = 20_000_000
"""A cycle of the bus that begins so late, ns, says that its process did not get the processor."""

LAST = 30
"""Cycles that are looked at: a quarter of a second."""


def too_busy(
    trial: ArmTrial | None,
    cycles: Sequence[Cycle] = (),
    stopped_by: Collection[Rule] = (),
    *,
    gone: bool = False,
    never_silent: bool = False,
) -> str:
    """What to do, in one line, if the arm was stopped because loop or bus came too late; '' if for anything else.

    Args:
        trial: the high five in which it was stopped, or after which; None where that was too short to be one.
        cycles: of the bus, those after the trial's; the watchdogs may have tripped in a pause.
        stopped_by: the rules that stopped it; none where its driver did, or its servos' watchdogs.
        never_silent: servos that are silent got no processor, and neither did a bus that is: they are emulated, and
            nothing is to go wrong with them.
        gone: the arm's driver or its port has ended: then all is late for that, however idle the computer.
    """
    if gone:
        return ""
    of_trial = () if trial is None else (*trial.cycles[-LAST:], *trial.back.cycles[-LAST:])
    last = [*of_trial, *cycles]
    late = any(cycle.begun_ns - cycle.due_ns > LATE_NS for cycle in last)
    silent = Rule.SILENT_SERVO in stopped_by or (not stopped_by and any(cycle.state.tripped.any() for cycle in last))
    if Rule.DEADLINE not in stopped_by and not ((late or never_silent) and silent):
        return ""
    advice = "the computer was too busy: end other programs"
    if not may_go_first():
        line = f"{getpass.getuser()} - rtprio {PRIORITY}"
        advice += (
            ", or let this one go before them (real-time priority), once: "
            f"echo '{line}' | sudo tee /etc/security/limits.d/highfive.conf, then log in again"
        )
    return advice
