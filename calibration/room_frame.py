"""The avatar's world from markers on the floor: an L-frame, three markers, or a wand that lies there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from highfive.calibration.placement import Placement
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class RoomFrameSettings(Settings):
    """What markers have to show."""

    shortest: float = setting(0.1, "m", above=0.0)
    """From the first to each other one: nearer, 0.5 mm of noise turns the world by more than 0.3°."""
    longest: float = setting(5.0, "m", above=0.0)
    narrowest: float = setting(float(np.radians(20.0)), "rad", above=0.0)
    """Between the two ways from the first: a floor that hangs on less is none."""
    tilt: float = setting(float(np.radians(5.0)), "rad", above=0.0)
    """Of the markers' plane, or of the way ahead, beside the motion capture's: more is no floor."""


ROOM_FRAME = RoomFrameSettings()


def room_from_markers(
    places: Array, names: Sequence[str], height: float, settings: RoomFrameSettings = ROOM_FRAME
) -> Placement:
    """Where the world lies: its origin below the first marker, +x towards the second, the third to the avatar's left.

    With three the floor is parallel to their plane; with two the motion capture's vertical is taken.

    Args:
        places: (2, 3) or (3, 3) m, in the motion capture's frame, z up.
        names: of the markers.
        height: m, of their middles above the floor.
        settings: what they have to show.

    Raises:
        HighFiveError: they do not; one line says what.
    """
    origin, ahead = places[0], places[1] - places[0]
    up, vertical = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0])
    for name, place in zip(names[1:], places[1:], strict=True):
        if not settings.shortest <= (away := float(np.linalg.norm(place - origin))) <= settings.longest:
            raise HighFiveError(
                f"{name} is {away:.3g} m from {names[0]}, expected {settings.shortest:g} to {settings.longest:g}; does "
                "the motion capture send metres?"
            )
    if len(places) == 3:
        across = places[2] - origin
        plane = np.cross(ahead, across)
        size = float(np.linalg.norm(plane))
        if size < np.sin(settings.narrowest) * np.linalg.norm(ahead) * np.linalg.norm(across):
            raise HighFiveError(f"{', '.join(names)} lie almost in a line; put {names[2]} to the side")
        up = plane / size
        if up[2] < 0.0:
            raise HighFiveError(
                f"{names[2]} lies to the right of the way from {names[0]} to {names[1]}, expected to its left: "
                "name them the other way round, or set the motion capture's up axis to z"
            )
    leans = float(np.arccos(np.clip(up[2], -1.0, 1.0)))
    rises = float(np.arcsin(np.clip(ahead[2] / np.linalg.norm(ahead), -1.0, 1.0)))
    if max(leans, abs(rises)) > settings.tilt:
        raise HighFiveError(
            f"the markers lean by {np.degrees(max(leans, abs(rises))):.1f}° against the motion capture's floor, at "
            f"most {np.degrees(settings.tilt):g}° are believed: do all lie on the floor, and is z up?"
        )
    forward = ahead - (ahead @ up) * up
    forward = forward / np.linalg.norm(forward)
    turn = np.stack([forward, np.cross(up, forward), up])
    told = "the floor is the markers' plane" if len(places) == 3 else "the floor is the motion capture's"
    lean = float(np.degrees(np.arccos(np.clip(up @ vertical, -1.0, 1.0))))
    note = f"the world stands at {names[0]} and faces {names[1]}; {told}, {lean:.1f}° off its axes"
    return Placement(rotations.from_matrix(turn), np.array([0.0, 0.0, height]) - turn @ origin, (note,))
