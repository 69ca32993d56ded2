"""Who raises a hand: a simulated person, or one in a recording."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from highfive.calibration.placement import place_person
from highfive.hil.datasets.training_data import track_hand
from highfive.hil.runtime.threads import parallel_map
from highfive.hil.sim.avatar import right_palm
from highfive.hil.sim.people.actors import PairTrial, simulate_pair
from highfive.hil.sim.people.capture import PERSON_SET, Defects, markers_of, record
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.people.grid import CELLS
from highfive.mocap_bridge.files.c3d import read_c3d
from highfive.mocap_bridge.files.recording import Recording, resample
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.markers.recognise import find_marker_set
from highfive.mocap_bridge.sources.source import RATE_HZ, C3DSource
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.geometry.skeleton import Skeleton

_SESSION_DRAWS = 1_000_000
"""Added to the repetition of a session's trials, so that none is one that a capture with the same seed holds."""


@dataclass(frozen=True)
class Partner:
    """A person's part in one trial, in the world of the avatar.

    Attributes:
        title: what the trial is, for people.
        emotion, cell: as requested; '' where not known.
        simulated: the person is simulated.
        recording: the person's markers at 120 Hz, without prefix.
        marker_set: the set that they belong to.
        contact_frame: frame at which the palms met originally; -1 where not known.
        palm: (T, 3) m, the person's true palm where it is known, else None.
        other_palm: (T, 3) m, the palm of who met that hand originally (actor or real partner), else None.
        notes: how the person was placed in the world.
        draws: how many pairs were drawn until two could meet; 0 of a real person.
    """

    title: str
    emotion: str
    cell: str
    simulated: bool
    recording: Recording
    marker_set: MarkerSet
    contact_frame: int
    palm: Array | None
    other_palm: Array | None
    notes: tuple[str, ...] = ()
    draws: int = 0

    def in_emotion(self, emotion: str) -> Partner:
        """The same person, to be answered in another emotion."""
        return replace(self, emotion=emotion)

    def lost(self, seconds: float) -> Partner:
        """The same person, of whom nothing is seen any more from so many s before the palms met originally.

        Raises:
            HighFiveError: it is not known when they met.
        """
        if self.contact_frame < 0:
            raise HighFiveError(f"--lost: it is not known when palms met in {self.title}; leave it out")
        start = max(0, self.contact_frame - round(seconds * self.recording.rate_hz))
        seen = np.arange(len(self.recording)) < start
        recording = replace(
            self.recording,
            points=np.where(seen[:, None, None], self.recording.points, 0.0),
            valid=self.recording.valid & seen[:, None],
            unlabelled=np.where(seen[:, None, None], self.recording.unlabelled, 0.0),
            unlabelled_valid=self.recording.unlabelled_valid & seen[:, None],
        )
        return replace(self, recording=recording)

    def frames(self) -> C3DSource:
        """The person's markers frame by frame, at the session's rate; iterate over it."""
        return C3DSource(self.recording, RATE_HZ)


