"""Two people from each file of a folder, under one marker set each, in the avatar's world, right hands meeting."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from highfive.calibration.hands import meeting_hands, mirrored
from highfive.calibration.pair_frame import Pair, find_frame, place_trial
from highfive.mocap_bridge.files.c3d import read_c3d
from highfive.mocap_bridge.files.recording import Recording
from highfive.mocap_bridge.markers.joint_centres import canonical_names, joint_centre_set, left_out
from highfive.mocap_bridge.markers.joint_shapes import recognise_shape
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.markers.recognise import find_marker_set
from highfive.model.errors import HighFiveError

SHORTEST_S = 0.3
"""A trial that lasts less shows no reaching."""

DEFAULT_PREFIXES = ("human", "avatar")
"""What the two people are called where nobody says otherwise."""

_LOOKED_AT = 12  # recordings, where points are identified by how they move


@dataclass(frozen=True)
class Role:
    """One of the two people as requested: a prefix of labels and a marker set, a name or a path, or None to find it."""

    prefix: str
    marker_set: str | None


@dataclass(frozen=True)
class PlacedPairs:
    """What was read.

    Attributes:
        kept: for each pair the index of its file; files that hold no trial are left out.
        pairs: the recordings of the person and of the avatar's actor; the actor's right hand is the one that meets.
        people, actors: their marker sets.
        reflected: the person's recordings are mirror images of what the actor meets, so that a right hand is tracked.
    """

    kept: tuple[int, ...]
    pairs: tuple[Pair, ...]
    people: MarkerSet
    actors: MarkerSet
    reflected: bool


def read_pairs(paths: Sequence[Path], human: Role, avatar: Role, say: Callable[[str], None]) -> PlacedPairs:
    """Reads files of two people each.

    Args:
        paths: the C3D files.
        human: the person.
        avatar: who the avatar learns from.
        say: called with a line about each thing that had to be found out.

    Raises:
        HighFiveError: a file is missing, none can be read, a person is not in one, the points are not those of a
            body, or no trial is left.
    """
    whole = _read(paths, say)
    human, avatar = _roles(list(whole.values()), human, avatar, say)
    # Of each whole recording, as large as both people of it together, only these are kept.
    pairs = {n: _pair(whole.pop(n), human, avatar) for n in list(whole)}
    persons, others = ([pair[role] for pair in pairs.values()] for role in (0, 1))
    people, actors = _set_of(persons, others, human, say), _set_of(others, persons, avatar, say)
    if (known := canonical_names(actors)) and not known.keys() & {"pelvis", "left_hip", "right_hip"}:
        raise HighFiveError(f"{avatar.prefix}: no pelvis and no hip is recognised in {', '.join(actors.names)}")
    long_enough = [n for n, (_, actor) in pairs.items() if len(actor) >= SHORTEST_S * actor.rate_hz]
    for n in sorted(pairs.keys() - set(long_enough)):
        say(f"{paths[n].name} is left out: {len(pairs[n][1])} frames are less than {SHORTEST_S} s")
    placed = _placed({n: pairs[n] for n in long_enough}, people, actors, say)
    if not placed:
        raise HighFiveError(f"none of the {len(paths)} files shows two people for {SHORTEST_S} s or longer")
    hands = meeting_hands(list(placed.values()), people, actors)
    if (hands.person, hands.actor) != ("right", "right"):
        share = f"in {hands.fraction:.0%} of the trials"
        say(f"the person's {hands.person} hand meets the actor's {hands.actor} one ({share}); left hands are mirrored")
    seen = [
        (
            mirrored(person, people) if hands.person == "left" else person,
            mirrored(actor, actors) if hands.actor == "left" else actor,
        )
        for person, actor in placed.values()
    ]
    return PlacedPairs(tuple(placed), tuple(seen), people, actors, hands.person != hands.actor)


def _read(paths: Sequence[Path], say: Callable[[str], None]) -> dict[int, Recording]:
    """The files that can be read: a damaged one costs its own trial; one that is not there is a slip in the table."""
    whole = {}
    for n, path in enumerate(paths):
        try:
            whole[n] = read_c3d(path, trust_unit=False)
        except HighFiveError as error:
            if not path.is_file():
                raise
            say(f"{path.name} is left out: {error}")
    if not whole:
        raise HighFiveError(f"none of the {len(paths)} files can be read; the reasons are above")
    return whole


def _placed(
    pairs: dict[int, Pair], people: MarkerSet, actors: MarkerSet, say: Callable[[str], None]
) -> dict[int, Pair]:
    """The pairs in the avatar's world; those that never show both people are left out."""
    if not pairs:
        return {}
    frame = find_frame(list(pairs.values()), people, actors)
    if frame.in_world:
        return pairs
    for note in frame.notes:
        say(note)
    placed = {}
    for n, (person, actor) in pairs.items():
        try:
            placed[n] = place_trial(frame.apply(person), frame.apply(actor), people, actors)
        except HighFiveError as error:
            say(f"{actor.source} is left out: {error}")
    return placed


