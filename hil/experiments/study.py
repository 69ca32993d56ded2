"""A study's folder: its protocol, and a folder a participant with her plan, her rows and her recordings.

    DIR/protocol.toml, DIR/instructions/en.md, …    the experiment, as it was planned; words of its page (de.toml)
    DIR/planned.json                                the same, as plans were drawn from it: what is changed is refused
    DIR/participants/P01/plan.toml, plan.csv        what she is asked
    DIR/participants/P01/session-1/trials.jsonl     what she answered; recordings beside it

Codes only: no name stands in a path.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from highfive.hil.experiments.plan import Plan
from highfive.hil.experiments.plan_file import difference, plan_csv, plan_toml, read_plan
from highfive.hil.experiments.protocol import Protocol
from highfive.hil.experiments.protocol_file import CODE, TEMPLATES, read_protocol, templates
from highfive.hil.experiments.words import words_toml
from highfive.model.errors import HighFiveError
from highfive.model.files import read_bounded, write_whole

PROTOCOL, PLANNED, INSTRUCTIONS = "protocol.toml", "planned.json", "instructions"
_MOST_PLANNED = 16 << 20
"""Bytes of ``planned.json`` that are read: the instructions in all languages are in it."""
_DEEPEST = 20
"""Tables and lists within each other: more than an experiment has."""
_SHORT = 80
"""Characters of what a difference shows."""
PARTICIPANTS, PLAN, LOG = "participants", "plan.toml", "trials.jsonl"


def check_code(code: str) -> str:
    """A participant's code.

    Raises:
        HighFiveError: it is no code.
    """
    if not CODE.fullmatch(code):
        raise HighFiveError(
            f"participant {code!r}: expected a code of 2 to 12 letters and digits, one digit at least, such as P07, "
            "and no name"
        )
    return code


def participant_folder(study: Path, code: str) -> Path:
    """Hers; need not be there."""
    return study / PARTICIPANTS / check_code(code)


def session_folder(study: Path, code: str, session: int) -> Path:
    """Of one run of hers; need not be there."""
    return participant_folder(study, code) / f"session-{session}"


def participants(study: Path) -> list[str]:
    """Codes of those who have a plan."""
    return sorted(path.parent.name for path in (study / PARTICIPANTS).glob(f"*/{PLAN}"))


def has_run(study: Path, code: str) -> bool:
    """Whether she took part already."""
    return any(participant_folder(study, code).glob(f"session-*/{LOG}"))


def study_protocol(study: Path) -> Protocol:
    """The experiment of a study.

    Raises:
        HighFiveError: there is none.
    """
    if not (study / PROTOCOL).is_file():
        raise HighFiveError(f"{study} is no study: it has no {PROTOCOL}; make one with highfive experiment plan")
    return read_protocol(study / PROTOCOL)


def check_planned(study: Path, protocol: Protocol) -> None:
    """Refuses an experiment that was changed since plans were drawn from it.

    Raises:
        HighFiveError: it was; each difference is said.
    """
    path = study / PLANNED
    if not path.exists():  # of before 0.2.0
        return
    try:
        before = json.loads(read_bounded(path, _MOST_PLANNED))
    except (OSError, ValueError, RecursionError) as error:
        raise HighFiveError(f"cannot read {path}: {error}; take it as highfive experiment plan wrote it") from None
    now, said = dict(_flat(_planned(protocol))), []
    if not isinstance(before, dict) or now.keys().isdisjoint(was := dict(_flat(before))):
        raise HighFiveError(f"{path} is nothing that highfive experiment plan wrote; take it as it was")
    for name, value in was.items():
        if name in now and now[name] != value:
            short = len(f"{value}{now[name]}") < _SHORT
            said.append(f"{name} was {value!r} and is {now[name]!r}" if short else f"{name} is another text")
    if said:
        raise HighFiveError(
            f"{study / PROTOCOL} was changed since the plans were drawn: {'; '.join(said)}; take it as it was, or plan "
            "a study of its own"
        )


def _planned(protocol: Protocol) -> dict[str, Any]:
    """What all plans of a study have in common, as JSON has it."""
    return json.loads(json.dumps(asdict(replace(protocol, participants=0, codes=())), default=str))


def _flat(content: Any, name: str = "", depth: int = 0) -> Iterator[tuple[str, Any]]:
    """``timing.answer_s`` and so on, and how long lists are; what is nested deeper than an experiment is left out."""
    if isinstance(content, dict):
        parts = list(content.items())
    elif isinstance(content, list):
        parts = [("number", len(content)), *((str(place + 1), one) for place, one in enumerate(content))]
    else:
        yield name, content
        return
    for key, value in parts if depth < _DEEPEST else ():
        yield from _flat(value, f"{name}.{key}" if name else str(key), depth + 1)


def stored_plan(study: Path, code: str) -> Plan:
    """A participant's plan.

    Raises:
        HighFiveError: she has none, or it was changed.
    """
    path = participant_folder(study, code) / PLAN
    if not path.is_file():
        known = participants(study)
        raise HighFiveError(
            f"{code} has no plan in {study}; planned are {', '.join(known) or 'none'}; "
            "highfive experiment plan --participants N plans more"
        )
    plan = read_plan(path)
    if plan.participant != code:
        raise HighFiveError(
            f"plan {path} is that of {plan.participant}, expected {code}'s; each has a plan of their own"
        )
    return plan


def check_plans(study: Path, plans: list[Plan], redraw: bool = False) -> list[Plan]:
    """Those of the plans that are not stored yet; what is stored has to be the same.

    Args:
        study: the folder.
        plans: of everybody.
        redraw: whether plans may be replaced of people who did not take part yet.

    Raises:
        HighFiveError: somebody has another plan.
    """
    new: list[Plan] = []
    for plan in plans:
        path = participant_folder(study, plan.participant) / PLAN
        if not path.is_file():
            new.append(plan)
            continue
        ran = has_run(study, plan.participant)
        if redraw and not ran:
            new.append(plan)
        elif changed := difference(read_plan(path), plan):
            advice = (
                "she took part already; plan another study, with another --study"
                if ran
                else "give another --study, or --overwrite, which draws the plans of those anew who did not take part"
            )
            raise HighFiveError(f"participant {plan.participant} has another plan in {study}: {changed}; {advice}")
    return new


def write_study(study: Path, source: Path, protocol: Protocol, plans: list[Plan]) -> None:
    """Writes protocol, instructions and plans; each file whole.

    Args:
        study: the folder.
        source: the experiment's file.
        protocol: what it says, with the number of people and the seed that were asked for.
        plans: those to be written.

    Raises:
        HighFiveError: they cannot be written.
    """
    values = {"participants": protocol.participants, "seed": protocol.seed, "instructions": INSTRUCTIONS}
    try:
        for language, text in protocol.instructions.items():
            _write(study / INSTRUCTIONS / f"{language}.md", text.encode())
        for language, words in protocol.words.items():
            _write(study / INSTRUCTIONS / f"{language}.toml", words_toml(words))
        _write(study / PROTOCOL, _with(source.read_text(encoding="utf-8"), values).encode())
        _write(study / PLANNED, json.dumps(_planned(protocol), indent=1, ensure_ascii=False).encode())
        for plan in plans:
            folder = participant_folder(study, plan.participant)
            _write(folder / "plan.csv", plan_csv(plan))
            _write(folder / PLAN, plan_toml(plan))
    except OSError as error:
        raise HighFiveError(f"cannot write the study {study}: {error.strerror or error}; make room") from None
    if read_protocol(study / PROTOCOL) != protocol:
        raise HighFiveError(
            f"{source}: {', '.join(values)} in [experiment] could not be set in {study / PROTOCOL}; write each on a "
            "line of its own, name = value"
        )


def _with(text: str, values: Mapping[str, str | int]) -> str:
    """The experiment's file with other values in [experiment]; comments stay."""
    head, found, rest = (*re.split(r"^(\s*\[\s*experiment\s*\].*\n)", text, maxsplit=1, flags=re.MULTILINE), "", "")[:3]
    inside, *after = re.split(r"^(?=\s*\[)", rest, maxsplit=1, flags=re.MULTILINE)
    for name, value in values.items():
        line = f"{name} = {json.dumps(value)}\n"
        inside, count = re.subn(rf"^\s*{name}\s*=.*\n", lambda _, line=line: line, inside, flags=re.MULTILINE)
        inside = inside if count else line + inside
    return head + found + inside + "".join(after)


def _write(path: Path, content: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, content)


def write_template(name: str, path: Path, overwrite: bool) -> Path:
    """Writes an experiment that comes along, and its instructions into a folder beside it, which it gives back.

    Raises:
        HighFiveError: there is none of that name, its instructions are there already, or it cannot be written.
    """
    source, beside = TEMPLATES / f"{name}.toml", path.with_name(f"{name}_{INSTRUCTIONS}")
    if name not in templates():
        raise HighFiveError(f"--template {name}: there is none; there are {', '.join(templates())}")
    if beside.exists() and not overwrite:
        raise HighFiveError(f"{beside} is there already; give --out in another folder, or --overwrite")
    try:
        for text in sorted((TEMPLATES / beside.name).iterdir()):
            _write(beside / text.name, text.read_bytes())
        _write(path, source.read_bytes())
    except OSError as error:
        raise HighFiveError(f"cannot write {path}: {error.strerror or error}; give another --out") from None
    return beside
