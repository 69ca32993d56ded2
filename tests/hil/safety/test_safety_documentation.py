"""docs/safety.md says what the code does: every rule, every state, every limit, every test."""

import re
from dataclasses import fields
from pathlib import Path

import pytest
from paths import ROOT

from highfive.hil.safety import limits as module
from highfive.hil.safety import limits_file
from highfive.hil.safety.rules import Rule
from highfive.hil.safety.states import TABLE, Event, State

TEXT = (ROOT / "docs" / "safety.md").read_text(encoding="utf-8")
LIMITS = limits_file.load_limits()


def rows(heading: str) -> list[list[str]]:
    """Cells of the first table under a heading, without its own head."""
    section = TEXT.partition(f"## {heading}\n")[2].partition("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def safety_tests() -> dict[str, str]:
    """Name and source of every test of the envelope."""
    found = {}
    for path in Path(__file__).parent.glob("test_*.py"):
        parts = re.split(r"^def (test_\w+)", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
        found |= dict(zip(parts[1::2], parts[2::2], strict=True))
    return found


def test_every_rule_has_its_line_in_the_order_of_the_code() -> None:
    assert [row[0].strip("`") for row in rows("Rules")] == [rule.value for rule in Rule]


@pytest.mark.parametrize("row", rows("Rules"), ids=lambda row: row[0].strip("`"))
def test_a_rule_says_what_it_does_and_does_not_protect_against_and_its_test_exists(row: list[str]) -> None:
    assert len(row) == 6
    assert all(row)
    known = safety_tests()
    name = row[5].strip("`")
    assert name in known


def test_every_rule_acts_somewhere_in_the_code() -> None:
    """Rules that act in a tick are named by the code; the others are lines of the start-up check."""
    source = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "hil" / "safety").glob("*.py"))
    tests = "".join(path.read_text(encoding="utf-8") for path in Path(__file__).parent.glob("test_*.py"))
    for rule in Rule:
        if rule not in (Rule.ARM, Rule.ROOM, Rule.WATCHDOG):
            assert f"Rule.{rule.name}" in source, rule
            assert f"Rule.{rule.name}" in tests, rule


def test_the_picture_is_the_table() -> None:
    """Its words, each arrow's events among them, are those of the table."""
    words = re.findall(r"<text[^>]*>([^<]*)</text>", (ROOT / "docs" / "arm_states.svg").read_text(encoding="utf-8"))
    ways: dict[tuple[State, State], list[str]] = {}
    for (state, event), then in TABLE.items():
        if event is not Event.ESTOP:
            ways.setdefault((state, then), []).append(event.value)
    said = [state.value for state in State] + [", ".join(events) for events in ways.values()]
    assert sorted(words) == sorted([*said, "from each state but itself: estop → estopped"])
    assert {state for (state, event) in TABLE if event is Event.ESTOP} == set(State) - {State.ESTOPPED}


def test_every_limit_is_listed_with_its_value() -> None:
    listed = {name: row[1] for row in rows("Limits") for name in re.findall(r"`([^`]+)`", row[0])}
    expected = {f"joint.*.{field.name}": "by joint" for field in fields(module.Joint)}
    for section, kind in limits_file.SECTIONS.items():
        for field in fields(kind):
            value, unit = getattr(getattr(LIMITS, section), field.name), field.metadata["span"].unit
            expected[f"{section}.{field.name}"] = f"{value:.10g} {unit}"
    assert listed == expected


def test_the_table_of_contacts_is_that_of_the_limits() -> None:
    for row, zone in zip(rows("Contact"), (LIMITS.contact, LIMITS.face), strict=True):
        assert row[1].startswith(f"{zone.force:g} N,")
        assert row[2:] == [f"{zone.body_mass:g} kg", f"{zone.stiffness / 1e3:g} N/mm", f"{zone.speed:g} m/s"]
