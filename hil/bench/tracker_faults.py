"""How steady the tracked palm is when labels are swapped, ghosts appear and markers are missing."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np

from highfive.hil.bench.tracker_cases import RATE_HZ, Case
from highfive.mocap_bridge.frames import TrackedMarkers
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.servers.faults import Fault, Faults
from highfive.mocap_bridge.tracking.human_arm import HumanArmEstimator
from highfive.mocap_bridge.tracking.tracker import Tracker
from highfive.model.geometry.rotations import Array

GHOSTS, MISSING = 0.2, 0.3  # of the markers
BACK = 0.010
"""Nearer than this to the true palm it has recovered, m."""

WARM_UP, AFTER = 60, 30  # frames before a fault, and after it
SCORED = ("swap", "ghosts", "missing")
"""What the targets are for; the rest is harder, and shown beside it."""


def robustness(case: Case, pairs: int, episodes: int, advance: Callable[[], None]) -> dict[str, Any]:
    """Largest jump of the palm beyond its true motion, mm, and frames until it is back, of each fault and of all.

    Args:
        case: the paper's set, long enough for a second of fault.
        pairs: of labels that are swapped, spread over all there are.
        episodes: of each other fault.
        advance: called after each episode.
    """
    names = case.marker_set.names
    every = list(itertools.combinations(names, 2))
    chosen = [every[i] for i in np.unique(np.linspace(0, len(every) - 1, pairs).astype(int))]
    ghosts, missing = Fault("ghosts", amount=round(GHOSTS * len(names))), Fault("occlusion", amount=MISSING)
    swaps = [Fault("swap", names=pair) for pair in chosen]
    kinds: dict[str, tuple[float, list[tuple[Fault, ...]]]] = {  # seconds, and what goes wrong in each episode
        "swap": (0.1, [(swap,) for swap in swaps]),
        "ghosts": (1.0, [(ghosts,)] * episodes),
        "missing": (1.0, [(missing,)] * episodes),
        "swap_1_s": (1.0, [(swap,) for swap in swaps]),
        "all_at_once": (0.1, [(swap, ghosts, missing) for swap in swaps]),
    }
    palms = true_palms(case)
    by_fault = {}
    for kind, (seconds, spoilt) in kinds.items():
        rows = []
        for number, faults in enumerate(spoilt):
            rows.append(_episode(case, palms, faults, round(seconds * RATE_HZ), number))
            advance()
        jump, late, error = (np.array(column) for column in zip(*rows, strict=True))
        worst = int(jump.argmax())
        by_fault[kind] = {
            "palm_jump_mm": round(float(jump[worst]), 2),
            "recovery_frames": int(late.max()),
            "palm_error_mm": round(float(error.max()), 2),
            "episodes": len(rows),
            "over_20_mm": int((jump > 20.0).sum()),
            "worst": "+".join(spoilt[worst][0].names) or f"episode {worst}",
        }
    return {
        "palm_jump_mm": max(by_fault[kind]["palm_jump_mm"] for kind in SCORED),
        "recovery_frames": max(by_fault[kind]["recovery_frames"] for kind in SCORED),
        "by_fault": by_fault,
    }


def count_of_episodes(pairs: int, episodes: int) -> int:
    """How often :func:`robustness` calls ``advance``, at most."""
    return 3 * pairs + 2 * episodes


def true_palms(case: Case) -> Array:
    """Palm centres (T, 3), m, as they follow from the true markers."""
    arm = HumanArmEstimator(case.marker_set)
    return np.array([arm(_known(case.marker_set, points)).palm.position for points in case.truth])


def _known(marker_set: MarkerSet, points: Array) -> TrackedMarkers:
    """Markers (M, 3) of which there is no doubt."""
    count = len(points)
    yes = np.ones(count, dtype=bool)
    return TrackedMarkers(
        names=marker_set.names,
        positions=points,
        velocities=np.zeros((count, 3)),
        covariances=np.zeros((count, 3, 3)),
        seen=yes,
        age_ns=np.zeros(count, dtype=np.int64),
        valid=yes,
        rejected=~yes,
        time_ns=0,
    )


def _episode(case: Case, palms: Array, faults: tuple[Fault, ...], length: int, number: int) -> tuple[float, int, float]:
    """Largest jump, mm; frames until the palm is back after the fault; largest error, mm, of one stretch of a case."""
    total = WARM_UP + length + AFTER
    offset = (37 * number) % max(1, len(case.truth) - total)
    spoil = Faults(faults, seed=number)
    tracker, arm = Tracker(case.marker_set), HumanArmEstimator(case.marker_set)
    found = []
    for k, frame in enumerate(itertools.islice(case.frames(), offset, offset + total)):
        during = WARM_UP <= k < WARM_UP + length
        sent = spoil.of(frame)[0] if during else frame
        found.append(arm(tracker.update(sent)).palm.position)
    truth = palms[offset : offset + len(found)]
    error = 1e3 * np.linalg.norm(np.array(found) - truth, axis=1)[WARM_UP:]
    moved = np.diff(np.array(found) - truth, axis=0)[WARM_UP - 1 :]
    away = np.flatnonzero(error[length:] > 1e3 * BACK)
    return float(1e3 * np.linalg.norm(moved, axis=1).max()), int(away[-1]) + 1 if len(away) else 0, float(error.max())
