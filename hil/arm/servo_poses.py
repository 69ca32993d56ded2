"""What a calibration of servos has the arm do: postures from both sides, and each joint up and down at one speed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from highfive.calibration.arm_kinematics import ArmShape
from highfive.calibration.joint_friction import friction_torque
from highfive.calibration.pose_choice import choose_poses
from highfive.calibration.pose_file import TakenPose
from highfive.calibration.servo_fit import SERVOS
from highfive.hil.arm.extrinsics import taken
from highfive.hil.arm.free_postures import POSTURES, free_postures, way_is_free
from highfive.hil.arm.plate_watch import PlateWatch
from highfive.hil.arm.posture_drive import PostureDrive
from highfive.hil.arm_model.servo_arm import ServoArm
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

ASIDE = np.radians(2.0)
"""rad, from which each joint comes: eight times the gears' play."""
SWEEP, SWEEP_SPEED = 0.12, 0.15
"""rad to either side of where the arm waits, and rad/s: there and back."""


def pair_postures(arm: ServoArm, shape: ArmShape, count: int, seed: int) -> tuple[Array, Array]:
    """Postures (N, J), rad, that tell most of servos, and from which side (N, J), ± 1, each joint comes first.

    Raises:
        HighFiveError: too few are free, with the ways to both sides.
    """
    free = free_postures(arm, seed)
    sides = np.random.default_rng((seed, 3)).choice([-1.0, 1.0], free.shape)
    clear = [
        way_is_free(arm, q - ASIDE * side, q + ASIDE * side, POSTURES.clearance)
        for q, side in zip(free, sides, strict=True)
    ]
    free, sides = free[clear], sides[clear]
    chosen = choose_poses(shape, free, count, SERVOS[:2])
    return free[chosen], sides[chosen]


def take_pairs(
    drive: PostureDrive,
    watch: PlateWatch,
    stages: Sequence[Array],
    postures: Array,
    sides: Array,
    before: Sequence[TakenPose],
    kept: Callable[[list[TakenPose]], object],
) -> list[TakenPose]:
    """Each posture (N, J), rad, twice, every joint first from one of its ``sides`` (N, J), then from the other.

    Args:
        drive, watch: arm and plate.
        stages: :func:`highfive.hil.arm.posture_route.route` through those that were not taken already.
        postures, sides: all, and from where.
        before: pairs that were taken already.
        kept: gets all pairs after each.

    Raises:
        HighFiveError: the arm was stopped, somebody stayed in the way, or the plate is not seen.
    """
    poses = list(before)
    for target in stages:
        drive.go(target)
        if not (which := np.flatnonzero((postures == target).all(axis=1))).size:
            continue
        pair = []
        for side in (sides[which[0]], -sides[which[0]]):
            drive.go(target - ASIDE * side)
            drive.go(target)
            pair.append(taken(drive, watch, target, side))
        poses += pair
        kept(poses)
    return poses


def frictions(drive: PostureDrive, arm: ServoArm, advance: Callable[[], object]) -> dict[str, float]:
    """N·m, that each joint's friction takes at :data:`SWEEP_SPEED`, about where the arm waits.

    Raises:
        HighFiveError: the arm was stopped, or a joint did not move steadily; which.
    """
    found = {}
    for joint, name in enumerate(arm.folder.names):
        along = SWEEP * np.eye(len(arm.ready))[joint]
        drive.go(arm.ready - along)
        seconds = 2.0 * SWEEP / SWEEP_SPEED
        course = partial(_up_and_down, arm.ready, along, seconds)
        cycles = [cycle for cycle in drive.follow(course, 2.0 * seconds) if cycle.state.answered[joint]]
        strength = arm.folder.each[0][joint] / arm.folder.stall_currents[joint]
        angles, speeds, currents = (
            np.array([getattr(cycle.state, what)[joint] for cycle in cycles])
            for what in ("positions", "velocities", "currents")
        )
        try:
            found[name] = friction_torque(angles, speeds, strength * currents, SWEEP_SPEED)
        except HighFiveError as error:
            raise HighFiveError(f"{name}: {error}") from None
        drive.go(arm.ready)
        advance()
    return found


def _up_and_down(middle: Array, along: Array, seconds: float, now: float) -> Array:
    """From one side of a posture (J,) to the other and back, at constant speed, ``seconds`` each way."""
    return middle + along * (1.0 - 2.0 * abs(1.0 - min(now / seconds, 2.0)))
