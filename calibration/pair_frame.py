"""Puts a set of two-person recordings into the project's world, whatever unit, axes and room they were made in.

Unit, vertical, handedness and floor are those of the whole set: one laboratory, one export. Place and heading are each
trial's own, from its first frames alone: what comes later is what a model has to tell. See
``docs/decisions/2026-11-21-unseen-recordings.md``.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from highfive.mocap_bridge.files.recording import Recording
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting

Pair = tuple[Recording, Recording]
"""The person's recording and that of the avatar's actor, from one file."""

_UNITS = {1e3: "metres, not millimetres", 1e-3: "millimetres, not metres", 10.0: "centimetres, not millimetres"} | {
    1e2: "metres, not centimetres", 1e-2: "centimetres, not metres", 0.1: "millimetres, not centimetres",
    25.4: "inches, not millimetres", 0.0254: "inches, not metres",
}  # fmt: skip


@dataclass(frozen=True)
class PairFrameSettings(Settings):
    """What is believed of a set of recordings and its people. Set by hand."""

    stature: float = setting(1.7, "m", above=0.0)
    """Height of a person, towards which the unit is taken that the numbers are in."""
    smallest: float = setting(0.35, "m", above=0.0)
    largest: float = setting(3.5, "m", above=0.0)
    """Diagonals of the box about a person's points, between which the unit is believed."""
    upright: float = setting(0.94, above=0.0, most=1.0)
    """Cosine between head above feet and a coordinate axis, for the axis to be the vertical."""
    start: float = setting(0.2, "s", least=0.0)
    """Beginning of a trial that says where its people stand."""
    near: float = setting(0.3, "m", least=0.0)
    """Two people nearer than that do not tell a direction."""
    head_height: float = setting(1.60, "m", above=0.0)
    """Of the head of a standing adult where nothing shows the floor."""
    at_origin: float = setting(0.15, "m", least=0.0)
    """The actor's pelvis from the origin in a set that is in the world already, ..."""
    at_floor: float = setting(0.06, "m", least=0.0)
    """... the floor from zero ..."""
    ahead: float = setting(float(np.radians(15.0)), "rad", least=0.0)
    """... and the person's direction from +x."""


PAIR_FRAME = PairFrameSettings()


@dataclass(frozen=True)
class SetFrame:
    """From the recordings' frame to one in metres, right-handed, z up, floor at zero.

    Attributes:
        scale: factor on all positions.
        mirrored: x is turned round first, as the recordings' axes are left-handed.
        rotation: (4,) quaternion, the vertical to z.
        floor: m, height of the floor after the rotation.
        in_world: the recordings are in the project's world already; nothing is to be moved.
        notes: what was found, a line each.
    """

    scale: float
    mirrored: bool
    rotation: Array
    floor: float
    in_world: bool
    notes: tuple[str, ...]

    def apply(self, recording: Recording) -> Recording:
        """The recording in that frame; unseen points stay zero."""
        if self.in_world:
            return recording
        return _mapped(recording, self._points)

    def _points(self, points: Array) -> Array:
        flipped = points * [-1.0, 1.0, 1.0] if self.mirrored else points
        return rotations.rotate(self.rotation, self.scale * flipped) - [0.0, 0.0, self.floor]


@dataclass(frozen=True)
class _Body:
    """Tracks (T, 3) of one person, m, NaN where not seen; ``sole`` (T,) is the height of the lower foot's sole."""

    head: Array
    centre: Array
    left: Array
    forward: Array
    feet: Array
    sole: Array


def find_frame(
    pairs: Sequence[Pair], people: MarkerSet, actors: MarkerSet, settings: PairFrameSettings = PAIR_FRAME
) -> SetFrame:
    """The frame of a whole set of recordings.

    Raises:
        HighFiveError: no frame shows head and trunk of the actor.
    """
    scale, notes = _unit(pairs, settings)
    sets = (people, actors)
    bodies = [_body(_scaled(r, scale), s) for pair in pairs for r, s in zip(pair, sets, strict=True)]
    up, up_note = _up(bodies, settings)
    mirrored = _left_handed(bodies, up)
    if mirrored:
        notes.append("the recordings' axes are left-handed: as they stand left is right; x is turned round")
        up = up * [-1.0, 1.0, 1.0]
    rotation = rotations.rotation_between(up, np.array([0.0, 0.0, 1.0]))
    level = SetFrame(scale, mirrored, rotation, 0.0, False, ())
    levelled = [tuple(level.apply(r) for r in pair) for pair in pairs]
    floor, floor_note = _floor([_body(r, s) for pair in levelled for r, s in zip(pair, sets, strict=True)], settings)
    as_is = scale == 1.0 and not mirrored and bool(np.all(up == [0.0, 0.0, 1.0])) and abs(floor) <= settings.at_floor
    if as_is and _in_world(_known_starts(pairs, people, actors, settings), settings):
        return replace(level, in_world=True, notes=("the recordings are in the avatar's world already",))
    notes += [up_note, floor_note, "each trial begins with the actor at the origin, the person ahead"]
    return replace(level, floor=floor, notes=tuple(notes))


