"""How near a palm can be known at all, at the person's own contact, from what a headset has sent by then.

No session, no model, no reaching: the palm rides on the hand as the headset measured it (the rigid fit of its wrist and
knuckles to the true ones, so that no model of a hand adds an error), and a Kalman filter of white jerk, told the
headset's mean delay, predicts it over that. What a session does worse than this is its own doing: that it
meets earlier or later, its tracker, its hand. It is no bound on what a predictor that knows people could do.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from highfive.hil.bench.headset_model import Device, Wearer
from highfive.hil.bench.live_people import BEFORE_S
from highfive.hil.sim.people.role import RATE_HZ
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

SIGMA_M = 0.002
"""Of a measurement, beside what wanders and stays, which no filter takes away."""
JERK = 1e3
"""Power of the white jerk, m²/s⁵: of 1e2, 1e3, 1e4 and 1e5 a compromise of median and 95 %, seed 7: 1e4 has a lower
95 % at 30 Hz (by a tenth), and a higher median."""
SPEED, ACCELERATION = 2.0, 10.0
"""Standard deviations, m/s and m/s², of a hand that comes into view."""
GAP_S = 0.1
"""After so long without a hand the filter begins anew; a hand unseen for so long before contact is not seen."""


def palm_limit(wearer: Wearer, device: Device, palm: Float[np.ndarray, "T 3"], contact_s: float) -> float:
    """m, by which the palm is mispredicted at contact; NaN where the headset does not see it then.

    Args:
        wearer: of the headset; draws from its generator.
        device: the headset.
        palm: the true one, m, at :data:`RATE_HZ` from the person's beginning on.
        contact_s: of the person.
    """
    truth, end = CubicSpline(np.arange(len(palm)) / RATE_HZ, palm), (len(palm) - 1) / RATE_HZ
    times, places, before = list[float](), list[Array](), None
    for arrives, holds, pose in wearer.poses(device, BEFORE_S):
        if arrives > contact_s:
            break
        hand = pose.hands[1, [0, 6, 11, 16, 21]]
        if not pose.hands_seen[1, 0] or (before is not None and np.array_equal(hand, before)):
            continue
        before, time = hand, holds - 1e-3 * device.late_ms
        times.append(time)
        places.append(_carried(wearer.hands(np.array([time]))[0, 1], hand, truth(np.clip(time, 0.0, end))))
    if not times or contact_s - times[-1] > GAP_S + 1e-3 * device.late_ms:
        return np.nan
    return float(np.linalg.norm(predicted(np.array(times), np.array(places), contact_s) - truth(contact_s)))


def _carried(true: Array, measured: Array, point: Array) -> Array:
    """Where a point (3,) of a true hand (J, 3) lies on the measured one."""
    middle, centre = true.mean(axis=0), measured.mean(axis=0)
    return centre + rotations.nearest_rotation((measured - centre).T @ (true - middle)) @ (point - middle)


def predicted(times: Array, places: Array, at: float) -> Array:
    """The place (3,), m, at a time after the last of ``places`` (N, 3), by a Kalman filter of white jerk."""
    begin = np.diag([SIGMA_M**2, SPEED**2, ACCELERATION**2])
    state, covariance, last = np.zeros((3, 3)), begin, -np.inf  # rows: place, speed, acceleration
    for time, place in zip(times, places, strict=True):
        if time - last > GAP_S:
            state, covariance = np.stack([place, np.zeros(3), np.zeros(3)]), begin
        elif time > last:
            step, noise = _passed(time - last)
            state, covariance = step @ state, step @ covariance @ step.T + noise
            gain = covariance[:, :1] / (covariance[0, 0] + SIGMA_M**2)
            state, covariance = state + gain * (place - state[0]), covariance - gain @ covariance[:1]
        last = time
    return (_passed(at - last)[0] @ state)[0]


def _passed(dt: float) -> tuple[Array, Array]:
    """Transition and noise (3, 3) of constant acceleration with white jerk over ``dt``, s."""
    step = np.array([[1.0, dt, 0.5 * dt**2], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])
    noise = [[dt**5 / 20, dt**4 / 8, dt**3 / 6], [dt**4 / 8, dt**3 / 3, dt**2 / 2], [dt**3 / 6, dt**2 / 2, dt]]
    return step, JERK * np.array(noise)


def limit_figures(errors: Sequence[float]) -> dict[str, Any]:
    """Of how many hands the headset sees at contact, and median and 95th percentile of these, mm."""
    seen = 1e3 * np.array([error for error in errors if np.isfinite(error)])
    median, p95 = np.percentile(seen, [50, 95]).round(2).tolist() if len(seen) else (None, None)
    return {"seen": len(seen), "median": median, "p95": p95}
