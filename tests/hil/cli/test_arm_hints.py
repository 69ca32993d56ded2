"""What a message says to type for an arm is read by the command line as that arm."""

import shlex
import shutil
from pathlib import Path

import pytest
from typer.core import TyperGroup
from typer.main import get_command

from highfive.hil.arm.arm_files import rig_file, rig_of
from highfive.hil.arm_model.arm_folder import ARMS, find_arm
from highfive.hil.cli.main import app
from highfive.hil.commands.arm_options import known_arm_name
from highfive.hil.drivers.bus.rig import Rig

PORT = "/dev/serial/by-id/an arm"


def read(line: str) -> dict[str, object]:
    """The values that a command line gives to its command."""
    program, *words = shlex.split(line)
    assert program == "highfive"
    command = get_command(app)
    while isinstance(command, TyperGroup):
        command = command.commands[words.pop(0)]
    return command.make_context(program, words).params


@pytest.fixture(params=["vx300s", "koch_v1_1", "own folder"])
def arm(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """Its name, or a folder of somebody's own."""
    if request.param in ("vx300s", "koch_v1_1"):
        return request.param
    return str(shutil.copytree(ARMS / "wx250s", tmp_path / "my arm"))


@pytest.mark.parametrize("verb", ["check", "configure", "release"])
@pytest.mark.parametrize("own_file", [True, False])
def test_rig_commands(arm: str, own_file: bool, verb: str, tmp_path: Path) -> None:
    rig, file = told(arm, own_file, tmp_path)
    values = read(rig.command(verb, PORT))
    assert (values["port"], values["file"]) == (PORT, file)
    assert find_arm(known_arm_name(str(values["arm"]))) == find_arm(arm)


@pytest.mark.parametrize("own_file", [True, False])
def test_calibrate_commands_let_it_move(arm: str, own_file: bool, tmp_path: Path) -> None:
    rig, file = told(arm, own_file, tmp_path)
    values = read(rig.calibrate("servos", PORT, "--source", "vicon://host", "--out", "my arm.toml", "--overwrite"))
    assert (values["port"], values["rig_file"], values["arm"]) == (PORT, file, True)
    which = values["which_arm"]
    assert find_arm(known_arm_name(None if which is None else str(which))) == find_arm(arm)
    assert (values["source"], values["out"], values["overwrite"]) == ("vicon://host", Path("my arm.toml"), True)


def told(arm: str, own_file: bool, folder: Path) -> tuple[Rig, Path | None]:
    """The arm's rig, from its own file or from a copy; the copy."""
    found, copy = find_arm(arm), folder / "my rig.toml"
    if own_file:
        return rig_of(found, simulated=True), None
    shutil.copy(rig_file(found), copy)
    return rig_of(found, copy, simulated=True), copy
