"""High fives on the emulated rig in virtual time, each on a rig of its own that was just switched on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.arm_trial import ArmTrial, played_until_stopped
from highfive.hil.arm.contact_outcome import ReferenceTrajectory
from highfive.hil.arm.lifecycle import emulator_options, virtual_arm
from highfive.hil.arm.planner import Retarget
from highfive.hil.arm.preconditions import check_options
from highfive.hil.arm.rig_planner import planner
from highfive.hil.drivers.emulator.emulator_process import make_bus
from highfive.hil.drivers.emulator.virtual_rig import VirtualRig
from highfive.hil.runtime.virtual_clock import VirtualClock


@dataclass(frozen=True)
class VirtualPlay:
    """What is played: a high five, with the seed of what is left to chance."""

    reference: ReferenceTrajectory
    seed: int = 0


@cache
def default_planner() -> Retarget:
    """Retargeting for the arm that comes with the project; one for all that is played in this process."""
    limits, rig = check_options(ArmOptions())
    return planner(rig, limits)


def play_virtually(play: VirtualPlay) -> tuple[ArmTrial | None, str]:
    """What the arm did, None where it hardly began; and why it was stopped, '' where it was not.

    Raises:
        HighFiveError: it was not allowed to begin.
    """
    with VirtualClock(play.seed) as clock:
        virtual = VirtualRig(clock, make_bus(emulator_options(ArmOptions())))
        with virtual_arm(virtual, retarget=default_planner()) as loop:
            return played_until_stopped(play.reference, loop), loop.trouble
