"""How far off the lags are that ``highfive calibrate latency`` finds: of arms whose servos are late by what is known.

Each servo acts on its goals 0 to 15 ms after they came, drawn for each joint. What is found is held against what is
found of the same arm without that, and the delay: an independent truth of the servo's own cycle there is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from highfive.hil.arm.arm_files import limits_of
from highfive.hil.arm.arm_options import VIRTUAL, ArmOptions
from highfive.hil.arm.driven_arm import virtual_driven_arm
from highfive.hil.arm.rig_planner import sags
from highfive.hil.arm.servo_lags import lead_along, servo_lags
from highfive.hil.arm_model.servo_arm import default_arm
from highfive.hil.bench.perturbed_arm import DELAY_S, drawn_perturbation, perturbed_bus
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.emulator.virtual_rig import VirtualRig
from highfive.hil.runtime.console import Bar
from highfive.hil.runtime.threads import parallel_map
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.model.geometry.rotations import Array

_AT_ONCE = 1e-6  # s; an emulated servo looks once a millisecond for goals that wait, also for these


@dataclass(frozen=True)
class LateArm:
    """An arm of the files but for its servos, which are late.

    Attributes:
        seed: of what is left to chance.
        late: s, of each joint.
    """

    seed: int
    late: tuple[float, ...]


def lags_found(arm: LateArm) -> tuple[float, ...]:
    """s, of each joint, as ``calibrate latency`` finds them in virtual time."""
    body, rig = default_arm(), load_rig()
    count, ones = body.joints, np.ones(body.joints)
    as_drawn = replace(
        drawn_perturbation(arm.seed), masses=ones, friction=ones, torques=ones, play=np.zeros(count), delay_s=0.0,
        voltage=12.0, zeros=np.zeros(count),
    )  # fmt: skip
    with VirtualClock(arm.seed) as clock:
        bus = perturbed_bus(as_drawn, rig)
        late = dict(zip(body.folder.names, arm.late, strict=True))
        for servo in bus.servos:
            servo.delay_ns = round(1e9 * late[rig.servos[servo.id].name])  # pyright: ignore[reportAttributeAccessIssue]
        virtual, slow = VirtualRig(clock, bus), ArmOptions(VIRTUAL, slow=True)
        with virtual_driven_arm(virtual, slow, body, lambda: "") as drive:
            led = lead_along(drive, body, limits_of(body.folder), body.folder.names)
    found = servo_lags(led, body, limits_of(body.folder), reply=rig.reply_s, sag=sags(rig, body.folder))
    return tuple(found[name].lag for name in body.folder.names)


def lag_errors(seeds: Sequence[int], bar: Bar) -> Array:
    """(arms, J) s, by which lags are off."""
    joints = default_arm().joints
    arms = [
        LateArm(seed, tuple(np.random.default_rng((seed, 4)).uniform(0.0, DELAY_S, joints).tolist())) for seed in seeds
    ]
    jobs = [LateArm(seeds[0], (_AT_ONCE,) * joints), *arms]
    plain, *found = parallel_map(lags_found, jobs, lambda total: bar("lags", total))
    return np.array(found) - np.array(plain) - np.array([arm.late for arm in arms])
