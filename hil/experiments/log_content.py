"""What a trial log holds: read from its bytes, marks applied, and what they say comes next. Pure.

A line is a JSON object with a ``kind``: ``run`` (the log was opened, by which version, for which plan), ``begin`` (a
trial begins), ``trial`` (it is over: a :class:`~highfive.hil.experiments.trial_row.TrialRow`), ``mark`` (trials that
are asked again, by their number in the session).
"""

from __future__ import annotations

import json
import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

from highfive.hil.experiments.plan import Plan, PlannedTrial
from highfive.hil.experiments.plan_file import plan_of
from highfive.hil.experiments.trial_row import TrialRow, row_of
from highfive.model.errors import HighFiveError
from highfive.model.toml_file import check_keys, is_table, typed


@dataclass(frozen=True)
class LogContent:
    """A log, read.

    Attributes:
        plan: with which the first run began; None while there was none.
        simulated: no person took part in the first run.
        software: versions that wrote it, in their order.
        begun: number in the session -> trial, of all that began.
        finished: rows as they were written.
        marked: number in the session -> why it is asked again.
        torn: what stands behind the last whole line, in words (:func:`torn_end`); empty where nothing does.
    """

    plan: Plan | None = None
    simulated: bool = False
    software: tuple[str, ...] = ()
    begun: dict[int, str] | None = None
    finished: tuple[TrialRow, ...] = ()
    marked: dict[int, str] | None = None
    torn: str = ""

    @property
    def asks(self) -> dict[int, str]:
        """Number in the session -> trial, of all that began."""
        return self.begun or {}

    @property
    def rows(self) -> list[TrialRow]:
        """All that are over; those that were asked again say so in ``excluded_why``."""
        marked = self.marked or {}
        return [replace(row, excluded_why=marked.get(row.ask, row.excluded_why)) for row in self.finished]

    @property
    def standing(self) -> list[TrialRow]:
        """Those that were not asked again."""
        return [row for row in self.finished if row.ask not in (self.marked or {})]

    @property
    def unfinished(self) -> list[int]:
        """Numbers of those that began, are not over, and are not marked."""
        over = {row.ask for row in self.finished} | set(self.marked or {})
        return [ask for ask in self.asks if ask not in over]


def whole_lines(content: bytes) -> int:
    """How many of the bytes are whole lines: what a crash or a loss of power left behind them is torn."""
    end = content.rfind(b"\n") + 1
    last = content[content.rfind(b"\n", 0, max(0, end - 1)) + 1 : end]
    return end if not last or _is_object(last) else end - len(last)


def torn_end(content: bytes) -> str:
    """What stands behind a log's whole lines, in words; empty where nothing does."""
    rest = content[whole_lines(content) :]
    if not rest:
        return ""
    zeros = "" if rest.strip(b"\0") else " of zeros"  # as a loss of power leaves them
    return f"its end is torn ({len(rest)} byte{'' if len(rest) == 1 else 's'}{zeros})"


def read_log(content: bytes, where: str) -> LogContent:
    """The content of a log's whole lines.

    Raises:
        HighFiveError: a line is damaged, or missing; the message begins with ``where``.
    """
    read = LogContent()
    open_ask: int | None = None  # of a trial that began, and is not over
    for number, line in enumerate(content.splitlines(), 1):
        at = f"{where}, line {number}"
        one = read_line(line, at)
        if twice := {row.ask for row in one.finished} & {row.ask for row in read.finished}:
            raise HighFiveError(f"{at}: trial {read.asks[twice.pop()]} is there twice; take the log from a backup")
        if missing := _missing_before(one, read, open_ask):
            raise HighFiveError(f"{at}: {missing}: a line before it is missing; take the log from a backup")
        for row in one.finished:
            if read.plan is not None and (other := _other_than_planned(row, read.plan)):
                raise HighFiveError(f"{at}: {other}; take the log from a backup")
        open_ask = next(iter(one.asks), None if one.finished or one.plan is not None else open_ask)
        read = joined(read, one)
    return read


def read_line(line: bytes, where: str) -> LogContent:
    """The content of one line, by itself.

    Raises:
        HighFiveError: it is damaged; the message begins with ``where``.
    """
    if not _is_object(line):
        raise HighFiveError(f"{where}: damaged, expected a JSON object; take the log from a backup")
    entry: dict[str, Any] = _loaded(line)
    match entry.pop("kind", None):
        case "run":
            plan = plan_of(_table(entry, where, "plan"))
            simulated = typed(entry, f"{where}: ", "simulated", bool)
            return LogContent(plan, simulated, (typed(entry, f"{where}: ", "software", str),))
        case "begin":
            return LogContent(begun={typed(entry, f"{where}: ", "ask", int): typed(entry, f"{where}: ", "trial", str)})
        case "trial":
            return LogContent(finished=(row_of(entry, where),))
        case "mark":
            why = typed(entry, f"{where}: ", "why", str)
            asks = typed(entry, f"{where}: ", "asks", list)
            return LogContent(marked={typed({"ask": ask}, f"{where}: ", "ask", int): why for ask in asks})
        case other:
            raise HighFiveError(f"{where}: kind is {other!r}, expected run, begin, trial or mark")


