"""Which trials are held out from which training: the table's own split, or each repetition or cell in turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.trials import Trial

LEAVE_OUT = ("repetition", "cell")


@dataclass(frozen=True)
class Fold:
    """One training and the trials that it does not see.

    Attributes:
        name: what is left out, '' for the table's own split.
        trials: all trials, with ``test`` set on those that are held out.
    """

    name: str
    trials: tuple[Trial, ...]

    @property
    def held_out(self) -> list[int]:
        """Indices of the trials that are held out."""
        return [index for index, trial in enumerate(self.trials) if trial.test]


def own_split(trials: Sequence[Trial]) -> list[Fold]:
    """The split that the trials bring.

    Raises:
        HighFiveError: nothing is held out, or everything.
    """
    held = sum(trial.test for trial in trials)
    if not 0 < held < len(trials):
        word = "every" if held else "no"
        raise HighFiveError(f"{word} trial is held out; mark some with split test in trials.csv, or use --leave-out")
    return [Fold("", tuple(trials))]


class Labelled(Protocol):
    """What a trial, or a row of a table of trials, says of itself."""

    @property
    def cell(self) -> str:
        """'' where it is not known."""
        ...

    @property
    def repetition(self) -> int:
        """-1 where it is not known."""
        ...


def left_out_in_turn(trials: Sequence[Labelled], what: str) -> list[str]:
    """The repetitions or cells, by number.

    Raises:
        HighFiveError: fewer than two of them, or ``what`` is another word.
    """
    if what not in LEAVE_OUT:
        raise HighFiveError(f"cannot leave out one {what!r} in turn; expected {' or '.join(LEAVE_OUT)}")
    groups = sorted({group for trial in trials if (group := group_of(trial, what))}, key=_natural)
    if len(groups) < 2:
        known = f"only {what} {groups[0]}" if groups else f"no {what}"
        raise HighFiveError(f"trials.csv names {known}; at least two are needed to leave one out in turn")
    return groups


def leave_out(trials: Sequence[Trial], what: str) -> list[Fold]:
    """One fold for each repetition or cell: its trials are held out, whatever their split, the others are not.

    Trials that do not say their repetition or cell are learned from in every fold.

    Raises:
        HighFiveError: fewer than two repetitions or cells, or another word.
    """
    return [
        Fold(group, tuple(replace(trial, test=group_of(trial, what) == group) for trial in trials))
        for group in left_out_in_turn(trials, what)
    ]


def group_of(trial: Labelled, what: str) -> str:
    """The trial's repetition or cell as text, '' where it is not known."""
    if what == "cell":
        return trial.cell
    return str(trial.repetition) if trial.repetition >= 0 else ""


def _natural(name: str) -> tuple[int, str]:
    """Numbers by size: 2 before 10."""
    return (int(name) if name.isdecimal() else 0, name)
