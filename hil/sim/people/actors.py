"""The simulated pair of actors: a person who raises a hand to a cell of the grid, and an avatar actor who meets it.

Simulated, and to be called so wherever figures of it appear. Both actors are full bodies of their own size. Joints move
along minimum-jerk splines between key poses (Flash & Hogan 1985); the arms at the keys are solved for the palm, so that
palms meet.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled bindings ship no type stubs.)

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import mujoco
import numpy as np
from scipy.interpolate import BPoly, make_interp_spline
from scipy.optimize import minimize

from highfive.hil.sim.avatar import Pose, avatar_skeleton, right_palm
from highfive.hil.sim.limb_ik import solve_arm, solve_leg
from highfive.hil.sim.people.emotions import EmotionStyle, emotion_style
from highfive.hil.sim.profiles import minimum_jerk
from highfive.hil.sim.scene import Scene, build_scene
from highfive.hil.sim.touch import TouchReader
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.geometry.skeleton import Skeleton

RATE_HZ = 120.0
GRID_Y = (-0.25, 0.0, 0.25)
GRID_Z = (1.2, 1.4, 1.6)
CELLS = tuple(f"{row}{column}" for row in "ABC" for column in "123")
"""Cells of the imaginary grid: rows A to C from low to high, columns 1 to 3 from the avatar's right to its left."""

MOST_DRAWS = 80
"""So many pairs in a row that cannot meet, and none is drawn any more."""

_ARM = ("right_shoulder", "right_elbow", "right_wrist")
_TRUNK = ("lumbar_5", "lumbar_3", "thoracic_12", "thoracic_8")
_MARGIN = np.radians(3.0)
_GRAZE = 0.004  # m of overlap that skin takes
_FINGER_JOINTS = tuple(f"{f}_{n}" for f in ("index", "middle", "ring", "little") for n in (1, 2, 3))


@dataclass(frozen=True)
class ActorMotion:
    """Motion of one actor at 120 Hz.

    Attributes:
        skeleton: the actor's body.
        root_in_world: (T, 3) m.
        quaternions: (T, 53, 4), the pelvis relative to the world.
    """

    skeleton: Skeleton
    root_in_world: Array
    quaternions: Array


@dataclass(frozen=True)
class PairTrial:
    """One simulated high five.

    Attributes:
        emotion, cell, repetition: what was asked for.
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


@dataclass(frozen=True)
class _PalmTarget:
    """A palm at contact, the swivel of the elbow and the trunk's extra lean (rad) behind it."""

    position: Array
    normal: Array
    fingers: Array
    elbow_out: float
    extra_lean: float


@dataclass(frozen=True)
class _Individual:
    """How one performance differs from the next: angles in rad, lengths in m, times in s."""

    posture: Array
    sway_amplitude: Array
    sway_frequency: Array
    sway_phase: Array
    trunk_lead: float
    rest_arm: Array
    elbow_out: float
    wobble: Array


@dataclass(frozen=True)
class _Role:
    """One actor's part in a trial, in the actor's own frame (pelvis over the origin, facing +x)."""

    skeleton: Skeleton
    style: EmotionStyle
    individual: _Individual
    palm: _PalmTarget
    contact_s: float
    end_s: float
    onset_s: float


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
        arm = [motion.skeleton.index(name) for name in _ARM]
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
    facing = rotations.about_axis("z", np.radians(40.0))
    normal = rotations.rotate(rotations.multiply(_jitter(rng, 5.0), facing), [1.0, 0.0, 0.0])

    start = rng.uniform(0.25, 0.45)
    speeds = np.array([style.peak_speed, style.person_peak_speed]) * np.exp(rng.normal(0.0, 0.10, 2))
    body = avatar_skeleton()
    drawn_size = float(np.clip(rng.normal(1.0, 0.035), 0.92, 1.08))
    person_body = body.scaled(drawn_size) if given_body is None else given_body
    performers = [(body, point, normal), (person_body, _turn(point, distance), -normal * [-1, -1, 1])]
    individuals = [_draw_individual(rng) for _ in performers]
    palms = [_comfortable(b, style, who, p, n) for (b, p, n), who in zip(performers, individuals, strict=True)]

    # How long each reach takes at the wanted speed decides when the palms can meet.
    drafts = zip(performers, individuals, palms, speeds, strict=True)
    reach, person_reach = (_reach_duration(b, style, who, palm, speed) for (b, _, _), who, palm, speed in drafts)
    person_reach = max(person_reach, reach + style.reaction)
    contact = np.ceil((start + person_reach) * RATE_HZ) / RATE_HZ
    end = contact + 0.1 + style.return_ratio * max(person_reach, reach) + 0.3
    avatar, person = (
        _perform(_Role(b, style, who, palm, contact, end, contact - duration))
        for (b, _, _), who, palm, duration in zip(performers, individuals, palms, (reach, person_reach), strict=True)
    )
    frame = round(contact * RATE_HZ)
    return PairTrial(emotion, cell, repetition, _face_the_avatar(person, distance), avatar, frame, point)


