"""The plate as its drawing or jig says: where its markers are, its middle, and which way it faces.

Markers show where they are themselves, never where the plate's surface is: that follows from this file alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from highfive.calibration.placement_file import vector
from highfive.calibration.rigid_fit import rigid_fit
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting
from highfive.model.toml_file import check_keys, read_toml, table


@dataclass(frozen=True)
class TemplateSettings(Settings):
    """What a template may be, and how near the plate's markers have to be to it."""

    largest: float = setting(0.5, "m", above=0.0)
    """Most that a place is from the middle: further off, the unit is wrong."""
    apart: float = setting(0.010, "m", above=0.0)
    """Least between two markers, and least width of the group: nearer ones are taken for each other."""
    worst: float = setting(0.003, "m", above=0.0)
    """Most that markers may be off it (root mean square): they are glued to 0.5 mm, a swap of neighbours is 30 mm."""
    distinct: float = setting(0.005, "m", above=0.0)
    """Least that a swap of two markers changes the group's shape by: else nobody could tell it."""


TEMPLATE = TemplateSettings()


@dataclass(frozen=True)
class PlateTemplate:
    """A plate with M markers, in the axes of the arm's last joint where it is mounted as drawn.

    Attributes:
        names: (M,) of the markers, as the motion capture says them.
        places: (M, 3) m, of the markers from the middle of the plate's surface.
        centre, normal: (3,) m from the last joint, and a unit vector out of the plate.
    """

    names: tuple[str, ...]
    places: Array
    centre: Array
    normal: Array

    @property
    def markers(self) -> Array:
        """(M, 3) m, in the last joint's frame."""
        return self.places + self.centre


def template_text(template: PlateTemplate) -> str:
    """Its file."""
    markers = [f"{name} = {_metres(at)}" for name, at in zip(template.names, template.places, strict=True)]
    return "\n".join(
        [
            "[plate]",
            f"centre_m = {_metres(template.centre)} # middle of the surface, from the last joint",
            f"normal = {template.normal.tolist()}",
            "",
            "[markers] # from the middle of the surface, m",
            *markers,
            "",
        ]
    )


def _metres(place: Array) -> list[float]:
    """To a micrometre."""
    return np.round(place, 6).tolist()


def load_template(path: Path, settings: TemplateSettings = TEMPLATE) -> PlateTemplate:
    """Reads a plate's template.

    Raises:
        HighFiveError: there is none, or no plate is like that; one line says what.
    """
    data = read_toml(path, "the plate's template")
    try:
        check_keys(data, "the file", {"plate", "markers"})
        plate, markers = table(data, "plate"), table(data, "markers")
        check_keys(plate, "[plate]", {"centre_m", "normal"})
        names = tuple(markers)
        places = np.array([vector(markers, "markers.", name, 3) for name in names]).reshape(-1, 3)
        found = PlateTemplate(
            names, places, vector(plate, "plate.", "centre_m", 3), vector(plate, "plate.", "normal", 3)
        )
        check_template(found, settings)
    except HighFiveError as error:
        raise HighFiveError(f"{path} is no template of a plate: {error}") from None
    return found


def check_template(template: PlateTemplate, settings: TemplateSettings = TEMPLATE) -> None:
    """Three markers or more, apart, not in a line, no two of which could be taken for each other.

    Raises:
        HighFiveError: it is not so.
    """
    names, places = template.names, template.places
    if len(names) < 3:
        raise HighFiveError(f"it has {len(names)} markers; a plate's place and normal need three, five are better")
    if abs(math.hypot(*template.normal) - 1.0) > 1e-6:
        raise HighFiveError("plate.normal is no unit vector")
    if (far := float(np.abs(np.vstack([places, template.centre])).max())) > settings.largest:
        raise HighFiveError(f"a place is {far:g} m off, at most {settings.largest:g}; is it in millimetres?")
    gaps = {(a, b): float(np.linalg.norm(places[a] - places[b])) for a, b in combinations(range(len(names)), 2)}
    (a, b), least = min(gaps.items(), key=lambda item: item[1])
    if least < settings.apart:
        raise HighFiveError(
            f"{names[a]} and {names[b]} are {1e3 * least:.1f} mm apart, {1e3 * settings.apart:g} needed"
        )
    if np.linalg.svd(places - places.mean(axis=0))[1][1] < settings.apart:
        raise HighFiveError("its markers lie in a line, about which nobody sees it turn")
    for a, b in gaps:
        if (change := rigid_fit(_swapped(places, a, b), places).rms) < settings.distinct:
            raise HighFiveError(
                f"{names[a]} and {names[b]} swapped look the same to {1e3 * change:.1f} mm; move one of them"
            )


def swapped_markers(template: PlateTemplate, seen: Array) -> tuple[str, str] | None:
    """The two markers whose labels are swapped in places (M, 3), m, all seen; None where they fit the template best."""
    best, found = rigid_fit(template.places, seen).rms, None
    for a, b in combinations(range(len(seen)), 2):
        if (rms := rigid_fit(_swapped(template.places, a, b), seen).rms) < 0.5 * best:
            best, found = rms, (template.names[a], template.names[b])
    return found


def _swapped(places: Array, a: int, b: int) -> Array:
    order = np.arange(len(places))
    order[[a, b]] = b, a
    return places[order]
