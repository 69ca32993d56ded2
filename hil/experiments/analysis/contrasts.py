"""Interaction against the conditions that the source study has not: another's replays, and acting without an answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from highfive.hil.experiments.analysis.answers import BESIDE, Answer
from highfive.hil.experiments.analysis.counts import CONDITIONS, Count, PersonCounts
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
        right: dict[str, dict[str, list[bool]]] = {}
        for one in answers:
            if one.weight is None and one.condition in (first, other):
                right.setdefault(one.participant, {}).setdefault(one.condition, []).append(one.agrees)
        people = [
            PersonCounts(person, *(Count(sum(hers[name]), len(hers[name])) for name in (first, other)))
            for person, hers in right.items()
            if len(hers) == len((first, other))
        ]
        if people:
            sums = [
                sum(count.correct for count in counts) / sum(count.n for count in counts)
                for counts in ([one.interactive for one in people], [one.replay for one in people])
            ]
            effects = over_people(*logit_differences(people), level) if len(people) > 1 else None
            found[other] = Contrast(len(people), dict(zip((first, other), sums, strict=True)), effects)
    return found
