"""Simulated people who raise a hand for something else than a high five.

Simulated, and to be called so wherever figures of it appear: what each gesture is, and how large, was set by hand. The
body, its tempo and posture in an emotion, the markers and their capture are those of the simulated actors
(:mod:`highfive.hil.sim.people.actors`); the hand goes along minimum-jerk movements between key poses (Flash & Hogan
1985), which inverse kinematics solves for the palm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from highfive.hil.sim.avatar import avatar_skeleton, right_palm
from highfive.hil.sim.limb_ik import solve_arm
from highfive.hil.sim.people.emotions import EmotionStyle, emotion_style
from highfive.hil.sim.people.gestures import GESTURES, Hand, Landmarks
from highfive.hil.sim.people.grid import GRID_Y, GRID_Z
from highfive.hil.sim.people.performance import hanging_arm, with_arm
from highfive.hil.sim.people.posture import BodyMotion
from highfive.hil.sim.people.role import RATE_HZ, ActorMotion, Individual, PalmTarget, Role, draw_individual
from highfive.hil.sim.profiles import minimum_jerk
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.geometry.skeleton import Skeleton

CLEAR = 0.05
"""m, that a palm keeps at least from where palms could meet: the grid, halfway between person and avatar."""
MOVED = 0.02
"""m, by which a palm that has risen has moved."""
_DRAWS = 60
_USUAL = 0.6  # share of people who stand as in a high five; the others anywhere before the avatar
_NEAREST, _FURTHEST, _TURNED = 0.90, 1.60, 25.0  # m, m and °, of these
_HAND_TURNS = np.radians([0.0, -25.0, 25.0, -50.0, 50.0, -80.0, 80.0])
_SWIVELS = np.radians([0.0, -20.0, 20.0, -40.0, 40.0, -60.0, 60.0])
_FASTEST = 6.0  # m/s, of a palm
_AFTER = 0.3  # s, that the arm hangs again
_QUICKEST, _SLOWEST = 0.22, 3.0  # s, of a movement
_QUICKEST_STROKE = 0.12  # s
_BENT = 1.15  # of a hand's way over the straight one


@dataclass(frozen=True)
class Distractor:
    """One gesture of a simulated person.

    Attributes:
        gesture: a name of :data:`highfive.hil.sim.people.gestures.GESTURES`.
        emotion: in whose tempo and posture.
        person: in the avatar's world.
        palm: (T, 3) m, the right palm.
        rise_s: when the hand has moved by :data:`MOVED`, s.
    """

    gesture: str
    emotion: str
    person: ActorMotion
    palm: Array
    rise_s: float


def simulate_distractor(
    gesture: str, emotion: str, rng: np.random.Generator, person_body: Skeleton | None = None
) -> Distractor:
    """One gesture; every call differs as ``rng`` says: body, place and heading, tempo, size, path and repetitions.

    A draw that brings the palm within :data:`CLEAR` of where palms could meet is drawn again.

    Args:
        gesture, emotion: which.
        rng: where the differences come from.
        person_body: of the person; None draws one, of 0.92 to 1.08 of the avatar's size.

    Raises:
        HighFiveError: an unknown gesture or emotion, or no draw keeps clear.
    """
    if gesture not in GESTURES:
        raise HighFiveError(f"unknown gesture {gesture!r}; known are {', '.join(GESTURES)}")
    style = emotion_style(emotion)
    for _ in range(_DRAWS):
        size = float(np.clip(rng.normal(1.0, 0.035), 0.92, 1.08))
        body = avatar_skeleton().scaled(size) if person_body is None else person_body
        own = _gestures(body, style, gesture, rng)
        person, distance = _placed(own, rng)
        kinematics = person.skeleton.forward_kinematics(person.root_in_world, person.quaternions)
        palm, _, _ = right_palm(person.skeleton, *kinematics)
        speed = np.linalg.norm(np.diff(palm, axis=0), axis=1).max() * RATE_HZ
        if from_grid(palm, distance).min() > CLEAR and speed < _FASTEST:
            moved = np.linalg.norm(palm - palm[0], axis=1) > MOVED
            return Distractor(gesture, emotion, person, palm, float(np.argmax(moved)) / RATE_HZ)
    raise HighFiveError(f"no {gesture} of {_DRAWS} draws keeps clear of where palms could meet")


def from_grid(palm: Array, distance: float) -> Array:
    """How far palms (T, 3), m, are from the rectangle in which palms meet of people ``distance`` m apart: (T,), m."""
    low = np.array([0.5 * distance, min(GRID_Y), min(GRID_Z)])
    high = np.array([0.5 * distance, max(GRID_Y), max(GRID_Z)])
    return np.linalg.norm(palm - np.clip(palm, low, high), axis=-1)


def _gestures(skeleton: Skeleton, style: EmotionStyle, gesture: str, rng: np.random.Generator) -> ActorMotion:
    """The motion in the person's own frame: pelvis over the origin, facing +x."""
    plan = GESTURES[gesture](_landmarks(skeleton), rng)
    individual, start = draw_individual(rng), rng.uniform(0.25, 0.9)
    speed = plan.pace * style.person_peak_speed * float(np.exp(rng.normal(0.0, 0.2)))
    main = plan.hands[0]
    # A raised arm lifts the shoulder; the trunk does not turn to anybody.
    aside = PalmTarget(np.array([main.palm[0], min(GRID_Y), main.palm[2]]), main.normal, main.fingers, 0.0, 0.0)
    calm = replace(style, reach_lean=0.0, bounce=0.0)
    draft = BodyMotion(Role(skeleton, calm, individual, aside, start + 1.0, start + 3.0, start))
    hanging = _hanging(skeleton, draft, style, individual)
    way = [hanging, *(hand.palm for hand in plan.hands), hanging]
    lengths = np.linalg.norm(np.diff(way, axis=0), axis=1)
    # A minimum-jerk movement peaks at 1.875 of its mean speed; the hand's way is bent.
    lasts = np.clip(_BENT * 1.875 * lengths / speed, _QUICKEST, _SLOWEST)
    lasts[1:-1] = np.clip(lasts[1:-1] / plan.strokes_quicker, _QUICKEST_STROKE, _SLOWEST)
    lasts[-1] *= style.return_ratio
    begins = start + np.concatenate([[0.0], np.cumsum(lasts[:-1])])
    begins[1:] += plan.waits
    begins[-1] += plan.holds
    end = float(begins[-1] + lasts[-1] + _AFTER)
    body = BodyMotion(Role(skeleton, calm, individual, aside, float(begins[1]), end, start))
    first, last = hanging_arm(style) + individual.rest_arm
    keys = [first]
    for hand, time in zip(plan.hands, begins[1:], strict=True):
        keys.append(_solved(skeleton, body, hand, float(time), keys[-1]))
    return with_arm(body.role, body, _between(np.array([*keys, last]), begins, lasts))


