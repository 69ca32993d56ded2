"""Clips of the avatar turning round, as an experiment shows them: a lab's own, or the simulated actor's."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from highfive.calibration.subject import fit_subject
from highfive.hil.datasets.training_data import SAME_SIZE, SOLVE_RATE_HZ, unwrapped
from highfive.hil.experiments.protocol import Protocol
from highfive.hil.session.session import RATE_HZ, Session, Tick, TickInput
from highfive.hil.sim.avatar import Pose, avatar_skeleton
from highfive.hil.sim.people.role import ActorMotion
from highfive.hil.sim.people.turning import turning
from highfive.hil.trials.partners import Partner
from highfive.mocap_bridge.body.body_solver import solve_body
from highfive.mocap_bridge.files.c3d import read_c3d
from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.markers.recognise import find_marker_set
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

SIMULATED = "simulated"
"""In place of a folder."""
TAP = 0.14
"""m, from the middle of a shoulder joint to the middle of the palm's surface: the hand lies on the shoulder."""
NEAR = 0.45
"""m, by so much the avatar stands nearer than for a high five: its shoulder is where a palm would be met."""
END_S = 0.2
"""The end of a clip, whose mean heading is towards who tapped, s."""
SEED = 2013
"""Of the simulated clips: the same in all runs."""


@dataclass(frozen=True)
class Clip:
    """One of them, from the tap on.

    Attributes:
        name: ``angry 2``.
        poses: at 120 Hz; the first shows the back, the last faces +x.
    """

    name: str
    poses: tuple[Pose, ...]


def load_clips(source: str, protocol: Protocol) -> Mapping[tuple[str, int], Clip]:
    """All that an experiment shows, by style and number from 1.

    Args:
        source: a folder with ``angry_1.c3d`` and so on, of one actor with markers of the whole body; or
            :data:`SIMULATED`.
        protocol: the experiment.

    Raises:
        HighFiveError: one is missing, or cannot be read or solved.
    """
    found: dict[tuple[str, int], Clip] = {}
    for place, style in enumerate(style.name for style in protocol.styles):
        for number in range(1, protocol.clips + 1):
            if source == SIMULATED:
                motion = turning(style, np.random.default_rng([SEED, place, number]))
            else:
                motion = recorded_turn(Path(source) / f"{style}_{number}.c3d")
            found[style, number] = Clip(f"{style} {number}", _poses(motion))
    return found


def recorded_turn(path: Path) -> ActorMotion:
    """The motion of an actor's C3D file, on the avatar's body, from where she stands first, facing +x in the end.

    Raises:
        HighFiveError: it is not there, too short, or shows too little of a body.
    """
    if not path.is_file():
        raise HighFiveError(f"--clips: there is no {path}; a clip of each style and number is needed")
    recording = read_c3d(path)
    names = tuple(name.rpartition(":")[2] for name in recording.names)
    try:
        worn = find_marker_set(names)
        if not {"pelvis", "left_hip", "right_hip"} & set(worn.joints):
            raise HighFiveError(f"it shows no pelvis and no hip (marker set {worn.name}); the whole body is needed")
        points, valid = worn.arrange(names, recording.points, recording.valid)
        if len(points) < recording.rate_hz * END_S * 2.0:
            raise HighFiveError(f"it lasts {len(points) / recording.rate_hz:.1f} s, which is no turn")
        subject = fit_subject(avatar_skeleton(), worn, points, valid)
        step = max(1, round(recording.rate_hz / SOLVE_RATE_HZ))
        keys = np.unique(np.append(np.arange(0, len(points), step), len(points) - 1))
        solved = solve_body(subject.skeleton, worn, points[keys], valid[keys])
    except HighFiveError as error:
        raise HighFiveError(f"--clips: {path}: {error}") from None
    skeleton = avatar_skeleton()
    size = skeleton.offsets[0, 2] / subject.skeleton.offsets[0, 2]
    scene = 1.0 if abs(size - 1.0) < SAME_SIZE else size
    turns = unwrapped(skeleton.to_rotation_vectors(solved.quaternions))
    rows = np.concatenate([turns, solved.root * [scene, scene, size]], axis=-1)
    times = np.arange(0.0, (len(points) - 1) / recording.rate_hz, 1.0 / RATE_HZ)
    motion = CubicSpline(keys / recording.rate_hz, rows)(times)
    return _facing(ActorMotion(skeleton, motion[:, -3:], skeleton.from_rotation_vectors(motion[:, :-3])))