def _draw_individual(rng: np.random.Generator) -> _Individual:
    joints = len(avatar_skeleton())
    return _Individual(
        posture=np.radians(rng.normal(0.0, 1.2, (joints, 3))) * _NOISY[:, None],
        sway_amplitude=np.radians(rng.normal(0.0, 0.35, (2, joints, 3))) * _NOISY[:, None],
        sway_frequency=rng.uniform(0.15, 0.6, (2, joints, 3)),
        sway_phase=rng.uniform(0, 2 * np.pi, (2, joints, 3)),
        trunk_lead=rng.uniform(0.03, 0.09),
        rest_arm=np.radians(rng.normal(0.0, [4, 2, 6, 6, 0, 8, 4, 3, 0], (2, 9))),
        elbow_out=np.radians(rng.normal(0.0, 5.0)),
        wobble=rng.normal(0.0, 0.02, 3),
    )


def _jitter(rng: np.random.Generator, degrees: float) -> Array:
    return rotations.from_rotation_vector(np.radians(degrees) * np.clip(rng.standard_normal(3), -2, 2) * 0.6)


def _turn(point: Array, distance: float) -> Array:
    """A point of the world in the frame of an actor who stands at x = ``distance`` and faces -x; its own inverse."""
    return np.array([distance, 0.0, 0.0]) + point * [-1, -1, 1]


def _face_the_avatar(motion: ActorMotion, distance: float) -> ActorMotion:
    half_turn = rotations.about_axis("z", np.pi)
    quaternions = motion.quaternions.copy()
    quaternions[:, 0] = rotations.multiply(half_turn, quaternions[:, 0])
    root = np.array([distance, 0.0, 0.0]) + motion.root_in_world * [-1, -1, 1]
    return ActorMotion(motion.skeleton, root, quaternions)


def _comfortable(
    skeleton: Skeleton, style: EmotionStyle, individual: _Individual, point: Array, normal: Array
) -> _PalmTarget:
    """Finger direction, elbow swivel and lean that put the palm at ``point`` facing ``normal`` inside the limits."""
    up = np.array([0.0, 0.0, 1.0]) - normal * normal[2]
    up = up / np.linalg.norm(up)
    wanted = np.radians(style.elbow_out) + individual.elbow_out

    best: tuple[float, _PalmTarget] | None = None
    for lean in np.radians([0.0, 5.0, 10.0, 15.0]):

        def target(choice: Array, lean: float = lean) -> _PalmTarget:
            fingers = rotations.rotate(rotations.from_rotation_vector(normal * choice[1]), up)
            return _PalmTarget(point, normal, fingers, float(choice[0]), float(lean))

        body = _Body(_Role(skeleton, style, individual, target(np.zeros(2)), 1.0, 2.0, 0.2))
        clavicle, limits = body.clavicle(1.0), skeleton.hinge_limits[body.arm]

        def beyond(choice: Array, clavicle=clavicle, limits=limits, target=target) -> float:
            palm = target(choice)
            angles = solve_arm(skeleton, clavicle, point, normal, palm.fingers, palm.elbow_out)
            stretched = max(0.0, angles[1, 0] + np.radians(20.0))
            over = np.maximum(0.0, np.maximum(limits[..., 0] + _MARGIN - angles, angles - limits[..., 1] + _MARGIN))
            return float((over**2).sum() + stretched**2)

        def discomfort(choice: Array, beyond=beyond) -> float:
            return 50.0 * beyond(choice) + 2e-3 * float(choice[1] ** 2 + (choice[0] - wanted) ** 2)

        starts = [np.array([e, f]) for e in np.radians([-10, 10, 30, 60]) for f in np.radians([-60, -30, 0, 30])]
        options = {"maxfev": 50, "xatol": 1e-3, "fatol": 1e-9}
        choice = minimize(discomfort, min(starts, key=discomfort), method="Nelder-Mead", options=options).x
        left = beyond(choice)
        if best is None or left < 0.5 * best[0]:
            best = (left, target(choice))
        if left < _MARGIN**2:
            break
    assert best is not None
    return best[1]


