"""Writes a marker set as the TOML file that :func:`highfive.mocap_bridge.markers.marker_set_file.load_marker_set`
reads.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from highfive.mocap_bridge.markers.marker_set import PLACE_SIGMA, ArmRecipe, MarkerSet, Segment
from highfive.model.errors import HighFiveError
from highfive.model.files import write_whole
from highfive.model.geometry.names import listed
from highfive.model.geometry.rotations import Array
from highfive.model.toml_file import read_toml

Value = str | float | bool | Sequence[str] | Sequence[float]
"""What may stand in the ``[subject]`` table."""

_HEAD = """\
# Positions are in metres, in the frame of the joint that carries the marker (x forward, y left, z up while the body
# stands with hanging arms; the right palm then faces +y), on the body whose segments are given under [segments].
# spread: standard deviation of a coordinate of that place, m. How to write one: docs/markers.md.
"""


def marker_set_text(marker_set: MarkerSet, subject: Mapping[str, Value | Mapping[str, float]] | None = None) -> str:
    """The set as TOML; every number is written so that it is read back exactly.

    Args:
        marker_set: the set.
        subject: entries of a ``[subject]`` table, for people: whose set it is, and where it comes from.
    """
    lines = [_HEAD, f"name = {_value(marker_set.name)}", f"description = {_value(marker_set.description)}", ""]
    lines += ["markers = [", *(f"  {{ {_marker(marker_set, m)} }}," for m in range(len(marker_set))), "]", ""]
    lines += ["# How the right arm follows from the markers.", "[arm]", *_arm(marker_set.arm), ""]
    lines += [
        "# Length: mean distance from a joint to its children. Centre: of the joint, in the zero pose.",
        "[segments]",
    ]
    for joint, segment in marker_set.segments.items():
        above = "" if segment.parent is None else f", parent = {_value(segment.parent)}"
        centre = _value(segment.centre.tolist())
        unsure = "" if segment.sigma is None else f", sigma = {_value(segment.sigma)}"
        lines.append(f"{joint} = {{ length = {_value(segment.length)}, centre = {centre}{above}{unsure} }}")
    if subject is not None:
        lines += ["", "[subject]", *(f"{key} = {_entry(value)}" for key, value in subject.items())]
    return "\n".join(lines) + "\n"


def write_marker_set(
    path: str | Path,
    marker_set: MarkerSet,
    subject: Mapping[str, Value | Mapping[str, float]] | None = None,
    *,
    replace: bool = True,
) -> None:
    """Writes :func:`marker_set_text` to a file, which appears whole or not at all.

    Raises:
        HighFiveError: it cannot be written, or there is such a file and it may not be replaced.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, marker_set_text(marker_set, subject).encode(), replace=replace)
    except OSError as error:
        raise HighFiveError(f"cannot write {path}: {error.strerror or error}; choose another place") from None


def _marker(marker_set: MarkerSet, m: int) -> str:
    entries = [
        f"name = {_value(marker_set.names[m])}",
        f"joint = {_value(marker_set.joints[m])}",
        f"position = {_value(marker_set.local_positions[m].tolist())}",
        f"spread = {_value(float(marker_set.spreads[m]))}",
        f"roles = {_value(marker_set.roles[m])}",
    ]
    if marker_set.aliases[m]:
        entries.append(f"aliases = {_value(marker_set.aliases[m])}")
    return ", ".join(entries)


def _arm(arm: ArmRecipe) -> list[str]:
    left = f"left = {_value(arm.head_left)}, " if arm.head_left else ""
    centre = _value(arm.centre_in_head.tolist())
    return [
        f"head = {{ markers = {_value(arm.head)}, {left}centre_in_head = {centre} }}",
        f"shoulder = {{ markers = {_value(arm.shoulder)}, below = {_value(arm.shoulder_below)} }}",
        f"elbow = {{ markers = {_value(arm.elbow)}, medial = {_value(arm.elbow_medial)} }}",
        f"wrist = {{ markers = {_value(arm.wrist)} }}",
        f"hand = {_value(arm.hand)}",
        f"across = {_value(arm.across)}",
        f"knuckles_in_hand = {_value(arm.knuckles_in_hand.tolist())}",
        f"palm_in_hand = {_value(arm.palm_in_hand.tolist())}",
        f"scale_by_forearm = {_value(arm.scale_by_forearm)}",
    ]


def _entry(value: Value | Mapping[str, float]) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_value(key)} = {_value(number)}" for key, number in value.items()) + " }"
    return _value(value)


def _value(value: Value) -> str:
    """A TOML value. JSON's strings are TOML's basic strings, and its numbers are written to be read back exactly."""
    if isinstance(value, str | bool | float | int):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return "[" + ", ".join(_value(item) for item in value) + "]"


