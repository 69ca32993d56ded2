"""A simulated participant: known confusions, PSE, lapses and reaction times, answering as a page does.

It hears the messages that pages hear, and says what pages say; a carrier brings them to it, over the page's own
connection or in one process. What it answers is drawn from its seed, the participant and the trial's number, so that a
run that was killed and resumed gets the same answers to the same trials.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import ndtr

from highfive.hil.experiments.desk import READY
from highfive.hil.experiments.protocol import Mode
from highfive.hil.experiments.question import ANSWER, DONE, RATE
from highfive.model.errors import HighFiveError
from highfive.model.toml_file import check_keys, is_table, number, read_toml, table

PROBIT_75 = 0.6744897501960817
"""A just noticeable difference in standard deviations."""
READING_S = 1.0


@dataclass(frozen=True)
class Perception:
    """How one condition is seen.

    Attributes:
        right: share of right answers; the others are even over the wrong labels.
        confusion: style -> label -> share; in place of ``right`` where a style is in it.
        pse, jnd: of morphs, shares of the second style.
        lapse: share of answers that are any label.
    """

    right: float = 0.75
    confusion: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    pse: float = 0.5
    jnd: float = 0.1
    lapse: float = 0.0


@dataclass(frozen=True)
class Observer:
    """A simulated participant.

    Attributes:
        seed: of what is drawn.
        interactive, replay: how the avatar is seen that answers, and how all else is.
        rt_s, rt_spread: median of the reaction times, s, and standard deviation of their logarithm.
        silent: share of trials without an answer.
    """

    seed: int = 0
    interactive: Perception = field(default_factory=Perception)
    replay: Perception = field(default_factory=Perception)
    rt_s: float = 0.9
    rt_spread: float = 0.3
    silent: float = 0.0

    def perception(self, condition: str) -> Perception:
        """Of a mode."""
        return self.interactive if condition == Mode.INTERACTIVE.value else self.replay


@dataclass(frozen=True)
class Reply:
    """What a participant does: after so many seconds a page says this."""

    after_s: float
    name: str
    value: Any = None


class SimulatedParticipant:
    """An observer who takes part: hears the texts of a page, and replies."""

    def __init__(self, observer: Observer, participant: str) -> None:
        """Under a participant's code."""
        self._observer, self._code = observer, participant
        self._about: Mapping[str, Any] = {}
        self._trial: Mapping[str, Any] = {}

    def hear(self, kind: str, text: Mapping[str, Any]) -> list[Reply]:
        """What follows from a text."""
        if kind == "experiment":
            self._about = text
        elif kind == "experimenter":
            self._trial = text
        elif kind == "participant" and text["phase"] == "ready":
            return [Reply(READING_S, READY)]
        elif kind == "participant" and text["phase"] == "question":
            return self._answer() if text["asks"] == ANSWER else self._rate()
        return []

    def _rng(self, use: int) -> np.random.Generator:
        code = int.from_bytes(self._code.encode(), "big")
        return np.random.default_rng([self._observer.seed, code, int(self._trial["ask"]), use])

    def _answer(self) -> list[Reply]:
        rng, observer = self._rng(0), self._observer
        if rng.random() < observer.silent:
            return []
        label = said(observer.perception(self._trial["condition"]), self._trial, list(self._about["keys"]), rng)
        after = observer.rt_s * float(np.exp(observer.rt_spread * rng.standard_normal()))
        return [Reply(after, ANSWER, {"key": self._about["keys"][label]})]

    def _rate(self) -> list[Reply]:
        rng, replies = self._rng(1), list[Reply]()
        for slider in self._about["sliders"]:
            value = int(rng.integers(1, slider["points"] + 1)) if slider["points"] else round(float(rng.random()), 3)
            replies.append(Reply(0.3, RATE, {"name": slider["name"], "value": value}))
        return [*replies, Reply(0.3, DONE)]


