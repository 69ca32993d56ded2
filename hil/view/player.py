"""Plays a recording on the page: at any speed, step by step, from any moment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from highfive.hil.recording.trial_spans import TrialSpan
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.view.commands import Command
from highfive.hil.view.live_page import LivePage
from highfive.hil.view.recorded import RecordedTrial, RecordedTrials, met_time_of, style_of
from highfive.hil.view.wire import PoseMessage
from highfive.model.geometry.rotations import Array

RATE_HZ = 120.0
PERIOD_NS = round(1e9 / RATE_HZ)
STATES_EVERY = 8
"""Poses between two texts that say how it stands."""
REST_S = 1.2
"""Between the end of a high five and the next one."""


class Player:
    """Where in which high five of a recording it is."""

    def __init__(self, trials: Sequence[RecordedTrial]) -> None:
        """At the start of the first of them, playing."""
        self._trials = trials
        self.trial, self.time_s, self.speed, self.playing = 0, 0.0, 1.0, True
        self._rested_s = 0.0

    def obey(self, command: Command) -> None:
        """What a page asked for; what has no meaning in a recording is passed over."""
        last = len(self._trials) - 1
        match command.name:
            case "pause":
                self.playing = not command.value
            case "speed":
                self.speed = command.value
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
        """Everything as it was then, between two ticks by interpolation; ``now_ns`` is for when it is shown."""
        trial = self._now
        first = int(np.clip(np.searchsorted(trial.times, self.time_s, side="right") - 1, 0, len(trial.times) - 2))
        span = float(trial.times[first + 1] - trial.times[first])
        share = min(max((self.time_s - float(trial.times[first])) / span, 0.0), 1.0)
        moves = self.playing and self.time_s < float(trial.times[-1])
        return PoseMessage(
            0, now_ns, 0, 0, self.speed if moves else 0.0, self.time_s,
            between(trial.bodies[first], trial.bodies[first + 1], share),
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
        }

    @property
    def _now(self) -> RecordedTrial:
        return self._trials[self.trial]

    def _go(self, trial: int, time_s: float) -> None:
        self.trial, self._rested_s = trial, 0.0
        self.time_s = min(max(time_s, 0.0), float(self._now.times[-1]))


def between(first: Array, then: Array, share: float) -> Array:
    """(B, 7) positions by straight lines, quaternions by the normalised straight line the short way."""
    mixed = (1.0 - share) * first + share * then
    opposite = (first[:, 3:] * then[:, 3:]).sum(axis=1) < 0.0
    mixed[opposite, 3:] = ((1.0 - share) * first - share * then)[opposite, 3:]
    mixed[:, 3:] /= np.linalg.norm(mixed[:, 3:], axis=1, keepdims=True)
    return mixed


def play(page: LivePage, trials: RecordedTrials, clock: Clock = MACHINE, until_ns: int | None = None) -> None:
    """Plays until the page's end button, Ctrl-C, or ``until_ns``."""
    player, count, due = Player(trials), 0, clock.now()
    page.tell("contacts", trials=[trial_line(span) for span in trials.spans])
    while page.alive and (until_ns is None or due < until_ns):
        for command in page.commands():
            if command.name == "end":
                return
            player.obey(command)
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
    return {
        "title": span.text("title"),
        "style": style_of(span),
        "cell": span.text("cell"),
        "met": contact.get("met"),
        "contact_s": met_time_of(contact),
        "distance_m": contact.get("distance"),
        "where": contact.get("where"),
    }
