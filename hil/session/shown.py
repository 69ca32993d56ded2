"""What a renderer or a headset says that it has shown: the only proof of what was seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Shown:
    """One picture.

    Attributes:
        frame: number of the picture, counted by whoever shows it.
        pose_ns: for when the pose in it was, ns.
        display_ns: when it was seen, or is said to have been, ns of the same clock.
        dropped: pictures that were due since the report before, and not shown.
    """

    frame: int
    pose_ns: int
    display_ns: int
    dropped: int = 0


def picture_rate(reports: Sequence[Shown]) -> float | None:
    """Hz, of the pictures of the last second before the newest; None of fewer than two."""
    times = np.array([one.display_ns for one in reports], dtype=float)
    times = times[times > times[-1] - 1e9] if len(times) else times
    passed = float(times[-1] - times[0]) if len(times) else 0.0
    return round((len(times) - 1) / (1e-9 * passed), 3) if passed > 0.0 else None


def shown_figures(reports: Sequence[Shown]) -> dict[str, Any]:
    """Pictures, those dropped (said, or missing in the numbers), and by how much poses were late when seen, ms."""
    steps = [b.frame - a.frame - 1 for a, b in pairwise(reports)]
    late = 1e-6 * np.array([one.display_ns - one.pose_ns for one in reports], dtype=float)
    p50, p95 = np.percentile(late, [50, 95]).tolist() if len(late) else (None, None)
    said = sum(one.dropped for one in reports)
    return {
        "pictures": len(reports),
        "dropped": max(said, sum(step for step in steps if step > 0)),
        "late_ms": {"p50": p50, "p95": p95},
    }
