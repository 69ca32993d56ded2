"""How fast plate and hand closed in, and how fast the arm was near the head, from where they were: for figures.

Independent of the rules: positions are differenced, whoever says where they were: goals as they were sent, or servos.
"""

from __future__ import annotations

import numpy as np

from highfive.hil.safety.limits import Contact, Face
from highfive.model.geometry.rotations import Array


def closing_speed(
    times: Array,
    plates: Array,
    palms: Array,
    limits: Contact,
    bodies: Array | None = None,
    hand_velocities: Array | None = None,
) -> float:
    """Largest speed, m/s, at which plate and palm came nearer each other along the line between them, near each other.

    Each step is judged by where it led, as whoever commanded it had to. What the hand is faster than the limit by
    itself is not counted: the plate then stands. Nearer than ``touching`` there is no line. 0 where they never were
    near.

    Args:
        times: (T,) s, rising.
        plates, palms: (T, 3) m; NaN where one is not known.
        limits: ``near``, ``touching`` and ``speed``.
        bodies: (T, 3) m, where the plate was while ``plates`` are goals for it: the line is drawn from there.
        hand_velocities: (T, 3) m/s, as known then; None takes differences of the palms.
    """
    if len(times) < 2:
        return 0.0
    step = np.maximum(np.diff(times), 1e-9)[:, None]
    origins = plates if bodies is None else bodies
    apart, beside = palms[1:] - origins[1:], palms[1:] - plates[1:]
    hand = np.diff(palms, axis=0) / step if hand_velocities is None else hand_velocities[1:]
    distance = np.linalg.norm(apart, axis=1)
    line = apart / np.maximum(distance, 1e-9)[:, None]
    closing = np.einsum("ti,ti->t", np.diff(plates, axis=0) / step - hand, line)
    own = np.maximum(0.0, -np.einsum("ti,ti->t", hand, line) - limits.speed)
    nearest = np.minimum(distance, np.linalg.norm(beside, axis=1))
    near = np.isfinite(closing) & (nearest <= limits.near) & (distance >= limits.touching)
    return float((closing - own)[near].max(initial=0.0))


def face_speed(times: Array, points: Array, heads: Array, limits: Face, reach: Array | None = None) -> float:
    """Largest speed, m/s, of any point of the arm inside the zone about the head; 0 where none ever was.

    Args:
        times: (T,) s, rising.
        points: (T, P, 3) m.
        heads: (T, 3) m; NaN where the head is not known.
        limits: ``radius``.
        reach: (T, P, 3, J) m, by which a point may be off for each joint, whichever way: what that may have added to a
            step's speed at the most does not count. None is exact.
    """
    if len(times) < 2:
        return 0.0
    step = np.maximum(np.diff(times), 1e-9)[:, None]
    moved = np.diff(points, axis=0)
    speeds = np.linalg.norm(moved, axis=2) / step
    if reach is not None:
        ways = moved / np.maximum(np.linalg.norm(moved, axis=2), 1e-12)[:, :, None]
        off = [np.abs(np.einsum("tpi,tpij->tpj", ways, ends)).sum(axis=2) for ends in (reach[:-1], reach[1:])]
        speeds = np.maximum(0.0, speeds - (off[0] + off[1]) / step)
    inside = np.linalg.norm(points - heads[:, None], axis=2) <= limits.radius  # NaN is not inside
    return float(speeds[inside[:-1] & inside[1:]].max(initial=0.0))
