"""Two-person recordings as another laboratory might hand them over: joint centres, other names, units, axes and places.

Made from the simulated pair, whose true motion is known. People come walking, each trial somewhere else in the room.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import ezc3d
import numpy as np

from highfive.hil.sim.avatar import right_palm
from highfive.hil.sim.people.actors import PairTrial, simulate_pair
from highfive.hil.sim.people.role import ActorMotion
from highfive.mocap_bridge.files.trial_table import write_table
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

STEP = 4  # from 120 to 30 Hz

# Where another laboratory may have put its 34 points: joint of our skeleton, place in its frame, m.
POINTS: dict[str, tuple[str, tuple[float, float, float]]] = {
    "PELVIS": ("pelvis", (0.0, 0.0, 0.06)),
    "NAVAL_SPINE": ("lumbar_3", (0.02, 0.0, 0.03)),
    "CHEST_SPINE": ("thoracic_8", (0.0, 0.0, 0.06)),
    "NECK": ("neck", (0.0, 0.0, -0.02)),
    "HEAD": ("head", (0.03, 0.0, 0.04)),
    "NOSE": ("head", (0.12, 0.0, 0.05)),
} | {
    f"{side}_{name}": (f"{side.lower()}_{joint}", place)
    for side in ("LEFT", "RIGHT")
    for name, joint, place in (
        ("CLAVICLE", "clavicle", (0.0, 0.0, 0.0)),
        ("SHOULDER", "shoulder", (0.0, 0.0, 0.0)),
        ("ELBOW", "elbow", (0.0, 0.0, 0.0)),
        ("WRIST", "wrist", (0.0, 0.0, 0.0)),
        ("HAND", "wrist", (0.0, 0.0, -0.07)),
        ("HANDTIP", "wrist", (0.0, 0.0, -0.16)),
        ("THUMB", "wrist", (0.05, 0.0, -0.07)),
        ("HIP", "hip", (0.0, 0.0, 0.0)),
        ("KNEE", "knee", (0.0, 0.0, 0.0)),
        ("ANKLE", "ankle", (0.0, 0.0, 0.0)),
        ("FOOT", "toe", (0.03, 0.0, 0.0)),
        ("HEEL", "ankle", (-0.05, 0.0, -0.05)),
    )
} | {
    f"{side}_{name}": ("head", (x, sign * y, z))
    for side, sign in (("LEFT", 1.0), ("RIGHT", -1.0))
    for name, x, y, z in (("EYE", 0.09, 0.03, 0.08), ("EAR", 0.0, 0.07, 0.06))
}  # fmt: skip

# The same points under names of other habits; what is not in the table is left out there.
BVH = {
    "PELVIS": "Hips", "NAVAL_SPINE": "Spine", "CHEST_SPINE": "Spine1", "NECK": "Neck", "HEAD": "Head",
} | {
    f"{side.upper()}_{name}": f"{side}{label}"
    for side in ("Left", "Right")
    for name, label in (
        ("CLAVICLE", "Shoulder"), ("SHOULDER", "Arm"), ("ELBOW", "ForeArm"), ("WRIST", "Hand"), ("HANDTIP", "Hand_End"),
        ("HIP", "UpLeg"), ("KNEE", "Leg"), ("ANKLE", "Foot"), ("FOOT", "ToeBase"),
    )
}  # fmt: skip
HABITS: dict[str, Callable[[str], str | None]] = {
    "zed": lambda name: name,
    "bvh": BVH.get,
    "mixamo": lambda name: f"mixamorig:{BVH[name]}" if name in BVH else None,
    "numbers": lambda name: f"j{(7 * list(POINTS).index(name)) % len(POINTS):02d}",
    "short": lambda name: name.lower().replace("right_", "r").replace("left_", "l"),
}


@dataclass(frozen=True)
class Export:
    """How a laboratory writes its files.

    Attributes:
        habit: of naming, see :data:`HABITS`.
        unit: what it says, and how many of it a metre has in truth.
        axes: (3, 3) rows are the file's axes in a room with z up; a reflection if left-handed.
        left_handers: the mirror image of all that happens, so that the left hands meet.
        size: of the actor, relative to the avatar.
        noise: m, of every coordinate.
        gaps: share of the points that are missing, in runs.
    """

    habit: str = "zed"
    unit: tuple[str, float] = ("mm", 1000.0)
    axes: tuple[tuple[float, float, float], ...] = ((1, 0, 0), (0, 0, 1), (0, -1, 0))
    left_handers: bool = False
    size: float = 1.0
    noise: float = 0.001
    gaps: float = 0.02


@cache
def walking_pair(cell: str, number: int) -> PairTrial:
    """A simulated high five for which both come walking, from further away each time, and stop before it."""
    rng = np.random.default_rng([7, number])
    trial = simulate_pair("neutral", cell, number, rng)
    return replace(
        trial,
        person=_walking(trial.person, trial.contact_frame, rng.uniform(0.4, 1.0)),
        avatar=_walking(trial.avatar, trial.contact_frame, rng.uniform(0.0, 0.6)),
    )


def _walking(motion: ActorMotion, contact: int, away: float) -> ActorMotion:
    """The motion with a walk of ``away`` metres until a third of a second before contact."""
    time = np.arange(len(motion.root_in_world)) / max(contact - 40, 1)
    left = away * (1.0 - np.clip(time, 0.0, 1.0) ** 2 * (3.0 - 2.0 * np.clip(time, 0.0, 1.0)))
    back = rotations.rotate(motion.quaternions[0, 0], [-1.0, 0.0, 0.0]) * [1.0, 1.0, 0.0]
    hinges = motion.skeleton.to_hinges(motion.quaternions)
    stride = 0.35 * np.sin(np.pi * left / 0.65)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        hinges[:, motion.skeleton.index(f"{side}_hip"), 0] += sign * stride
        hinges[:, motion.skeleton.index(f"{side}_knee"), 0] += 0.3 * np.abs(stride)
    turns = motion.skeleton.from_hinges(motion.skeleton.clamp(hinges))
    turns[:, 0] = motion.quaternions[:, 0]
    return replace(motion, root_in_world=motion.root_in_world + left[:, None] * back, quaternions=turns)


def points_of(motion: ActorMotion, size: float = 1.0) -> Array:
    """All 34 joint centres (T, 34, 3), m, of an actor scaled by ``size``."""
    skeleton = motion.skeleton.scaled(size)
    positions, turns = skeleton.forward_kinematics(size * motion.root_in_world, motion.quaternions)
    joints = [skeleton.index(joint) for joint, _ in POINTS.values()]
    places = size * np.array([place for _, place in POINTS.values()])
    return positions[:, joints] + rotations.rotate(turns[:, joints], places)


def write_set(folder: Path, cells: Sequence[str], export: Export, test: int = 1, first: int = 0) -> list[PairTrial]:
    """Writes C3D pairs and ``trials.csv``; returns what really happened, at 120 Hz, in the avatar's world.

    Their seeds go on from ``first``.
    """
    folder.mkdir(parents=True, exist_ok=True)
    trials, rows = [], []
    for number, cell in enumerate(cells):
        trial = walking_pair(cell, first + number)
        trials.append(trial)
        points = [points_of(motion, export.size) for motion in (trial.person, trial.avatar)]
        _write(folder / f"take{number}.c3d", np.stack(points)[:, ::STEP], export, np.random.default_rng(number))
        rows.append((f"take{number}.c3d", "neutral", "", "", "test" if number >= len(cells) - test else "train"))
    write_table(folder, rows)
    return trials


def _write(path: Path, points: Array, export: Export, rng: np.random.Generator) -> None:
    """Writes both people's points (2, T, 34, 3) somewhere in the room."""
    labels = [HABITS[export.habit](name) for name in POINTS]
    kept = [m for m, label in enumerate(labels) if label is not None]
    names = [f"{who}:{labels[m]}" for who in ("human", "avatar") for m in kept]
    room = points[:, :, kept] + rng.normal(0.0, export.noise, (2, points.shape[1], len(kept), 3))
    if export.left_handers:
        room = room * [1.0, -1.0, 1.0]
        other = {"LEFT": "RIGHT", "RIGHT": "LEFT"}
        order = list(POINTS)
        swapped = [order.index("_".join(other.get(word, word) for word in order[m].split("_"))) for m in kept]
        room = room[:, :, [kept.index(m) for m in swapped]]
    turn = rotations.from_axis_angle("z", rng.uniform(-np.pi, np.pi))
    room = rotations.rotate(turn, room) + np.append(rng.uniform(-2.0, 2.0, 2), 0.3)
    room = room @ np.array(export.axes, dtype=float).T * export.unit[1]
    seen = np.ones(room.shape[:-1], dtype=bool)
    for person, _, column in np.argwhere(rng.random((2, 1, len(kept))) < 20 * export.gaps):
        start = rng.integers(room.shape[1])
        seen[person, start : start + max(1, room.shape[1] // 20), column] = False
    flat = np.where(seen[..., None], room, np.nan).transpose(3, 0, 2, 1).reshape(3, len(names), -1)
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["UNITS"]["value"] = [export.unit[0]]
    file["parameters"]["POINT"]["RATE"]["value"] = [120.0 / STEP]
    file["parameters"]["POINT"]["LABELS"]["value"] = names
    file["data"]["points"] = np.concatenate([flat, np.ones((1, *flat.shape[1:]))])
    file.write(str(path))


def palm_of(motion: ActorMotion) -> Array:
    """Right palm (T, 3), m."""
    return right_palm(motion.skeleton, *motion.skeleton.forward_kinematics(motion.root_in_world, motion.quaternions))[0]
