"""What one picture says of a person's joints: where in it they are, and how far away, each with its deviation.

Two nets looked at it, one for the body and one for hands. The body's may take left for right; the hands' may show
anybody's hand, and its own left and right are as good as a coin (55 % right): the hand that counts is the one at the
body's right wrist.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.sources.camera_settings import (
    HAND,
    KNUCKLES,
    SHOULDER,
    TRUNK,
    WRIST,
    Camera,
    CameraSettings,
)
from highfive.mocap_bridge.wire.landmarks import POSE, HandLandmarks, Landmarks
from highfive.model.geometry.rotations import Array

_RIGHT = (12, 14, 16)
_EARS, _SHOULDERS, _ELBOWS, _WRISTS, _HIPS = (7, 8), (11, 12), (13, 14), (15, 16), (23, 24)
_PALM = (0, 5, 9, 13, 17)
_MIRROR = np.array([0, 4, 5, 6, 1, 2, 3, 8, 7, 10, 9, *(i + 1 if i % 2 else i - 1 for i in range(11, POSE))])
_GUESSED = 4.0
_LEAST_PX = 8.0  # a trunk or hand that spans fewer pixels says nothing of its distance


@dataclass(frozen=True)
class Look:
    """What one picture says.

    Attributes:
        pixels: (6, 2) where each joint of the filter is.
        across: (6,) m, standard deviation across the view.
        seen: (6,) which of them are in it.
        depths: (6,) m, of each joint behind the shoulders' middle, by the body's net; of the knuckles by the wrist's.
        distance: m, of the shoulders' middle, by the trunk's size; NaN where that is not seen.
        hand_distance: m, of the knuckles, by the hand's size; NaN where no hand is seen.
        exchanged: left and right of the body were exchanged.
        strangers: hands that belong to neither wrist.
    """

    pixels: Array
    across: Array
    seen: NDArray[np.bool_]
    depths: Array
    distance: float
    hand_distance: float
    exchanged: bool = False
    strangers: int = 0


def look(found: Landmarks, camera: Camera, settings: CameraSettings, expected: Array | None = None) -> Look | None:
    """What landmarks say; None where nobody is in the picture.

    Args:
        found: of one picture.
        camera: that took it.
        settings: deviations, and the person's height.
        expected: (6, 2) pixels where the joints are expected; None where nothing is known yet.
    """
    if found.picture is None or found.visibility is None or found.world is None:
        return None
    size = np.array(found.size, dtype=float)
    exchanged = _exchanged(found.picture * size, found.visibility, expected, settings)
    order = _MIRROR if exchanged else np.arange(POSE)
    picture, sure, world = found.picture[order] * size, found.visibility[order], found.world[order]
    inside = np.asarray((np.abs(picture / size - 0.5) < 0.5 + settings.margin).all(axis=1))

    scale = (
        settings.height * TRUNK / max(float(np.linalg.norm(_middle(world, _SHOULDERS) - _middle(world, _HIPS))), 0.1)
    )
    world = scale * world  # the net makes people too small
    pixels, across = np.empty((6, 2)), np.array(settings.across)
    seen, depths = np.zeros(6, dtype=bool), np.zeros(6)
    base = _middle(world, _SHOULDERS)[2]
    for joint, landmarks in enumerate(((12,), (14,), (16,), (18, 20), (11,), _EARS)):
        rows = list(landmarks)
        pixels[joint], depths[joint] = picture[rows].mean(axis=0), world[rows, 2].mean() - base
        visibility = float(sure[rows].min())
        seen[joint] = visibility >= settings.visible and inside[rows].all()
        across[joint] /= max(visibility, 0.1)
    across[KNUCKLES] = _GUESSED * across[WRIST]  # of the body's net, which guesses index and little finger

    hand, strangers = _hand_of(found, picture, size, settings)
    hand_distance = np.nan
    if hand is not None:
        points = hand.picture * size
        pixels[WRIST], pixels[KNUCKLES] = points[0], points[9]
        across[WRIST], across[KNUCKLES] = settings.hand_wrist, settings.across[KNUCKLES]
        seen[[WRIST, KNUCKLES]] = True
        hand_distance = _distance(points[list(_PALM)], _sized(hand, settings)[list(_PALM)], camera)
    depths[KNUCKLES] = depths[WRIST] + (0.0 if hand is None else float((hand.world[9] - hand.world[0])[2]))
    trunk = [*_SHOULDERS, *_HIPS]
    whole = sure[trunk].min() >= settings.visible and inside[trunk].all()
    distance = _distance(picture[trunk], world[trunk], camera) if whole else np.nan
    return Look(pixels, across, seen, depths, distance, hand_distance, exchanged, strangers)


def in_mirror(found: Landmarks) -> Landmarks:
    """The landmarks of who is behind a mirror: her left hand is a right one there."""
    hands = tuple(
        replace(hand, picture=_turned_round(hand.picture, 1.0), world=_turned_round(hand.world, 0.0))
        for hand in found.hands
    )
    if found.picture is None or found.visibility is None or found.world is None:
        return replace(found, hands=hands)
    return replace(
        found,
        picture=_turned_round(found.picture[_MIRROR], 1.0),
        visibility=found.visibility[_MIRROR],
        world=_turned_round(found.world[_MIRROR], 0.0),
        hands=hands,
    )


def _turned_round(points: Array, edge: float) -> Array:
    """Points (N, 2) or (N, 3) whose first coordinate counts from the other side, from ``edge`` down."""
    return np.column_stack([edge - points[:, 0], points[:, 1:]])


def _middle(points: Array, pair: tuple[int, int]) -> Array:
    return points[list(pair)].mean(axis=0)


def _distance(pixels: Array, world: Array, camera: Camera) -> float:
    """m, of the points' middle: how large the body (N, 3), m, is in the picture (N, 2) (weak perspective)."""
    flat = world[:, :2] - world[:, :2].mean(axis=0)
    spread = pixels - pixels.mean(axis=0)
    size = float(np.linalg.norm(spread))
    return camera.focal * float(np.linalg.norm(flat)) / size if size > _LEAST_PX else np.nan


