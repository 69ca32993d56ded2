"""By how much one stream is later than another, from events that both see: claps, the palm on the arm, a light.

No clock shows a stream's least delay from one side. An event that two streams see shows the difference of theirs; where
the other is known (the arm's contact on this computer's clock), the delay itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from highfive.model.errors import HighFiveError
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class EventSettings(Settings):
    """Which events are believed to be the same. Set by hand."""

    within_ns: int = setting(300_000_000, "ns", above=0)
    """Seen so far apart at the most; events have to be further from each other than that."""
    fewest: int = setting(5, least=3)
    """Events that both see."""
    scatter_ns: int = setting(15_000_000, "ns", above=0)
    """Most that differences may scatter by, as a standard deviation: a frame at 60 Hz."""


@dataclass(frozen=True)
class EventLatency:
    """How late a stream is.

    Attributes:
        latency_ns: by which it is later than the other; below 0 it is earlier.
        bound_ns: how far that may be off, two standard errors.
        events: that it rests on.
    """

    latency_ns: int
    bound_ns: int
    events: int


def event_latency(
    reference_ns: Sequence[int], stream_ns: Sequence[int], settings: EventSettings | None = None
) -> EventLatency:
    """How much later a stream has the same events than a reference.

    Args:
        reference_ns: when the reference has them, ns of this computer's clock.
        stream_ns: when the stream has them, by its time on the same clock.
        settings: of the pairing.

    Raises:
        HighFiveError: too few events are seen by both, or their differences scatter.
    """
    s = settings or EventSettings()
    ours, theirs = np.sort(np.asarray(reference_ns, dtype=np.int64)), np.sort(np.asarray(stream_ns, dtype=np.int64))
    gaps = theirs[:, None] - ours[None, :]
    near = np.abs(gaps) <= s.within_ns
    alone = (near.sum(axis=1, keepdims=True) == 1) & (near.sum(axis=0, keepdims=True) == 1)  # no other is as likely
    found = gaps[near & alone].astype(float)
    if len(found) < s.fewest:
        raise HighFiveError(
            f"{len(found)} events are seen by both within {1e-6 * s.within_ns:.0f} ms, and are told from each other; "
            f"expected {s.fewest} or more: repeat them a second apart"
        )
    middle = float(np.median(found))
    scatter = 1.4826 * float(np.median(np.abs(found - middle)))  # of a normal distribution
    if scatter > s.scatter_ns:
        raise HighFiveError(
            f"the events' differences scatter by {1e-6 * scatter:.0f} ms, expected {1e-6 * s.scatter_ns:.0f} or less: "
            "use an event that begins at once"
        )
    # The median's standard error is 1.25 times the mean's.
    return EventLatency(round(middle), round(2.0 * 1.2533 * scatter / np.sqrt(len(found))), len(found))
