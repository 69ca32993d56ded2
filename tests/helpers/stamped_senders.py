"""Senders that stamp each sample when they push it, made up: what they lost and what was only late is known."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

PUSH_S = 2e-5
"""What a push takes at least, s: so close together come samples that were held up."""


@dataclass(frozen=True)
class Sent:
    """N samples: their true numbers (N,), when they were stamped (N,), s, and what was lost before each (N,)."""

    numbers: NDArray[np.int64]
    stamps: NDArray[np.float64]

    @property
    def lost(self) -> NDArray[np.int64]:
        return np.diff(self.numbers, prepend=-1) - 1


def send(
    seed: int,
    rate_hz: float,
    seconds: float = 10.0,
    late: float = 0.0,
    late_s: float = 0.025,
    lost: float = 0.0,
    outage: tuple[float, float] = (0.0, 0.0),
    noise_s: float = 1e-4,
    wander_s: float = 0.0,
) -> Sent:
    """A sender of ``seconds``.

    Args:
        seed: of all that is random.
        rate_hz: its true rate.
        seconds: how long it sends.
        late: share of samples that are held up by ``late_s``; those that are due meanwhile follow all at once.
        late_s: s.
        lost: share of samples that are never sent; not among the last ones, nor the first, nor those that would come
            all at once with a first one that is held up: of these nothing can be known.
        outage: from, to, s: nothing is sent.
        noise_s: standard deviation, s, of the normal distribution whose magnitude each sample is late by besides.
        wander_s: amplitude, s, of a slow wander of the sender's clock.
    """
    rng = np.random.default_rng(seed)
    count = round(rate_hz * seconds)
    due = np.arange(count) / rate_hz
    there = (rng.random(count) >= lost) & ((due < outage[0]) | (due >= outage[1]))
    there[: 2 + round(late_s * rate_hz) * (late > 0.0)] = there[-5:] = True
    held_up = np.zeros(count)
    held_up[rng.permutation(count - 1 - round(3 * late_s * rate_hz))[: round(late * count)]] = late_s
    due += wander_s * np.sin(2.0 * np.pi * due / 7.0) + np.abs(rng.normal(scale=noise_s, size=count)) + held_up
    queue = PUSH_S * np.arange(there.sum())  # a sample is never pushed before the one in front of it
    return Sent(np.flatnonzero(there), 1000.0 + np.maximum.accumulate(due[there] - queue) + queue)
