"""Interaction against the conditions that the source study has not: another's replays, and acting without an answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from highfive.hil.experiments.analysis.answers import BESIDE, Answer, right_by_person
from highfive.hil.experiments.analysis.counts import CONDITIONS, PersonCounts, pooled
from highfive.hil.experiments.analysis.hierarchical import Effects, logit_differences, over_people


@dataclass(frozen=True)
class Contrast:
    """Interactive − another condition.

    Attributes:
        people: who answered in both.
        rates: condition -> share of right answers, of all of these together.
        effects: of the logit differences; None of one person.
    """

    people: int
    rates: Mapping[str, float]
    effects: Effects | None


def contrasts(answers: Sequence[Answer], level: float = 0.95) -> dict[str, Contrast]:
    """Condition -> contrast, of answers to whole emotions, where somebody answered in both."""
    found: dict[str, Contrast] = {}
    first = CONDITIONS[0]
    for other in BESIDE:
        counts = right_by_person([one for one in answers if one.condition in (first, other)])
        people = [PersonCounts(person, hers[first], hers[other]) for person, hers in counts.items() if len(hers) > 1]
        if people:
            together = pooled(people)
            sums = [count.correct / count.n for count in (together.interactive, together.replay)]
            effects = over_people(*logit_differences(people), level) if len(people) > 1 else None
            found[other] = Contrast(len(people), dict(zip((first, other), sums, strict=True)), effects)
    return found
