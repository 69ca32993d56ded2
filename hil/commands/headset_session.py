"""A session whose person wears a headset: the live page comes first, for it is what tracks her."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from highfive.calibration.placement import Placement
from highfive.hil.commands.simulate_options import PageOptions, SimulateOptions
from highfive.hil.commands.waiting import Waiting
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.runtime.console import say_aside
from highfive.hil.trials.live_wiring import MACHINE_WIRING, LiveWiring
from highfive.hil.view.live_page import LivePage
from highfive.mocap_bridge.sources.address import parse_address
from highfive.mocap_bridge.sources.headset import HeadsetLink
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.model.errors import HighFiveError

SCHEME = "headset"
PATIENCE_S = 180.0
"""So long a session waits for somebody to put the headset on."""
WAKE_S = 0.2
"""So long the page's buttons may go unheard meanwhile."""
HERE = Placement(
    np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), ("the page puts the avatar an arm's length before the headset",)
)
"""What the page sends is in the world already."""


def wears_headset(options: SimulateOptions) -> bool:
    """The person comes from a headset."""
    return options.source is not None and parse_address(options.source).scheme == SCHEME


def hand_of(options: SimulateOptions) -> str:
    """The hand that she gives: ``right`` or ``left``."""
    return parse_address(str(options.source)).options.get("hand", "right")


def with_page(options: SimulateOptions) -> SimulateOptions:
    """The options with the page that a headset needs, and the whole address.

    Raises:
        HighFiveError: something does not go with a headset.
    """
    if options.place is not None:
        raise HighFiveError("--place keeps where a live person stands; the page puts the avatar before a headset anew")
    if options.arm is not None and not options.arm.emulated:
        raise HighFiveError(
            f"--rig {options.arm.port} may be a real arm: a headset's world begins where it is put on, so that nothing "
            "says where the arm's base stands in it; use --rig emulated, or a motion capture system with --calibration "
            "and no headset"
        )
    if options.arm is not None and hand_of(options) == "left":
        raise HighFiveError("a left hand is met by the avatar's mirror image; a servo arm has none: leave out --rig")
    return replace(options, source=str(parse_address(str(options.source))), view=options.view or PageOptions())


def headset_wiring(options: SimulateOptions, page: LivePage, wiring: LiveWiring | None) -> LiveWiring:
    """What a headset's source hangs on: the messages that come through the page."""
    wiring, tracked = wiring or MACHINE_WIRING, page.tracked
    assert tracked is not None
    return replace(
        wiring, connects=lambda address: lambda: HeadsetLink(tracked.wait, hand_of(options), wiring.clock.now)
    )


def wait_until_worn(source: LiveSource, page: LivePage, clock: Clock = MACHINE) -> None:
    """Waits for the headset, and as long as the page says pause.

    Raises:
        HighFiveError: nobody puts it on, or somebody ends the session on the page.
    """
    say_aside(f"put the headset on, open {page.participant_address} in its browser, and press Enter VR or Enter AR")
    waiting = Waiting(page, PATIENCE_S, clock)
    while source.wait(None, WAKE_S) is None or waiting.paused:
        if not waiting.look("no headset has sent anything yet: open the page in it, and press Enter VR or Enter AR"):
            raise HighFiveError(f"no headset has sent anything within {PATIENCE_S:g} s; is it in Enter VR or Enter AR?")
        if waiting.paused:
            clock.wait_until(clock.now() + round(1e9 * WAKE_S))
