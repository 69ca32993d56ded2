"""Simulated people whose raised hand is no high five: to learn from, and to judge by.

Both come from :mod:`highfive.hil.sim.people.distractors`, from seeds that are never mixed: those of training are drawn
with its seed, in bodies of the avatar's proportions; those that judge have a seed and bodies of their own. Nothing is
chosen on the latter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from highfive.hil.datasets.training_data import track_hand
from highfive.hil.runtime.threads import parallel_map
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.hil.sim.people.actors import CannotMeetError
from highfive.hil.sim.people.capture import PERSON_SET, Defects, markers_of, record
from highfive.hil.sim.people.distractors import simulate_distractor
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.people.gestures import GESTURES
from highfive.hil.sim.people.grid import CELLS
from highfive.hil.sim.people.role import RATE_HZ
from highfive.hil.trials.partners import Partner, simulated_partner
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.model.geometry.skeleton import Skeleton
from highfive.model.hgpdm.trials import Gesture
from highfive.scenes.anthropometry import HEIGHT

Progress = Callable[[int], Callable[[], None]]

JUDGE_SEED = 577_215_664
"""Of the people who judge."""
_LEARNED = 1_000_003
"""Before the seed of a training, so that none of its draws is one of another purpose."""
_BODIES = ((1.56, 1.03), (1.66, 0.96), (1.75, 1.02), (1.87, 0.97))
"""Of those who judge: stature, m, and length of the arms over what it would be in the avatar's proportions."""


@dataclass(frozen=True)
class Drawn:
    """A gesture that is to be simulated: its name, emotion, and the seed; ``body`` is one of those who judge."""

    gesture: str
    emotion: str
    seed: tuple[int, ...]
    body: int | None = None


def drawn_gestures(rounds: int, seed: int, progress: Progress = lambda total: lambda: None) -> list[Gesture]:
    """Hands to learn from, tracked: each gesture in each emotion, ``rounds`` times."""
    draws = [
        Drawn(gesture, emotion, (_LEARNED, seed, g, e, number))
        for number in range(rounds)
        for g, gesture in enumerate(GESTURES)
        for e, emotion in enumerate(EMOTIONS)
    ]
    return list(parallel_map(_tracked, draws, progress))


def judging_gestures(rounds: int = 3) -> list[Drawn]:
    """Gestures to judge by: each in each emotion, ``rounds`` times, in the bodies in turn."""
    return [
        Drawn(gesture, emotion, (JUDGE_SEED, g, e, number), (g + e + number) % len(_BODIES))
        for number in range(rounds)
        for g, gesture in enumerate(GESTURES)
        for e, emotion in enumerate(EMOTIONS)
    ]


def distractor_partner(drawn: Drawn) -> tuple[Partner, float]:
    """The person of a gesture, captured, and when the hand rises, s."""
    rng = np.random.default_rng(drawn.seed)
    found = simulate_distractor(drawn.gesture, drawn.emotion, rng, _body(drawn.body))
    marker_set = load_marker_set(PERSON_SET)
    recording = record([("", markers_of(found.person, marker_set), marker_set)], Defects(), rng)
    title = f"simulated person, {drawn.gesture}, {drawn.emotion}"
    partner = Partner(title, drawn.emotion, "", True, recording, marker_set, -1, found.palm, None)
    return partner, found.rise_s


def judging_high_five(number: int) -> Partner | None:
    """A high five of the people who judge, cell by cell in each emotion; None where nobody of that size can meet."""
    emotion, cell = list(EMOTIONS)[number % len(EMOTIONS)], CELLS[number // len(EMOTIONS) % len(CELLS)]
    rng = np.random.default_rng((JUDGE_SEED, len(GESTURES), number))
    try:
        return simulated_partner(emotion, cell, 0, rng, body=_body(number % len(_BODIES)))
    except CannotMeetError:
        return None


def _body(number: int | None) -> Skeleton | None:
    if number is None:
        return None
    stature, arms = _BODIES[number]
    size, names = stature / HEIGHT, avatar_skeleton().names
    return avatar_skeleton().scaled({n: size * (arms if n.endswith(("elbow", "wrist")) else 1.0) for n in names})


def _tracked(drawn: Drawn) -> Gesture:
    partner, _ = distractor_partner(drawn)
    return Gesture(RATE_HZ, track_hand(partner.recording, partner.marker_set)[0], drawn.gesture)