def _sized(hand: HandLandmarks, settings: CameraSettings) -> Array:
    """(21, 3) m, the hand as large as of people of this height."""
    length = max(float(np.linalg.norm(hand.world[9] - hand.world[0])), 0.02)
    return hand.world * (settings.height * HAND / length)


def _hand_of(
    found: Landmarks, picture: Array, size: Array, settings: CameraSettings
) -> tuple[HandLandmarks | None, int]:
    """The hand at the right wrist, if one is, and how many belong to neither wrist."""
    reach = settings.hand_near * float(np.linalg.norm(picture[11] - picture[12]))
    reach = max(reach, 0.1 * float(np.linalg.norm(picture[11] - picture[23])))  # who stands sideways shows no width
    best, nearest, strangers = None, np.inf, 0
    for hand in found.hands:
        if hand.score < settings.hand_score:
            continue
        wrist = hand.picture[0] * size
        left, right = (float(np.linalg.norm(wrist - picture[joint])) for joint in _WRISTS)
        if min(left, right) > reach:
            strangers += 1
        elif right <= left and right < nearest:
            best, nearest = hand, right
    return best, strangers


def _exchanged(picture: Array, sure: Array, expected: Array | None, settings: CameraSettings) -> bool:
    """Whether the body's left and right are exchanged.

    Who faces the camera has the right shoulder on the picture's left. Once a person is followed, what was expected
    decides; only a clear difference does.
    """
    if expected is None:
        width, height = picture[11] - picture[12], np.linalg.norm(picture[11] - picture[23])
        return bool(sure[0] >= settings.visible and width[0] < -0.2 * height)
    joints = np.array([SHOULDER, 1, WRIST, 4])
    right = np.array([12, 14, 16, 11])
    misfits = [
        float(np.linalg.norm(picture[order] - expected[joints], axis=1).sum()) for order in (right, _MIRROR[right])
    ]
    return misfits[1] < settings.exchanged * misfits[0]