def joined(first: LogContent, then: LogContent) -> LogContent:
    """Of a log, and of what comes after it."""
    return LogContent(
        first.plan or then.plan,
        then.simulated if first.plan is None else first.simulated,
        tuple(dict.fromkeys((*first.software, *then.software))),
        {**first.asks, **then.asks},
        first.finished + then.finished,
        {**(first.marked or {}), **(then.marked or {})},
    )


def _missing_before(one: LogContent, read: LogContent, open_ask: int | None) -> str:
    """What shows that a line before this one is missing; empty where none does."""
    if read.plan is None:
        return "" if one.plan is not None else "no run has begun"
    for ask, trial in one.asks.items():
        left = [open_ask, *read.unfinished]  # of this run, and of those before
        reasons = (
            (
                any(left),
                f"trial {trial} begins, and {read.asks.get(left[0] or left[-1] or 0)} is neither over nor marked",
            ),
            (ask != len(read.asks) + 1, f"trial {trial} is number {ask} after {len(read.asks)}"),
            (any(row.trial == trial for row in read.standing), f"trial {trial} begins again, and is not marked"),
        )
        return next((why for holds, why in reasons if holds), "")
    for row in one.finished:
        if row.ask != open_ask or read.asks[row.ask] != row.trial:
            return f"trial {row.trial} is over, and has not begun"
    return next(
        (f"trial number {ask} is marked, and has not begun" for ask in one.marked or {} if ask not in read.asks), ""
    )


def _other_than_planned(row: TrialRow, plan: Plan) -> str:
    """What of a row is not as the plan of its log has it; empty where all is."""
    key = plan.keys.get(row.answer, "")
    answer_ns, asked_ns = row.answer_ns or 0, row.asked_ns or 0
    impossible = (
        (row.answer not in ("", *plan.keys), f"answer is {row.answer!r}, expected {', '.join(plan.keys)}"),
        (row.key not in ("", key), f"key is {row.key!r}, the plan has {key!r} for {row.answer or 'no answer'}"),
        (not 0.0 <= (row.certainty or 0.0) <= 1.0, f"certainty is {row.certainty}, expected 0 to 1"),
        ((row.rt_s or 0.0) < 0.0, f"rt_s is {row.rt_s}, expected 0 or more"),
        (row.answer_ns is not None and answer_ns < asked_ns, f"answer_ns is {answer_ns}, before it was asked"),
    )
    if found := next((why for holds, why in impossible if holds), ""):
        return found
    planned = next((trial for trial in plan.trials if trial.name == row.trial), None)
    if planned is None:
        return f"trial {row.trial} is in no plan"
    wanted = {
        "participant": plan.participant, "block": planned.block, "condition": planned.mode, "style": planned.style,
        "expected": planned.answer, "cell": planned.cell, "clip": planned.clip, "source_trial": planned.source,
    }  # fmt: skip
    return next(
        (
            f"{name} is {getattr(row, name)!r}, the plan has {own!r}"
            for name, own in wanted.items()
            if getattr(row, name) != own
        ),
        "",
    )


def trials_left(plan: Plan, content: LogContent, missing: Collection[str] = ()) -> list[PlannedTrial]:
    """The trials of the plan that are still to be asked, in order.

    Not asked are replays of what was broken off, or never played: such a trial is in neither condition.

    Args:
        plan: hers.
        content: of her log.
        missing: other people's trials that there are not (``P03:I1-07``).
    """
    done = {row.trial for row in content.standing}
    broken = {row.trial for row in content.standing if row.broken_off} | set(missing)
    return [trial for trial in plan.trials if trial.name not in done and trial.source not in broken]


def block_asks(plan: Plan, content: LogContent, block: str) -> list[int]:
    """Numbers in the session of a block's trials that began, and are not marked."""
    names = {trial.name for trial in plan.block(block)}
    return [ask for ask, trial in content.asks.items() if trial in names and ask not in (content.marked or {})]


def interrupted_block(plan: Plan, content: LogContent, missing: Collection[str] = ()) -> str:
    """The block that a run stopped inside of; empty where it stopped between two."""
    left = trials_left(plan, content, missing)
    return left[0].block if left and block_asks(plan, content, left[0].block) else ""


def _table(entry: dict[str, Any], where: str, name: str) -> Any:
    needed = {"software", "plan", "digest", "consent", "calibration", "simulated", "utc_ns"}
    check_keys(entry, where, needed, {"language"})
    return entry[name]


def _loaded(line: bytes) -> Any:
    """JSON whose numbers are finite."""
    return json.loads(line, parse_constant=_finite, parse_float=_finite)


def _finite(text: str) -> float:
    if not math.isfinite(value := float(text)):
        raise ValueError(f"{text} is no finite number")
    return value


def _is_object(line: bytes) -> bool:
    try:
        return is_table(_loaded(line))
    except (ValueError, RecursionError):
        return False
