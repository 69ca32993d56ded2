"""The simulated pair of actors: a person who raises a hand to a cell of the grid, and an avatar actor who meets it.

Simulated, and to be called so wherever figures of it appear. Both actors are full bodies of their own size. What each
does is in :mod:`highfive.hil.sim.people.performance`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import mujoco
import numpy as np

from highfive.hil.sim.avatar import Pose, avatar_skeleton, right_palm
from highfive.hil.sim.people.emotions import emotion_style
from highfive.hil.sim.people.grid import CELLS, GRID_Y, GRID_Z
from highfive.hil.sim.people.performance import comfortable_palm, perform, reach_duration
from highfive.hil.sim.people.role import ARM, RATE_HZ, ActorMotion, Role, draw_individual
from highfive.hil.sim.scene import Scene, build_scene
from highfive.hil.sim.touch import TouchReader
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.geometry.skeleton import Skeleton

MOST_DRAWS = 80
"""So many pairs in a row that cannot meet, and none is drawn any more."""
_GRAZE = 0.004  # m of overlap that skin takes


@dataclass(frozen=True)
class PairTrial:
    """One simulated high five.

    Attributes:
        emotion, cell, repetition: what was requested.
        person: the person, who stands at x about 1 m and faces -x.
        avatar: the avatar actor, at the origin, facing +x.
        contact_frame: frame at which the palms touch.
        contact_point: (3,) m, where.
        draws: how many pairs were drawn until these two could meet.
    """

    emotion: str
    cell: str
    repetition: int
    person: ActorMotion
    avatar: ActorMotion
    contact_frame: int
    contact_point: Array
    draws: int = 1


class CannotMeetError(HighFiveError):
    """Nobody of this size can meet there."""


def simulate_pair(
    emotion: str, cell: str, repetition: int, rng: np.random.Generator, person_body: Skeleton | None = None
) -> PairTrial:
    """One high five in ``emotion`` at ``cell`` of the grid; every call differs as ``rng`` says.

    Differences: the person's body size and distance, tempo, start pose, sway, path, jitter of the cell, palm direction.
    A draw in which a joint limit keeps the palms apart, or an arm runs through a body, is drawn again.

    Args:
        emotion, cell, repetition: which.
        rng: where the differences come from.
        person_body: of the person; None draws one, of 0.92 to 1.08 of the avatar's size.

    Raises:
        CannotMeetError: no pair of :data:`MOST_DRAWS` could meet.
        HighFiveError: an unknown emotion or cell.
    """
    for draws in range(1, MOST_DRAWS + 1):
        trial = _draw_pair(emotion, cell, repetition, rng, person_body)
        if _palms_meet(trial) and _bodies_clear(trial):
            return replace(trial, draws=draws)
    raise CannotMeetError(
        f"the simulated actors cannot meet at cell {cell} in {emotion}: {MOST_DRAWS} draws ran into limits"
    )


def _palms_meet(trial: PairTrial) -> bool:
    """Palms within 1 mm and 1° at contact, and no arm quicker than an arm can be (2,500 rad/s²)."""
    ends = []
    for motion in (trial.avatar, trial.person):
        frame = slice(trial.contact_frame, trial.contact_frame + 1)
        kinematics = motion.skeleton.forward_kinematics(motion.root_in_world[frame], motion.quaternions[frame])
        ends.append(right_palm(motion.skeleton, *kinematics))
        arm = [motion.skeleton.index(name) for name in ARM]
        steps = rotations.multiply(rotations.conjugate(motion.quaternions[:-1, arm]), motion.quaternions[1:, arm])
        if np.abs(np.diff(rotations.to_rotation_vector(steps), axis=0)).max() * RATE_HZ**2 > 2500.0:
            return False
    (ours, normal, _), (theirs, facing, _) = ends
    return bool(np.linalg.norm(ours - theirs) < 1e-3 and (normal * -facing).sum() > np.cos(np.radians(1.0)))


def _bodies_clear(trial: PairTrial) -> bool:
    """The avatar's arm stays out of its own body (by the scene's contact shapes) and the hands out of both faces."""
    scene = _bare_scene()
    data, reader = scene.make_data(), TouchReader(scene)
    motion, person = trial.avatar, trial.person
    frames = slice(0, None, 4)
    hinges = motion.skeleton.to_hinges(motion.quaternions[frames])
    for root, angles in zip(motion.root_in_world[frames], hinges, strict=True):
        scene.set_pose(data, Pose(root, angles))
        mujoco.mj_kinematics(scene.model, data)
        mujoco.mj_collision(scene.model, data)
        touches = reader.read(data, forces=False)
        if any(t.distance < -_GRAZE for t in touches if not (t.expected or t.second.startswith("person"))):
            return False
    hands, faces = [], []
    for actor in (motion, person):
        positions, orientations = actor.skeleton.forward_kinematics(actor.root_in_world, actor.quaternions)
        head = actor.skeleton.index("head")
        faces.append(positions[:, head] + rotations.rotate(orientations[:, head], [0.02, 0.0, 0.08]))
        hands.append(positions[:, [actor.skeleton.index(f"right_{f}_3") for f in ("index", "middle", "ring")]])
    gaps = [np.linalg.norm(hand - face[:, None], axis=-1).min() for hand in hands for face in faces]
    return min(gaps) > 0.13


@cache
def _bare_scene() -> Scene:
    return build_scene()


def _draw_pair(
    emotion: str, cell: str, repetition: int, rng: np.random.Generator, given_body: Skeleton | None
) -> PairTrial:
    style = emotion_style(emotion)
    distance = 0.98 + 0.03 * np.clip(rng.standard_normal(), -2, 2)
    if cell not in CELLS:
        raise HighFiveError(f"unknown cell {cell!r}; the grid has {', '.join(CELLS)}")
    row, column = divmod(CELLS.index(cell), 3)
    nominal = np.array([0.5 * distance, GRID_Y[column], GRID_Z[row]])
    point = nominal + np.clip(rng.normal(0.0, [0.015, 0.02, 0.02]), -0.05, 0.05)
    # Palms turned a little to each one's left, as forearms can; straight on, the forearms run into their limits.
    facing = rotations.from_axis_angle("z", np.radians(40.0))
    normal = rotations.rotate(rotations.multiply(_jitter(rng, 5.0), facing), [1.0, 0.0, 0.0])

    start = rng.uniform(0.25, 0.45)
    speeds = np.array([style.peak_speed, style.person_peak_speed]) * np.exp(rng.normal(0.0, 0.10, 2))
    body = avatar_skeleton()
    drawn_size = float(np.clip(rng.normal(1.0, 0.035), 0.92, 1.08))
    person_body = body.scaled(drawn_size) if given_body is None else given_body
    performers = [(body, point, normal), (person_body, _turn(point, distance), -normal * [-1, -1, 1])]
    individuals = [draw_individual(rng) for _ in performers]
    palms = [comfortable_palm(b, style, who, p, n) for (b, p, n), who in zip(performers, individuals, strict=True)]

    # How long each reach takes at the desired speed decides when the palms can meet.
    drafts = zip(performers, individuals, palms, speeds, strict=True)
    reach, person_reach = (reach_duration(b, style, who, palm, speed) for (b, _, _), who, palm, speed in drafts)
    person_reach = max(person_reach, reach + style.reaction)
    contact = np.ceil((start + person_reach) * RATE_HZ) / RATE_HZ
    end = contact + 0.1 + style.return_ratio * max(person_reach, reach) + 0.3
    avatar, person = (
        perform(Role(b, style, who, palm, contact, end, contact - duration))
        for (b, _, _), who, palm, duration in zip(performers, individuals, palms, (reach, person_reach), strict=True)
    )
    frame = round(contact * RATE_HZ)
    return PairTrial(emotion, cell, repetition, _face_the_avatar(person, distance), avatar, frame, point)


def _jitter(rng: np.random.Generator, degrees: float) -> Array:
    return rotations.from_rotation_vector(np.radians(degrees) * np.clip(rng.standard_normal(3), -2, 2) * 0.6)


def _turn(point: Array, distance: float) -> Array:
    """A point of the world in the frame of an actor who stands at x = ``distance`` and faces -x; its own inverse."""
    return np.array([distance, 0.0, 0.0]) + point * [-1, -1, 1]


def _face_the_avatar(motion: ActorMotion, distance: float) -> ActorMotion:
    half_turn = rotations.from_axis_angle("z", np.pi)
    quaternions = motion.quaternions.copy()
    quaternions[:, 0] = rotations.multiply(half_turn, quaternions[:, 0])
    root = np.array([distance, 0.0, 0.0]) + motion.root_in_world * [-1, -1, 1]
    return ActorMotion(motion.skeleton, root, quaternions)