def place_trial(
    person: Recording,
    actor: Recording,
    people: MarkerSet,
    actors: MarkerSet,
    settings: PairFrameSettings = PAIR_FRAME,
) -> Pair:
    """A levelled pair with the actor's pelvis above the origin at the start and the person in the direction of +x.

    Raises:
        HighFiveError: pelvis, hips or head of the two are never seen together.
    """
    here, angle = _starts(person, actor, people, actors, settings)
    turn = rotations.from_axis_angle("z", -angle)

    def points(values: Array) -> Array:
        return rotations.rotate(turn, values - [here[0], here[1], 0.0])

    return _mapped(person, points), _mapped(actor, points)


def _mapped(recording: Recording, transform) -> Recording:
    return replace(
        recording,
        points=np.where(recording.valid[..., None], transform(recording.points), 0.0),
        unlabelled=np.where(recording.unlabelled_valid[..., None], transform(recording.unlabelled), 0.0),
    )


def _scaled(recording: Recording, scale: float) -> Recording:
    return recording if scale == 1.0 else _mapped(recording, lambda points: scale * points)


def _unit(pairs: Sequence[Pair], s: PairFrameSettings) -> tuple[float, list[str]]:
    """Factor to metres, and a note if it is not 1."""
    size = float(np.median([_size(actor) for _, actor in pairs]))
    if s.smallest <= size <= s.largest or not size > 0.0:
        return 1.0, []
    scale = min(_UNITS, key=lambda factor: abs(np.log(factor * size / s.stature)))
    if not s.smallest <= scale * size <= s.largest:
        raise HighFiveError(
            f"the actor's points span {size:.3g} m; a person spans about {s.stature} m in no known unit"
        )
    return scale, [f"the actor's points span {size:.3g} m: read as {_UNITS[scale]}"]


def _size(recording: Recording) -> float:
    """Median diagonal of the box about the points; 0 if no frame shows most of them."""
    often = recording.valid.sum(axis=1)
    frames = often >= max(5, 0.7 * often.max(initial=0))
    if not frames.any():
        return 0.0
    seen = recording.valid[frames, :, None]
    low = np.where(seen, recording.points[frames], np.inf).min(axis=1)
    high = np.where(seen, recording.points[frames], -np.inf).max(axis=1)
    return float(np.median(np.linalg.norm(high - low, axis=-1)))


def _body(recording: Recording, marker_set: MarkerSet) -> _Body:
    points, seen = marker_set.arrange(recording.names, recording.points, recording.valid)
    points = np.where(seen[..., None], points, np.nan)

    def mean_of(*joints: str) -> Array:
        """Mean of the markers that are ever seen on these joints; NaN in frames that lack one."""
        columns = [m for m, joint in enumerate(marker_set.joints) if joint in joints and seen[:, m].any()]
        return points[:, columns].mean(axis=1) if columns else np.full((len(points), 3), np.nan)

    head = mean_of("head") if "head" in marker_set.joints else mean_of("neck")
    candidates = (mean_of("pelvis"), 0.5 * (mean_of("left_hip") + mean_of("right_hip")), head)
    centre = next((track for track in candidates if np.isfinite(track).any()), head)
    sides = [(mean_of(f"left_{part}"), mean_of(f"right_{part}")) for part in ("hip", "shoulder", "clavicle")]
    left = next((a - b for a, b in sides if np.isfinite(a - b).any()), np.full_like(head, np.nan))
    foot = [m for m, joint in enumerate(marker_set.joints) if joint.endswith(("_ankle", "_toe")) and seen[:, m].any()]
    heights = np.array([marker_set.segments[marker_set.joints[m]].centre[2] for m in foot])
    heights = heights + marker_set.local_positions[foot, 2] if foot else heights
    return _Body(
        head=head,
        centre=centre,
        left=left,
        forward=mean_of("left_toe", "right_toe") - mean_of("left_ankle", "right_ankle"),
        feet=mean_of("left_ankle", "right_ankle"),
        sole=np.fmin.reduce(points[:, foot, 2] - heights, axis=1) if foot else np.full(len(points), np.nan),
    )


