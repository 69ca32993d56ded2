"""The plate of a fitted arm, and how far it was from where it was seen in poses that were held out of the fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from highfive.calibration.arm_fit import ALL, ARM_FIT, ArmFit, ArmFitSettings, fit_arm
from highfive.calibration.arm_kinematics import ArmShape
from highfive.calibration.arm_poses import ArmPoses
from highfive.calibration.plate_template import TEMPLATE, PlateTemplate, TemplateSettings
from highfive.calibration.rigid_fit import rigid_fit
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

LOOSE_M = 0.002
"""m by which a marker that is glued on is never off: it is seen to 0.5 mm."""
_FEWEST = 3

FOLDS = 5
"""Every fifth pose is held out, five times."""


@dataclass(frozen=True)
class Plate:
    """A plate in the last joint's frame.

    Attributes:
        centre, normal: (3,) m and a unit vector, of its surface.
        rms: m, by which the fitted markers are off the template.
    """

    centre: Array
    normal: Array
    rms: float

    def at(self, places: Array, axes: Array) -> tuple[Array, Array]:
        """Centres and normals (N, 3) with the last joint's frames there: places (N, 3), axes (N, 3, 3)."""
        return places + axes @ self.centre, axes @ self.normal


def plate_of_fit(fit: ArmFit, template: PlateTemplate, settings: TemplateSettings = TEMPLATE) -> Plate:
    """The plate's surface, from where its markers came out.

    Raises:
        HighFiveError: they lie otherwise than the template says; one line names the worst.
    """
    places = fit.shape.markers + fit.errors.marker
    found = rigid_fit(template.places, places)
    if found.rms > settings.worst:
        off = np.linalg.norm(places - found.apply(template.places), axis=1)
        worst = int(np.argmax(off))
        raise HighFiveError(
            f"the plate's markers are {1e3 * found.rms:.1f} mm off their template (root mean square), at most "
            f"{1e3 * settings.worst:g}; {template.names[worst]} is off most, {1e3 * off[worst]:.1f} mm"
        )
    return Plate(found.translation, found.rotation @ template.normal, found.rms)


def held_out(
    shape: ArmShape,
    poses: ArmPoses,
    up: Array,
    template: PlateTemplate,
    fitted: tuple[str, ...] = ALL,
    settings: ArmFitSettings = ARM_FIT,
) -> Array:
    """Distances (N,), m, of the plate's middle from where it was seen, each pose by a fit that did not know it.

    Where it was seen: the fitted plate laid on the markers of that pose alone. NaN where fewer than three were seen.

    Raises:
        HighFiveError: as :func:`~highfive.calibration.arm_fit.fit_arm`.
    """
    numbers, found = np.arange(len(poses)), np.full(len(poses), np.nan)
    for fold in range(FOLDS):
        out = numbers % FOLDS == fold
        fit = fit_arm(shape, poses.only(~out), up, fitted, settings)
        plate = plate_of_fit(fit, template)
        _, places, axes = fit.predicted(poses.encoders, poses.sides)
        centres = plate.at(places, axes)[0]
        own = shape.markers + fit.errors.marker
        for n in numbers[out]:
            seen = poses.seen[n]
            if seen.sum() >= 3:
                laid = rigid_fit(own[seen], poses.markers[n, seen], settings.marker_noise * settings.cut)
                found[n] = float(np.linalg.norm(centres[n] - laid.apply(plate.centre)))
    return found


def check_loose(fit: ArmFit, poses: ArmPoses, template: PlateTemplate, most: float = LOOSE_M) -> None:
    """Refuses markers that moved on the plate between poses.

    In each pose the others say where a marker has to be; one that is ``most`` (m) off in a quarter of them is loose.

    Raises:
        HighFiveError: which one, and how far it moved.
    """
    own = fit.shape.markers + fit.errors.marker
    off = np.full(poses.seen.shape, np.nan)
    for n, seen in enumerate(poses.seen):
        for m in np.flatnonzero(seen):
            others = seen.copy()
            others[m] = False
            if others.sum() >= _FEWEST:
                laid = rigid_fit(own[others], poses.markers[n, others])
                off[n, m] = np.linalg.norm(poses.markers[n, m] - laid.apply(own[m]))
    if np.isnan(off).all(axis=0).any():
        return
    moved = np.nanpercentile(off, 75, axis=0)
    worst = int(np.argmax(moved))
    if moved[worst] > most:
        raise HighFiveError(
            f"the marker {template.names[worst]} is loose: it was {1e3 * moved[worst]:.1f} mm from its place beside "
            "the others in a quarter of the poses; glue it, and take the poses again"
        )
