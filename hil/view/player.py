"""Plays a recording on the page: at any speed, step by step, from any moment."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any

import numpy as np

from highfive.hil.recording.trial_spans import TrialSpan
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.runtime.console import say_aside
from highfive.hil.view.commands import Command
from highfive.hil.view.live_page import LivePage
from highfive.hil.view.recorded import RecordedTrial, RecordedTrials, met_time_of, readable_from
from highfive.hil.view.wire import PoseMessage
from highfive.model.geometry.rotations import Array

RATE_HZ = 120.0
PERIOD_NS = round(1e9 / RATE_HZ)
STATES_EVERY = 8
"""Poses between two texts that say how it stands."""
REST_S = 1.2
"""Between the end of a high five and the next one."""
AHEAD_S = 0.034
"""Poses are sent for so much later, s: what comes next is known here, so the page draws between two poses, and never
beyond the newest (a picture is on the screen some 25 ms after the last pose that it can know)."""


class Player:
    """Where in which high five of a recording it is."""

    def __init__(self, trials: Sequence[RecordedTrial]) -> None:
        """At the start of the first of them, playing."""
        self._trials = trials
        self.damaged: dict[int, str] = {}
        """Those that were passed over, and why."""
        self.trial, self.time_s, self.speed, self.playing = readable_from(trials, 0, self.damaged), 0.0, 1.0, True
        self._rested_s = 0.0
        self._leapt = True

    def obey(self, command: Command) -> None:
        """What a page asked for; what has no meaning in a recording is passed over."""
        last = len(self._trials) - 1
        match command.name:
            case "pause":
                self.playing, self._leapt = not command.value, True
            case "speed":
                self.speed, self._leapt = command.value, True
            case "seek":
                self._go(self.trial, command.value)
            case "step":
                self.playing = False
                times = self._now.times
                at = int(np.searchsorted(times, self.time_s + 1e-6, side="right")) - 1 + command.value
                self._go(self.trial, float(times[min(max(at, 0), len(times) - 1)]))
            case "next":
                self._go(self.trial + 1 if self.trial < last else 0, 0.0)
            case "again":
                self.playing = True
                self._go(self.trial, 0.0)
            case "trial":
                self._go(min(command.value, last), 0.0)
            case _:
                pass

    def advance(self, seconds: float) -> None:
        """Lets so much time of the clock pass."""
        if not self.playing:
            return
        end = float(self._now.times[-1])
        if self.time_s >= end:
            self._rested_s += seconds
            if self._rested_s >= REST_S:
                self._go(self.trial + 1 if self.trial + 1 < len(self._trials) else 0, 0.0)
            return
        self.time_s = min(self.time_s + seconds * self.speed, end)

    def poses(self, now_ns: int) -> PoseMessage:
        """Everything as it is :data:`AHEAD_S` after ``now_ns``, between two ticks by interpolation.

        At a standstill, and where the time has leapt, it is for ``now_ns`` itself: a pose that is for no later time
        than the one before tells the page to forget what it was sent.
        """
        trial = self._now
        end = float(trial.times[-1])
        moves = self.playing and self.time_s < end
        ahead = AHEAD_S if moves and not self._leapt else 0.0
        self._leapt = False
        time_s = min(self.time_s + ahead * self.speed, end)
        first = int(np.clip(np.searchsorted(trial.times, time_s, side="right") - 1, 0, len(trial.times) - 2))
        span = float(trial.times[first + 1] - trial.times[first])
        share = min(max((time_s - float(trial.times[first])) / span, 0.0), 1.0)
        return PoseMessage(
            0, now_ns + round(1e9 * ahead), 0, 0, self.speed if moves else 0.0, time_s,
            along(trial.times, trial.bodies, first, share),
            (1.0 - share) * trial.markers[first] + share * trial.markers[first + 1], trial.seen[first],
        )  # fmt: skip

    def state(self) -> dict[str, Any]:
        """What is told beside the poses."""
        trial = self._now
        at = max(int(np.searchsorted(trial.times, self.time_s + 1e-6, side="right")) - 1, 0)
        return {
            "trial": self.trial,
            "trials": len(self._trials),
            "title": trial.title,
            "style": trial.style,
            "cell": trial.cell,
            "time_s": self.time_s,
            "length_s": float(trial.times[-1]),
            "contact_s": trial.contact_s,
            "playing": self.playing,
            "speed": self.speed,
            "time_to_contact_s": float(trial.expected[at]),
            "correction": float(trial.weight[at]),
            "palms_m": float(trial.palms[at]),
            "forecast": trial.forecasts[at],
            "tracked": int(trial.seen[at].sum()),
            "markers": int(trial.seen.shape[1]),
            **({} if trial.plates is None else {"plate_m": float(trial.plates[at])}),
        }

    @property
    def _now(self) -> RecordedTrial:
        return self._trials[self.trial]

    def _go(self, trial: int, time_s: float) -> None:
        self.trial, self._rested_s, self._leapt = readable_from(self._trials, trial, self.damaged), 0.0, True
        self.time_s = min(max(time_s, 0.0), float(self._now.times[-1]))


def along(times: Array, bodies: Array, first: int, share: float) -> Array:
    """(B, 7) of T poses, a share of the way from the tick ``first`` to the next one.

    By cubic Hermite curves, with the speeds of the ticks on either side (Catmull-Rom): of recordings at half the rate
    straight lines cut 3 mm off a quick hand's way. Quaternions go the short way, and are made whole.

    Args:
        times: (T,) s, increasing.
        bodies: (T, B, 7) position, m, and quaternion.
        first: 0 to T - 2.
        share: 0 to 1.
    """
    ticks = np.clip([first - 1, first, first + 1, first + 2], 0, len(times) - 1)
    t = times[ticks]
    leaving = (share * (share - 1.0) ** 2) * (t[2] - t[1]) / (t[2] - t[0])
    coming = (share**2 * (share - 1.0)) * (t[2] - t[1]) / (t[3] - t[1])
    there = share**2 * (3.0 - 2.0 * share)
    shares = np.array([-leaving, 1.0 - there - coming, there + leaving, coming])
    four = bodies[ticks].copy()
    four[..., 3:] *= np.where((four[..., 3:] * four[1, :, 3:]).sum(axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
    found = np.tensordot(shares, four, axes=1)
    found[:, 3:] /= np.linalg.norm(found[:, 3:], axis=1, keepdims=True)
    return found


def play(page: LivePage, trials: RecordedTrials, clock: Clock = MACHINE, until_ns: int | None = None) -> None:
    """Plays until the page's end button, Ctrl-C, or ``until_ns``."""
    player, count, due, told = Player(trials), 0, clock.now(), set[int]()
    page.tell("contacts", trials=[trial_line(span) for span in trials.spans])
    while page.alive and (until_ns is None or due < until_ns):
        for command in page.commands():
            if command.name == "end":
                return
            player.obey(command)
        for place in player.damaged.keys() - told:
            told.add(place)
            say_aside(f"left out: {player.damaged[place]}", logging.WARNING)
            page.tell("say", message=f"High five {trials.spans[place].number + 1} is damaged and left out.")
        page.show(player.poses(due))
        if count % STATES_EVERY == 0:
            page.tell("state", **player.state())
        count += 1
        due = max(due + PERIOD_NS, clock.now() - PERIOD_NS)
        clock.wait_until(due)
        player.advance(1.0 / RATE_HZ)


def trial_line(span: TrialSpan) -> dict[str, Any]:
    """A high five in a list."""
    contact = span.contact
    touched = contact.get("touch_error")  # the true palm's, as a session's own page has it; of no person who lives
    return {
        "number": span.number + 1,
        "title": span.text("title"),
        "style": span.text("style"),
        "cell": span.text("cell"),
        "met": contact.get("met"),
        "contact_s": met_time_of(contact),
        "distance_m": contact.get("distance") if touched is None else touched,
        "where": contact.get("where"),
    }