def _reach_duration(
    skeleton: Skeleton, style: EmotionStyle, individual: _Individual, palm: _PalmTarget, peak_speed: float
) -> float:
    """Duration, s, of a reach from rest to ``palm`` whose hand peaks at ``peak_speed`` m/s."""
    duration = 1.0
    for _ in range(3):
        # Again and again, because the speed asked for at contact keeps the peak from scaling as 1 / duration.
        role = _Role(skeleton, style, individual, palm, duration + 0.2, 2.0 * duration + 0.8, 0.2)
        times = np.linspace(role.onset_s, role.contact_s, 60)
        root, angles = _upper_body(role, times)
        centre, _, _ = right_palm(skeleton, *skeleton.forward_kinematics(root, skeleton.from_hinges(angles)))
        peak = np.linalg.norm(np.diff(centre, axis=0), axis=-1).max() / (times[1] - times[0])
        duration = float(np.clip(duration * peak / peak_speed, 0.25, 4.0))
    return duration


def _upper_body(role: _Role, times: Array) -> tuple[Array, Array]:
    """Pelvis (T, 3) m and hinge angles (T, 53, 3) rad with the legs still straight."""
    body = _Body(role)
    angles = body.without_arm(times)
    angles[:, body.arm] = _arm_motion(role, body)(times).reshape(-1, 3, 3)
    return body.root(times), angles


def _perform(role: _Role) -> ActorMotion:
    """The whole motion of one actor."""
    skeleton = role.skeleton
    times = np.arange(round(role.end_s * RATE_HZ) + 1) / RATE_HZ
    root, angles = _upper_body(role, times)
    pelvis = (root, rotations.from_hinges(skeleton.hinge_orders[0], angles[:, 0]))
    for side in ("right", "left"):
        leg = [skeleton.index(f"{side}_{n}") for n in ("hip", "knee", "ankle")]
        angles[:, leg] = solve_leg(skeleton, side, pelvis, _standing_ankle(skeleton, side))
    return ActorMotion(skeleton, root, skeleton.from_hinges(skeleton.clamp(angles)))


def _standing_ankle(skeleton: Skeleton, side: str) -> Array:
    """Where the ankle of ``side`` stands, (3,) m: the left foot a little in front."""
    ankle = sum(skeleton.offsets[skeleton.index(n)] for n in ("pelvis", f"{side}_hip", f"{side}_knee", f"{side}_ankle"))
    return ankle + (np.array([0.06, 0.02, 0.0]) if side == "left" else np.array([-0.04, -0.02, 0.0]))


