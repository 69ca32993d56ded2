"""The person: how fast the plate may come near the hand and the head.

Speed and separation monitoring (ISO/TS 15066): near the face the arm keeps its path and becomes slower on it; the
closing speed of plate and hand is limited along the line between them. Both at once, even if that brakes harder than
the limit of acceleration: the person comes first.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from highfive.hil.safety.limits import Contact, Face, Limits
from highfive.hil.safety.rules import Rule
from highfive.model.geometry.rotations import Array

SMOOTHING_S = 0.05
"""Time constant of the head's velocity, s: a millimetre of jitter at 120 Hz would be 0.12 m/s without."""

BORDER = 0.05
"""m: who is this near the zone around a head counts the less as passing by, at its border as going straight in."""

STRAIGHT = 0.97
"""Fraction of a limit of the plate that is used: within a tick the plate moves on a bent line."""

ALONE = 2.0
"""Times the limit near the head by which any one joint may move a point. Joints that cancel each other's motion do so
only in step; servos lag each by its own load, and what is left over is the point's speed."""

MEASURED, WIDENING = 0.003, 3.0
"""m: standard deviation of a part of the body whose markers are measured, which the distances of the limits allow for;
and by how many standard deviations beyond that the distance kept grows where an estimate is carried on without them."""


@dataclass(frozen=True)
class Sighting:
    """How well a part of the body is known, whatever an estimate believes.

    Attributes:
        age_ns: since one of its markers was last measured, at the time of the tick.
        deviation: m, standard deviation of where it is.
    """

    age_ns: int = 0
    deviation: float = 0.0

    @property
    def margin(self) -> float:
        """m, by which the distance kept from it is wider."""
        return WIDENING * max(0.0, self.deviation - MEASURED)


@dataclass(frozen=True)
class Human:
    """The person, in the world frame.

    Attributes:
        head: (3,) m, its centre.
        palm: (3,) m, centre of the palm's surface; None where the hand is not known.
        palm_velocity: (3,) m/s; None where the hand is not known.
        age_ns: how old this estimate is at the time of the tick.
        head_seen, palm_seen: how well they are known; a hand's markers are those of wrist and hand.
    """

    head: Array
    palm: Array | None
    palm_velocity: Array | None
    age_ns: int
    head_seen: Sighting = field(default_factory=Sighting)
    palm_seen: Sighting = field(default_factory=Sighting)

    @property
    def measured_ns(self) -> int:
        """Age of the older of the two measurements that this rests on, head and hand."""
        return max(self.age_ns, self.head_seen.age_ns, self.palm_seen.age_ns)


@dataclass(frozen=True)
class Points:
    """Points of the arm that may meet the person; the first is the palm plate's centre.

    Attributes:
        commanded: (P, 3) m, where they are if the joints are where they were commanded to be.
        jacobians: (P, 3, J) m/rad, halfway through the step that begins at ``commanded``: points move on arcs.
        measured: (P, 3) m, where they are if the joints are where the servos say.
    """

    commanded: Array
    jacobians: Array
    measured: Array


@dataclass(frozen=True)
class Remembered:
    """What is carried from tick to tick about the person.

    Attributes:
        head: (3,) m, where the head was; None before it was seen.
        head_velocity: (3,) m/s, smoothed.
        seen_ns: when that was.
        line: (3,) unit vector from the plate to the palm, when they were last far enough apart; None before.
    """

    head: Array | None = None
    head_velocity: Array = field(default_factory=lambda: np.zeros(3))
    seen_ns: int = 0
    line: Array | None = None


def remembered(limits: Contact, before: Remembered, human: Human, points: Points, now_ns: int) -> Remembered:
    """What is known of the person after one more look."""
    head, velocity, line = before.head, before.head_velocity, before.line
    seen_ns = now_ns - human.age_ns
    if head is None:
        head = human.head
    elif seen_ns > before.seen_ns:
        dt = (seen_ns - before.seen_ns) * 1e-9
        gain = 1.0 - math.exp(-dt / SMOOTHING_S)
        head, velocity = human.head, velocity + gain * ((human.head - head) / dt - velocity)
    if human.palm is not None:
        away = human.palm - points.measured[0]
        gap = length(away.tolist())
        line = away / gap if gap >= limits.touching else line
    return Remembered(head, velocity, max(seen_ns, before.seen_ns), line)


