"""What is looked at before a calibration opens anything."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from highfive.hil.arm.arm_options import ArmOptions
from highfive.mocap_bridge.sources.address import WEBCAM, is_live, parse_address
from highfive.model.errors import HighFiveError


def check_system(source: str) -> None:
    """That it is a motion capture system's address.

    Raises:
        HighFiveError: it is a file, a headset or a webcam, or no address.
    """
    if not is_live(source) or parse_address(source).scheme in ("headset", WEBCAM):
        raise HighFiveError(f"--source {source}: expected a motion capture system, such as vicon://host")


def check_in_a_room(arm: ArmOptions) -> None:
    """That the arm is a real one.

    Raises:
        HighFiveError: it is emulated.
    """
    if arm.emulated:
        raise HighFiveError(f"{arm.port}: an emulated arm stands in no room; give a serial port, and --arm")


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
