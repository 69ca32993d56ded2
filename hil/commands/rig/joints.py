"""``highfive rig joints``: the joints of an arm, their servos and limits."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from highfive.hil.arm.arm_files import limits_file, limits_of, rig_file, rig_of
from highfive.hil.arm_model.arm_folder import find_arm


def joints(arm: str, rig: Path | None = None) -> dict[str, Any]:
    """Each joint of an arm, as rig and limits have it: rad, rad/s, A; and the paths of these two files.

    Raises:
        HighFiveError: no such arm, or its files cannot be used.
    """
    folder = find_arm(arm)
    rows = [
        {
            "name": joint.name,
            "ids": list(joint.ids),
            "model": joint.model,
            "low": limit.lowest,
            "high": limit.highest,
            "speed": limit.speed,
            "current": limit.current,
        }
        for joint, limit in zip(rig_of(folder, rig).joints, limits_of(folder).joints, strict=True)
    ]
    files = {"rig": str(rig or rig_file(folder)), "limits": str(limits_file(folder))}
    return {"arm": arm, "joints": rows, "files": files}


def print_joints(result: dict[str, Any]) -> None:
    """The same for people, in degrees."""
    print(f"{'joint':<16}{'ID':<8}{'servo':<14}{'from':>8}{'to':>8}{'at most':>12}")
    for joint in result["joints"]:
        low, high, speed = (math.degrees(joint[name]) for name in ("low", "high", "speed"))
        ids = ", ".join(map(str, joint["ids"]))
        print(f"{joint['name']:<16}{ids:<8}{joint['model']:<14}{low:>7.0f}°{high:>7.0f}°{speed:>9.0f} °/s")
    for what, path in result["files"].items():
        print(f"{what}: {path}")
