"""From where a film and its pictures are taken: one of the scene's cameras, or anywhere around the two."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations

CAMERAS = ("wide", "close", "shoulder", "front")
"""Of the scene."""

BETWEEN = np.array([0.5, 0.0, 1.15])
"""(3,) m, half way between the two, at the height of their chests: what is looked at."""
HANDS = np.array([0.53, -0.2, 1.43])
"""(3,) m, amid the places where palms meet: what the camera ``close`` looks at, from :data:`NEAR`."""
NEAR = 1.06
"""m."""
FIELD_OF_VIEW = 36.0
"""°, upright, of a camera of one's own."""


@dataclass(frozen=True)
class Viewpoint:
    """Where the camera for whole high fives stands.

    Attributes:
        camera: one of the scene's; empty for a place of one's own.
        azimuth: °, about the vertical, in which it looks: 0 from the avatar's back towards the person, 90 from the
            avatar's right; as in MuJoCo's viewer.
        elevation: °, negative looks down.
        distance: m, from :data:`BETWEEN`.
    """

    camera: str
    azimuth: float = 0.0
    elevation: float = 0.0
    distance: float = 0.0

    def apply(self, model: Any) -> None:
        """Puts the camera ``wide`` of a MuJoCo model there; ``close`` then looks at the hands in the same direction."""
        self._stand(model)
        if self.camera in ("wide", "close"):
            return
        wide, close = model.camera("wide").id, model.camera("close").id
        ahead = -rotations.to_matrix(model.cam_quat[wide])[:, 2]
        model.cam_pos[close], model.cam_quat[close] = HANDS - NEAR * ahead, model.cam_quat[wide]
        model.cam_fovy[close] = FIELD_OF_VIEW

    def _stand(self, model: Any) -> None:
        wide = model.camera("wide").id
        if self.camera:
            other = model.camera(self.camera).id
            for values in (model.cam_pos, model.cam_quat, model.cam_fovy):
                values[wide] = values[other]
            return
        azimuth, elevation = math.radians(self.azimuth), math.radians(self.elevation)
        level = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        ahead = math.cos(elevation) * level + np.array([0.0, 0.0, math.sin(elevation)])
        right = np.array([level[1], -level[0], 0.0])
        axes = np.stack([right, np.cross(right, ahead), -ahead], axis=1)  # x to the right, y up, looks along -z
        model.cam_pos[wide] = BETWEEN - self.distance * ahead
        model.cam_quat[wide] = rotations.from_matrix(axes)
        model.cam_fovy[wide] = FIELD_OF_VIEW


def viewpoint(text: str) -> Viewpoint:
    """The viewpoint of a camera's name, or of ``AZIMUTH,ELEVATION,DISTANCE`` (°, °, m).

    Raises:
        HighFiveError: it is neither; the camera would be below the floor, or nowhere near.
    """
    if text in CAMERAS:
        return Viewpoint(text)
    try:
        azimuth, elevation, distance = (float(part) for part in text.split(","))
    except ValueError:
        raise HighFiveError(
            f"{text!r} is no view; expected {', '.join(CAMERAS)}, or AZIMUTH,ELEVATION,DISTANCE such as 90,-10,3"
        ) from None
    height = BETWEEN[2] - distance * math.sin(math.radians(elevation))
    if not (abs(azimuth) <= 360.0 and abs(elevation) <= 89.0 and 0.5 <= distance <= 10.0 and height > 0.05):
        raise HighFiveError(
            f"a view of {text}; expected -360 to 360°, -89 to 89° and 0.5 to 10 m, with the camera above the floor"
        )
    return Viewpoint("", azimuth, elevation, distance)