def _between(keys: Array, begins: Array, lasts: Array) -> Callable[[Array], Array]:
    """Hinge angles (T, 9) of times (T,): from each key (K, 9) to the next along a minimum jerk."""

    def angles(times: Array) -> Array:
        moved = minimum_jerk((times[:, None] - begins) / lasts)
        return keys[0] + moved @ np.diff(keys, axis=0)

    return angles


def _solved(skeleton: Skeleton, body: BodyMotion, hand: Hand, time: float, before: Array) -> Array:
    """Hinge angles (9,), rad, of the palm at its place, inside the limits, as near as can be to those ``before``."""
    clavicle, limits = body.clavicle(time), skeleton.hinge_limits[body.arm]
    desired = hand.elbow_out + body.role.individual.elbow_out
    best = (np.inf, np.zeros((3, 3)))
    for turn in _HAND_TURNS:
        fingers = rotations.rotate(rotations.from_rotation_vector(hand.normal * turn), hand.fingers)
        for swivel in _SWIVELS:
            angles = solve_arm(skeleton, clavicle, hand.palm, hand.normal, fingers, desired + swivel)
            kept = np.clip(angles, limits[..., 0], limits[..., 1])
            near = 0.02 * np.sum((kept.ravel() - before) ** 2)
            cost = float(50.0 * np.sum((angles - kept) ** 2) + 0.02 * (turn**2 + swivel**2) + near)
            if cost < best[0]:
                best = cost, kept
    return best[1].ravel()


def _hanging(skeleton: Skeleton, body: BodyMotion, style: EmotionStyle, individual: Individual) -> Array:
    """(3,) m, of the hanging palm."""
    times = np.zeros(1)
    angles = body.without_arm(times)
    angles[:, body.arm] = (hanging_arm(style) + individual.rest_arm)[0].reshape(3, 3)
    palm, _, _ = right_palm(
        skeleton, *skeleton.forward_kinematics(body.root(times), skeleton.from_hinges(skeleton.clamp(angles)))
    )
    return palm[0]


def _landmarks(skeleton: Skeleton) -> Landmarks:
    rest = np.zeros((1, len(skeleton), 3))
    kinematics = skeleton.forward_kinematics(skeleton.offsets[:1], skeleton.from_hinges(rest))
    positions, orientations = kinematics[0][0], kinematics[1][0]
    head = skeleton.index("head")
    limbs = [skeleton.offsets[skeleton.index(f"right_{name}")] for name in ("elbow", "wrist")]
    return Landmarks(
        shoulder=positions[skeleton.index("right_shoulder")],
        head=positions[head] + rotations.rotate(orientations[head], [0.02, 0.0, 0.08]),
        arm=float(np.linalg.norm(limbs, axis=-1).sum()),
        size=float(skeleton.offsets[0, 2] / avatar_skeleton().offsets[0, 2]),
    )


def _placed(motion: ActorMotion, rng: np.random.Generator) -> tuple[ActorMotion, float]:
    """The person before the avatar, and how far away, m."""
    distance, aside, turned = 0.98 + 0.03 * float(np.clip(rng.standard_normal(), -2, 2)), 0.0, 0.0
    if rng.uniform() > _USUAL:
        distance, aside = float(rng.uniform(_NEAREST, _FURTHEST)), float(rng.normal(0.0, 0.1))
        turned = float(np.radians(rng.uniform(-_TURNED, _TURNED)))
    turn = rotations.from_axis_angle("z", np.pi + turned)
    quaternions = motion.quaternions.copy()
    quaternions[:, 0] = rotations.multiply(turn, quaternions[:, 0])
    root = rotations.rotate(turn, motion.root_in_world) + np.array([distance, aside, 0.0])
    return ActorMotion(motion.skeleton, root, quaternions), distance
