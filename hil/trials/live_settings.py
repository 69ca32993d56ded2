"""How long a live person, and the system that sees them, are waited for."""

from __future__ import annotations

from dataclasses import dataclass

from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class LiveSettings(Settings):
    """Times of trials with a live person and of their ticks. Set by hand."""

    practice: float = setting(5.0, "s", above=0.0)
    """For so long the person is looked at before the first trial: with the hand raised once, that is where it is
    met."""
    stale: float = setting(0.1, "s", above=0.0)
    """An older frame says nothing any more of where a marker is."""
    stale_frames: float = setting(2.5, "frames", above=0.0)
    """Nor is a frame stale that is younger than so many of its source's are apart: a webcam's come at 5 to 30 Hz."""
    resting: float = setting(0.3, "s", least=0.0)
    resting_speed: float = setting(0.3, "m/s", above=0.0)
    """A hand that was slower than this for so long rests: only then does a trial begin."""
    longest: float = setting(15.0, "s", above=0.0)
    """A trial in which no hand is raised ends after so long."""
    afterwards: float = setting(0.5, "s", least=0.0)
    """A trial goes on for so long after the avatar has let go."""
    silent: float = setting(2.0, "s", above=0.0)
    """A source that says nothing for so long while the person is looked at is given up."""
    gone: float = setting(5.0, "s", above=0.0)
    """A source from which nothing has come for so long is given up."""
    early_ns: int = setting(1_000_000, "ns", least=0)
    """A tick may begin so much sooner than a period after the last: a system of 500 Hz gives its newest frame."""
    soon: float = setting(1.4, "ticks", least=1.0, most=1.5)
    """A frame that is expected within so many is waited for; until a later one comes, the person is predicted. From 1.5
    periods on the arm's safety envelope calls a tick late."""
    overdue_ns: int = setting(4_000_000, "ns", least=0)
    """A frame that is so much later than expected is waited for no longer."""
    least_step_ns: int = setting(1_000_000, "ns", least=1)
    """Ticks are for times at least so far apart."""
    clock_set_ns: int = setting(250_000_000, "ns", above=0)
    """A system's clock whose frames are so much further apart than their arrivals, or nearer, was set."""
    told_set_ns: int = setting(2_000_000, "ns", above=0)
    """So much says it where the estimate of that clock begins anew at this frame."""


LIVE = LiveSettings()

WORN = LiveSettings(gone=12.0)
"""Of a person in a headset: who takes it off for a moment, or loads the page again, comes back."""
