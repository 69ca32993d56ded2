"""The servo arm in an experiment's run: it answers the person, or plays again what it was asked for in another trial.

An arm that plays again does not answer her, so that she has to stand where it does not reach.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from highfive.hil.arm.arm_trial import ArmWatch
from highfive.hil.arm.busy import LAST, too_busy
from highfive.hil.arm.contact_goal import palm_goal
from highfive.hil.arm.planner_values import PalmGoal
from highfive.hil.commands.shown_again import RecordedMotion, recorded_trial
from highfive.hil.drivers.bus.cycle_ring import Cycle
from highfive.hil.experiments.stage import RunFailedError, TrialBrokenOffError
from highfive.hil.recording.replay_goals import asked_of_arm
from highfive.hil.session.session import Tick
from highfive.model.errors import HighFiveError

AWAY = 0.3
"""m, beyond the stretched arm's reach: there its plate meets nobody who sways, or lets an arm hang."""


class ArmInRun:
    """The arm of one run.

    Attributes:
        watch: takes part in its trials.
    """

    def __init__(self, watch: ArmWatch, *, live: bool, never_silent: bool = False) -> None:
        """``live``: somebody is there who has to stand away from an arm that does not answer her; ``never_silent``: as
        :attr:`ArmOptions.never_silent`."""
        self.watch, self._live, self._never_silent = watch, live, never_silent
        arm = watch.loop.retarget.arm
        self._base, self._away = np.array(arm.mount.position, float), arm.reach + AWAY
        self._first_ns: int | None = None

    def begin(self, source: tuple[Path, str] | None, motion: RecordedMotion | None) -> None:
        """A new trial; of one that is shown again the recording and its title there, and what was recorded.

        Raises:
            RunFailedError: the arm is not found fit to follow, or was stopped.
            TrialBrokenOffError: what was asked of the arm then cannot be read.
        """
        self._first_ns = None
        self.watch.goal = palm_goal if source is None or motion is None else self._again(*source, motion)
        if why := self.stopped(self.watch.loop.cycles()):  # since the last trial, which nobody records
            raise RunFailedError(why)
        try:
            self.watch.begin()
        except HighFiveError as error:
            raise RunFailedError(f"the arm: {error}") from None

    def seen(self, tick: Tick) -> None:
        """A tick that was played.

        Raises:
            RunFailedError: the arm was stopped.
            TrialBrokenOffError: who is there stands within reach of an arm that does not answer her.
        """
        if self.watch.goal is not palm_goal and self._live and (near := self._nearest(tick)) < self._away:
            raise TrialBrokenOffError(
                f"she stood {near:.2f} m from the arm's base, which plays again and does not answer her; expected "
                f"{self._away:.2f} m at least"
            )
        self.watch.watch(tick)
        if why := self.stopped():
            raise RunFailedError(why)

    def stopped(self, since: Sequence[Cycle] = ()) -> str:
        """Why it is not driven any more, in one line, and what to do; '' while it is.

        ``since``: cycles of the bus after those of the trial.
        """
        loop, last = self.watch.loop, [*self.watch.cycles[-LAST:], *since]
        if not loop.trouble:
            return ""
        remedy = too_busy(None, last, loop.stopped_by, gone=loop.gone, never_silent=self._never_silent)
        return f"the arm was stopped: {loop.trouble}{remedy and '; ' + remedy}"

    def _nearest(self, tick: Tick) -> float:
        """m, of head and palm to the arm's base, from above; 0 where nobody knows where she is."""
        person = tick.person
        if not person.valid:
            return 0.0
        places = np.array([person.head_position, person.palm.position])
        return float(np.linalg.norm((places - self._base)[:, :2], axis=1).min())

    def _again(self, path: Path, title: str, motion: RecordedMotion) -> Callable[[Tick], PalmGoal]:
        """The goals of that trial at their times, beside the person as she is now; at rest where palms did not meet."""
        try:
            asked = asked_of_arm(*recorded_trial(path, title))
        except HighFiveError as error:
            raise TrialBrokenOffError(str(error)) from None
        then = () if asked is None else asked.goals

        def goal(tick: Tick) -> PalmGoal:
            if self._first_ns is None:
                self._first_ns = tick.time_ns
            now = replace(palm_goal(tick), contact=None, hypotheses=None)
            if not then:
                return now
            at = motion.row(tick.time_ns - self._first_ns)
            one = then[min(at, len(then) - 1)]
            return replace(now, palm=one.palm, contact=one.contact, hypotheses=one.hypotheses)

        return goal
