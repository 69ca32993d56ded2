"""A marker set for joint centres under a lab's own names, from a skeleton fit or a depth camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from highfive.mocap_bridge.markers.joint_names import recognise
from highfive.mocap_bridge.markers.marker_set import ArmRecipe, MarkerSet
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

ARM = ("right_shoulder", "right_elbow", "right_wrist")
_LOW = ("neck", "trunk_4", "trunk_3", "left_shoulder", "pelvis")
_HIGH = ("head", "head_top", "nose", "left_ear", "left_eye", "upper_neck", "neck")
_KNUCKLES = ("right_middle_1", "right_index_1", "right_ring_1", "right_little_1")
_NAMED = 6
"""Labels that a message names."""
_BEYOND_WRIST = ("right_hand", "right_hand_tip")


def joint_centre_set(reference: MarkerSet, labels: Sequence[str], known: Mapping[str, str] | None = None) -> MarkerSet:
    """The part of the ``reference`` set ``joint_centres`` that ``labels`` have; its markers bear their labels.

    Args:
        reference: the set of all canonical joint centres.
        labels: the lab's labels.
        known: canonical joint centre -> label; None recognises the names.

    Raises:
        HighFiveError: the labels do not give a right arm, a head or neck above something, and left from right.
    """
    known = dict(recognise(labels) if known is None else known)
    missing = [name for name in ARM if name not in known]
    low, high = (next((name for name in names if name in known), None) for names in (_LOW, _HIGH))
    left = next((s for s in ("shoulder", "hip", "ear", "eye") if f"left_{s}" in known and f"right_{s}" in known), None)
    missing += [] if high and low != high else ["head"]
    missing += [] if left else ["left_shoulder"]
    if missing or not low or not high:
        raise HighFiveError(f"no {', '.join(missing)} is recognised ({_what_is(labels, known)})")
    names = [name for name in reference.names if name in known]
    arm = replace(
        reference.arm,
        head=(low, high),
        head_left=(f"right_{left}", f"left_{left}"),
        centre_in_head=_head_centre(reference, (low, high)),
        hand=_hand(names),
    )
    part = replace(reference, arm=arm).subset(names)
    return replace(
        part,
        names=tuple(known[name] for name in part.names),
        roles=tuple((*roles, name) for name, roles in zip(part.names, part.roles, strict=True)),
        arm=_renamed(arm, known),
    )


def canonical_names(marker_set: MarkerSet) -> dict[str, int]:
    """Canonical joint centre -> index, of a set from :func:`joint_centre_set`; empty for other sets."""
    return {roles[-1]: m for m, roles in enumerate(marker_set.roles)} if marker_set.name == "joint_centres" else {}


def left_out(marker_set: MarkerSet, labels: Sequence[str]) -> list[str]:
    """The labels that the set does not use."""
    used = marker_set.match(labels)
    return [label for column, label in enumerate(labels) if column not in used]


def _what_is(labels: Sequence[str], known: Mapping[str, str]) -> str:
    """What the labels were taken for, the right arm's first, and which were taken for nothing: what a line holds."""
    found = [f"{known[name]} as {name}" for name in sorted(known, key=lambda name: name not in ARM)]
    others = [label for label in labels if label not in known.values()]
    return f"recognised: {_few(found)}; not recognised: {_few(others)}"


def _few(words: Sequence[str]) -> str:
    more = f" and {len(words) - _NAMED} more" if len(words) > _NAMED else ""
    return f"{', '.join(words[:_NAMED])}{more}" if words else "none"


def _hand(names: Sequence[str]) -> tuple[str, ...]:
    """What shows the direction of the fingers: knuckles, else hand and finger tips; empty for none."""
    knuckles = tuple(name for name in _KNUCKLES if name in names)
    beyond = tuple(name for name in _BEYOND_WRIST if name in names)
    return knuckles or beyond


def _head_centre(reference: MarkerSet, pair: Sequence[str]) -> Array:
    """The head's centre as the arm's recipe wants it: as if both points were given in the head's frame."""
    joints = [reference.joints[reference.index(name)] for name in pair]
    below = np.mean([reference.segments[joint].centre - reference.segments["head"].centre for joint in joints], axis=0)
    return reference.arm.centre_in_head - below


def _renamed(arm: ArmRecipe, known: Mapping[str, str]) -> ArmRecipe:
    def labels(names: Sequence[str]) -> tuple[str, ...]:
        return tuple(known[name] for name in names)

    return replace(
        arm,
        head=labels(arm.head),
        head_left=labels(arm.head_left),
        shoulder=labels(arm.shoulder),
        elbow=labels(arm.elbow),
        wrist=labels(arm.wrist),
        hand=labels(arm.hand),
    )