def allowed_speed(limit: float, fleeing: float, distance: float, braking: float, straight: float = 1.0) -> float:
    """How fast, m/s, the plate may go towards something, so that it can still be slow enough when it gets there.

    There it may have ``limit`` + ``fleeing``, but not less than 0. Of a speed a the fraction ``straight`` leads there.
    Until then, ``distance`` / (straight a - ``fleeing``) s away, it can lose ``braking`` times as much: the answer is
    the root of (a - there) (straight a - fleeing) = braking · distance.

    Args:
        limit: m/s, largest closing speed at its end.
        fleeing: m/s, how fast the other one moves away; negative where it comes nearer.
        distance: m, left until ``limit`` holds.
        braking: m/s².
        straight: cosine of the angle between its path and the line between them, 0 to 1.
    """
    there = max(0.0, limit + fleeing)
    if distance <= 0.0:
        return there
    loss = braking * distance
    root = math.sqrt((straight * there - fleeing) ** 2 + 4.0 * straight * loss)
    if straight > 1e-9 and straight * there + fleeing > 0.0:  # of two forms the one without a difference of equals
        return (straight * there + fleeing + root) / (2.0 * straight)
    slack = root - straight * there - fleeing
    return 2.0 * (loss - there * fleeing) / slack if slack > 0.0 else math.inf if loss > 0.0 else there


def gap_to_hand(human: Human, points: Points) -> float:
    """From the plate, where it is or is commanded to be, to the nearest place where the palm may be, m.

    0 where the palm is not known.
    """
    if human.palm is None:
        return 0.0
    palm = human.palm.tolist()
    gap = min(math.dist(palm, points.commanded[0].tolist()), math.dist(palm, points.measured[0].tolist()))
    return max(0.0, gap - human.palm_seen.margin)


def limit_closing_speed(
    limits: Contact, seen: Remembered, human: Human, points: Points, velocities: Array, dt: float
) -> tuple[Array, float | None]:
    """The joints' velocities (J,), rad/s, without what would let plate and hand meet too fast.

    Along the line between them, from far away: the hand may keep its velocity, the plate has to be able to brake. What
    of the plate's motion is too fast along that line is taken out, with the least change of the joints; across it the
    plate may still get in front of the hand. A plate that moves away is left alone; so is one whose hand flees. Where
    the hand is not known, it may be anywhere: the plate is no faster than the limit. Where it was close from the first
    look on, the line is not known: the plate stands.

    Returns:
        the velocities, and how fast plate and hand then close in, m/s (None where that is not known).
    """
    limit, plate = STRAIGHT * limits.speed, points.jacobians[0] @ velocities
    if human.palm is None or human.palm_velocity is None:
        return _fraction(limit, length(plate.tolist())) * velocities, None
    if seen.line is None:
        return np.zeros_like(velocities), None
    towards, fleeing = float(seen.line @ plate), float(seen.line @ human.palm_velocity)
    distance = gap_to_hand(human, points) - limits.near - max(0.0, towards - fleeing) * dt
    allowed = allowed_speed(limit, fleeing, distance, limits.braking)
    if towards <= allowed:
        return velocities, towards - fleeing
    along = seen.line @ points.jacobians[0]
    return velocities - (towards - allowed) / float(along @ along) * along, allowed - fleeing


def speeds_near_people(parts: Array) -> list[float]:
    """(P,) m/s: how fast points are whose velocities are the sum of the joints' ``parts`` (P, 3, J), m/s; that of one
    joint alone counts, too, by 1 / :data:`ALONE`."""
    alone = np.linalg.norm(parts, axis=1).max(axis=1) / ALONE
    return np.maximum(np.linalg.norm(parts.sum(axis=2), axis=1), alone).tolist()


