"""A frame of markers between two others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from highfive.mocap_bridge.frames import MarkerFrame


def mix_frames(a: MarkerFrame, b: MarkerFrame, share: float, time_ns: int) -> MarkerFrame:
    """The frame at ``share`` of the way from one to the next of the same names, or beyond it.

    A marker is seen where both see it; points without a label, which have no identity from frame to frame, are those
    of the nearer frame. Covariances are those of two independent errors.
    """
    near = a if share < 0.5 else b
    valid = a.valid & b.valid
    covariance = None
    if a.covariance is not None and b.covariance is not None:
        covariance = (1.0 - share) ** 2 * a.covariance + share**2 * b.covariance
    positions = np.where(valid[:, None], a.positions + share * (b.positions - a.positions), 0.0)
    return replace(near, positions=positions, valid=valid, covariance=covariance, source_time_ns=time_ns)
