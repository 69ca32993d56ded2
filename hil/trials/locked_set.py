"""The locked set: simulated people by whom no setting is chosen.

Every setting, threshold and design of this project was chosen on others: seeds such as 0, 3, 5, 7, 101 and 202, bodies
of 0.92 to 1.08 of the avatar's size with its proportions, 0.5 mm of marker noise, and markers that sit exactly where
their set has them. The people here have other sizes, other proportions, worse markers and a seed of their own. They are
for reporting alone (``highfive bench locked``, ``highfive evaluate --locked``): no setting may be changed because of
what comes out here, and this file is not changed to make figures better. Whoever has to change it says so in the
changelog, and gives the new set another number.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from highfive.hil.sim.avatar import avatar_skeleton
from highfive.hil.sim.people.actors import CannotMeetError, PairTrial, simulate_pair
from highfive.hil.sim.people.capture import PERSON_SET, Defects
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.people.grid import CELLS
from highfive.hil.trials.partners import Partner, partner_of
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.model.geometry.skeleton import Skeleton
from highfive.scenes.anthropometry import HEIGHT

NUMBER = 1
"""Of this version of the set."""
SEED = 161_803_399
CELLS_EACH = 5
"""Cells, of the nine, in which each person raises a hand in each emotion."""
_ARM = ("elbow", "wrist")


@dataclass(frozen=True)
class Subject:
    """A person of the locked set.

    Attributes:
        name: in tables.
        stature: standing height, m.
        arms: length of upper arm and forearm over what they would be at that height in the avatar's proportions.
        slip: m, standard deviation of each coordinate by which a marker sits elsewhere than its set says; the same in
            all of a person's trials.
        defects: of the capture.
    """

    name: str
    stature: float
    arms: float
    slip: float
    defects: Defects

    @property
    def body(self) -> Skeleton:
        """The person's skeleton."""
        size = self.stature / HEIGHT
        names = avatar_skeleton().names
        return avatar_skeleton().scaled({n: size * (self.arms if n.endswith(_ARM) else 1.0) for n in names})


SUBJECTS = (
    Subject("1.52 m", 1.52, 0.97, 0.002, Defects(0.0008, 0.10, (0.05, 0.30), 2.0)),
    Subject("1.61 m", 1.61, 1.04, 0.005, Defects(0.0003, 0.05, (0.05, 0.30), 1.0)),
    Subject("1.72 m", 1.72, 0.95, 0.003, Defects(0.0012, 0.20, (0.05, 0.30), 3.0)),
    Subject("1.83 m", 1.83, 1.03, 0.004, Defects(0.0006, 0.10, (0.05, 0.30), 2.0)),
    Subject("1.95 m", 1.95, 1.00, 0.003, Defects(0.0010, 0.15, (0.05, 0.30), 2.0)),
)


@dataclass(frozen=True)
class LockedTrial:
    """One high five of the set: index into :data:`SUBJECTS`, emotion and cell."""

    subject: int
    emotion: str
    cell: str

    @property
    def name(self) -> str:
        """Of the person, in tables."""
        return SUBJECTS[self.subject].name


def locked_trials() -> list[LockedTrial]:
    """The set, subject by subject: 5 people × 4 emotions × 5 cells."""
    return [
        LockedTrial(subject, emotion, CELLS[cell])
        for subject in range(len(SUBJECTS))
        for number, emotion in enumerate(EMOTIONS)
        for cell in np.random.default_rng([SEED, subject, number]).permutation(len(CELLS))[:CELLS_EACH]
    ]


def locked_partner(trial: LockedTrial) -> Partner | None:
    """The person of one trial, the same every time; None where nobody of that size and an avatar can meet there."""
    found = locked_pair(trial)
    return None if found is None else found[0]


def locked_pair(trial: LockedTrial) -> tuple[Partner, PairTrial] | None:
    """The same, and both people's true motion."""
    subject = SUBJECTS[trial.subject]
    markers = len(load_marker_set(PERSON_SET))
    slips = np.random.default_rng([SEED, trial.subject]).normal(0.0, subject.slip, (markers, 3))
    where = [SEED, trial.subject, list(EMOTIONS).index(trial.emotion), CELLS.index(trial.cell)]
    rng = np.random.default_rng(where)
    try:
        pair = simulate_pair(trial.emotion, trial.cell, 0, rng, subject.body)
    except CannotMeetError:
        return None
    return partner_of(pair, trial.emotion, trial.cell, rng, subject.defects, slips), pair
