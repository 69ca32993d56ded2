"""Contact as the screen shows it: one camera does not know how far away a hand is, only where in its view."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from highfive.hil.sim.contact_check import ON_THE_PALM
from highfive.hil.trials.key_frames import contact_tick
from highfive.hil.trials.trial_result import TrialResult
from highfive.model.geometry.rotations import Array


def across_view(points: Array, others: Array, eye: Array) -> Array:
    """(...) m, how far points (..., 3) are from the rays that go from an eye (3,) through others (..., 3), m."""
    rays = others - eye
    rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    gaps = points - others
    return np.linalg.norm(gaps - (gaps * rays).sum(axis=-1, keepdims=True) * rays, axis=-1)


def seen_on_screen(result: TrialResult, camera: Array) -> TrialResult:
    """The result as far as a camera (3,), m in the world, can tell.

    Palms have met where they did as tracked, or where they lay on each other across the view when they were nearest.
    What depends on depth is not known: those figures are NaN.
    """
    contact = result.contact
    when = contact.nearest_time_ns if contact.met_time_ns is None else contact.met_time_ns
    at = contact_tick(result)
    across = float(across_view(result.palm[at], result.person_palm[at], camera))
    met = contact.met or across <= ON_THE_PALM
    note = (
        f"seen by one camera: across its view the avatar's palm came to {1e3 * across:.0f} mm of the palm as tracked; "
        "how far away the hand was, and how far off where it was seen, nobody measured"
    )
    unknown = np.nan
    return replace(
        result,
        contact=replace(
            contact, met=met, met_time_ns=when if met else None, distance=unknown, lateral=unknown, gap=unknown,
            palm_angle=unknown, approach_speed=unknown, peak_force=unknown,
        ),
        error=unknown, uncorrected_error=unknown, palm_angle=unknown, out_of_reach=result.out_of_reach and not met,
        contact_time=1e-9 * when if met else unknown, notes=(*result.notes, note),
    )  # fmt: skip
