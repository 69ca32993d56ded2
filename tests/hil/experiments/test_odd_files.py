"""Files in which one value is something else: a line that says so, or another experiment; never a traceback."""

import copy
import json
import tomllib
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from experiments import answer, head, protocol, study
from mutations import mutated

from highfive.hil.experiments.balance import check_balance
from highfive.hil.experiments.log_content import read_line, read_log, whole_lines
from highfive.hil.experiments.plan import draw_plan
from highfive.hil.experiments.plan_file import plan_of
from highfive.hil.experiments.protocol_file import TEMPLATES, _protocol, templates
from highfive.hil.experiments.trial_log import open_log
from highfive.model.errors import HighFiveError

ODD: list[Any] = [
    None, True, -1, 0, 7, 10**400, 0.5, float("nan"), float("inf"), "", "x", "é\n", [], [1], [[]], {}, {"a": 1}
]  # fmt: skip


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Where something is, however deep."""
    if path:
        yield path
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list | tuple) else ()
    for key, one in items:
        yield from places(one, (*path, key))


def changed(value: Any, path: tuple[Any, ...], to: Any) -> Any:
    new = copy.deepcopy(value)
    inner = new
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = to
    return new


@pytest.mark.parametrize("name", templates())
@pytest.mark.slow
def test_an_experiment_with_an_odd_value(name: str) -> None:
    data = tomllib.loads((TEMPLATES / f"{name}.toml").read_text(encoding="utf-8"))
    refused = 0
    for path in places(data):
        for odd in ODD:
            try:
                asked = _protocol(changed(data, path, odd), TEMPLATES)
                check_balance(asked)
            except HighFiveError as error:
                refused += 1
                assert str(error) and len(str(error)) < 600
            else:
                draw_plan(asked, 1)
    assert refused > 400


def test_a_plan_with_an_odd_value() -> None:
    data = json.loads(json.dumps(asdict(draw_plan(protocol("tipping", practice=0, participants=1), 1))))
    data["trials"] = data["trials"][:2]
    for path in places(data):
        for odd in ODD:
            try:
                plan_of(changed(data, path, odd))
            except HighFiveError as error:
                assert str(error)


def test_a_log_with_an_odd_value_or_damaged_bytes(tmp_path: Path) -> None:
    folder = study(tmp_path)
    with open_log(folder, head(), resume=False) as log:
        answer(log, 2)
    with open_log(folder, head(), resume=True) as log:
        answer(log, 1)
    content = (folder / "participants" / "P01" / "session-1" / "trials.jsonl").read_bytes()
    lines = [json.loads(line) for line in content.splitlines()]
    lines[0]["plan"]["trials"] = lines[0]["plan"]["trials"][:1]
    assert {line["kind"] for line in lines} == {"run", "begin", "trial", "mark"}
    for number, line in enumerate([*lines[:3], next(line for line in lines if line["kind"] == "mark")]):
        for path in places(line):
            for odd in ODD:
                try:
                    read_line((json.dumps(changed(line, path, odd)) + "\n").encode(), f"line {number}")
                except HighFiveError as error:
                    assert str(error)
    rng = np.random.default_rng(0)
    for _ in range(200):
        damaged = bytes(mutated(content, rng))
        try:
            read_log(damaged[: whole_lines(damaged)], "log")
        except HighFiveError as error:
            assert str(error)
