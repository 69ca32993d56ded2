"""How fast wire and body moved, near the person and anywhere, and how suddenly: laws for sessions under faults."""

from __future__ import annotations

import numpy as np

from highfive.hil.arm.arm_trial import ArmTrial
from highfive.hil.arm.planner import Retarget
from highfive.hil.bench.black_box import BlackBox
from highfive.hil.bench.fault_laws import Laws
from highfive.hil.safety.limits import Limits


def judge_motion(
    laws: Laws, trial: ArmTrial, box: BlackBox, limits: Limits, planner: Retarget, sound_until_ns: int
) -> None:
    """TBD"""
