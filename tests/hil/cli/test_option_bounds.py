"""No number of the command line is taken that makes a command run, or grow, without end."""

from collections.abc import Iterator

import pytest
from typer.core import TyperCommand, TyperGroup, TyperOption
from typer.exceptions import TyperException
from typer.main import get_command

from highfive.hil.cli.main import app
from highfive.hil.commands import calibrate_headset, live_options, serve
from highfive.mocap_bridge.sources.camera_settings import CameraSettings
from highfive.model.errors import HighFiveError

ENDLESS = ("nan", "inf", "-inf", "1e300", "-1e300")
HUGE = str(10**20)
CHECKED_LATER = {
    ("calibrate extrinsics", "poses"): "the command says how many are good",
    ("calibrate servos", "pairs"): "the command says how many are good",
    ("experiment power", "people"): "the command says why two are the fewest",
    ("rig emulate", "baud"): "the command says which rates servos have",
    ("export", "trial"): "which of a recording's; the command says how many it has",
    ("rig play", "trial"): "which of a recording's; the command says how many it has",
    ("rig play", "begin"): "which of a recording's; the command says how many it has",
    ("rig play", "trials"): "at most as many as a recording has",
}
"""Whole numbers that have no bound as they are parsed, and why."""


def commands(group: TyperGroup, names: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], TyperCommand]]:
    for name, command in group.commands.items():
        if isinstance(command, TyperGroup):
            yield from commands(command, (*names, name))
        else:
            assert isinstance(command, TyperCommand)
            yield (*names, name), command


def numbers(kind: type) -> dict[tuple[str, str], tuple[TyperCommand, TyperOption]]:
    """Every option that takes such a number, by command and name."""
    root = get_command(app)
    assert isinstance(root, TyperGroup)
    return {
        (" ".join(names), str(option.name)): (command, option)
        for names, command in commands(root)
        for option in command.params
        if isinstance(option, TyperOption) and option.type_descriptor.annotation in (kind, list[kind])
    }


def refused(command: TyperCommand, option: TyperOption, value: str) -> None:
    """The words are refused before the command begins, for this option's value, in a line."""
    with pytest.raises(TyperException) as raised:  # which ends the program with 2, in a line: test_cli.py
        command.parse_args(command.context_class(command), [f"{option.opts[0]}={value}"])
    message = raised.value.format_message()
    assert option.opts[0] in message and "it should be" in message.replace("Input should be", "it should be"), message
    assert "\n" not in message and raised.value.exit_code == 2


FLOATS, WHOLE = numbers(float), numbers(int)


def test_there_are_options_of_either_kind() -> None:
    assert ("simulate", "lost") in FLOATS and ("bench rates", "rate") in FLOATS and len(FLOATS) > 30
    assert ("simulate", "trials") in WHOLE and ("rig play", "trial") in WHOLE and len(WHOLE) > 60


@pytest.mark.parametrize("named", FLOATS, ids=" ".join)
def test_no_float_is_endless(named: tuple[str, str]) -> None:
    for value in ENDLESS:
        refused(*FLOATS[named], value)


@pytest.mark.parametrize("named", sorted(WHOLE.keys() - CHECKED_LATER.keys()), ids=" ".join)
def test_no_whole_number_is_endless(named: tuple[str, str]) -> None:
    refused(*WHOLE[named], HUGE)


def test_what_is_checked_later_is_there_and_has_no_bound() -> None:
    assert CHECKED_LATER.keys() <= WHOLE.keys()
    assert all(WHOLE[named][1].max is None for named in CHECKED_LATER)


def test_bounds_are_those_of_the_commands() -> None:
    for command in ("simulate", "experiment run"):
        assert FLOATS[command, "latency"][1].max == live_options.LONGEST_LATENCY_MS
        for name, field in (("height", "height"), ("fov", "field_of_view")):
            option = FLOATS[command, name][1]
            for bound, beyond in ((option.min, -0.01), (option.max, 0.01)):
                assert bound is not None
                CameraSettings(**{field: bound})
                with pytest.raises(HighFiveError):
                    CameraSettings(**{field: bound + beyond})
    rate, seconds = FLOATS["serve", "rate"][1], FLOATS["calibrate headset", "seconds"][1]
    assert (rate.min, rate.max) == serve.RATES
    assert (seconds.min, seconds.max) == (calibrate_headset.SHORTEST_S, calibrate_headset.LONGEST_S)
