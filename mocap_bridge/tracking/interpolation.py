"""Tracked markers between two frames: cubic Hermite splines through both, with the speeds that the tracker gives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from highfive.mocap_bridge.frames import TrackedMarkers


def between(before: TrackedMarkers, after: TrackedMarkers, time_ns: int) -> TrackedMarkers:
    """The markers at a time from ``before`` to ``after``.

    Covariances are mixed as the positions are. A marker is valid where it is in both, and as old as in ``after``.
    """
    span = 1e-9 * (after.time_ns - before.time_ns)
    u = 1e-9 * (time_ns - before.time_ns) / span
    start, end = span * before.velocities, span * after.velocities
    step = after.positions - before.positions
    # p(u) = p0 + u v0 + u² (3 d - 2 v0 - v1) + u³ (v0 + v1 - 2 d), with d the step and speeds per span
    bend, twist = 3.0 * step - 2.0 * start - end, start + end - 2.0 * step
    return replace(
        after,
        positions=before.positions + u * (start + u * (bend + u * twist)),
        velocities=(start + u * (2.0 * bend + 3.0 * u * twist)) / span,
        covariances=before.covariances + u * (after.covariances - before.covariances),
        seen=before.seen & after.seen,
        age_ns=np.where(after.seen, after.age_ns, np.maximum(after.age_ns - (after.time_ns - time_ns), 0)),
        valid=before.valid & after.valid,
        time_ns=time_ns,
    )
