"""Judges a trial: did the palms meet, how well, how hard, and what else touched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from highfive.hil.sim.playout import PlayState
from highfive.mocap_bridge.frames import PalmPose
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

TOUCHING = 0.002
"""m of gap below which two palms count as touching: skin gives way by more than that."""
APPROACH_NS = 100_000_000
"""How long before the touch the approach speed counts, ns: hands brake in the last moment."""
ON_THE_PALM = 0.040
"""m beside each other up to which palms meet on the palm (its half width is 0.042 m)."""
PALMS = ("right_palm", "person_palm")


@dataclass(frozen=True)
class UnwantedContact:
    """Two bodies that should not have touched.

    Attributes:
        first, second: shapes; the first is the avatar's.
        first_time_ns: when they first touched, ns.
        deepest: m, deepest overlap.
    """

    first: str
    second: str
    first_time_ns: int
    deepest: float


@dataclass(frozen=True)
class ContactReport:
    """The contact of one trial.

    Attributes:
        met: the palms touched.
        met_time_ns: when they first did, ns; None if they did not.
        nearest_time_ns: when the palm centres were nearest, ns. All places and distances below are of that moment.
        where: (3,) m in the world, half way between the palm centres.
        distance: m, between the palm centres.
        lateral: m, its part along the palms.
        gap: m, its part along the palms' common normal: positive where they do not reach, negative where they overlap.
        palm_angle: rad, between the avatar's normal and the opposite of the person's.
        approach_speed: m/s, largest at which the palms closed in along the normal in the 0.1 s before they touched.
        peak_force: N, largest force between the hands; 0 in kinematic play-out.
        bodies: pairs of hand shapes that touched in the trial.
        unwanted: all other contacts.
    """

    met: bool
    met_time_ns: int | None
    nearest_time_ns: int
    where: Array
    distance: float
    lateral: float
    gap: float
    palm_angle: float
    approach_speed: float
    peak_force: float
    bodies: tuple[tuple[str, str], ...]
    unwanted: tuple[UnwantedContact, ...]


def common_normal(palm: PalmPose, other: PalmPose) -> Array:
    """(3,) unit vector from ``palm`` to ``other``, half way between its normal and the opposite of the other's."""
    normal = palm.normal - other.normal
    length = float(np.linalg.norm(normal))
    # Two palms that face the same way have no common normal.
    return normal / length if length > 1e-6 else palm.normal


def palm_offset(palm: PalmPose, other: PalmPose) -> tuple[float, float]:
    """Gap (along the common normal) and lateral distance between two palms, m."""
    normal, between = common_normal(palm, other), other.position - palm.position
    gap = float(between @ normal)
    return gap, float(np.linalg.norm(between - gap * normal))


def _touching(state: PlayState) -> bool:
    gap, lateral = palm_offset(state.palm, state.person_palm)
    near = abs(gap) <= TOUCHING and lateral <= ON_THE_PALM
    return near or any((t.first, t.second) == PALMS for t in state.touches)


def _closing_speed(state: PlayState) -> float:
    relative = state.palm.velocity - state.person_palm.velocity
    return float(relative @ common_normal(state.palm, state.person_palm))


def contact_report(states: Sequence[PlayState]) -> ContactReport:
    """The report of a trial from the states of its ticks, in order of time.

    Raises:
        HighFiveError: there are no states.
    """
    if not states:
        raise HighFiveError("a trial without a single played pose has no contact to report; play at least one")
    distances = [float(np.linalg.norm(s.person_palm.position - s.palm.position)) for s in states]
    nearest = int(np.argmin(distances))
    met = next((i for i, state in enumerate(states) if _touching(state)), None)
    end = nearest if met is None else met
    approach = [s for s in states[:end] if states[end].time_ns - s.time_ns <= APPROACH_NS] or [states[end]]
    state = states[nearest]
    gap, lateral = palm_offset(state.palm, state.person_palm)
    cosine = float(np.clip(-state.palm.normal @ state.person_palm.normal, -1.0, 1.0))
    expected = [touch for s in states for touch in s.touches if touch.expected]
    return ContactReport(
        met=met is not None,
        met_time_ns=None if met is None else states[met].time_ns,
        nearest_time_ns=state.time_ns,
        where=0.5 * (state.palm.position + state.person_palm.position),
        distance=distances[nearest],
        lateral=lateral,
        gap=gap,
        palm_angle=float(np.arccos(cosine)),
        approach_speed=max(_closing_speed(s) for s in approach),
        peak_force=max(s.hand_force for s in states),
        bodies=tuple(dict.fromkeys((touch.first, touch.second) for touch in expected)),
        unwanted=_unwanted(states),
    )


def _unwanted(states: Sequence[PlayState]) -> tuple[UnwantedContact, ...]:
    found: dict[tuple[str, str], UnwantedContact] = {}
    for state in states:
        for touch in state.touches:
            if not touch.expected:
                pair, depth = (touch.first, touch.second), -touch.distance
                known = found.get(pair)
                since = state.time_ns if known is None else known.first_time_ns
                deepest = depth if known is None else max(depth, known.deepest)
                found[pair] = UnwantedContact(*pair, since, deepest)
    return tuple(found.values())


class ContactCheck:
    """Collects the states of a trial; ``report`` judges what came so far."""

    def __init__(self) -> None:
        """Starts a trial."""
        self._states: list[PlayState] = []

    def record(self, state: PlayState) -> None:
        """Adds a tick."""
        self._states.append(state)

    def report(self) -> ContactReport:
        """See :func:`contact_report`."""
        return contact_report(self._states)
