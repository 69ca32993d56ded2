"""What a law is: a value that may be so large at most, judged in many runs, and what of the wire is only rounding."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from highfive.hil.drivers.bus.rig import COUNTS
from highfive.hil.safety.rules import Rule

PERSON_FIRST = frozenset({Rule.CONTACT_SPEED, Rule.FACE_ZONE, Rule.POSITION})
"""Person and position come before acceleration: near them an arm slows down as fast as it has to."""

ROUNDING = 1.02
"""The ticks' own times jitter by some µs."""

NEVER = 1e9
"""In place of NaN, which JSON has not: a time that never came."""

COUNT = 2.0 * np.pi / COUNTS
"""rad, of a servo."""


@dataclass
class Laws:
    """The worst value of each law that was judged, and those that were broken.

    Attributes:
        worst: law → value.
        broken: law and value.
    """

    worst: dict[str, float] = field(default_factory=dict)
    broken: list[tuple[str, float]] = field(default_factory=list)

    def judge(self, law: str, value: float, most: float) -> None:
        """``value`` may be ``most`` at most; NaN, what never came to pass, is :data:`NEVER`."""
        value = NEVER if np.isnan(value) else value
        self.worst[law] = max(self.worst.get(law, -np.inf), float(value))
        if not value <= most:
            self.broken.append((law, float(value)))

    def judge_near(self, law: str, speed: float, most: float) -> None:
        """A ``speed`` near the person, m/s, that is 0 where nothing was near: then nothing is judged."""
        if speed != 0.0:
            self.judge(law, speed, most)


def largest(worst: list[dict[str, float]]) -> dict[str, float]:
    """Of several runs."""
    laws = {law for one in worst for law in one}
    return {law: max(one[law] for one in worst if law in one) for law in laws}


def judged_in(worst: Iterable[dict[str, float]]) -> dict[str, int]:
    """Law → number of runs in which it was judged."""
    return dict(Counter(law for one in worst for law in one))
