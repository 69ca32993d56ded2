"""Poses kept while they are taken: a calibration that broke off half way goes on where it was."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from highfive.calibration.arm_poses import ArmPoses
from highfive.model.errors import HighFiveError
from highfive.model.files import read_bounded_text, write_whole
from highfive.model.geometry.rotations import Array

FORMAT = 1
MOST_BYTES = 4 << 20
"""Largest file of poses that is read: a pose has a kilobyte."""


@dataclass(frozen=True)
class TakenPose:
    """One posture.

    Attributes:
        asked: (J,) rad, where the arm was sent.
        encoders: (J,) rad, the mean of what the servos said.
        sides: (J,) from which each joint came: ± 1, 0 where it hardly moved.
        markers, seen: (M, 3) m and (M,), in the motion capture's frame.
    """

    asked: Array
    encoders: Array
    sides: Array
    markers: Array
    seen: NDArray[np.bool_]


def together(poses: Sequence[TakenPose]) -> ArmPoses:
    """As the fit takes them."""
    found = [np.array([getattr(p, name) for p in poses]) for name in ("encoders", "sides", "markers", "seen")]
    return ArmPoses(found[0], found[1], found[2], found[3].astype(bool))


def save_poses(path: Path, arm: str, markers: Sequence[str], poses: Sequence[TakenPose]) -> None:
    """Writes all of them in one piece.

    Raises:
        HighFiveError: they cannot be written.
    """
    rows = [{name: np.asarray(value).tolist() for name, value in vars(pose).items()} for pose in poses]
    content = json.dumps({"format": FORMAT, "arm": arm, "markers": list(markers), "poses": rows})
    try:
        write_whole(path, content.encode(), replace=True)
    except OSError as error:
        raise HighFiveError(f"cannot keep the poses in {path}: {error.strerror or error}") from None


def load_poses(path: Path, arm: str, markers: Sequence[str], joints: int) -> list[TakenPose]:
    """Those that were kept.

    Args:
        path: of the file.
        arm: fingerprint of the arm that goes on.
        markers: names on its plate.
        joints: number of them.

    Raises:
        HighFiveError: they are of another arm or plate, or no poses.
    """
    try:
        data = json.loads(read_bounded_text(path, MOST_BYTES))
        if (data["format"], data["arm"], data["markers"]) != (FORMAT, arm, list(markers)):
            raise HighFiveError(f"{path} has the poses of another arm or plate; delete it, and begin anew")
        return [_pose(row, joints, len(markers)) for row in data["poses"]]
    except OSError as error:
        raise HighFiveError(f"cannot read the poses {path}: {error.strerror or error}") from None
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        raise HighFiveError(f"{path} has no poses of this program; delete it, and begin anew") from None


def _pose(row: dict[str, Any], joints: int, markers: int) -> TakenPose:
    shapes = {
        "asked": (joints,),
        "encoders": (joints,),
        "sides": (joints,),
        "markers": (markers, 3),
        "seen": (markers,),
    }
    values = {
        name: np.array(row[name], bool if name == "seen" else float).reshape(shape) for name, shape in shapes.items()
    }
    if not all(np.isfinite(value).all() for value in values.values()):
        raise ValueError
    return TakenPose(**values)
