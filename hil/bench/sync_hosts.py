"""Hosts with clocks of their own, and networks between them: what is sent, when it arrives, and the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

S, MS = 1_000_000_000, 1_000_000
BEGAN_NS = 5_000 * S
"""Of this computer's clock, at which all of it begins."""
EPOCH_NS = 123_456 * S
"""What the hosts' clocks show then."""

Times = NDArray[np.int64]


@dataclass(frozen=True)
class Network:
    """Delays, in order.

    Attributes:
        least_ms: nothing takes less.
        gamma_ms: scale of a gamma distribution of shape 2 on top.
        tail: share of the frames that have a heavy-tailed delay on top (Pareto, shape 1.5, scale 5 ms).
        stalls_ms: shortest and longest stall, one in each 20 s; frames that are held up come all at once.
    """

    least_ms: float
    gamma_ms: float
    tail: float = 0.0
    stalls_ms: tuple[float, float] = (0.0, 0.0)


WIRED = Network(0.15, 0.03)
WIRELESS = Network(1.5, 0.7, 0.03, (20.0, 120.0))


@dataclass(frozen=True)
class Host:
    """Another computer, or a camera system.

    Attributes:
        rate_hz: frames a second.
        ppm: by how much its clock is faster than this computer's; it wanders by ``wander_ppm`` over 1,000 s.
        steps: when its clock is set, s, and by how much, ms.
    """

    rate_hz: float = 120.0
    ppm: float = 50.0
    wander_ppm: float = 2.0
    steps: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class Heard:
    """What came from a host.

    Attributes:
        true: (N,) ns of this computer's clock at which a frame was made.
        stamps: (N,) ns, the same by the host's clock.
        arrivals: (N,) ns of this computer's clock.
    """

    true: Times
    stamps: Times
    arrivals: Times


def heard(host: Host, network: Network, seconds: float, rng: np.random.Generator) -> Heard:
    """What comes in so many seconds."""
    at = np.arange(0.0, seconds, 1.0 / host.rate_hz)
    stamps = at * (1.0 + 1e-6 * host.ppm)
    stamps += 1e-6 * host.wander_ppm * 1000.0 / (2.0 * np.pi) * (1.0 - np.cos(2.0 * np.pi * at / 1000.0))
    for when, by_ms in host.steps:
        stamps += 1e-3 * by_ms * (at >= when)
    delays = network.least_ms + rng.gamma(2.0, network.gamma_ms, len(at))
    delays += np.where(rng.random(len(at)) < network.tail, 5.0 * rng.pareto(1.5, len(at)), 0.0)
    arrivals = at + 1e-3 * delays
    if network.stalls_ms[1]:
        begins = np.arange(0.0, seconds, 20.0) + rng.uniform(1.0, 19.0, int(np.ceil(seconds / 20.0)))
        for begin, lasts in zip(begins, 1e-3 * rng.uniform(*network.stalls_ms, len(begins)), strict=True):
            held = slice(*np.searchsorted(at, [begin, begin + lasts]))
            arrivals[held] = np.maximum(arrivals[held], begin + lasts)
    true = BEGAN_NS + np.rint(S * at).astype(np.int64)
    return Heard(
        true,
        EPOCH_NS + np.rint(S * stamps).astype(np.int64),
        BEGAN_NS + np.rint(S * np.maximum.accumulate(arrivals)).astype(np.int64),
    )