def said(seen: Perception, trial: Mapping[str, Any], labels: list[str], rng: np.random.Generator) -> str:
    """The label that is answered to a trial: its ``style``, ``weights`` and ``expected``."""
    if rng.random() < seen.lapse:
        return labels[int(rng.integers(len(labels)))]
    expected, weights = trial["expected"], trial["weights"]
    if trial["style"] in seen.confusion:
        p = np.array([seen.confusion[trial["style"]].get(label, 0.0) for label in labels])
    elif expected:
        p = np.where(np.array(labels) == expected, seen.right, (1.0 - seen.right) / (len(labels) - 1))
    else:  # a level of a morph, from the first of its emotions to the last, has no right answer
        first, second = next(iter(weights)), next(reversed(weights))
        share = float(ndtr((weights[second] - seen.pse) / (seen.jnd / PROBIT_75)))
        p = np.array([{first: 1.0 - share, second: share}[label] for label in labels])
    return labels[int(rng.choice(len(labels), p=p / p.sum()))]


def read_observer(path: Path) -> Observer:
    """A simulated participant's file.

    Raises:
        HighFiveError: it cannot be read, or something in it is wrong.
    """
    data = read_toml(path, "the simulated participant")
    where = f"simulated participant {path}: "
    usual = Observer()
    check_keys(data, where.rstrip(": "), set(), {"seed", "interactive", "replay", "reaction"})
    reaction = table(data, "reaction") if "reaction" in data else {}
    check_keys(reaction, f"{where}[reaction]", set(), {"median_s", "spread", "silent"})

    def given(name: str, default: float, low: float, high: float) -> float:
        return number(reaction, f"{where}reaction.", name, float, low, high) if name in reaction else default

    return Observer(
        seed=number(data, where, "seed", int, 0, 2**62) if "seed" in data else usual.seed,
        interactive=_perception(data, "interactive", where),
        replay=_perception(data, "replay", where),
        rt_s=given("median_s", usual.rt_s, 0.001, 600.0),
        rt_spread=given("spread", usual.rt_spread, 0.0, 5.0),
        silent=given("silent", usual.silent, 0.0, 1.0),
    )


def check_labels(observer: Observer, labels: Collection[str], where: str) -> None:
    """What a simulated participant confuses are answers that there are.

    Raises:
        HighFiveError: one is not.
    """
    for name, seen in (("interactive", observer.interactive), ("replay", observer.replay)):
        for style, shares in seen.confusion.items():
            if strange := [label for label in shares if label not in labels]:
                raise HighFiveError(
                    f"simulated participant {where}: {name}.confusion.{style} has {strange[0]!r}; the answers are "
                    f"{', '.join(labels)}"
                )


def _perception(data: Mapping[str, Any], name: str, where: str) -> Perception:
    if name not in data:
        return Perception()
    entry, usual = table(data, name), Perception()
    check_keys(entry, f"{where}[{name}]", set(), {"right", "confusion", "pse", "jnd", "lapse"})
    bounds = {"right": (0.0, 1.0), "pse": (-2.0, 3.0), "jnd": (1e-3, 10.0), "lapse": (0.0, 1.0)}
    values = {
        key: number(entry, f"{where}{name}.", key, float, *limits) if key in entry else getattr(usual, key)
        for key, limits in bounds.items()
    }
    confusion: dict[str, dict[str, float]] = {}
    for style, row in (table(entry, "confusion") if "confusion" in entry else {}).items():
        place = f"{where}{name}.confusion.{style}"
        if not is_table(row):
            raise HighFiveError(f"{place}: got {row!r}, expected a table of label = share")
        confusion[style] = {label: number(row, f"{place}.", label, float, 0.0, 1.0) for label in row}
        if abs(sum(confusion[style].values()) - 1.0) > 1e-6:
            raise HighFiveError(f"{place}: shares sum to {sum(confusion[style].values()):g}, expected 1")
    return Perception(confusion=confusion, **values)
