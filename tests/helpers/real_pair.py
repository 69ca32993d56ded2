"""Trials cut from the real two-person high five, as another laboratory might hand them over."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from highfive.mocap_bridge.files.c3d import read_c3d, write_c3d
from highfive.mocap_bridge.files.recording import make_recording, resample
from highfive.mocap_bridge.files.trial_table import write_table
from highfive.model.geometry import rotations

# What the Acclaim labels, which name the far end of a bone, are called by who names joints.
SIDED = {
    "hipjoint": "hip", "femur": "knee", "tibia": "ankle", "foot": "foot", "toes": "toe", "clavicle": "shoulder",
    "humerus": "elbow", "wrist": "wrist", "hand": "hand", "fingers": "handtip", "thumb": "thumb",
}  # fmt: skip
CENTRAL = {"root": "pelvis", "lowerback": "spine_1", "upperback": "spine_2", "thorax": "spine_3", "lowerneck": "neck"}
NAMES = {"upperneck": "neck_2", "head": "head"} | CENTRAL
NAMES |= {f"{s}{old}": f"{side}_{new}" for s, side in (("l", "left"), ("r", "right")) for old, new in SIDED.items()}


def write_real_set(recordings: Path, folder: Path, trials: int) -> None:
    """Pieces of the recording around the contact, at 30 Hz, y up, its joint centres under plain names.

    Each begins and ends elsewhere, is turned and shifted, and is played a little faster or slower.
    """
    folder.mkdir(parents=True, exist_ok=True)
    whole = read_c3d(recordings / "high_five" / "cmu_20_21_11_high_five.c3d")
    y_up = rotations.from_axis_angle("x", -np.pi / 2)
    rows = []
    for number in range(trials):
        rng = np.random.default_rng(number)
        tempo = rng.uniform(0.9, 1.1)
        keep = slice(int(rng.integers(0, 25)), int(rng.integers(140, 183)))
        points = rotations.rotate(rotations.from_axis_angle("z", rng.uniform(-3, 3)), whole.points[keep])
        points = rotations.rotate(y_up, points + np.append(rng.uniform(-1, 1, 2), 0.0))
        names = []
        for label in whole.names:
            who, _, name = label.partition(":")
            names.append(f"{'human' if who == 'A' else 'avatar'}:{NAMES.get(name, name)}")
        piece = make_recording(120.0 * tempo, names, points, whole.valid[keep])
        write_c3d(folder / f"piece{number}.c3d", resample(piece, 30.0))
        rows.append((f"piece{number}.c3d", "neutral", "", "", "test" if number % 4 == 3 else "train"))
    write_table(folder, rows)
