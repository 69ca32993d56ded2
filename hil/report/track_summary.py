"""What tracking a recording found, in numbers: the figures of ``highfive track --json``, of its page and its table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.markers.one_person import OnePerson
from highfive.mocap_bridge.tracking.joint_angles import ANGLES, BASES
from highfive.mocap_bridge.tracking.tracked_recording import TrackedRecording
from highfive.mocap_bridge.tracking.unobservable import unseen_angles
from highfive.model.geometry.rotations import Array

MM = 1e3


def summarise_track(person: OnePerson, track: TrackedRecording) -> dict[str, Any]:
    """Counts, residuals and ranges of angles; lengths are in mm and angles in degrees where a name says so."""
    hidden, filled = track.hidden, track.hidden & track.usable
    return {
        "file": str(person.path),
        "person": person.prefix,
        "other_persons": list(person.others),
        "marker_set": track.marker_set.name,
        "rate_hz": float(track.rate_hz),
        "frames": len(track),
        "seconds": round(len(track) / track.rate_hz, 3),
        "tracked_frames": int(track.posed.sum()),
        "gaps": sum(len(runs(column)) for column in hidden.T),
        "hidden_points": int(hidden.sum()),
        "filled_points": int(filled.sum()),
        "disbelieved_points": int(track.disbelieved.sum()),
        "refused_frames": person.refused,
        "residual_mm": _spread(track.residuals),
        "markers": {name: _marker(track, m) for m, name in enumerate(track.marker_set.names) if track.labelled[m]},
        "missing": [name for m, name in enumerate(track.marker_set.names) if not track.labelled[m]],
        "unused": list(person.unused),
        "angles_relative_to": _base(track),
        "angles_deg": _angles(track) if knows_arm(track) else None,
        "angles_not_seen": unseen_angles(track) if knows_arm(track) else [],
    }


def _base(track: TrackedRecording) -> dict[str, Any] | None:
    """The segment that the shoulder's angles are relative to, and how many markers of the recording it bears."""
    base = next((name for name in BASES if name in track.segments), None)
    if base is None or not knows_arm(track):
        return None
    bears = sum(joint == base and track.labelled[m] for m, joint in enumerate(track.marker_set.joints))
    return {"segment": base, "markers": int(bears)}


def knows_arm(track: TrackedRecording) -> bool:
    """Whether there are angles of the right arm in any frame."""
    return bool(np.isfinite(track.angles).any())


def runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Runs of True in ``flags`` (T,): first frame and the one after the last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _marker(track: TrackedRecording, m: int) -> dict[str, Any]:
    gaps = runs(track.hidden[:, m])
    longest = max((end - start for start, end in gaps), default=0)
    return {
        "seen": round(float(track.there[:, m].mean()), 4),
        "gaps": len(gaps),
        "longest_gap_ms": round(1e3 * longest / track.rate_hz, 1),
        "hidden": int(track.hidden[:, m].sum()),
        "filled": int((track.hidden & track.usable)[:, m].sum()),
        "filled_sd_mm": _spread(track.filled_sd[:, m]),
        "disbelieved": int(track.disbelieved[:, m].sum()),
        "residual_mm": _spread(track.residuals[:, m]),
    }


def _spread(metres: Array) -> dict[str, float] | None:
    known = MM * metres[np.isfinite(metres)]
    if not len(known):
        return None
    middle, high = np.percentile(known, [50.0, 95.0])
    return {"median": round(float(middle), 3), "p95": round(float(high), 3), "max": round(float(known.max()), 3)}


def _angles(track: TrackedRecording) -> dict[str, dict[str, float] | None]:
    """Of each angle; None where no frame shows it."""
    return {name: _angle(track, i) for i, name in enumerate(ANGLES)}


def _angle(track: TrackedRecording, i: int) -> dict[str, float] | None:
    known = np.isfinite(track.angles[:, i])
    if not known.any():
        return None
    degrees, deviation = np.degrees(track.angles[known, i]), np.degrees(track.deviations[known, i])
    return {
        "seen": round(float(known[track.posed].mean()), 4),
        "min": round(float(degrees.min()), 2),
        "max": round(float(degrees.max()), 2),
        "sd": round(float(np.median(deviation)), 3),
    }


def angle_rows(track: TrackedRecording) -> tuple[list[str], Sequence[Sequence[str]]]:
    """Heads and rows of the CSV file: time, s, then each angle and its standard deviation, degrees; empty: unknown."""
    heads = ["time_s", *(f"{name}{what}_deg" for name in ANGLES for what in ("", "_sd"))]
    values = np.degrees(np.stack([track.angles, track.deviations], axis=-1).reshape(len(track), -1))
    rows = [
        [f"{time:.6f}", *("" if np.isnan(value) else f"{value:.4f}" for value in row)]
        for time, row in zip(track.times, values, strict=True)
    ]
    return heads, rows
