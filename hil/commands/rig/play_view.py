"""High fives that the arm plays from a recording, on the live page: people as recorded, the arm as it is now."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from highfive.hil.arm.arm_trial import ArmTrial
from highfive.hil.arm.loop import ArmLoop, ArmTick
from highfive.hil.commands.page import open_page
from highfive.hil.commands.page_options import check_port
from highfive.hil.commands.play_trials import Played, over_told
from highfive.hil.commands.simulate_options import PageOptions
from highfive.hil.recording.session_reader import SessionReader
from highfive.hil.runtime.clock import Clock
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.events import PalmsTogether
from highfive.hil.view.arm_cast import ArmCast
from highfive.hil.view.cast import PERSON
from highfive.hil.view.recorded import RecordedTrial, RecordedTrials
from highfive.hil.view.session_view import PAUSED_NS, STATES_EVERY, ShowingPage, heard
from highfive.hil.view.wire import PoseMessage


class PlayView:
    """The page of ``rig play``.

    Attributes:
        ends: somebody asked for the end on the page: after this high five.
    """

    def __init__(self, page: ShowingPage, trials: RecordedTrials, loop: ArmLoop, arm: str, count: int) -> None:
        """Of ``count`` high fives out of ``trials``, played by ``loop``; ``arm`` is the arm's name, or its folder."""
        self._page, self._trials, self._loop, self._count = page, trials, loop, count
        self._places = {span.number: place for place, span in enumerate(trials.spans)}
        self._people, self._arm = len(avatar_skeleton().names) + len(PERSON), ArmCast(arm)
        self._trial: RecordedTrial = trials[0]
        self._about: dict[str, Any] = {}
        self._palms, self._tick, self._played = PalmsTogether(), 0, 0
        self._paused, self._gone, self.ends = False, False, False

    @property
    def _clock(self) -> Clock:
        return self._loop.clock

    def begin(self, number: int) -> None:
        """The high five of a number is next; waits as long as the page says pause and nothing has stopped the arm."""
        self._trial = trial = self._trials[self._places[number]]
        self._about = {"trial": self._played, "trials": self._count, "cell": trial.cell, "style": trial.style}
        self._palms, self._tick = PalmsTogether(), 0
        self._obey()
        while self._paused and not (self.ends or self._loop.trouble):
            self._show(0.0)
            self._page.tell("state", **self._about, **self._standing(), time_s=0.0)
            self._clock.wait_until(self._clock.now() + PAUSED_NS)
            self._obey()

    def watch(self, tick: ArmTick) -> None:
        """Shows a tick that was played, or was part of the way back."""
        self._obey()
        self._show(1.0, tick)
        if self._tick % STATES_EVERY == 0:
            self._page.tell("state", **self._state(tick))
        self._tick += 1

    def judged(self, played: ArmTrial) -> None:
        """A high five was played."""
        self._played += 1
        met, trial = played.met, self._trial
        self._page.tell("contact", met=met.touched, distance_m=met.error, style=trial.style, cell=trial.cell)

    def end(self, why: str, folder: Path) -> None:
        """It is over: '', or ``why`` it was ended early; ``folder`` is the report's."""
        if self._loop.trouble:
            told = f"The arm was stopped: {self._loop.trouble}"
            self._page.tell("state", **self._about, **self._standing(), time_s=0.0, message=told)
        self._page.tell("over", **over_told(Played(interrupted=bool(why), why=why), folder))

    def _show(self, rate: float, tick: ArmTick | None = None) -> None:
        trial, at, now = self._trial, self._at, self._clock.now()
        bodies, measured = trial.bodies[at, : self._people], self._loop.measured
        if measured is not None:
            wanted = measured if tick is None else tick.planned
            bodies = np.vstack([bodies, self._arm.poses(measured, wanted)])
        time_s = float(trial.times[at])
        self._page.show(PoseMessage(0, now, 0, 0, rate, time_s, bodies, trial.markers[at], trial.seen[at]))

    @property
    def _at(self) -> int:
        """Where in the recorded high five it is; people stand as they did last while the arm goes back."""
        return min(self._tick, len(self._trial.times) - 1)

    def _state(self, tick: ArmTick) -> dict[str, Any]:
        trial, at, goal = self._trial, self._at, tick.goal
        distance, measured = None, self._loop.measured
        if measured is not None and goal.person is not None:
            arm = self._loop.retarget.arm
            plate = arm.plate_at(arm.standing(measured)).position
            distance = float(np.linalg.norm(plate - goal.person.position))
            if self._palms(distance):
                self._page.tell("touch", where=0.5 * (plate + goal.person.position))
        return {
            **self._about,
            **self._standing(),
            "time_s": float(trial.times[at]),
            "correction": trial.weight[at],
            "time_to_contact_s": None if goal.contact is None else goal.contact.time,
            "palms_m": distance,
            "tracked": int(trial.seen[at].sum()),
            "markers": trial.seen.shape[1],
            "forecast": None if goal.contact is None else trial.forecasts[at],
        }

    def _standing(self) -> dict[str, Any]:
        return {"paused": self._paused, "stopped": bool(self._loop.trouble)}

    def _obey(self) -> None:
        for command in self._page.commands():
            if command.name == "pause":
                self._paused = command.value
            elif command.name == "end":
                self.ends = True
        self._page.shown()  # nobody keeps what was seen
        if gone := not heard(self._page, self._gone, "the arm plays on without it"):
            self._paused = False  # nobody could let it go on
        self._gone = self._gone or gone


def shown_trials(session: SessionReader, options: PageOptions) -> RecordedTrials:
    """What the page is to show: before the arm is made ready.

    Raises:
        HighFiveError: the port cannot be had, or the recording cannot be shown.
    """
    check_port(options)
    return RecordedTrials(session, build_scene())


@contextmanager
def play_view(
    options: PageOptions, trials: RecordedTrials, loop: ArmLoop, arm: str, count: int, title: str
) -> Iterator[PlayView]:
    """The page with the arm's emergency stop, once somebody looks on, or could have.

    Raises:
        HighFiveError: the page cannot be served.
    """
    about = {"mode": "played", "title": title, "arm": True, "rig": arm}
    with open_page(options, about, loop.estop) as page:
        yield PlayView(page, trials, loop, arm, count)