def face_zone_fraction(
    limits: Face, seen: Remembered, points: Points, parts: Array, dt: float, margin: float = 0.0
) -> float:
    """How much of the joints' velocities may be kept so that the points are slow near the head.

    Inside the zone, which is ``margin`` m wider where the head's place is not sure, a point is no faster than the
    limit, whatever its direction, less what the head itself comes nearer, and no joint alone moves it faster than
    :data:`ALONE` times that; outside it can still brake before the zone, which one that passes by comes near more
    slowly. A point outside that moves away is left alone.

    Args:
        limits: near the head.
        seen: what is known of the person.
        points: of the arm.
        parts: (P, 3, J) m/s, by which each joint moves each point.
        dt: s, of the tick.
        margin: m.
    """
    if seen.head is None:
        return 0.0
    fraction, limit, radius = 1.0, STRAIGHT * limits.speed, limits.radius + margin
    head, head_velocity = seen.head.tolist(), seen.head_velocity.tolist()
    commanded, measured = points.commanded.tolist(), points.measured.tolist()
    speeds = speeds_near_people(parts)
    for number, velocity in enumerate(parts.sum(axis=2).tolist()):
        speed = speeds[number]
        for place in (commanded[number], measured[number]):
            away = [h - p for h, p in zip(head, place, strict=True)]
            distance = length(away)
            if distance - speed * dt > radius and _dot(away, velocity) <= 0.0:
                continue
            fleeing = min(0.0, _dot(away, head_velocity) / max(distance, 1e-9))
            left = distance - radius - (speed - fleeing) * dt
            straight = _dot(away, velocity) / max(distance * speed, 1e-9)
            fraction = min(fraction, _fraction(speed_near_face(limit, fleeing, left, limits.braking, straight), speed))
    return fraction


def speed_near_face(limit: float, fleeing: float, distance: float, braking: float, straight: float) -> float:
    """How fast, m/s, a point may be that is ``distance`` m outside the face's zone; see :func:`allowed_speed`."""
    return allowed_speed(limit, fleeing, distance, braking, min(max(straight, 1.0 - distance / BORDER, 0.0), 1.0))


def monitor_separation(
    limits: Limits,
    seen: Remembered,
    human: Human | None,
    points: Points,
    velocities: Array,
    dt: float,
) -> tuple[Array, float | None, set[Rule]]:
    """What of the joints' velocities (J,), rad/s, speed and separation monitoring allows.

    Args:
        limits: all of them.
        seen: what is known of the person.
        human: the person; None where nobody knows where they are.
        points: of the arm.
        velocities: (J,) rad/s, of the joints.
        dt: s, of the tick.

    Returns:
        the velocities, the closing speed of plate and hand that remains, m/s, or None, and the rules that acted.
    """
    if human is None:
        fraction = unseen_fraction(limits, points.jacobians * velocities)
        return fraction * velocities, None, {Rule.UNSEEN_PERSON} if fraction < 1.0 else set()
    limited, closing = limit_closing_speed(limits.contact, seen, human, points, velocities, dt)
    acted: set[Rule] = {Rule.CONTACT_SPEED} if limited is not velocities and (limited != velocities).any() else set()
    fraction, closing, slowing = points_fraction(limits, seen, human, points, limited, closing, dt)
    return fraction * limited, closing, acted | slowing


def unseen_fraction(limits: Limits, parts: Array) -> float:
    """How much of the joints' velocities may be kept where nobody knows where the person is: all points are as slow as
    near a head. ``parts`` (P, 3, J), m/s, is by which each joint moves each point."""
    return _fraction(STRAIGHT * min(limits.face.speed, limits.motion.point_speed), max(speeds_near_people(parts)))


def points_fraction(
    limits: Limits, seen: Remembered, human: Human, points: Points, rates: Array, closing: float | None, dt: float
) -> tuple[float, float | None, set[Rule]]:
    """How much of the joints' velocities (J,), rad/s, may be kept: slow near the face, not too fast anywhere.

    Returns:
        the fraction, what is then left of the ``closing`` speed of plate and hand, m/s, and the rules that acted.
    """
    parts = points.jacobians * rates
    velocities = parts.sum(axis=2)
    face = face_zone_fraction(limits.face, seen, points, parts, dt, human.head_seen.margin)
    anywhere = _fraction(STRAIGHT * limits.motion.point_speed, max(length(it) for it in velocities.tolist()))
    acted: set[Rule] = {Rule.FACE_ZONE} if face < 1.0 else set()
    if anywhere < face:
        acted.add(Rule.POINT_SPEED)
    fraction = min(face, anywhere)
    if fraction < 1.0 and closing is not None and seen.line is not None:
        closing -= (1.0 - fraction) * _dot(seen.line.tolist(), velocities[0].tolist())
    return fraction, closing, acted


def length(vector: list[float]) -> float:
    """Of a vector."""
    return math.sqrt(_dot(vector, vector))


def _dot(a: list[float], b: list[float]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _fraction(allowed: float, speed: float) -> float:
    return 1.0 if speed <= allowed else allowed / speed
