"""Postures that an arm can take where nobody is: for calibrations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from highfive.hil.arm_model.servo_arm import ServoArm
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class PostureSettings(Settings):
    """Which postures a calibration may take."""

    candidates: int = setting(300, least=30)
    clearance: float = setting(0.04, "m", above=0.0)
    """From floor, mount and the arm itself, in a posture and on the way to it: the base is known to 20 mm then."""
    margin: float = setting(float(np.radians(8.0)), "rad", above=0.0)
    """From the joints' limits: zeros may be off, and both sides of approach take some."""
    lowest: float = setting(0.7, "m", above=0.0)
    """Of the plate: below, mount and table hide it from cameras."""
    facing: float = setting(-0.3, least=-1.0, most=1.0)
    """Least share of the plate's normal that points away from the base, where cameras are; -1 for all round."""


POSTURES = PostureSettings()

RESTS = 0.005
"""m: an arm that rests on something gives way by no more."""


def free_postures(arm: ServoArm, seed: int, settings: PostureSettings = POSTURES) -> Array:
    """Random postures (C, J), rad, in which the arm is clear of everything and its plate can be seen."""
    rng, packed = np.random.default_rng(seed), arm.packed
    low, high = packed.low + settings.margin, packed.high - settings.margin
    found: list[Array] = []
    for _ in range(200 * settings.candidates):
        joints = rng.uniform(low, high)
        pose = arm.plate_at(joints)
        away = pose.position - np.asarray(arm.mount.position)
        ahead = float(pose.normal @ away) / float(np.linalg.norm(away))
        if pose.position[2] < settings.lowest or ahead < settings.facing or arm.clearance(joints) < settings.clearance:
            continue
        found.append(joints)
        if len(found) == settings.candidates:
            break
    return np.array(found)


def check_way(arm: ServoArm, start: Array, end: Array, release: str) -> None:
    """Refuses a straight way, from where an arm was found, on which it would meet floor, mount or itself.

    A limp arm may rest on one of them: then it comes no nearer. ``release`` is the command that makes it limp.

    Raises:
        HighFiveError: it would.
    """
    if not way_is_free(arm, start, end, min(0.0, arm.clearance(start)) - RESTS):
        raise HighFiveError(
            "the straight way from where the arm is to where it waits leads through the floor, its mount or itself; "
            f"move it by hand ({release}), and start again"
        )


def way_is_free(arm: ServoArm, start: Array, end: Array, clearance: float, step: float = 0.05) -> bool:
    """Whether the arm is clear of everything on the straight way between two postures (J,), rad."""
    return arm.clearance(start) >= clearance and last_free(arm, start, end, clearance, step) is end


def last_free(arm: ServoArm, start: Array, end: Array, clearance: float, step: float = 0.05) -> Array:
    """The last posture (J,), rad, on the straight way to ``end`` up to which the arm is clear of everything; ``end``
    itself, where all of it is. ``start`` is not looked at."""
    before, steps = start, max(1, int(np.ceil(np.abs(end - start).max() / step)))
    for share in np.linspace(0.0, 1.0, steps + 1)[1:]:
        posture = start + share * (end - start)
        if arm.clearance(posture) < clearance:
            return before
        before = posture
    return end
