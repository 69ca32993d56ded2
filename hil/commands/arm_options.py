"""The servo arm as a command line gives it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from highfive.model.errors import HighFiveError

if TYPE_CHECKING:
    from highfive.hil.arm.arm_options import ArmOptions


def arm_options(
    port: str | None,
    armed: bool,
    rig: Path | None,
    limits: Path | None,
    lower: list[str] | None,
    estop: Path | None,
    calibration: Path | None,
    nobody_near: bool,
    slow: bool,
    faults: list[str] | None,
    name: str | None = None,
) -> ArmOptions | None:
    """The arm that takes part in a session, if there is one; ``name`` is its, or its folder.

    Raises:
        HighFiveError: something is said about an arm, and none takes part.
    """
    if port is not None:
        from highfive.hil.arm.arm_options import ArmOptions  # noqa: PLC0415 (most sessions have none)

        changes = tuple(lower or ())
        return ArmOptions(
            port, rig, limits, changes, armed, estop, tuple(faults or ()),
            calibration=calibration, nobody_near=nobody_near, slow=slow,
            arm=known_arm_name(name),
        )  # fmt: skip
    given = {
        "--arm": armed or name,
        "--rig-file": rig,
        "--limits": limits,
        "--lower": lower,
        "--estop": estop,
        "--calibration": calibration,
        "--nobody-near": nobody_near,
        "--slow": slow,
        "--faults": faults,
    }
    if said := next((name for name, value in given.items() if value), None):
        raise HighFiveError(f"{said} is about an arm, and none takes part; add --rig emulated, or --rig PORT")
    return None


def names_arm(word: str) -> bool:
    """Whether a word of the command line is the name of an arm, or a folder with one."""
    from highfive.hil.arm_model.arm_folder import shipped  # noqa: PLC0415

    return word in shipped() or (Path(word) / "arm.toml").is_file()


def known_arm_name(name: str | None) -> str:
    """The name of an arm that comes along, or the whole path of another one's folder: recordings keep it.

    Raises:
        HighFiveError: there is no such arm.
    """
    from highfive.hil.arm_model.arm_folder import DEFAULT_ARM, find_arm, shipped  # noqa: PLC0415

    if name is None or name in shipped():
        return name or DEFAULT_ARM
    find_arm(name)
    return str(Path(name).resolve())
