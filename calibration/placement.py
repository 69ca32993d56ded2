"""Puts a recording of real people into the project's world: z up, origin under the avatar's pelvis, +x to the person.

Nothing needs to be given: the head shows which way is up, the feet where the floor is, and the partner, if the file has
one, where the avatar is to stand.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from highfive.mocap_bridge.files.recording import Recording
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class PlacementSettings(Settings):
    """Where the avatar is to stand, and what is believed of a person. Set by hand."""

    avatar_reach: float = setting(0.50, "m", above=0.0)
    """Horizontal distance of a comfortable contact from the avatar's pelvis."""
    nearest: float = setting(0.90, "m", above=0.0)
    furthest: float = setting(1.20, "m", above=0.0)
    """Places of the avatar from the person where no partner shows it, pelvis to pelvis."""
    raised_below: float = setting(0.15, "m", least=0.0)
    """A hand that comes so near the shoulder's height, below it, was raised."""
    head_height: float = setting(1.60, "m", above=0.0)
    """Of the head's markers of a standing adult where nothing shows the floor."""

    raised_over: float = setting(0.10, "m", above=0.0)
    """Below its highest within which a hand counts as held up."""


PLACEMENT = PlacementSettings()


@dataclass(frozen=True)
class Placement:
    """A rigid transform from a recording's frame into the world.

    Attributes:
        rotation: (4,) quaternion.
        translation: (3,) m, added after the rotation.
        notes: what it rests on, one line each.
        guesses: those of them that nothing in the recording shows.
    """

    rotation: Array
    translation: Array
    notes: tuple[str, ...]
    guesses: tuple[str, ...] = ()

    def apply(self, points: Array) -> Array:
        """Points (..., 3), m, of the recording in the world."""
        return rotations.rotate(self.rotation, points) + self.translation

    def turned(self, covariances: Array) -> Array:
        """Covariances (..., 3, 3), m², of points of the recording in the world."""
        turn = rotations.to_matrix(self.rotation)
        return turn @ covariances @ turn.T

    def apply_to(self, recording: Recording) -> Recording:
        """The whole recording in the world; unseen points stay zero."""
        return replace(
            recording,
            points=np.where(recording.valid[..., None], self.apply(recording.points), 0.0),
            unlabelled=np.where(recording.unlabelled_valid[..., None], self.apply(recording.unlabelled), 0.0),
        )


@dataclass(frozen=True)
class _Person:
    """Tracks of one person, (T, 3) m, NaN where not seen.

    ``left`` points from the right half of the trunk to the left one and is zero if the set has only one half;
    ``everything`` is all markers (T, M, 3).
    """

    head: Array
    shoulder: Array
    hand: Array
    centre: Array
    left: Array
    everything: Array


def place_person(
    person: Recording,
    marker_set: MarkerSet,
    partner: Recording | None = None,
    partner_set: MarkerSet | None = None,
    settings: PlacementSettings = PLACEMENT,
) -> Placement:
    """Where a recorded person stands in the world.

    With a partner the avatar takes the partner's place, that of the pelvis when their hands are nearest, facing from
    pelvis to pelvis. Without one it stands before the person's hand at its furthest reach.

    Args:
        person: the markers of the person (no prefixes).
        marker_set: the person's set.
        partner: the markers of the partner in the same recording.
        partner_set: the partner's set; the person's if left out.
        settings: of the search.

    Raises:
        HighFiveError: the recording lacks markers of the head or the arm, or never shows both hands.
    """
    first = _person(person, marker_set)
    second = _person(partner, partner_set or marker_set) if partner is not None else None
    up, notes = _up_axis(first)
    level = rotations.rotation_between(up, np.array([0.0, 0.0, 1.0]))
    first = _turned(first, level)
    if second is not None:
        second = _turned(second, level)
        here, there, note = _beside_partner(first, second)
    else:
        here, there, note = _before_hand(first, settings)
    floor, floor_note, floor_seen = _floor(first, second, settings)
    guesses = () if floor_seen else (floor_note,)
    if second is None and not _raised(first, settings):
        guesses = (*guesses, f"{note}; no hand was raised as for a high five")
    facing = there - here
    yaw = rotations.from_axis_angle("z", -np.arctan2(facing[1], facing[0]))
    translation = -rotations.rotate(yaw, np.array([here[0], here[1], floor]))
    return Placement(rotations.multiply(yaw, level), translation, (*notes, floor_note, note), guesses)


