"""``--arm`` alone lets an arm move, ``--arm NAME`` says which it is, and other words stay as they are."""

from typing import Annotated

import pytest
import typer
from typer.main import get_command

from highfive.hil.cli.options import ArmCommand, Armed, WhichArm


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--arm"], ("", True, None)),
        (["--arm", "wx250s"], ("", False, "wx250s")),
        (["--arm=wx250s"], ("", False, "wx250s")),
        (["--note=new--arm=old"], ("new--arm=old", False, None)),
        (["--note=--arm=old", "--arm"], ("--arm=old", True, None)),
    ],
)
def test_only_a_word_that_begins_with_it_names_an_arm(words: list[str], expected: tuple) -> None:
    app, seen = typer.Typer(), []

    @app.command(cls=ArmCommand)
    def go(note: Annotated[str, typer.Option()] = "", arm: Armed = False, which_arm: WhichArm = None) -> None:
        seen.append((note, arm, which_arm))

    get_command(app).main(words, standalone_mode=False)
    assert seen == [expected]
