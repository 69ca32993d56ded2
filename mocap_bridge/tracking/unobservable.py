"""Angles of the right arm that a recording's markers do not show, why, and what would show them."""

from __future__ import annotations

from typing import Any

import numpy as np

from highfive.mocap_bridge.tracking.joint_angles import ANGLES, USUAL
from highfive.mocap_bridge.tracking.tracked_recording import TrackedRecording

_SHOULDER = (
    "where the upper arm points against the trunk does not show: the trunk bears too few markers, the arm hangs, or "
    "its markers are hidden",
    "three markers or more on the trunk",
)
_WRIST = (
    "how the hand is turned against the forearm does not show",
    "three markers on the hand that are not in line, and one on each side of the wrist",
)
_REASONS = {
    "plane_of_elevation": _SHOULDER,
    "elevation": _SHOULDER,
    "axial_rotation": (
        "a turn of the upper arm about its own length shows only in markers beside its axis, or in the plane of a bent "
        "elbow",
        "a marker on each side of the elbow, or three on the upper arm",
    ),
    "elbow_flexion": ("shoulder, elbow or wrist is not known well enough", "markers at shoulder, elbow and wrist"),
    "carrying_angle": (
        "where the elbow's axis lies in the arm does not show; it is taken to be as people's are, and elbow flexion is "
        "the whole angle between upper arm and forearm",
        "a marker on each side of the elbow and of the wrist, and more on the upper arm; then highfive calibrate "
        "subject",
    ),
    "pronation": (
        "a turn of the forearm about its own length shows only in markers beside its axis",
        "a marker on each side of the wrist",
    ),
    "wrist_flexion": _WRIST,
    "wrist_deviation": _WRIST,
}

RULE = (
    "An angle is given where looking at the markers at least halves the standard deviation that it has over people and "
    "poses (one bit): "
    + ", ".join(f"{name.replace('_', ' ')} {np.degrees(usual):.0f}°" for name, usual in zip(ANGLES, USUAL, strict=True))
    + "."
)


def unseen_angles(track: TrackedRecording) -> list[dict[str, Any]]:
    """Angles that are left blank in some tracked frame: in how many, why, and what to add; none without an arm."""
    blank = ~np.isfinite(track.angles) & track.posed[:, None]
    rows = []
    for i, name in enumerate(ANGLES):
        if blank[:, i].any():
            why, add = _REASONS[name]
            rows.append({"angle": name, "frames": int(blank[:, i].sum()), "why": why, "add": add})
    return rows


def unseen_lines(summary: dict[str, Any]) -> list[str]:
    """What cannot be seen, in words; one line for all angles with the same reason and the same share of the frames."""
    groups: dict[tuple[str, str, str], list[str]] = {}
    for row in summary["angles_not_seen"]:
        always = row["frames"] == summary["tracked_frames"]
        share = "every frame" if always else f"{row['frames']} of {summary['tracked_frames']} frames"
        groups.setdefault((share, row["why"], row["add"]), []).append(row["angle"].replace("_", " "))
    return [
        f"{' and '.join(names)}, blank in {share}: {why}; needed: {add}" for (share, why, add), names in groups.items()
    ]