def _facing(motion: ActorMotion) -> ActorMotion:
    """Turned about the vertical so that its end faces +x, and moved so that it begins over the origin."""
    ahead = rotations.rotate(motion.quaternions[:, 0], [1.0, 0.0, 0.0])[-round(END_S * RATE_HZ) :].mean(axis=0)
    turn = rotations.from_axis_angle("z", -float(np.arctan2(ahead[1], ahead[0])))
    quaternions = motion.quaternions.copy()
    quaternions[:, 0] = rotations.multiply(turn, quaternions[:, 0])
    root = rotations.rotate(turn, motion.root_in_world - motion.root_in_world[0] * [1.0, 1.0, 0.0])
    return ActorMotion(motion.skeleton, root, quaternions)


def _poses(motion: ActorMotion) -> tuple[Pose, ...]:
    skeleton, root = avatar_skeleton(), motion.root_in_world + np.array([NEAR, 0.0, 0.0])
    hinges = skeleton.to_hinges(motion.quaternions)
    return tuple(Pose(place, angles) for place, angles in zip(root, hinges, strict=True))


class TappedClip:
    """The session's chain, but that the avatar stands with its back to her, and turns round as the clip does, once its
    shoulder is tapped.

    Attributes:
        tapped: it was.
        tapped_ns: when a switch said so, ns of the host's clock; None where her hand did.
        over: the clip has been shown.
    """

    def __init__(self, session: Session, clip: Clip, switch: Callable[[], int | None] | None = None) -> None:
        """Who is tracked is tracked as ever. ``switch`` says when the shoulder was tapped, ns, None as long as it was
        not; without one her hand does."""
        self._session, self._clip, self._switch = session, clip, switch
        self._shoulders = shoulders(clip.poses[0])
        self._from_ns = 0
        self.tapped = self.over = False
        self.tapped_ns: int | None = None

    def reset(self) -> None:
        """A new trial."""
        self._session.reset()
        self.tapped = self.over = False
        self.tapped_ns = None

    def step(self, frame: MarkerFrame | None, time_ns: int | None = None) -> Tick:
        """One tick, in which the clip is shown."""
        tick = self._session.step(frame, time_ns)
        if not self.tapped:
            self.tapped, self._from_ns = self._is_tapped(tick), tick.time_ns
        row = round(1e-9 * (tick.time_ns - self._from_ns) * RATE_HZ) if self.tapped else 0
        self.over = row >= len(self._clip.poses)
        return replace(tick, pose=self._clip.poses[min(row, len(self._clip.poses) - 1)])

    def _is_tapped(self, tick: Tick) -> bool:
        if self._switch is not None:
            self.tapped_ns = self._switch()
            return self.tapped_ns is not None
        away = np.linalg.norm(self._shoulders - tick.person.palm.position, axis=1)
        return tick.person.valid and bool(away.min() < TAP)

    def until_over(self, inputs: Iterable[TickInput]) -> Iterator[TickInput]:
        """The inputs until the clip has been shown."""
        for begins in inputs:
            yield begins
            if self.over:
                return


def shoulders(pose: Pose) -> Array:
    """(2, 3) m, the middles of both shoulder joints in the world."""
    skeleton = avatar_skeleton()
    positions, _ = skeleton.forward_kinematics(pose.root_in_world[None], pose.quaternions[None])
    return positions[0, [skeleton.index(f"{side}_shoulder") for side in ("right", "left")]]


def tapping(partner: Partner, shoulder: Array) -> Partner:
    """A simulated person who stands where the high five that she raises her hand for ends at a ``shoulder``, (3,) m."""
    assert partner.palm is not None
    away = partner.palm - shoulder
    aside = away[np.nanargmin(np.linalg.norm(away, axis=1))] * [1.0, 1.0, 0.0]
    recording = replace(partner.recording, points=partner.recording.points - aside)
    return replace(partner, recording=recording, palm=partner.palm - aside)


def going_on(partner: Partner, seconds: float) -> Partner:
    """A simulated person who stands for some seconds more, as she does last: she looks on."""
    recording = partner.recording
    last, count = int(np.flatnonzero(recording.valid.all(axis=1))[-1]), round(RATE_HZ * seconds)
    points = np.concatenate([recording.points[: last + 1], np.repeat(recording.points[last : last + 1], count, axis=0)])
    valid = np.concatenate([recording.valid[: last + 1], np.repeat(recording.valid[last : last + 1], count, axis=0)])
    longer = make_recording(RATE_HZ, recording.names, points, valid)
    return replace(partner, recording=longer, palm=None, other_palm=None, contact_frame=-1)