def _roles(recordings: Sequence[Recording], human: Role, avatar: Role, say: Callable[[str], None]) -> tuple[Role, Role]:
    """The roles as requested; or, if nothing was requested and all files name the same two others, those two."""
    found = {tuple(sorted({name.partition(":")[0] for name in r.names if ":" in name})) for r in recordings}
    if (human.prefix, avatar.prefix) != DEFAULT_PREFIXES or len(found) != 1 or len(names := found.pop()) != 2:
        return human, avatar
    if {name.lower() for name in names}.intersection(DEFAULT_PREFIXES):
        return human, avatar
    one, other = names
    swapped = f"--human {other} --avatar {one} is the other way round"
    say(f"nobody is called human or avatar: {one} is taken for the person, {other} for the avatar's actor; {swapped}")
    return replace(human, prefix=one), replace(avatar, prefix=other)


def _repeated(names: Sequence[str]) -> set[str]:
    return {name for name in names if names.count(name) > 1}


def _pair(whole: Recording, human: Role, avatar: Role) -> Pair:
    return _together(person_in(whole, human.prefix), person_in(whole, avatar.prefix))


def _together(person: Recording, actor: Recording) -> Pair:
    """The pair from the first to the last frame that shows both; as it is if none does."""
    both = np.flatnonzero(person.valid.any(axis=1) & actor.valid.any(axis=1))
    if not len(both) or len(both) == len(person):
        return person, actor
    kept = slice(both[0], both[-1] + 1)
    return _cut(person, kept), _cut(actor, kept)


def _cut(recording: Recording, kept: slice) -> Recording:
    names = ("points", "valid", "unlabelled", "unlabelled_valid")
    return replace(recording, **{name: getattr(recording, name)[kept] for name in names})


def person_in(recording: Recording, prefix: str) -> Recording:
    """One person's points; the prefix may be written in any case and end in a colon, point, stroke or underscore.

    Raises:
        HighFiveError: there is no such person.
    """
    start = re.compile(re.escape(prefix.rstrip(":")) + r"[:._/| -]", re.IGNORECASE)
    columns = [m for m, name in enumerate(recording.names) if start.match(name)]
    if not columns:
        try:
            return recording.person(prefix)
        except HighFiveError as error:
            ends = f"{recording.names[0]} … {recording.names[-1]}" if recording.names else "none"
            hint = f"--human and --avatar say with what each person's labels begin (there are {ends})"
            raise HighFiveError(f"{error}; {hint}") from None
    names = tuple(start.sub("", recording.names[m], count=1) for m in columns)
    return replace(recording, names=names, points=recording.points[:, columns], valid=recording.valid[:, columns])


def _set_of(
    recordings: Sequence[Recording], partners: Sequence[Recording], role: Role, say: Callable[[str], None]
) -> MarkerSet:
    """The marker set of one of the two people: the one that is given, or found by the labels, or by the movement."""
    if role.marker_set:
        return load_marker_set(role.marker_set)
    labels = tuple(dict.fromkeys(name for recording in recordings for name in recording.names))
    if twice := sorted({name for r in recordings if len(set(r.names)) < len(r.names) for name in _repeated(r.names)}):
        say(f"{role.prefix}: of labels that are there twice the first counts: {', '.join(twice)}")
    try:
        marker_set = find_marker_set(labels)
    except HighFiveError as no_names:
        alike = [recording for recording in (*recordings, *partners) if recording.names == labels]
        if not alike:
            raise HighFiveError(f"{role.prefix}: {no_names}") from None
        try:
            known = recognise_shape(alike[:: max(1, len(alike) // _LOOKED_AT)])
        except HighFiveError as no_shape:
            raise HighFiveError(f"{role.prefix}: {no_names}; {no_shape}") from None
        marker_set = joint_centre_set(load_marker_set("joint_centres"), labels, known)
        identified = ", ".join(f"{label} is {name}" for name, label in known.items())
        say(f"{role.prefix}: the labels name no joints; identified by how they move, {identified}")
    if canonical_names(marker_set):
        unused = left_out(marker_set, labels)
        rest = f", left out: {', '.join(unused)}" if unused else ""
        say(f"{role.prefix}: {len(marker_set)} of {len(labels)} labels recognised as joint centres{rest}")
    return marker_set
