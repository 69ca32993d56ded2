"""Marker sets as data: which marker sits where on which segment, and how the right arm follows from the markers.

A set is a TOML file; those that come with the project lie in ``mocap_bridge/marker_sets``. A lab's own file works the
same way.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.names import index_of, listed
from highfive.model.geometry.rotations import Array
from highfive.model.geometry.skeleton import Skeleton

PLACE_SIGMA = 0.010
"""Standard deviation of a marker's place on its segment from person to person, m, where the set says nothing else."""

PROPORTION_SIGMA = 0.08
"""Standard deviation of a segment's length over itself, from person to person of one height."""

_ALIKE = 0.5
"""Of two labels' letters, from 0 to 1: RELB and RELBOW_X have 0.67, RELB and LBHD 0.5."""

OFF_CENTRE = 0.03
"""m from the head joint's centre: what lies nearer is the top of the neck, and does not move as the head turns."""


@dataclass(frozen=True)
class ArmRecipe:
    """How head, shoulder, elbow, wrist and palm follow from the markers.

    Attributes:
        head: markers of the head. Three or more give its orientation by a rigid fit; otherwise the
            first and last of them point up along the neck and ``head_left`` gives the facing. Where the head bears
            none, three or more of one segment of the trunk: the head then looks where the trunk faces.
        head_left: two markers, from the right to the left side of the body, or empty.
        centre_in_head: (3,) m, the head's centre in the frame of the joint that carries these markers.
        shoulder, elbow, wrist: markers whose mean is the joint centre, or near it.
        shoulder_below: m, the shoulder's centre lies so far straight below that mean.
        elbow_medial: m, the elbow's centre lies so far from that mean towards the body, along the axis of flexion.
        hand: markers of the hand; with the wrist they give the direction of the fingers. Empty: the forearm does.
        across: two markers, from the little finger's side to the thumb's, or empty: then the palm is taken to face the
            partner (world −x).
        knuckles_in_hand, palm_in_hand: (3,) m, knuckle centre and palm centre in the frame of the right wrist joint.
        scale_by_forearm: the person's hand is as large as the forearm says, not as far as the hand's markers are.
    """

    head: tuple[str, ...]
    head_left: tuple[str, ...]
    centre_in_head: Array
    shoulder: tuple[str, ...]
    shoulder_below: float
    elbow: tuple[str, ...]
    elbow_medial: float
    wrist: tuple[str, ...]
    hand: tuple[str, ...]
    across: tuple[str, ...]
    knuckles_in_hand: Array
    palm_in_hand: Array
    scale_by_forearm: bool = False

    @property
    def markers(self) -> tuple[str, ...]:
        """All markers that the recipe uses, each once."""
        used = (*self.head, *self.head_left, *self.shoulder, *self.elbow, *self.wrist, *self.hand, *self.across)
        return tuple(dict.fromkeys(used))


@dataclass(frozen=True)
class Segment:
    """A body segment that carries markers, on the body for which the set was written.

    Attributes:
        length: m, see :func:`segment_lengths`.
        centre: (3,) m, the joint's centre in the zero pose.
        parent: the next joint towards the root that carries markers, or None.
        sigma: m, standard deviation of the length from person to person; None for :data:`PROPORTION_SIGMA` of it.
    """

    length: float
    centre: Array
    parent: str | None
    sigma: float | None = None

    @property
    def relative_sigma(self) -> float:
        """Standard deviation of the length, over the length."""
        return PROPORTION_SIGMA if self.sigma is None else self.sigma / self.length


