"""Before a real arm meets a live person: five poses show whether it still is where, and as, it was calibrated."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime

from highfive.hil.arm.arm_files import rig_of
from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.calibrated import known_arm, trusted_calibration
from highfive.hil.arm.driven_arm import driven_arm
from highfive.hil.arm.plate_watch import PlateWatch
from highfive.hil.arm.preconditions import check_person
from highfive.hil.arm.session_check import five_poses, plate_of
from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.runtime.console import say_aside
from highfive.hil.trials.live_partner import live_source
from highfive.hil.trials.live_wiring import MACHINE_WIRING, LiveWiring
from highfive.mocap_bridge.files.recording import EVERYBODY, SeveralPersons
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.model.errors import HighFiveError


def check_before_session(
    arm: ArmOptions, worn: MarkerSet | None, wiring: LiveWiring | None = None, human: str | None = None
) -> None:
    """Has a real arm visit five postures, slowly, while nobody is within a metre of its plate.

    Args:
        arm: which arm, and the address of whom it will meet.
        worn: the marker set that she will wear; None where it is found later.
        wiring: of the motion capture; None for this computer's.
        human: prefix of her markers.

    Raises:
        HighFiveError: the arm is not as it was calibrated, or cannot be seen, or nobody said which person is meant:
            there is no session.
    """
    if worn is not None:
        check_person(arm, worn)
    wiring, folder = wiring or MACHINE_WIRING, find_arm(arm.arm)
    found = trusted_calibration(arm, rig_of(folder, arm.rig), datetime.now(UTC))
    if found is None:
        raise HighFiveError(f"{arm.port}: no calibration says where the arm stands; give --calibration FILE.toml")
    body = known_arm(folder, found)
    _check_one_person(arm.person, human, found.marker_names, wiring)
    say_aside("THE ARM MOVES, slowly, for about a minute, to five poses: stay a metre away until it is back")
    with closing(live_source(arm.person, EVERYBODY, wiring)) as source:
        source.first()
        watch = PlateWatch(source, plate_of(found), wiring.clock)
        with driven_arm(replace(arm, slow=True), body, watch.in_the_way) as drive:
            check = five_poses(drive, watch, body, found)
    say_aside(f"the arm is where it was calibrated: {1e3 * check.rms:.1f} mm (root mean square of five poses)")


def _check_one_person(address: str, human: str | None, plate: Sequence[str], wiring: LiveWiring) -> None:
    """It is said which of several people is meant before the arm moves; nobody need be there yet."""
    with closing(live_source(address, human, wiring, plate)) as source:
        try:
            source.first()
        except SeveralPersons:
            raise
        except HighFiveError:  # said again where it matters
            return