def _up(bodies: Sequence[_Body], settings: PairFrameSettings) -> tuple[Array, str]:
    """Unit vector upward in the recordings' axes."""
    directions = []
    for body in bodies:
        low = body.feet if np.isfinite(body.feet).any() else body.centre
        upward = body.head - low
        upward = upward[np.isfinite(upward).all(axis=1)]
        if len(upward) and (mean := np.median(upward, axis=0)) @ mean > 0.01:
            directions.append(mean / np.linalg.norm(mean))
    if not directions:
        raise HighFiveError("head and pelvis or feet are never seen together; the recordings cannot be placed upright")
    mean = np.median(directions, axis=0)
    mean /= np.linalg.norm(mean)
    axis = int(np.argmax(np.abs(mean)))
    if abs(mean[axis]) < settings.upright:
        return mean, "up is where the heads are above the feet, along no axis of the recordings"
    up = np.zeros(3)
    up[axis] = np.sign(mean[axis])
    return up, f"up is {'-' if up[axis] < 0 else '+'}{'xyz'[axis]} of the recordings"


def _left_handed(bodies: Sequence[_Body], up: Array) -> bool:
    """The toes point backwards, if left is left: then the axes are a mirror image."""
    votes = []
    for body in bodies:
        ahead = np.sum(np.cross(body.left, up) * body.forward, axis=1)
        if np.isfinite(ahead).any():
            votes.append(np.nanmedian(ahead) < 0.0)
    return len(votes) > 0 and float(np.mean(votes)) > 0.8


def _floor(bodies: Sequence[_Body], settings: PairFrameSettings) -> tuple[float, str]:
    """Height of the floor in the levelled recordings, m."""
    soles = np.concatenate([body.sole for body in bodies])
    if np.isfinite(soles).any():
        low = float(np.nanmedian(soles))
        return low, f"the floor is at {low:+.3f} m, under the lower feet"
    head = float(np.nanmedian(np.concatenate([body.head[:, 2] for body in bodies])))
    if 1.2 < head < 2.1:
        return 0.0, "the floor is the recordings' zero, as no feet are seen"
    height = settings.head_height
    return head - height, f"the floor is {height} m below the heads, as no feet are seen"


def _starts(
    person: Recording, actor: Recording, people: MarkerSet, actors: MarkerSet, settings: PairFrameSettings
) -> tuple[Array, float]:
    """Where the actor's pelvis is at the start (3,), m, and in which direction, rad about z from +x, the person is."""
    one, other = _body(person, people), _body(actor, actors)
    together = np.flatnonzero(np.isfinite(one.centre + other.centre).all(axis=1))
    if not len(together):
        where = "the pelvis, the hips or the head of both people at once"
        raise HighFiveError(f"{actor.source} never shows {where}; the trial cannot be placed")
    first = together[: max(1, round(settings.start * actor.rate_hz))]
    here, there = other.centre[first].mean(axis=0), one.centre[first].mean(axis=0)
    ahead = there - here
    if np.hypot(*ahead[:2]) < settings.near:
        ahead = np.cross(other.left[first], [0.0, 0.0, 1.0])
        ahead = ahead[np.isfinite(ahead).all(axis=1)].sum(axis=0)
    return here, float(np.arctan2(ahead[1], ahead[0]))


def _known_starts(
    pairs: Sequence[Pair], people: MarkerSet, actors: MarkerSet, settings: PairFrameSettings
) -> list[tuple[Array, float]]:
    """Of the trials that show where both stand; one of which that is not known is a matter for itself."""
    starts = []
    for pair in pairs:
        with suppress(HighFiveError):
            starts.append(_starts(*pair, people, actors, settings))
    return starts


def _in_world(starts: Sequence[tuple[Array, float]], s: PairFrameSettings) -> bool:
    """The actors stand at the origin and have the person in the direction of +x, with few exceptions."""
    if not starts:
        return False
    away = np.array([np.hypot(*here[:2]) for here, _ in starts])
    angle = np.abs([angle for _, angle in starts])
    usual = np.median(away) <= s.at_origin and np.median(angle) <= s.ahead
    return bool(usual and np.quantile(away, 0.9) <= 2 * s.at_origin and np.quantile(angle, 0.9) <= 2 * s.ahead)