@dataclass(frozen=True)
class MarkerSet:
    """M named markers on the segments of the skeleton.

    Attributes:
        name: name of the set.
        description: what it is for, in a line.
        names: M marker names.
        aliases: for each marker the other names under which it is known.
        joints: for each marker the joint that carries it.
        local_positions: (M, 3) m in the frame of that joint, on the body that ``segments`` describes.
        spreads: (M,) m, standard deviation of a coordinate of that place from person to person.
        roles: for each marker what it is needed for, such as ``'hand'``.
        segments: for each carrying joint its segment.
        arm: how the right arm follows.
    """

    name: str
    description: str
    names: tuple[str, ...]
    aliases: tuple[tuple[str, ...], ...]
    joints: tuple[str, ...]
    local_positions: Array
    spreads: Array
    roles: tuple[tuple[str, ...], ...]
    segments: Mapping[str, Segment]
    arm: ArmRecipe

    def __len__(self) -> int:
        """Number of markers."""
        return len(self.names)

    def index(self, name: str) -> int:
        """Index of a marker by its own name."""
        return index_of(name, self.names, f"marker set {self.name}", "marker")

    def indices(self, names: Sequence[str]) -> NDArray[np.intp]:
        """Indices of several markers."""
        return np.array([self.index(name) for name in names], dtype=np.intp)

    @property
    def on_head(self) -> tuple[str, ...]:
        """Those of the arm recipe's head markers that lie on the head; none where trunk or neck stands in for it.

        A marker lies on the head if the head joint carries it, more than :data:`OFF_CENTRE` m from that joint's centre.
        """
        rows = [(name, self.index(name)) for name in self.arm.head]
        offsets = np.linalg.norm(self.local_positions, axis=1)
        return tuple(name for name, m in rows if self.joints[m] == "head" and offsets[m] > OFF_CENTRE)

    @cached_property
    def _known_as(self) -> dict[str, int]:
        known = {alias: m for m, aliases in enumerate(self.aliases) for alias in aliases}
        return known | {name: m for m, name in enumerate(self.names)}

    def match(self, labels: Sequence[str]) -> NDArray[np.intp]:
        """For each marker of the set the column of ``labels`` that holds it (by name or alias), or -1. Shape (M,)."""
        columns = np.full(len(self), -1, dtype=np.intp)
        for column, label in enumerate(labels):
            marker = self._known_as.get(label, -1)
            if marker >= 0 and (columns[marker] < 0 or label == self.names[marker]):
                columns[marker] = column
        return columns

    def arrange(
        self, labels: Sequence[str], points: Array, valid: NDArray[np.bool_], required: Sequence[str] = ()
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Points (..., M, 3) and validity (..., M) in the order of the set, from columns called ``labels``.

        Markers of the set that no label names come out invalid.

        Raises:
            HighFiveError: one of the markers ``required`` is not among the labels.
        """
        columns = self.match(labels)
        missing = [name for name in required if columns[self.index(name)] < 0]
        if missing:
            raise HighFiveError(self._lacking(missing, labels))
        there = (columns >= 0) & valid[..., columns]
        return np.where(there[..., None], points[..., columns, :], 0.0), there

    def _lacking(self, missing: Sequence[str], labels: Sequence[str]) -> str:
        """What is missing and for what; the labels most like it first, which may be the same by another name."""
        spelt = {label.lower(): label for label in labels if label not in self._known_as}
        alike = [spelt[near] for name in missing for near in get_close_matches(name.lower(), spelt, n=3, cutoff=_ALIKE)]
        first = list(dict.fromkeys(alike))
        wanted = [f"{name} ({' and '.join(parts)})" if (parts := self._parts(name)) else name for name in missing]
        there = listed([*first, *(label for label in labels if label not in first)]) or "no labels"
        alias = f'aliases = ["{first[0]}"]' if first else "aliases"
        return (
            f"marker set {self.name} needs {listed(wanted)}; the recording has {there}; if one of these is "
            f"{missing[0]}, give it as an alias in the set's TOML ({alias}), or choose another marker set"
        )

    def _parts(self, name: str) -> list[str]:
        """Of the arm, or the head, that a marker gives."""
        return [part for part in ("head", "shoulder", "elbow", "wrist", "hand") if name in getattr(self.arm, part)]

    def subset(self, names: Sequence[str]) -> MarkerSet:
        """The set with only the markers ``names``, in the set's order; they must hold those that the arm needs."""
        missing = [name for name in self.arm.markers if name not in names]
        if missing:
            raise HighFiveError(f"a part of marker set {self.name} without {listed(missing)} cannot give the arm")
        keep = np.sort(self.indices(names))
        carrying = tuple(dict.fromkeys(self.joints[m] for m in keep))
        return replace(
            self,
            names=tuple(self.names[m] for m in keep),
            aliases=tuple(self.aliases[m] for m in keep),
            joints=tuple(self.joints[m] for m in keep),
            local_positions=self.local_positions[keep],
            spreads=self.spreads[keep],
            roles=tuple(self.roles[m] for m in keep),
            segments={joint: replace(self.segments[joint], parent=self._above(joint, carrying)) for joint in carrying},
        )

    def _above(self, joint: str, carrying: Sequence[str]) -> str | None:
        """The next joint from ``joint`` towards the root that is among ``carrying``."""
        parent = self.segments[joint].parent
        while parent is not None and parent not in carrying:
            parent = self.segments[parent].parent
        return parent

    def positions_on(self, skeleton: Skeleton) -> Array:
        """Local positions (M, 3), m, scaled with the segment lengths of ``skeleton``."""
        lengths = segment_lengths(skeleton)
        scale = [lengths[skeleton.index(joint)] / self.segments[joint].length for joint in self.joints]
        return self.local_positions * np.array(scale)[:, None]

    def simulate(self, skeleton: Skeleton, positions: Array, orientations: Array) -> Array:
        """Marker positions (..., M, 3), m, from forward kinematics.

        Args:
            skeleton: the body that wears the markers.
            positions: (..., J, 3) m, joint centres in the world.
            orientations: (..., J, 4) quaternions of the joints in the world.
        """
        joints = np.array([skeleton.index(joint) for joint in self.joints])
        offsets = rotations.rotate(orientations[..., joints, :], self.positions_on(skeleton))
        return positions[..., joints, :] + offsets


def segment_lengths(skeleton: Skeleton) -> Array:
    """Length (J,), m, of the segment each joint carries: mean distance to its children, or to its parent if none."""
    distance = np.linalg.norm(skeleton.offsets, axis=1)
    parents = np.array(skeleton.parents)
    children = [distance[parents == joint] for joint in range(len(skeleton))]
    return np.array([c.mean() if len(c) else distance[joint] for joint, c in enumerate(children)])