def place_before_camera(
    person: Recording, marker_set: MarkerSet, camera: Array, settings: PlacementSettings = PLACEMENT
) -> Placement:
    """Where a person stands who is seen by one camera, in a frame that has z up and the floor at zero.

    The avatar is on the screen that the camera stands on, and she faces it. How far a hand reaches towards the camera
    is what the camera sees worst: the pictures in which the hand is highest say it together.

    Args:
        person: her markers.
        marker_set: of them.
        camera: (3,) m, in the recording's frame.
        settings: of the search.

    Raises:
        HighFiveError: markers of the head or the arm are missing, or hand and shoulder are never seen.
    """
    seen = _person(person, marker_set)
    known = np.isfinite(seen.hand + seen.shoulder + seen.head).all(axis=-1)
    if not known.any():
        raise HighFiveError("head, shoulder and hand are never seen together; stand back, from head to hips")
    hand, head = seen.hand[known], np.median(seen.head[known], axis=0)
    facing = (camera - head)[:2] / max(float(np.linalg.norm((camera - head)[:2])), 1e-9)
    raised = hand[:, 2] > hand[:, 2].max() - settings.raised_over
    ahead = float(np.median((hand[raised] - head)[:, :2] @ facing))
    away = float(np.clip(ahead + settings.avatar_reach, settings.nearest, settings.furthest))
    yaw = rotations.from_axis_angle("z", -np.arctan2(-facing[1], -facing[0]))
    avatar = np.array([*(head[:2] + away * facing), 0.0])
    note = f"the avatar stands {away:.2f} m before the person, towards the camera"
    guesses = () if _raised(seen, settings) else (f"{note}; no hand was raised as for a high five",)
    return Placement(yaw, -rotations.rotate(yaw, avatar), (note,), guesses)


def _person(recording: Recording, marker_set: MarkerSet) -> _Person:
    arm = marker_set.arm
    hand = arm.hand or arm.wrist
    required = (*arm.head, *arm.shoulder, *hand)
    points, seen = marker_set.arrange(recording.names, recording.points, recording.valid, required)
    points = np.where(seen[..., None], points, np.nan)
    pelvis = [m for m, joint in enumerate(marker_set.joints) if joint == "pelvis" and seen[:, m].any()]
    head = points[:, marker_set.indices(arm.head)].mean(axis=1)
    return _Person(
        head=head,
        shoulder=points[:, marker_set.indices(arm.shoulder)].mean(axis=1),
        hand=points[:, marker_set.indices(hand)].mean(axis=1),
        centre=points[:, pelvis].mean(axis=1) if pelvis else head,
        left=_leftward(marker_set, points),
        everything=points,
    )


def _leftward(marker_set: MarkerSet, points: Array) -> Array:
    halves = []
    for side in ("left", "right"):
        trunk = [m for m, joint in enumerate(marker_set.joints) if joint in (f"{side}_hip", f"{side}_shoulder")]
        halves.append(points[:, trunk].mean(axis=1) if trunk else None)
    left, right = halves
    return left - right if left is not None and right is not None else np.zeros((len(points), 3))


def _turned(person: _Person, rotation: Array) -> _Person:
    tracks = (person.head, person.shoulder, person.hand, person.centre, person.left, person.everything)
    return _Person(*(rotations.rotate(rotation, track) for track in tracks))


