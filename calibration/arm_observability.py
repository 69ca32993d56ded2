"""What poses tell of an arm, by name: joints that moved too little, and numbers that stayed as they were believed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from highfive.calibration.arm_fit import ArmFit
from highfive.calibration.arm_kinematics import KINDS, ArmErrors
from highfive.calibration.arm_poses import ArmPoses
from highfive.model.errors import HighFiveError
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class ExcitationSettings(Settings):
    """What poses have to show."""

    least_range: float = setting(float(np.radians(30.0)), "rad", above=0.0)
    """Of each joint's angles: with less, its zero goes into the base or the plate."""
    unknown: float = setting(0.9, above=0.0, below=1.0)
    """A number that is still so unsure, of what was believed before, was not observed."""


EXCITATION = ExcitationSettings()

_AXES = ("x", "y", "z")


def check_excitation(names: Sequence[str], poses: ArmPoses, settings: ExcitationSettings = EXCITATION) -> None:
    """Refuses poses that leave a joint nearly where it was.

    Raises:
        HighFiveError: which joints, and how far they moved.
    """
    ranges = np.ptp(poses.encoders, axis=0)
    if still := [n for n in range(len(names)) if ranges[n] < settings.least_range]:
        moved = ", ".join(f"{names[n]} {np.degrees(ranges[n]):.0f}°" for n in still)
        raise HighFiveError(
            f"the poses do not tell these joints' zeros: {moved} from end to end, "
            f"{np.degrees(settings.least_range):.0f}° are needed; take other poses"
        )


def parameter_names(joints: Sequence[str], errors: ArmErrors) -> tuple[str, ...]:
    """(P,) of :meth:`ArmErrors.packed`, such as ``zero elbow`` or ``tilt waist x``."""
    found: list[str] = []
    for kind in KINDS:
        own = getattr(errors, kind)
        if kind.startswith("base"):
            found += [f"{kind} {axis}" for axis in _AXES]
        elif own.ndim == 1:
            found += [f"{kind} {joint}" for joint in joints]
        else:
            over = [str(n + 1) for n in range(len(own))] if kind == "marker" else joints
            parts = ("sine", "cosine") if kind == "ripple" else _AXES
            found += [f"{kind} {one} {part}" for one in over for part in parts]
    return tuple(found)


def not_observed(fit: ArmFit, settings: ExcitationSettings = EXCITATION) -> tuple[str, ...]:
    """Names of what was fitted, and is about as unsure as before. Nothing of it moves the plate within the poses."""
    names = parameter_names(fit.shape.names, fit.errors)
    free = fit.priors > 0.0
    unsure = np.zeros(len(names), bool)
    unsure[free] = fit.sigmas[free] > settings.unknown * fit.priors[free]
    return tuple(name for name, one in zip(names, unsure, strict=True) if one)