FOLDER = Path(__file__).parent / "marker_sets"


def marker_set_names() -> list[str]:
    """Names of the marker sets that come with the project."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def load_marker_set(name_or_path: str | Path) -> MarkerSet:
    """Reads a marker set that comes with the project (by name) or a lab's own TOML file (by path).

    Raises:
        HighFiveError: there is no such set or file, or the file is not a valid marker set.
    """
    path = FOLDER / f"{name_or_path}.toml" if str(name_or_path) in marker_set_names() else Path(name_or_path)
    if not path.is_file():
        if path.suffix:
            raise HighFiveError(f"no file {path}; a marker set is a TOML file")
        known = listed(marker_set_names())
        raise HighFiveError(
            f"no marker set {str(name_or_path)!r}; the sets are {known}, or give the path of a TOML file"
        )
    data = read_toml(path, "marker set")
    try:
        return _parse(data)
    except KeyError as error:
        raise HighFiveError(f"marker set {path}: the entry {error.args[0]!r} is missing") from None
    except (TypeError, ValueError, AttributeError) as error:
        raise HighFiveError(f"marker set {path}: {error}") from None


def _parse(data: dict[str, Any]) -> MarkerSet:
    rows = data["markers"]
    for row in rows if isinstance(rows, list) else [rows]:
        if not isinstance(row, dict):
            raise ValueError(f"markers has {row!r}; each is a table with name, joint and position")
    names = tuple(str(row["name"]) for row in rows)
    positions = np.array([_vector(row["position"]) for row in rows])
    joints = tuple(str(row["joint"]) for row in rows)
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"marker names occur twice: {listed(twice)}")
    known = data["segments"]
    if missing := sorted({joint for joint in joints if joint not in known}):
        there = listed(tuple(known))
        raise ValueError(f"[segments] lacks the joints that markers name: {listed(missing)}; it has {there}")
    segments = {joint: _parse_segment(known[joint]) for joint in dict.fromkeys(joints)}
    orphans = sorted({s.parent for s in segments.values() if s.parent is not None} - segments.keys())
    if orphans:
        raise ValueError(f"[segments] names parents that carry no marker: {listed(orphans)}")
    arm = _parse_arm(data["arm"])
    unknown = [name for name in arm.markers if name not in names]
    if unknown:
        raise ValueError(f"the [arm] section names markers that are not in the set: {listed(unknown)}")
    return MarkerSet(
        name=str(data["name"]),
        description=str(data.get("description", "")),
        names=names,
        aliases=tuple(tuple(row.get("aliases", ())) for row in rows),
        joints=joints,
        local_positions=positions,
        spreads=np.array([float(row.get("spread", PLACE_SIGMA)) for row in rows]),
        roles=tuple(tuple(row.get("roles", ())) for row in rows),
        segments=segments,
        arm=arm,
    )


def _parse_segment(data: dict[str, Any]) -> Segment:
    if not float(data["length"]) > 0.0:
        raise ValueError("segment lengths must be positive")
    sigma = float(data["sigma"]) if "sigma" in data else None
    return Segment(float(data["length"]), _vector(data["centre"]), data.get("parent"), sigma)


def _parse_arm(data: dict[str, Any]) -> ArmRecipe:
    if not data.get("head", {}).get("markers"):
        raise ValueError("the [arm] section has no head; where it bears no markers, name three or more of the trunk")
    head, shoulder, elbow = data["head"], data["shoulder"], data["elbow"]
    for joint in ("shoulder", "elbow", "wrist"):
        if not data[joint]["markers"]:
            raise ValueError(f"the [arm] section names no marker of the {joint}")
    return ArmRecipe(
        head=tuple(head["markers"]),
        head_left=tuple(head.get("left", ())),
        centre_in_head=_vector(head["centre_in_head"]),
        shoulder=tuple(shoulder["markers"]),
        shoulder_below=float(shoulder.get("below", 0.0)),
        elbow=tuple(elbow["markers"]),
        elbow_medial=float(elbow.get("medial", 0.0)),
        wrist=tuple(data["wrist"]["markers"]),
        hand=tuple(data["hand"]),
        across=tuple(data.get("across", ())),
        knuckles_in_hand=_vector(data["knuckles_in_hand"]),
        palm_in_hand=_vector(data["palm_in_hand"]),
        scale_by_forearm=bool(data.get("scale_by_forearm", False)),
    )


def _vector(values: Sequence[float]) -> Array:
    vector = np.array(values, dtype=float)
    if vector.shape != (3,) or not np.all(np.isfinite(vector)):
        raise ValueError(f"expected three numbers in metres, got {values!r}")
    return vector
