"""What is asked after a trial, and what was answered: pure, by the times that answers say of themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from highfive.hil.experiments.protocol import CERTAINTY, Protocol, Rating

ANSWER, RATE, DONE = "answer", "rate", "done"
"""What a page says: which key, where a slider stands, that all is said."""
S = 1_000_000_000
_LONGEST_WAY_NS = 5 * S
"""A page's time of an answer is believed if the answer came within so long after it."""


@dataclass(frozen=True)
class Question:
    """What one participant is asked after each trial.

    Attributes:
        keys: answer -> key.
        sliders: asked once there is an answer.
        limit_s: for the answer; and once more for the sliders.
    """

    keys: Mapping[str, str]
    sliders: tuple[Rating, ...]
    limit_s: float


def question_of(protocol: Protocol, keys: Mapping[str, str]) -> Question:
    """Of an experiment, with the keys of a participant."""
    sure = (Rating(CERTAINTY, "How sure are you?", "a guess", "certain"),) if protocol.certainty else ()
    return Question(dict(keys), (*sure, *protocol.ratings), protocol.timing.answer_s)


@dataclass(frozen=True)
class Sheet:
    """A question, and what has been said to it so far.

    Attributes:
        question: what is asked.
        opened_ns: when it was asked, by the session's clock: after the motion.
        answer, key, answer_ns: given; empty and None as long as none is.
        values: slider -> where it stands, 0 to 1 or 1 to its points.
        done: all is said.
        late: the answer came after the limit.
    """

    question: Question
    opened_ns: int
    answer: str = ""
    key: str = ""
    answer_ns: int | None = None
    values: Mapping[str, float] = field(default_factory=dict)
    done: bool = False
    late: bool = False

    @property
    def open(self) -> str:
        """What is still asked: the answer, the sliders, or nothing."""
        if self.done:
            return ""
        return ANSWER if self.answer_ns is None else RATE

    @property
    def until_ns(self) -> int:
        """Until when it is asked."""
        return (self.answer_ns or self.opened_ns) + round(S * self.question.limit_s)


class Wrong(NamedTuple):
    """Why a message changed nothing.

    Attributes:
        word: of :data:`highfive.hil.experiments.words.PAGE`, for who takes part.
        detail: for the experimenter.
    """

    word: str
    detail: str


def heard(sheet: Sheet, name: str, value: Any, now_ns: int) -> tuple[Sheet, Wrong | None]:
    """The sheet after a message, and what is wrong with that; None where all is well.

    Args:
        sheet: so far.
        name: :data:`ANSWER`, :data:`RATE` or :data:`DONE`.
        value: of an answer ``{"key": …, "at_ms": …}``, the page's time of it by the session's clock, or None; of a
            slider ``{"name": …, "value": …}``.
        now_ns: when it came.
    """
    if sheet.done:
        return sheet, Wrong("too_late", "too late: this trial is over")
    if name == ANSWER:
        return _answered(sheet, str(value["key"]), _time_of(value.get("at_ms"), now_ns))
    if sheet.answer_ns is None:
        return sheet, Wrong("no_key", "the answer comes first")
    if name == RATE:
        return _rated(sheet, str(value["name"]), float(value["value"]))
    return replace(sheet, done=True), None


def timed_out(sheet: Sheet, now_ns: int) -> Sheet:
    """The sheet as time makes it: after its limit nothing more is asked."""
    return sheet if now_ns <= sheet.until_ns else replace(sheet, done=True)


def why_excluded(sheet: Sheet) -> str:
    """Why an answer does not count; empty where it does."""
    limit = f"{sheet.question.limit_s:g} s"
    if not sheet.answer:
        return f"no answer within {limit}"
    return f"answered after {limit}" if sheet.late else ""


def _answered(sheet: Sheet, key: str, at_ns: int) -> tuple[Sheet, Wrong | None]:
    if sheet.answer_ns is not None:
        return sheet, Wrong("answered", f"{sheet.answer} was answered already: the first answer counts")
    if at_ns < sheet.opened_ns:
        return sheet, Wrong("not_yet", "not yet: the answer is given when the motion is over")
    keys = sheet.question.keys
    label = next((one for one, own in keys.items() if key.lower() in (own.lower(), one.lower())), None)
    if label is None:
        meant = ", ".join(f"{own} {one}" for one, own in keys.items())
        return sheet, Wrong("no_key", f"{key!r} means nothing here; the keys are {meant}")
    late = at_ns > sheet.until_ns
    done = late or not sheet.question.sliders
    return replace(sheet, answer=label, key=keys[label], answer_ns=at_ns, done=done, late=late), None


def _rated(sheet: Sheet, name: str, value: float) -> tuple[Sheet, Wrong | None]:
    sliders: Sequence[Rating] = sheet.question.sliders
    slider = next((one for one in sliders if one.name == name), None)
    if slider is None:
        asked = ", ".join(one.name for one in sliders) or "none"
        return sheet, Wrong("no_key", f"{name!r} is not asked; asked are {asked}")
    low, high = (1.0, float(slider.points)) if slider.points else (0.0, 1.0)
    if not low <= value <= high:
        return sheet, Wrong("no_key", f"{name} is {value:g}, expected {low:g} to {high:g}")
    return replace(sheet, values={**sheet.values, name: value}), None


def _time_of(at_ms: float | None, now_ns: int) -> int:
    """When an answer was given: as its page says, if that can be; else as it came."""
    at_ns = now_ns if at_ms is None else round(1e6 * at_ms)
    return at_ns if now_ns - _LONGEST_WAY_NS <= at_ns <= now_ns else now_ns
