"""High fives of our own simulated person as the nets saw them: landmarks recorded once, beside the truth.

Made by ``docs/make_webcam_landmarks.py``, the nets and options those of the page. Kept is what the filter looks at.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.wire.landmarks import HAND, POSE, HandLandmarks, Landmarks
from highfive.model.geometry.rotations import Array

RECORDED = Path(__file__).parent / "webcam_landmarks.npz"
"""36 high fives, on which figures are measured and nothing is chosen."""
CHOICE = Path(__file__).parent / "webcam_choice.npz"
"""18 of other people, half of the emotions at each cell, on which the settings were chosen."""
TILTED = {degrees: Path(__file__).parent / f"webcam_tilted_{degrees}.npz" for degrees in (-10, 15)}
"""Two high fives of those others each, seen by a camera on a high screen that looks down, and one of a laptop on a
table that looks up, by so many degrees."""
STEP = 8
"""Frames of 120 Hz from picture to picture: 15 Hz."""
_BODY = np.array([0, 7, 8, *range(11, 21), 23, 24])
_PALM = np.array([0, 5, 9, 13, 17])
_MOST_HANDS = 2
_SHARE, _METRE, _SURE, _TRUE = 4096.0, 1000.0, 255.0, 2000.0  # steps of whole numbers


@dataclass(frozen=True)
class RecordedClip:
    """One high five before the camera.

    Attributes:
        emotion, cell: of it.
        frames: (N,) of 120 Hz, of the pictures.
        landmarks: N, stamped with the time of their frame.
        contact_frame: when the palms meet.
        joints: (N, 6, 3) m, where the filter's joints really are, in the camera's axes.
        palm: (T, 3) m, at 120 Hz, likewise.
    """

    emotion: str
    cell: str
    frames: NDArray[np.int64]
    landmarks: tuple[Landmarks, ...]
    contact_frame: int
    joints: Array
    palm: Array


def save_clips(path: Path, clips: Sequence[RecordedClip], size: tuple[int, int]) -> None:
    """Writes clips of one camera."""
    arrays: dict[str, NDArray[np.generic]] = {"size": np.array(size)}
    for clip in clips:
        name = f"{clip.emotion}_{clip.cell}"
        body = np.zeros((len(clip.frames), len(_BODY), 6))
        hands = np.zeros((len(clip.frames), _MOST_HANDS, len(_PALM), 5))
        scores = np.zeros((len(clip.frames), _MOST_HANDS))
        for n, found in enumerate(clip.landmarks):
            if found.picture is not None and found.visibility is not None and found.world is not None:
                body[n] = np.hstack([found.picture, found.visibility[:, None], found.world])[_BODY]
            for h, hand in enumerate(found.hands[:_MOST_HANDS]):
                hands[n, h] = np.hstack([hand.picture, hand.world])[_PALM]
                scores[n, h] = hand.score
        arrays[f"{name}_there"] = np.array([found.picture is not None for found in clip.landmarks])
        arrays[f"{name}_body"] = _whole(body[..., [0, 1]], _SHARE)
        arrays[f"{name}_sure"] = np.round(_SURE * body[..., 2]).astype(np.uint8)
        arrays[f"{name}_world"] = _whole(body[..., 3:], _METRE)
        arrays[f"{name}_hands"] = _whole(hands[..., :2], _SHARE)
        arrays[f"{name}_hand_worlds"] = _whole(hands[..., 2:], _METRE)
        arrays[f"{name}_scores"] = np.round(_SURE * scores).astype(np.uint8)
        arrays[f"{name}_frames"] = np.array([*clip.frames, clip.contact_frame], dtype=np.int32)
        arrays[f"{name}_joints"], arrays[f"{name}_palm"] = _whole(clip.joints, _TRUE), _whole(clip.palm, _TRUE)
    np.savez_compressed(path, **arrays)  # pyright: ignore[reportArgumentType]


def load_clips(path: Path = RECORDED) -> list[RecordedClip]:
    """What was recorded, in the order in which it was."""
    with np.load(path, allow_pickle=False) as kept:
        width, height = (int(side) for side in kept["size"])
        names = [name.removesuffix("_frames") for name in kept.files if name.endswith("_frames")]
        return [_clip(name, {key: kept[f"{name}_{key}"] for key in _KEYS}, (width, height)) for name in names]


_KEYS = ("there", "body", "sure", "world", "hands", "hand_worlds", "scores", "frames", "joints", "palm")


def _clip(name: str, kept: dict[str, NDArray[Any]], size: tuple[int, int]) -> RecordedClip:
    emotion, _, cell = name.rpartition("_")
    *frames, contact = (int(frame) for frame in kept["frames"])
    found = []
    for n, frame in enumerate(frames):
        picture, sure, world = np.zeros((POSE, 2)), np.zeros(POSE), np.zeros((POSE, 3))
        picture[_BODY], world[_BODY] = kept["body"][n] / _SHARE, kept["world"][n] / _METRE
        sure[_BODY] = kept["sure"][n] / _SURE
        there = bool(kept["there"][n])
        hands = tuple(
            _hand(score / _SURE, points / _SHARE, places / _METRE)
            for score, points, places in zip(kept["scores"][n], kept["hands"][n], kept["hand_worlds"][n], strict=True)
            if score > 0
        )
        body = (picture, sure, world) if there else (None, None, None)
        found.append(Landmarks(n, 1e3 * frame / 120.0, 0.0, size, int(there), *body, hands))
    return RecordedClip(
        emotion, cell, np.array(frames), tuple(found), contact, kept["joints"] / _TRUE, kept["palm"] / _TRUE
    )  # fmt: skip


def _hand(score: float, points: Array, places: Array) -> HandLandmarks:
    picture, world = np.tile(points[0], (HAND, 1)), np.tile(places[0], (HAND, 1))
    picture[_PALM], world[_PALM] = points, places
    return HandLandmarks(float(score), picture, world)


def _whole(values: Array, steps: float) -> NDArray[np.int16]:
    return np.round(np.clip(steps * values, -32_000, 32_000)).astype(np.int16)
