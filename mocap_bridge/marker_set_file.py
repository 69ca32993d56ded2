"""Writes a marker set as the TOML file that :func:`mocap_bridge.marker_sets.load_marker_set` reads."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from mocap_bridge.marker_sets import ArmRecipe, MarkerSet
from model.errors import HighFiveError
from model.files import write_whole

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
