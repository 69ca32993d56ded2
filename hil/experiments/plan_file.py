"""A participant's plan on disk: TOML that people read, with its digest, and a CSV table of its trials."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from highfive.hil.experiments.plan import Plan, PlannedTrial
from highfive.model.errors import HighFiveError
from highfive.model.toml_file import check_keys, read_toml, typed

_HEAD = [field.name for field in fields(Plan) if field.name != "trials"]
_TRIAL = [field.name for field in fields(PlannedTrial)]
_SHOWN = 3
"""Differences that are named; of more their number is said."""


def plan_toml(plan: Plan) -> bytes:
    """The plan as TOML."""
    content = asdict(plan)
    lines = [
        "# Drawn once, before the first trial. Do not change it: what differs from its digest is refused.",
        f"digest = {_toml(plan.digest)}",
        *(f"{name} = {_toml(content[name])}" for name in _HEAD),
    ]
    for trial in content["trials"]:
        lines += ["", "[[trials]]", *(f"{name} = {_toml(trial[name])}" for name in _TRIAL)]
    return ("\n".join(lines) + "\n").encode()


def plan_csv(plan: Plan) -> bytes:
    """A row a trial; weights as JSON."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["participant", "digest", *_TRIAL])
    digest = plan.digest
    for trial in asdict(plan)["trials"]:
        cells = (json.dumps(value) if isinstance(value, dict) else value for value in trial.values())
        table.writerow([plan.participant, digest, *cells])
    return text.getvalue().encode()


def read_plan(path: Path) -> Plan:
    """A plan, as it was written.

    Raises:
        HighFiveError: it cannot be read, or was changed since.
    """
    data = read_toml(path, "the plan")
    if not isinstance(digest := data.pop("digest", None), str):
        raise HighFiveError(f"plan {path}: digest is missing; take the file as highfive experiment plan wrote it")
    try:
        plan = plan_of(data)
    except HighFiveError as error:
        raise HighFiveError(f"plan {path}: {error}") from None
    if plan.digest != digest:
        raise HighFiveError(
            f"plan {path} was changed: its digest is {plan.digest}, expected {digest}; take the file as it was written"
        )
    return plan


def plan_of(data: Mapping[str, Any]) -> Plan:
    """A plan of a table of its values, as TOML and JSON have them.

    Raises:
        HighFiveError: something is missing, or of another kind.
    """
    check_keys(data, "the plan", {*_HEAD, "trials"})
    head = {name: _value(data, "", name, Plan) for name in _HEAD}
    entries = typed(data, "", "trials", list)
    trials: list[PlannedTrial] = []
    for place, entry in enumerate(entries):
        check_keys(entry, f"trial {place + 1}", set(_TRIAL))
        trials.append(
            PlannedTrial(**{name: _value(entry, f"trial {place + 1}: ", name, PlannedTrial) for name in _TRIAL})
        )
    return Plan(**head, trials=tuple(trials))


def difference(before: Plan, after: Plan) -> str:
    """What is different in ``after``, in a line; empty where nothing is."""
    old, new = asdict(before), asdict(after)
    found = [f"{name} was {old[name]}, is {new[name]}" for name in _HEAD if old[name] != new[name]]
    for place in range(max(len(before.trials), len(after.trials))):
        if place >= len(after.trials) or place >= len(before.trials):
            more = place >= len(before.trials)
            found.append(f"trial {(after if more else before).trials[place].name} {'is new' if more else 'is gone'}")
            continue
        was, now = old["trials"][place], new["trials"][place]
        found += [
            f"trial {was['name']}: {name} was {was[name]}, is {now[name]}" for name in _TRIAL if was[name] != now[name]
        ]
    rest = f"; and {len(found) - _SHOWN} more" if len(found) > _SHOWN else ""
    return "; ".join(found[:_SHOWN]) + rest


def _value(entry: Mapping[str, Any], where: str, name: str, of: type[Any]) -> Any:
    kinds = {"str": str, "int": int, "float": float}
    declared = next(field.type for field in fields(of) if field.name == name)
    if declared in kinds:
        return _finite(typed(entry, where, name, kinds[declared]), f"{where}{name}")
    check_keys(entry[name], f"{where}{name}", set(), set(entry[name]) if isinstance(entry[name], Mapping) else None)
    inner = kinds[str(declared).removeprefix("Mapping[str, ").removesuffix("]")]
    at = f"{where}{name}."
    return {key: _finite(typed(entry[name], at, key, inner), f"{at}{key}") for key in entry[name]}


def _finite(value: Any, where: str) -> Any:
    """Of it a digest is made, which knows no other numbers."""
    if isinstance(value, float) and not math.isfinite(value):
        raise HighFiveError(f"{where} is {value}, expected a finite number")
    return value


def _toml(value: Any) -> str:
    """A text, a number or a flat table; what JSON writes of the first two is TOML."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{json.dumps(key)} = {_toml(one)}" for key, one in value.items()) + "}"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
