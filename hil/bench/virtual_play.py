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
from highfive.hil.arm_model.arm_folder import DEFAULT_ARM, find_arm
from highfive.hil.arm_model.servo_arm import mounted
from highfive.hil.drivers.emulator.emulator_process import make_bus
from highfive.hil.drivers.emulator.virtual_rig import VirtualRig
from highfive.hil.runtime.virtual_clock import VirtualClock


@dataclass(frozen=True)
class VirtualPlay:
    """What is played: a high five, with the seed of what is left to chance, and by which arm."""

    reference: ReferenceTrajectory
    seed: int = 0
    arm: str = DEFAULT_ARM


@cache
def default_planner(arm: str = DEFAULT_ARM) -> Retarget:
    """Retargeting for an arm; one for all that is played in this process."""
    limits, rig = check_options(ArmOptions(arm=arm))
    return planner(rig, limits, mounted(find_arm(arm)))


def play_virtually(play: VirtualPlay) -> tuple[ArmTrial | None, str]:
    """What the arm did, None where it hardly began; and why it was stopped, '' where it was not.

    Raises:
        HighFiveError: it was not allowed to begin.
    """
    options = ArmOptions(arm=play.arm)
    with VirtualClock(play.seed) as clock:
        virtual = VirtualRig(clock, make_bus(emulator_options(options)))
        with virtual_arm(virtual, options, default_planner(play.arm)) as loop:
            return played_until_stopped(play.reference, loop), loop.trouble