class _Body:
    """All but the right arm as functions of time: posture, the trunk's part in the reach, gaze, fingers and sway."""

    def __init__(self, role: _Role) -> None:
        self.role, self.skeleton = role, role.skeleton
        self.arm = [self.skeleton.index(name) for name in _ARM]
        self._clavicle = self.skeleton.index("right_clavicle")
        self._base = self._posture() + role.individual.posture
        self._reach = self._reach_posture()

    def progress(self, times: Array) -> Array:
        """Share of the reach posture (T,), 0 at rest and 1 at contact, minimum jerk both ways."""
        role = self.role
        start, back = role.onset_s - role.individual.trunk_lead, role.contact_s + 0.05
        there = minimum_jerk((times - start) / (role.contact_s - start))
        return there - minimum_jerk((times - back) / (role.end_s - 0.25 - back))

    def without_arm(self, times: Array) -> Array:
        """Hinge angles (T, 53, 3), rad, with legs and right arm at zero."""
        return self._base + self.progress(times)[:, None, None] * self._reach + self._sway(times)

    def root(self, times: Array) -> Array:
        """Pelvis (T, 3) m: shifts forward in the reach, lower for a low cell, and bounces if the emotion does."""
        p, style = self.progress(times), self.role.style
        sway = 0.10 * self._sway(times)[:, 0]
        crouch = 0.012 + 0.06 * np.clip((1.45 - self.role.palm.position[2]) / 0.3, 0.0, 1.0)
        bounce = style.bounce * 4.0 * p * (1.0 - p)
        shift = np.stack(
            [0.02 * p + sway[:, 1], 0.01 * p + sway[:, 0], np.minimum(bounce, 0.4 * bounce) - crouch * p], axis=-1
        )
        return self.skeleton.offsets[0] * [1.0, 1.0, 0.988] + shift

    def _sway(self, times: Array) -> Array:
        """Slow involuntary movement (T, 53, 3), rad: two sinusoids a hinge, about half a degree."""
        who = self.role.individual
        # Counted from contact, so that the posture at contact does not depend on when that is.
        since = (times - self.role.contact_s)[:, None, None, None]
        waves = np.sin(2 * np.pi * who.sway_frequency * since + who.sway_phase)
        return (who.sway_amplitude * waves).sum(axis=1)

    def clavicle(self, time: float) -> tuple[Array, Array]:
        """Position (3,) m and orientation (4,) of the right clavicle joint."""
        times = np.array([time])
        quaternions = self.skeleton.from_hinges(self.without_arm(times))
        return self.skeleton.joint_in_world(self._clavicle, self.root(times)[0], quaternions[0])

    def _posture(self) -> Array:
        style, skeleton = self.role.style, self.skeleton
        degrees = np.zeros((len(skeleton), 3))
        for name in _TRUNK:
            degrees[skeleton.index(name), 0] = style.trunk_lean / len(_TRUNK)
        degrees[skeleton.index("neck"), 0] = 0.4 * style.head_pitch
        degrees[skeleton.index("head"), 0] = 0.6 * style.head_pitch - 0.5 * style.trunk_lean
        degrees[skeleton.index("right_clavicle")] = (0.0, -style.shoulder_lift, 0.0)
        degrees[skeleton.index("left_clavicle")] = (0.0, style.shoulder_lift, 0.0)
        degrees[skeleton.index("left_shoulder")] = (4.0, style.left_arm_out, 0.0)
        degrees[skeleton.index("left_elbow")] = (-style.rest_elbow, 0.0, -15.0)
        for side, sign in (("right", 1.0), ("left", -1.0)):
            for joint in _FINGER_JOINTS:
                degrees[skeleton.index(f"{side}_{joint}"), 0] = sign * style.finger_curl
            degrees[skeleton.index(f"{side}_thumb_2"), 0] = sign * 0.4 * style.finger_curl
        return np.radians(degrees)

    def _reach_posture(self) -> Array:
        """What is added to the posture at contact: the trunk turns and leans as far as the cell asks for."""
        style, skeleton, palm = self.role.style, self.skeleton, self.role.palm
        degrees = np.zeros((len(skeleton), 3))
        across = np.clip((palm.position[1] + 0.20) / 0.45, 0.0, 1.2)
        height = np.clip((palm.position[2] - 1.1) / 0.6, 0.0, 1.2)
        for name in _TRUNK[1:]:
            degrees[skeleton.index(name), 2] = 2.0 + 6.0 * across
        for name in _TRUNK:
            lean = style.reach_lean + np.degrees(palm.extra_lean)
            degrees[skeleton.index(name), 0] = lean / len(_TRUNK) + 1.5 * across
        degrees[0, 0] = 3.0 + 19.0 * across
        degrees[skeleton.index("right_clavicle")] = (8.0 + 14.0 * across, -6.0 - 14.0 * height, 0.0)
        degrees[skeleton.index("neck"), 2] = -5.0 - 12.0 * across
        degrees[skeleton.index("head"), 2] = -6.0 - 18.0 * across
        degrees[skeleton.index("head"), 0] = -4.0 * height
        degrees[skeleton.index("left_shoulder"), 0] = 8.0
        for joint in _FINGER_JOINTS:  # the hand opens
            degrees[skeleton.index(f"right_{joint}"), 0] = 4.0 - style.finger_curl
        degrees[skeleton.index("right_thumb_2"), 0] = -0.4 * style.finger_curl
        return np.radians(degrees)


