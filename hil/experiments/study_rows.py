"""All trials of a study, from the logs of its people, and which of them count."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from highfive.hil.experiments.analysis.answers import Answer
from highfive.hil.experiments.balance import PRACTICE
from highfive.hil.experiments.exclusion import RATING, ExclusionRules
from highfive.hil.experiments.log_content import LogContent
from highfive.hil.experiments.protocol import ADAPTIVE, Mode, Protocol
from highfive.hil.experiments.study import LOG, participant_folder, participants, study_protocol
from highfive.hil.experiments.trial_log import read_session, session_number
from highfive.hil.experiments.trial_row import COLUMNS, Key, TrialRow
from highfive.model.errors import HighFiveError

CONDITIONS = {Mode.INTERACTIVE.value: "interactive", Mode.OWN_REPLAY.value: "replay"}
"""Conditions of the comparison; another's replays and acting without contingency are other questions."""

PRACTICE_WHY, FILLER_WHY, PILOT_WHY = "practice", "a filler block", "the pilot's"
SIMULATED_WHY = "a simulated participant in a study of people"


@dataclass(frozen=True)
class Excluded:
    """A trial that does not count."""

    participant: str
    session: int
    trial: str
    ask: int
    why: str


@dataclass(frozen=True)
class IncompleteLog:
    """A session of whose trials some or all cannot be there; ``advice`` says what to do."""

    participant: str
    session: int
    why: str
    advice: str

    @property
    def line(self) -> str:
        """All of it, for people."""
        return f"log of {self.participant}, session {self.session}: {self.why}; {self.advice}"


@dataclass(frozen=True)
class StudyRows:
    """A study's trials.

    Attributes:
        protocol: the experiment.
        rows: all of them.
        counted: those that are compared.
        excluded: all others, with the reason.
        incomplete: logs without a trial, or with a torn end.
        simulated: those compared are of simulated participants.
        software: versions that wrote them.
    """

    protocol: Protocol
    rows: tuple[TrialRow, ...]
    counted: tuple[TrialRow, ...]
    excluded: tuple[Excluded, ...]
    simulated: bool
    software: tuple[str, ...]
    incomplete: tuple[IncompleteLog, ...] = ()


def study_rows(study: Path, rules: ExclusionRules | None = None) -> StudyRows:
    """All trials of a study. Where people took part, simulated participants do not count; nor does what ``rules`` of
    the lab's leave out.

    Raises:
        HighFiveError: it is no study, nobody took part, a log is damaged, or a rule is for somebody who was not
            planned.
    """
    protocol = study_protocol(study)
    logs = [
        (code, session, read_session(study, code, session))
        for code in participants(study)
        for session in sorted(map(session_number, participant_folder(study, code).glob(f"session-*/{LOG}")))
    ]
    rows = [row for _, _, content in logs for row in content.rows]
    incomplete = [IncompleteLog(code, session, *lacks) for code, session, log in logs if (lacks := _lacks(log))]
    for row in rows:
        _check_ratings(row, protocol)
    if not rows:
        said = "".join(f"; {one.line}" for one in incomplete)
        raise HighFiveError(f"{study} holds no answers{said}; run the experiment first (highfive experiment run)")
    people = any(not row.simulated for row in rows)
    fillers = {block.name for block in protocol.blocks if block.filler}
    pilot = protocol.code(0) if protocol.needs_donor else ""
    why = {row.row_key: _why(row, people, fillers, pilot) for row in rows}
    if rules is not None:
        _check_rules(rules, protocol, codes(study, protocol))
        _by_rules(rows, why, rules)
    one_condition = _of_one_condition([row for row in rows if not why[row.row_key]])
    for row in rows:
        if not why[row.row_key] and row.participant in one_condition:
            why[row.row_key] = f"{row.participant} has only one condition so far"
    counted = [row for row in rows if not why[row.row_key]]
    excluded = [
        Excluded(row.participant, row.session, row.trial, row.ask, why[row.row_key]) for row in rows if why[row.row_key]
    ]
    versions = tuple(dict.fromkeys(row.software for row in rows))
    return StudyRows(
        protocol, tuple(rows), tuple(counted), tuple(excluded), not people, versions, tuple(incomplete)
    )  # fmt: skip


def _lacks(log: LogContent) -> tuple[str, str] | None:
    """What cannot be there of a session's trials, and what to do; None where all that was written is there."""
    resume, anew = (f"{way}, or take its log from a backup" for way in ("resume the session", "run the session anew"))
    if log.plan is None:
        return (f"no line of it is whole, {log.torn}" if log.torn else "it is empty"), anew
    if not log.rows:
        return f"no trial is over in it{log.torn and f', {log.torn}'}", resume
    return (f"{log.torn} and left out", resume) if log.torn else None


def codes(study: Path, protocol: Protocol) -> list[str]:
    """Of all who were planned, also of who was forgotten since, and of who is there."""
    planned = {protocol.code(number) for number in range(1 - protocol.needs_donor, protocol.participants + 1)}
    return sorted(planned | set(participants(study)))


