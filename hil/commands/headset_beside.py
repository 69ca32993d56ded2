"""A session whose person is tracked by a lab's system and wears a registered headset to see the avatar."""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from highfive.calibration.headset_file import KeptRegistration, load_headset
from highfive.calibration.placement import Placement
from highfive.hil.commands.simulate_options import SimulateOptions
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.runtime.console import say_aside
from highfive.mocap_bridge.sources.address import WEBCAM, parse_address
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations

if TYPE_CHECKING:
    from highfive.hil.trials.head_watch import DriftWatch
    from highfive.hil.trials.live_partner import LivePerson
    from highfive.hil.view.live_page import LivePage


def registered_headset(options: SimulateOptions, live: bool) -> KeptRegistration | None:
    """The registration that a session's options name; None where they name none.

    Raises:
        HighFiveError: it does not go with the rest, or is of another system.
    """
    if options.headset is None:
        return None
    scheme = parse_address(str(options.source)).scheme if live else ""
    if scheme in ("", "headset", WEBCAM):
        raise HighFiveError(
            "--headset is of a headset beside a motion capture system; add --source ADDRESS (one that tracks hands "
            "itself needs no registration: --source headset)"
        )
    return load_headset(options.headset, scheme)


def space_in_world(kept: KeptRegistration, placement: Placement) -> dict[str, Any]:
    """For the page: where the headset's space (z up) lies in the avatar's world."""
    found = kept.registration
    return {
        "rotation": rotations.multiply(placement.rotation, found.rotation).tolist(),
        "translation": placement.apply(found.translation).tolist(),
    }


def drift_watch(kept: KeptRegistration, person: LivePerson, page: LivePage, clock: Clock = MACHINE) -> DriftWatch:
    """Watches whether the registration still holds, by the head as both see it.

    Raises:
        HighFiveError: the registration is of another marker set.
    """
    from highfive.hil.trials.head_watch import WINDOW_S, DriftWatch, HeadWatch  # noqa: PLC0415

    tracked = page.tracked
    assert tracked is not None
    if kept.marker_set != person.marker_set.name:
        raise HighFiveError(
            f"the headset was registered with marker set {kept.marker_set}, the person wears "
            f"{person.marker_set.name}; run highfive calibrate headset"
        )
    head = HeadWatch(
        person.source, person.marker_set, lambda _: tracked.take(), clock.now, WINDOW_S, person.placement.apply
    )

    def say(line: str) -> None:
        say_aside(line, logging.WARNING)
        page.tell("headset", message=line)

    # The page puts the headset's space where the registration says: what it sends is in the world already.
    in_world = replace(kept.registration, rotation=np.array([1.0, 0.0, 0.0, 0.0]), translation=np.zeros(3))
    return DriftWatch(head, in_world, clock.now, say)