def _arm_motion(role: _Role, body: _Body) -> Callable[[Array], Array]:
    """Hinge angles of shoulder, elbow and wrist (T, 9), rad, as a function of times (T,)."""
    style, palm, wobble = role.style, role.palm, role.individual.wobble

    def solve(time: float, offset: Array) -> Array:
        position = palm.position + offset
        clavicle = body.clavicle(time)
        return solve_arm(role.skeleton, clavicle, position, palm.normal, palm.fingers, palm.elbow_out).ravel()

    def velocity(time: float, speed: Array) -> Array:
        step = 1e-3
        return (solve(time + step, speed * step) - solve(time - step, -speed * step)) / (2.0 * step)

    # The arm hangs straight down whatever the trunk does, and clear of the thigh.
    hanging = np.radians(
        [2.0 - style.trunk_lean, -9.0 - 0.3 * style.left_arm_out, 0, -style.rest_elbow, 0, 15, 0, 0, 0]
    )
    first, last = hanging + role.individual.rest_arm
    start, contact, bounce = role.onset_s, role.contact_s, 0.05
    strike = style.contact_speed * palm.normal
    coming, going = velocity(contact, strike), velocity(contact + bounce, -strike)
    # Drawn back early for a strike, late for a plain reach, whose hand then follows one minimum-jerk curve.
    wind_up_s = start + (0.80 - 2.0 * style.wind_up) * (contact - start)
    # Both swing wide of the face.
    back = -(style.wind_up + 0.06) * palm.normal + [0.0, -0.05, -0.07] + wobble
    middle = make_interp_spline(
        [start, wind_up_s, contact],
        [first, solve(wind_up_s, back), solve(contact, np.zeros(3))],
        k=5,
        bc_type=([(1, np.zeros(9)), (2, np.zeros(9))], [(1, coming), (2, np.zeros(9))]),
    )
    follow_s = contact + bounce + 0.25 * (role.end_s - 0.25 - contact - bounce)
    follow = style.follow_through * np.array([-0.3, -1.0, -1.2]) - 0.10 * palm.normal + wobble
    after = make_interp_spline(
        [contact + bounce, follow_s, role.end_s - 0.2],
        [solve(contact + bounce, np.zeros(3)), solve(follow_s, follow), last],
        k=5,
        bc_type=(
            [(1, going), (2, np.zeros(9))],
            [(1, np.zeros(9)), (2, np.zeros(9))],
        ),
    )
    touch = BPoly.from_derivatives(
        [contact, contact + bounce],
        [
            [middle(contact), coming, np.zeros(9)],
            [after(contact + bounce), going, np.zeros(9)],
        ],
    )

    def angles(times: Array) -> Array:
        t = times[:, None]
        moving = np.where(
            t < contact,
            middle(np.clip(times, start, contact)),
            after(np.clip(times, contact + bounce, role.end_s - 0.2)),
        )
        return np.where(
            (t >= contact) & (t < contact + bounce), touch(np.clip(times, contact, contact + bounce)), moving
        )

    return angles


# Legs and fingers do not sway: the feet are planted and the fingers are set by the posture.
_NOISY = np.array(
    [
        float(n in (*_TRUNK, "pelvis", "neck", "head", "left_shoulder", "left_elbow", "right_clavicle"))
        for n in avatar_skeleton().names
    ]
)
