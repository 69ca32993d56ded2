"""Where a trial is played: with an avatar and a person, or, to try a study, with nothing but its time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol as Interface
from typing import runtime_checkable

from highfive.hil.experiments.plan import PlannedTrial
from highfive.hil.experiments.protocol import Mode
from highfive.hil.experiments.trial_row import TrialRow
from highfive.hil.runtime.clock import Clock
from highfive.model.errors import HighFiveError

S = 1_000_000_000


class TrialBrokenOffError(HighFiveError):
    """A trial was not played to its end; the run goes on. ``str`` of it says why."""


class RunStoppedError(HighFiveError):
    """The experimenter ended the run; what was asked is in the log."""


class RunFailedError(HighFiveError):
    """Nothing tracks the person any more, or nothing is recorded: the trial is broken off, and the run ends."""


@dataclass(frozen=True)
class Asked:
    """A trial on its way.

    Attributes:
        trial: of the plan.
        ask: the how manieth trial of the session it is.
        weights: emotion -> share, that are shown.
        source: the row of the trial that is shown again; None of an interactive one.
    """

    trial: PlannedTrial
    ask: int
    weights: Mapping[str, float]
    source: TrialRow | None = None


@dataclass(frozen=True, kw_only=True)
class Played:
    """What is known of a trial that was played to its end; times of the session's clock, ns.

    Attributes:
        ended_ns: when the motion was over.
        contact_ns: when palms met, or were shown to meet again; None if they did not.
        peak_speed: of the person's palm, m/s.
        longest_gap_s, stalled_s: the longest time between two ticks; all of them as far as they are beyond two ticks.
        frame, source_ns, arrival_ns, tick_ns: of the frame in which palms met, or the motion ended: its number, by the
            source's own clock, as it came, for when its pose was. None of what is not known.
        recording: file beside the log that holds the motion; empty where there is none.
    """

    ended_ns: int
    contact_ns: int | None = None
    peak_speed: float | None = None
    longest_gap_s: float | None = None
    stalled_s: float | None = None
    frame: int | None = None
    source_ns: int | None = None
    arrival_ns: int | None = None
    tick_ns: int | None = None
    recording: str = ""


@runtime_checkable
class Stage(Interface):
    """Plays trials."""

    def play(self, asked: Asked, cue: Callable[[], None]) -> Played:
        """Plays one; ``cue`` is called when the person is to begin.

        Raises:
            TrialBrokenOffError: it was not played to its end.
            RunStoppedError: the experimenter wants the run to end.
            RunFailedError: nothing tracks the person any more, or nothing is recorded.
        """
        ...

    def shown_ns(self) -> int | None:
        """When a page first showed that frame of the trial that was played, as far as pages have told: they do so some
        pictures later.
        """
        ...


class EmptyStage:
    """No avatar and no person: a trial takes its time, and palms meet but where she acts and is not answered."""

    LASTS_S, MEETS_S = 3.0, 1.6

    def __init__(self, clock: Clock) -> None:
        """By a clock, which may be a virtual one."""
        self._clock = clock

    def play(self, asked: Asked, cue: Callable[[], None]) -> Played:
        """Lets the time of a trial pass."""
        cue()
        begun = self._clock.now()
        ended = begun + round(S * self.LASTS_S)
        self._clock.wait_until(ended)
        met = begun + round(S * self.MEETS_S) if asked.trial.mode != Mode.NO_CONTINGENCY.value else None
        return Played(ended_ns=ended, contact_ns=met)

    def shown_ns(self) -> int | None:
        """Nothing is shown."""
        return None