def simulated_partners(
    count: int,
    emotions: Sequence[str],
    cells: Sequence[str],
    seed: int,
    progress: Callable[[int], Callable[[], None]] = lambda total: lambda: None,
) -> list[Partner]:
    """``count`` simulated people, cell by cell in a shuffled order, each cell in every emotion."""
    order = np.random.default_rng([seed, len(cells)]).permutation(len(cells))
    draws = []
    for number in range(count):
        repetition, place_in_round = divmod(number, len(cells) * len(emotions))
        cell = cells[order[place_in_round // len(emotions)]]
        draws.append((emotions[place_in_round % len(emotions)], cell, repetition, seed))
    return list(parallel_map(_simulated, draws, progress))


def simulated_person(emotion: str = "neutral", cell: str = "B2", seed: int = 0) -> Partner:
    """The person whom ``highfive simulate`` would simulate first in this emotion at this cell.

    Raises:
        HighFiveError: an unknown emotion or cell.
    """
    for what, name, known in (("emotion", emotion, tuple(EMOTIONS)), ("cell", cell, CELLS)):
        if name not in known:
            raise HighFiveError(f"unknown {what} {name!r}; there are {', '.join(known)}")
    return _simulated((emotion, cell, 0, seed))


def _simulated(chosen: tuple[str, str, int, int]) -> Partner:
    emotion, cell, repetition, seed = chosen
    draw = [seed, list(EMOTIONS).index(emotion), CELLS.index(cell), _SESSION_DRAWS + repetition]
    return simulated_partner(emotion, cell, repetition, np.random.default_rng(draw))


def simulated_partner(
    emotion: str,
    cell: str,
    repetition: int,
    rng: np.random.Generator,
    defects: Defects | None = None,
    body: Skeleton | None = None,
    slips: Array | None = None,
) -> Partner:
    """One simulated person who raises a hand.

    Args:
        emotion, cell, repetition: which high five.
        rng: where its differences and the defects come from.
        defects: of the capture; None for the usual ones.
        body: the person's; None draws one.
        slips: (M, 3) m, how far each marker sits from where the set has it, in the frame of the joint that carries it;
            None for not at all.
    """
    return partner_of(simulate_pair(emotion, cell, repetition, rng, body), emotion, cell, rng, defects, slips)


def partner_of(
    trial: PairTrial,
    emotion: str,
    cell: str,
    rng: np.random.Generator,
    defects: Defects | None = None,
    slips: Array | None = None,
) -> Partner:
    """The person of a simulated pair, captured; arguments as of :func:`simulated_partner`."""
    marker_set = load_marker_set(PERSON_SET)
    worn = marker_set if slips is None else replace(marker_set, local_positions=marker_set.local_positions + slips)
    defects = Defects() if defects is None else defects
    recording = record([("", markers_of(trial.person, worn), marker_set)], defects, rng)
    palms = [
        right_palm(a.skeleton, *a.skeleton.forward_kinematics(a.root_in_world, a.quaternions))[0]
        for a in (trial.person, trial.avatar)
    ]
    return Partner(
        title=f"simulated person, {emotion}, cell {cell}",
        emotion=emotion,
        cell=cell,
        simulated=True,
        recording=recording,
        marker_set=marker_set,
        contact_frame=trial.contact_frame,
        palm=palms[0],
        other_palm=palms[1],
        draws=trial.draws,
    )


def recorded_partner(
    path: Path | str, human: str | None = None, marker_set: MarkerSet | None = None, emotion: str = "neutral"
) -> Partner:
    """The person called ``human`` in a C3D file, placed in the avatar's world; whoever else is in it is compared with.

    Raises:
        HighFiveError: the file is not usable, or the person or her markers are not in it.
    """
    path = Path(path)
    whole = resample(read_c3d(path), RATE_HZ)
    person = whole.person(human)
    marker_set = marker_set or find_marker_set(person.names)
    # Who is not called anything is the only one there is.
    others = [] if human is None else [one for one in whole.prefixes if one and one != human.removesuffix(":")]
    other = _other(whole, others, marker_set)
    placement = place_person(person, marker_set, other)
    person, other = placement.apply_to(person), None if other is None else placement.apply_to(other)
    palm = None if other is None else track_hand(other, marker_set, (1.0, 0.0, 0.0))[1]
    own = track_hand(person, marker_set)[1]
    contact = -1 if palm is None else int(np.argmin(np.linalg.norm(own - palm, axis=-1)))
    name = human or "the person"
    title = f"{path.name}, {name}"
    return Partner(title, emotion, "", False, person, marker_set, contact, None, palm, placement.notes)


def _other(whole: Recording, prefixes: Sequence[str], marker_set: MarkerSet) -> Recording | None:
    """The first other person in the file with the markers of a right arm."""
    for prefix in prefixes:
        person = whole.person(prefix)
        if np.all(marker_set.match(person.names)[marker_set.indices(marker_set.arm.markers)] >= 0):
            return person
    return None