def _up_axis(person: _Person) -> tuple[Array, tuple[str, ...]]:
    """The coordinate axis, with its sign, that points most from the other markers to the head."""
    count = np.isfinite(person.everything).all(axis=-1).sum(axis=1, keepdims=True)
    difference = person.head - np.nansum(person.everything, axis=1) / np.maximum(count, 1)
    seen = np.isfinite(difference).all(axis=-1)
    if not seen.any():
        raise HighFiveError("the head's markers are never all seen; the recording cannot be placed in the world")
    mean = np.median(difference[seen], axis=0)
    axis = int(np.argmax(np.abs(mean)))
    up = np.zeros(3)
    up[axis] = np.sign(mean[axis])
    return up, (f"up is {'-' if up[axis] < 0 else '+'}{'xyz'[axis]} of the recording",)


def _raised(person: _Person, settings: PlacementSettings) -> bool:
    """Whether the hand once came up to the shoulder, of a person who has been turned upright."""
    above = person.hand[:, 2] - person.shoulder[:, 2]
    return bool(np.nanmax(above, initial=-np.inf) > -settings.raised_below)


def _floor(first: _Person, second: _Person | None, settings: PlacementSettings) -> tuple[float, str, bool]:
    """Height of the floor in the levelled recording, m, how that is known, and whether anything shows it."""
    everything = [p.everything for p in (first, second) if p is not None]
    lowest = np.fmin.reduce([np.fmin.reduce(points[..., 2], axis=1) for points in everything])
    low = float(np.nanpercentile(lowest, 20))
    head = float(np.nanmedian(first.head[:, 2]))
    if head - low > 1.3:
        return low, f"the floor is at {low:+.3f} m, where the lowest markers are", True
    if 1.2 < head < 2.1:
        return 0.0, "the floor is the recording's zero, as no marker is near the feet", True
    height = settings.head_height
    return head - height, f"the floor is {height} m below the head, as nothing shows it", False


def _beside_partner(person: _Person, partner: _Person) -> tuple[Array, Array, str]:
    """Places of avatar and person, and how they were found."""
    gap = np.linalg.norm(person.hand - partner.hand, axis=-1)
    gap[~np.isfinite(person.centre + partner.centre).all(axis=-1)] = np.nan
    if not np.isfinite(gap).any():
        raise HighFiveError("the hands of person and partner are never seen together; the avatar's place is not known")
    nearest = int(np.nanargmin(gap))
    note = (
        f"the avatar stands where the partner stood when the hands were nearest, {gap[nearest]:.2f} m, frame {nearest}"
    )
    return partner.centre[nearest], person.centre[nearest], note


def _before_hand(person: _Person, s: PlacementSettings) -> tuple[Array, Array, str]:
    """Places of avatar and person, and how they were found."""
    reach = person.hand - person.shoulder
    left = person.left[:, :2]
    width = np.linalg.norm(left, axis=-1)
    # Forward is across the body's width; of a set that shows no width any direction counts as forward.
    across = (reach[:, 0] * left[:, 1] - reach[:, 1] * left[:, 0]) / np.where(width > 0.0, width, 1.0)
    forward = np.where(width > 0.0, across, np.linalg.norm(reach[:, :2], axis=-1))
    # Forward and upward together: a hand that is given in greeting is not a raised one.
    distance = forward + reach[:, 2]
    distance[~np.isfinite(person.centre).all(axis=-1)] = np.nan
    if not np.isfinite(distance).any():
        raise HighFiveError("shoulder and hand are never seen together; the recording cannot be placed in the world")
    furthest = int(np.nanargmax(distance))
    centre = person.centre[furthest]
    # The hand comes to lie between the two pelvises: in a recorded pair it was within 3 cm of that line.
    ahead = (person.hand[furthest] - centre)[:2]
    facing = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    away = float(np.clip(np.linalg.norm(ahead) + s.avatar_reach, s.nearest, s.furthest))
    avatar = np.array([*(centre[:2] + away * facing), centre[2]])
    return (
        avatar,
        centre,
        f"the avatar stands {away:.2f} m before the person, where the hand reaches furthest (frame {furthest})",
    )
