"""What is to be known of an experiment's trial as it is played, tick by tick: speed, gaps, and where palms met."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from highfive.hil.commands.shown_again import ShownAgain
from highfive.hil.session.session import RATE_HZ, Tick, TickInput
from highfive.hil.sim.playout import PlayState
from highfive.hil.trials.events import TrialEvents
from highfive.hil.trials.live_partner import LiveTrial

TWO_TICKS_NS = round(2e9 / RATE_HZ)


@dataclass
class TrialWitness:
    """Hears each tick of a trial.

    Attributes:
        live: the live person's trial, whose source stamps its frames itself; None of a simulated one.
        acts: palms that meet are the contact.
        again: what shows a contact again; None where nothing does.
        longest_gap_ns, stalled_ns: between two ticks; all gaps as far as they are beyond two ticks.
        peak_speed: of the person's palm, m/s.
        met, last: the tick of the contact; the last one with a frame.
        ended_ns: of the last tick.
        switched_ns: when a switch said that they met; None without one.
        own_stamp_ns: by the source's own clock, of the frame in ``met`` or ``last``.
    """

    live: LiveTrial | None
    acts: bool
    again: ShownAgain | None = None
    longest_gap_ns: int = 0
    stalled_ns: int = 0
    peak_speed: float = 0.0
    met: TickInput | None = None
    last: TickInput | None = None
    ended_ns: int = 0
    switched_ns: int | None = None
    own_stamp_ns: int | None = None

    def __post_init__(self) -> None:
        """Nothing has happened."""
        self._events = TrialEvents()

    def __call__(self, begins: TickInput, tick: Tick, state: PlayState) -> None:
        """A tick that was played."""
        if self.ended_ns:
            gap_ns = begins.at_ns - self.ended_ns
            self.longest_gap_ns = max(self.longest_gap_ns, gap_ns)
            self.stalled_ns += max(gap_ns - TWO_TICKS_NS, 0)
        self.ended_ns = begins.at_ns
        person = tick.sighting.person if tick.sighting is not None else tick.person
        if person.valid:
            self.peak_speed = max(self.peak_speed, float(np.linalg.norm(person.palm.velocity)))
        if self.met is not None:
            return
        if begins.frame is not None or self.last is None:
            self.last = begins
            newest = None if self.live is None else self.live.newest
            self.own_stamp_ns = begins.frame.source_time_ns if newest is None and begins.frame is not None else (
                None if newest is None else newest.source_time_ns
            )  # fmt: skip
        came = "contact" in self._events(tick, state)
        if (came and self.acts) or (self.again is not None and self.again.met):
            self.met = replace(begins, frame=begins.frame or (self.last.frame if self.last else None))
