"""Addresses of several systems that see one person: ``vicon://a+qtm://b?at=1.2,0.4,0,90``."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from highfive.mocap_bridge.sources.marker_merge import Placed
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations

AT, PERSON = "at", "person"
"""Options of each system in it: where its origin stands in the frame of the first one (x, y, z, m, and by how many
degrees it is turned about the vertical), and the prefix of the person's markers."""

_NEXT = re.compile(r"\+(?=[A-Za-z][\w.-]*://|webcam$|headset(?:$|[?+]))")


@dataclass(frozen=True)
class Part:
    """One system of several.

    Attributes:
        address: of it alone.
        placed: where it stands in the frame of the first one.
        person: prefix of the person's markers; None where it is not said.
    """

    address: str
    placed: Placed
    person: str | None = None


def parts_of(text: str) -> tuple[str, ...]:
    """The addresses in an address; one where it is of one system."""
    return tuple(part.strip() for part in _NEXT.split(text.strip())) if "://" in text else (text,)


def merged_part(text: str) -> Part:
    """One of several systems: :data:`AT` and :data:`PERSON` are taken from its options.

    Raises:
        HighFiveError: the place is not four numbers.
    """
    address, _, query = text.partition("?")
    options = [option.partition("=") for option in query.split("&") if option]
    own = {key: value for key, _, value in options if key in (AT, PERSON)}
    rest = "&".join("".join(option) for option in options if option[0] not in own)
    return Part(f"{address}?{rest}" if rest else address, _placed(text, own.get(AT, "0,0,0,0")), own.get(PERSON))


def _placed(text: str, at: str) -> Placed:
    try:
        x, y, z, degrees = (float(value) for value in at.split(","))
    except ValueError:
        x = y = z = degrees = math.nan
    if not all(map(math.isfinite, (x, y, z, degrees))):
        raise HighFiveError(f"address {text!r}: at is {at!r}; expected x,y,z in m and degrees, as in at=1.2,0.4,0,90")
    return Placed(rotations.from_axis_angle("z", math.radians(degrees)), np.array([x, y, z]))
