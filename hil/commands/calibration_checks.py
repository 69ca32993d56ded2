"""What is looked at before a calibration opens anything."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from highfive.hil.arm.arm_options import VIRTUAL, ArmOptions
from highfive.hil.arm_model.arm_folder import DEFAULT_ARM, find_arm
from highfive.mocap_bridge.sources.address import WEBCAM, is_live, parse_address
from highfive.model.errors import HighFiveError


def check_system(source: str | None) -> str:
    """The scheme of a motion capture system's address.

    Raises:
        HighFiveError: there is none, it is a file, a headset or a webcam, or no address.
    """
    if source is None:
        raise HighFiveError("which motion capture system sees the arm's plate? give --source, such as vicon://host")
    if not is_live(source) or (scheme := parse_address(source).scheme) in ("headset", WEBCAM):
        raise HighFiveError(f"--source {source}: expected a motion capture system, such as vicon://host")
    return scheme


def check_in_a_room(arm: ArmOptions) -> None:
    """That the arm is a real one.

    Raises:
        HighFiveError: it is emulated.
    """
    if arm.emulated:
        raise HighFiveError(
            f"{arm.port}: an emulated arm stands in no room; give a serial port, and --arm, or, to rehearse, {VIRTUAL} "
            "without --source"
        )


def rehearsed(arm: ArmOptions, source: str | None) -> bool:
    """Whether this rehearses: with an emulated arm that is not as drawn, in virtual time, seen by cameras of its own.

    Raises:
        HighFiveError: such an arm cannot be had.
    """
    if not arm.emulated or source is not None:
        return False
    if arm.port != VIRTUAL:
        raise HighFiveError(f"{arm.port}: a calibration is rehearsed in virtual time; take {VIRTUAL} for the port")
    if find_arm(arm.arm) != find_arm():
        raise HighFiveError(f"{VIRTUAL}: only of {DEFAULT_ARM} is it known how it may differ from its drawing")
    return True


@contextmanager
def kept_where_refused(poses: Path) -> Iterator[None]:
    """Says of what stops or is refused in here that the poses which it rests on are still there, and are gone on from.

    Raises:
        HighFiveError: what stopped, or was refused.
    """
    try:
        yield
    except HighFiveError as error:
        if not poses.exists():
            raise
        kept = (
            f"the poses are kept in {poses}, and the same command goes on from them: delete it to take them anew, "
            "where the arm or its plate is changed"
        )
        raise HighFiveError(f"{error} ({kept})") from None
