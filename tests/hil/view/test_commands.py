"""Texts that no file takes are no command's."""

import json

import pytest

from highfive.hil.view.commands import Command, parse_command

HALF = "a\ud800"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("note", HALF),
        ("cell", HALF),
        ("style", {HALF: 1.0}),
        ("answer", {"key": HALF}),
        ("rate", {"name": HALF, "value": 0.5}),
    ],
)
def test_half_a_character_is_none(name: str, value: object) -> None:
    assert parse_command(json.dumps({"kind": "command", "name": name, "value": value})) is None


def test_whole_characters_outside_the_first_plane_are_taken() -> None:
    said = json.dumps({"kind": "command", "name": "note", "value": "🖐 well met"})
    assert parse_command(said) == Command("note", "🖐 well met")
