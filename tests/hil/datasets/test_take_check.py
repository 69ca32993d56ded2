"""Which takes of two people are good: simulated ones with usual gaps are, and each thing that goes wrong is said."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from highfive.hil.datasets.dyads import Role
from highfive.hil.datasets.take_check import TakeCheck, check_take
from highfive.hil.sim.people.actors import simulate_pair
from highfive.hil.sim.people.capture import Defects, record_pair, trial_seed
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.people.grid import CELLS, GRID_Y, GRID_Z
from highfive.mocap_bridge.files.c3d import write_c3d
from highfive.mocap_bridge.files.recording import Recording

PLACES = {cell: (GRID_Y[int(cell[1]) - 1], GRID_Z["ABC".index(cell[0])]) for cell in CELLS}
HUMAN, AVATAR = Role("human", None), Role("avatar", None)


def take(emotion: str, cell: str, repetition: int = 0) -> tuple[Recording, float]:
    """A simulated one, and when its palms meet, s."""
    rng = trial_seed(11, emotion, cell, repetition)
    pair = simulate_pair(emotion, cell, repetition, rng)
    return record_pair(pair, Defects(), rng), pair.contact_frame / 120.0


def checked(recording: Recording, folder: Path, wanted: str = "") -> TakeCheck:
    write_c3d(folder / "take.c3d", recording)
    return check_take(folder / "take.c3d", HUMAN, AVATAR, PLACES, wanted)


@pytest.mark.parametrize(
    ("repetition", "cells"), [(0, ("A1", "C2")), *(pytest.param(n, CELLS, marks=pytest.mark.slow) for n in (1, 2))]
)
@pytest.mark.slow
def test_every_simulated_take_is_good_and_its_contact_and_cell_are_those_it_was_made_with(
    repetition: int, cells: tuple[str, ...], tmp_path: Path
) -> None:
    """The hands' markers are together from some frames before the palms on, as palms press."""
    for emotion in EMOTIONS:
        for cell in cells:
            recording, met = take(emotion, cell, repetition)
            found = checked(recording, tmp_path, cell)
            assert not found.troubles, (emotion, cell, found)
            assert found.cell == cell and abs(found.contact_s - met) < 0.15, (emotion, cell, found.contact_s, met)


def unseen(who: str, start: float, end: float) -> Callable[[Recording, float], Recording]:
    """All markers of somebody hidden from ``start`` to ``end``, s from contact."""

    def hide(recording: Recording, met: float) -> Recording:
        valid = recording.valid.copy()
        rows = slice(max(0, round(120 * (met + start))), round(120 * (met + end)))
        valid[rows, [name.startswith(who) for name in recording.names]] = False
        return replace(recording, valid=valid)

    return hide


def apart(recording: Recording, met: float) -> Recording:
    """She stands half a metre further away."""
    points = recording.points.copy()
    points[:, [name.startswith("human") for name in recording.names], 0] += 0.5
    return replace(recording, points=points)


def cut(start: float, end: float) -> Callable[[Recording, float], Recording]:
    """From ``start`` to ``end``, s from contact."""

    def part(recording: Recording, met: float) -> Recording:
        rows = slice(max(0, round(120 * (met + start))), round(120 * (met + end)))
        names = ("points", "valid", "unlabelled", "unlabelled_valid")
        return replace(recording, **{name: getattr(recording, name)[rows] for name in names})

    return part


@pytest.mark.slow
@pytest.mark.parametrize(
    ("happens", "wanted", "says"),
    [
        (unseen("human", -0.9, -0.3), "B2", "a hand is unseen for 0.60 s at a time"),
        (unseen("avatar", -1.4, -0.8), "B2", "the actor's hand is seen in 87%"),
        (apart, "B2", "they did not meet"),
        (cut(-0.2, 2.0), "B2", "it is cut short"),
        (cut(-3.0, 0.02), "B2", "it is cut short"),
        (cut(-0.4, 0.4), "B2", "both are seen for 0.8 s, expected 1 s"),
        (lambda recording, met: recording, "C1", "hands met in B2"),
    ],
)
def test_what_goes_wrong_is_said(
    happens: Callable[[Recording, float], Recording], wanted: str, says: str, tmp_path: Path
) -> None:
    recording, met = take("neutral", "B2")
    assert says in "; ".join(checked(happens(recording, met), tmp_path, wanted).troubles)
    assert not checked(recording, tmp_path, "B2").troubles
