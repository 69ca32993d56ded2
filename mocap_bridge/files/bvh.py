"""BVH (Biovision hierarchy): joint centres of a skeleton that moves.

Format: Meredith & Maddock, "Motion capture file formats explained" (2001), §4. A joint's rotations follow each other in
the order of its channels, whatever that is. Position channels stand for the OFFSET, as Blender has it; where the root's
OFFSET is not zero, readers that add the two put the whole body elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from highfive.mocap_bridge.files.named_points import NamedPoints, number, unique
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

_CHANNELS = {f"{axis}{kind}".lower(): (kind, axis.lower()) for axis in "XYZ" for kind in ("position", "rotation")}
_RATES = (1.0, 10_000.0)
MOST_JOINTS = 2_000
"""End sites among them; a skeleton with fingers and a face has 200. Each takes memory in every frame."""
MOST_VALUES = 100_000_000
"""Frames × joints, or × channels: three hours of 60 joints at 120 Hz are 78 million places."""


@dataclass
class _Joint:
    name: str
    parent: int
    offset: Array = field(default_factory=lambda: np.full(3, np.nan))
    channels: tuple[tuple[str, str], ...] = ()
    end: bool = False


def parse_bvh(text: str, source: str) -> NamedPoints:
    """Reads the text of a BVH file; joints and end sites (``NAME_end``) become points, in the file's own unit.

    Raises:
        HighFiveError: it is none, ends early, or has other numbers of values than its channels.
    """
    lines = [(place, line.strip()) for place, line in enumerate(text.splitlines(), start=1)]
    motion = next((i for i, (_, line) in enumerate(lines) if line.upper() == "MOTION"), None)
    if lines[0][1].upper() != "HIERARCHY" or motion is None:
        raise HighFiveError(f"{source} is no BVH file, or cut off: expected HIERARCHY in its first line, and MOTION")
    joints = _hierarchy(lines[1:motion], source)
    rate, values = _motion(lines[motion + 1 :], sum(len(joint.channels) for joint in joints), source)
    names = unique([joint.name for joint in joints], source)
    if len(values) * len(joints) > MOST_VALUES:
        raise HighFiveError(f"{source}: {len(values)} frames of {len(joints)} joints are too many; cut it into trials")
    return NamedPoints(source, rate, names, _places(joints, values), None, centres=True)


def _hierarchy(lines: list[tuple[int, str]], source: str) -> list[_Joint]:
    """Joints, a parent before its children, in the order of their channels."""
    joints: list[_Joint] = []
    open_joints: list[int] = []
    named = False  # a joint whose brace has not come yet
    for place, line in lines:
        for part in line.replace("{", "\n{\n").replace("}", "\n}\n").split("\n"):
            word, _, rest = part.strip().partition(" ")
            where, kind = f"{source}, line {place}", word.upper()
            if not kind:
                continue
            if kind in ("ROOT", "JOINT", "END"):
                if named or (kind == "ROOT") == bool(open_joints):
                    raise HighFiveError(f"{where}: {part.strip()[:40]!r} is out of place")
                if len(joints) == MOST_JOINTS:
                    raise HighFiveError(f"{where}: more than {MOST_JOINTS} joints make no sense")
                joints.append(_named(kind, rest.strip(), joints, open_joints, where))
                named = True
            elif kind == "{" and named:
                open_joints.append(len(joints) - 1)
                named = False
            elif kind == "}" and open_joints and not named:
                open_joints.pop()
            elif kind in ("OFFSET", "CHANNELS") and open_joints and not named:
                _describe(joints[open_joints[-1]], kind, rest.split(), where)
            else:
                raise HighFiveError(f"{where}: {part.strip()[:40]!r} is out of place")
    if open_joints or named or not joints:
        raise HighFiveError(f"{source}: its skeleton is cut off")
    if lacking := [joint.name for joint in joints if not np.isfinite(joint.offset).all()]:
        raise HighFiveError(f"{source}: {lacking[0]} has no OFFSET")
    return joints


def _named(kind: str, name: str, joints: list[_Joint], open_joints: list[int], where: str) -> _Joint:
    parent = open_joints[-1] if open_joints else -1
    if parent >= 0 and joints[parent].end:
        raise HighFiveError(f"{where}: an end site has no joints")
    if kind == "END":
        before = sum(joint.end and joint.parent == parent for joint in joints)
        return _Joint(f"{joints[parent].name}_end{before + 1 if before else ''}", parent, end=True)
    if not name:
        raise HighFiveError(f"{where}: a joint without a name")
    return _Joint(name, parent)


def _describe(joint: _Joint, kind: str, words: list[str], where: str) -> None:
    if kind == "OFFSET":
        if len(words) != 3:
            raise HighFiveError(f"{where}: the OFFSET of {joint.name} has {len(words)} numbers, expected 3")
        joint.offset = np.array([number(word, where) for word in words])
        if not np.isfinite(joint.offset).all():
            raise HighFiveError(f"{where}: the OFFSET of {joint.name} is {' '.join(words)}; expected three lengths")
        return
    unknown = [word for word in words[1:] if word.lower() not in _CHANNELS]
    if unknown or not words or words[0] != str(len(words) - 1):
        raise HighFiveError(
            f"{where}: CHANNELS of {joint.name} announces {words[0] if words else 'nothing'} and names "
            f"{' '.join(words[1:]) or 'none'}; expected that many of Xposition … Zrotation"
        )
    if joint.end or joint.channels:
        raise HighFiveError(f"{where}: {joint.name} has channels twice, or is an end site")
    joint.channels = tuple(_CHANNELS[word.lower()] for word in words[1:])


def _motion(lines: list[tuple[int, str]], channels: int, source: str) -> tuple[float, Array]:
    """Rate, Hz, and the values (T, channels) of each frame."""
    lines = [(place, line) for place, line in lines if line]
    heads = [line.partition(":") for _, line in lines[:2]]
    if [" ".join(key.lower().split()) for key, _, _ in heads] != ["frames", "frame time"]:
        raise HighFiveError(f"{source}: after MOTION, Frames: and Frame Time: are expected; is it cut off?")
    frames, period = (number(value, f"{source}: {key}") for key, _, value in heads)
    if not (period > 0.0 and _RATES[0] <= 1.0 / period <= _RATES[1]):
        raise HighFiveError(f"{source}: Frame Time is {period:g} s; expected {1 / _RATES[1]:g} to {1 / _RATES[0]:g}")
    rows = lines[2:]
    if frames != len(rows) or not rows:
        raise HighFiveError(f"{source}: {frames:g} frames are announced, {len(rows)} are there; is it cut off?")
    if len(rows) * channels > MOST_VALUES:
        raise HighFiveError(f"{source}: {len(rows)} frames of {channels} channels are too many; cut it into trials")
    values = np.empty((len(rows), channels))
    for row, (place, line) in enumerate(rows):
        words = line.split()
        if len(words) != channels:
            raise HighFiveError(f"{source}, line {place}: {len(words)} values, its skeleton has {channels} channels")
        values[row] = [number(word, f"{source}, line {place}") for word in words]
    return round(1.0 / period, 3), values


def _places(joints: list[_Joint], values: Array) -> Array:
    """(T, J, 3) of joints and end sites, in the file's axes."""
    places = np.empty((len(values), len(joints), 3))
    turns = np.empty((len(values), len(joints), 4))
    column = 0
    for j, joint in enumerate(joints):
        local = np.tile(joint.offset, (len(values), 1))
        turn = np.tile(rotations.IDENTITY, (len(values), 1))
        for kind, axis in joint.channels:
            if kind == "position":
                local[:, "xyz".index(axis)] = values[:, column]
            else:
                turn = rotations.multiply(turn, rotations.from_axis_angle(axis, np.radians(values[:, column])))
            column += 1
        if joint.parent < 0:
            places[:, j], turns[:, j] = local, turn
        else:
            above = turns[:, joint.parent]
            places[:, j] = places[:, joint.parent] + rotations.rotate(above, local)
            turns[:, j] = rotations.multiply(above, turn)
    return places