def _check_ratings(row: TrialRow, protocol: Protocol) -> None:
    ends = {one.name: (1.0, float(one.points)) if one.points else (0.0, 1.0) for one in protocol.ratings}
    for name, value in row.ratings.items():
        low, high = ends.get(name, (1.0, 0.0))
        if not low <= value <= high:
            said = f"expected {low:g} to {high:g}" if name in ends else f"rated are {', '.join(ends) or 'none'}"
            raise HighFiveError(
                f"the log of {row.participant}, session {row.session}, trial {row.trial}: {name} is {value:g}, {said}; "
                "take it from a backup"
            )


def _why(row: TrialRow, people: bool, fillers: set[str], pilot: str) -> str:
    """Why a trial does not count, by the first rule that says so; empty where it does."""
    rules = (
        (people and row.simulated, SIMULATED_WHY),
        (row.participant == pilot, PILOT_WHY),
        (row.broken_off != "", f"broken off: {row.broken_off}"),
        (row.excluded_why != "", row.excluded_why),
        (row.block == PRACTICE, PRACTICE_WHY),
        (row.block in fillers, FILLER_WHY),
        (not row.answer, "no answer"),
    )
    return next((why for holds, why in rules if holds), "")


_NEVER_COMPARED = (PRACTICE_WHY, FILLER_WHY, PILOT_WHY, SIMULATED_WHY)


def _check_rules(rules: ExclusionRules, protocol: Protocol, planned: Sequence[str]) -> None:
    """What a rule names and nobody planned is a slip that would let trials count."""
    known = {
        "style": [style.name for style in protocol.styles] + [ADAPTIVE] * (protocol.morph is not None),
        "expected": protocol.labels, "answer": ("", *protocol.labels), "cell": ("", *protocol.cells),
        "block": [PRACTICE, *(block.name for block in protocol.blocks)], "condition": [mode.value for mode in Mode],
    }  # fmt: skip
    named = [("codes", code, planned) for rule in rules.people for code in rule.codes]
    for rule in rules.trials:
        if rule.column.startswith(RATING):
            named.append(("column", rule.column, [f"{RATING}{one.name}" for one in protocol.ratings]))
        elif rule.equals is not None and rule.column in known:
            named.append((f"{rule.column} is", str(rule.equals), known[rule.column]))
    for what, name, there in named:
        if name not in there:
            has = ", ".join(filter(None, there)) or "none"
            raise HighFiveError(f"rules {rules.source}: {what} {name!r}, which nobody planned; the study has {has}")


def _by_rules(rows: Sequence[TrialRow], why: dict[Key, str], rules: ExclusionRules) -> None:
    """Puts in the reasons of the lab's rules: of trials first, then of people, by what of theirs still counts then."""
    for row in rows:
        if not why[row.row_key]:
            why[row.row_key] = next((rule.why for rule in rules.trials if rule.holds(row)), "")
    for code in dict.fromkeys(row.participant for row in rows):
        asked = [row for row in rows if row.participant == code and why[row.row_key] not in _NEVER_COMPARED]
        counted = [row for row in asked if not why[row.row_key]]
        reason = next((rule.why for rule in rules.people if rule.holds(code, counted, len(asked))), "")
        for row in counted if reason else ():
            why[row.row_key] = reason


def _of_one_condition(rows: Sequence[TrialRow]) -> set[str]:
    """People with one condition alone, where somebody has both: a study that still runs can be looked at."""
    there: dict[str, set[str]] = {}
    for row in rows:
        if row.condition in CONDITIONS:
            there.setdefault(row.participant, set()).add(CONDITIONS[row.condition])
    both = [code for code, conditions in there.items() if len(conditions) > 1]
    return {code for code in there if code not in both} if both else set()


def answers_of(found: StudyRows) -> list[Answer]:
    """The answers to what was shown: to whole styles, or to morphs. Own replays are called as in the comparison."""
    morph = found.protocol.morph
    named = [(row, CONDITIONS.get(row.condition, row.condition)) for row in found.counted]
    if morph is None:
        return [Answer(row.participant, condition, row.expected, row.answer) for row, condition in named]
    return [
        Answer(row.participant, condition, morph.end, row.answer, row.weights.get(morph.end, 0.0))
        for row, condition in named
    ]


def reasons(excluded: Sequence[Excluded]) -> dict[Key, str]:
    """Why each does not count."""
    return {(one.participant, one.session, one.ask): one.why for one in excluded}


def tidy_rows(
    rows: Sequence[TrialRow],
    excluded: Sequence[Excluded],
    names: Sequence[str] = (),
    figures: Mapping[Key, Mapping[str, float | None]] | None = None,
) -> bytes:
    """A CSV row a trial in all columns of the log, and why it does not count; tables as JSON, nothing as empty.

    Args:
        rows: of the log.
        excluded: of those.
        names: of more columns.
        figures: (participant, session, ask) -> what stands in those.
    """
    why = reasons(excluded)
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow([*COLUMNS, *names, "not_counted_why"])
    for row in rows:
        values = asdict(row)
        more = (figures or {}).get(row.row_key, {})
        table.writerow(
            [
                *(_cell(values[name]) for name in COLUMNS),
                *(_cell(more.get(name)) for name in names),
                why.get(row.row_key, ""),
            ]
        )
    return text.getvalue().encode()


def _cell(value: Any) -> Any:
    if isinstance(value, dict):
        return json.dumps(value, sort_keys=True)
    if isinstance(value, bool):
        return int(value)
    return "" if value is None else value
