"""``highfive calibrate headset``: where a headset's space lies beside a lab's motion capture system."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from highfive.calibration.headset_file import KeptRegistration, save_headset
from highfive.hil.commands.calibration_checks import check_system
from highfive.hil.commands.simulate_options import PageOptions
from highfive.hil.runtime.console import Bar, say_aside
from highfive.hil.runtime.folders import check_toml
from highfive.hil.trials.head_watch import HeadWatch
from highfive.hil.trials.live_partner import live_source
from highfive.hil.trials.live_wiring import MACHINE_WIRING, LiveWiring
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.markers.recognise import find_marker_set
from highfive.mocap_bridge.sources.address import parse_address
from highfive.model.errors import HighFiveError

PATIENCE_S = 180.0
"""So long somebody may take to put the headset on."""
LOOK_S = 0.004
"""Between two looks at both systems at most."""
SHORTEST_S, LONGEST_S = 5.0, 120.0
"""Bounds of how long the head is watched."""

Take = Callable[[float], Sequence[bytes]]


@dataclass(frozen=True)
class HeadsetCalibration:
    """What is registered.

    Attributes:
        source: the motion capture system's address.
        person: prefix of the person's markers; None for the only one.
        marker_set: name or file of the marker set; None finds one.
        seconds: for which the head is watched.
        out: the file of the registration.
        overwrite: replace that file if it is there.
        page: where the page is that the headset opens.
    """

    source: str
    person: str | None = None
    marker_set: str | None = None
    seconds: float = 20.0
    out: Path = Path("headset.toml")
    overwrite: bool = False
    page: PageOptions = field(default_factory=lambda: PageOptions(open_browser=False))


def calibrate_headset(
    options: HeadsetCalibration, bar: Bar, wiring: LiveWiring = MACHINE_WIRING, messages: Take | None = None
) -> dict[str, Any]:
    """Watches a head that nods and turns with both systems, fits, and writes the registration.

    Args:
        options: what is registered.
        bar: shows how far it is.
        wiring: of the system.
        messages: gives the headset's, waiting so many s at most; None opens the page for them.

    Returns:
        The summary: what was found, residuals in mm and degrees, the delay in ms, and the file.

    Raises:
        HighFiveError: nothing comes, tracking was lost, the head did not turn enough, or the file cannot be written.
    """
    check_system(options.source)
    if not SHORTEST_S <= options.seconds <= LONGEST_S:
        raise HighFiveError(f"--seconds {options.seconds:g}; expected {SHORTEST_S:g} to {LONGEST_S:g}")
    check_toml(options.out, "a registration", options.overwrite)
    with ExitStack() as stack:
        source = stack.enter_context(closing(live_source(options.source, options.person, wiring)))
        first = source.first()
        marker_set = find_marker_set(first.names) if options.marker_set is None else load_marker_set(options.marker_set)
        head = HeadWatch(source, marker_set, messages or _page(options, stack), wiring.clock.now)
        _wait_until_worn(head, wiring)
        say_aside(f"for {options.seconds:g} s now: nod and turn the head, as far as is comfortable")
        head.forget()
        end, advance, told = wiring.clock.now() + round(1e9 * options.seconds), bar("seconds", int(options.seconds)), 0
        while (left := 1e-9 * (end - wiring.clock.now())) > 0.0:
            head.look(min(LOOK_S, left))
            while told < int(options.seconds - left):
                told += 1
                advance()
        found = head.registration()
    kept = KeptRegistration(found, parse_address(options.source).scheme, marker_set.name, datetime.now(UTC))
    save_headset(options.out, kept, replace=options.overwrite)
    return {
        "source": options.source,
        "marker_set": marker_set.name,
        "poses": len(head.poses),
        "frames": len(head.frames),
        "residual_mm": round(1e3 * found.residual_m, 2),
        "residual_deg": round(float(np.degrees(found.residual_rad)), 3),
        "delay_ms": round(1e3 * found.delay_s, 1),
        "hand_sigma_mm": round(1e3 * found.hand_sigma_m, 2),
        "rotation": found.rotation.tolist(),
        "translation_m": found.translation.tolist(),
        "out": str(options.out),
    }


def _page(options: HeadsetCalibration, stack: ExitStack) -> Take:
    """The page that the headset opens, in the headset's own space."""
    from highfive.hil.commands.page import open_page  # noqa: PLC0415

    about = {"mode": "recording", "title": "Register the headset", "tracks": True, "space": "own"}
    page = stack.enter_context(open_page(options.page, about, tracks=True))
    assert page.tracked is not None
    return page.tracked.wait


def _wait_until_worn(head: HeadWatch, wiring: LiveWiring) -> None:
    say_aside("put the headset on, open the address in its browser, and press Enter VR or Enter AR")
    end = wiring.clock.now() + round(1e9 * PATIENCE_S)
    while not head.poses:
        if wiring.clock.now() > end:
            raise HighFiveError(f"no headset has sent anything within {PATIENCE_S:g} s; is it in Enter VR or Enter AR?")
        head.look(0.1)


def print_headset(summary: dict[str, Any]) -> None:
    """The summary for people."""
    print(
        f"{summary['source']}, marker set {summary['marker_set']}: {summary['poses']} poses, {summary['frames']} frames"
    )
    print(f"Residuals {summary['residual_mm']:.1f} mm and {summary['residual_deg']:.2f}° (root mean square).")
    print(f"The headset's poses hold {summary['delay_ms']:.0f} ms later than the system's frames.")
    print(f"A hand before the eyes is known to {summary['hand_sigma_mm']:.1f} mm. Written: {summary['out']}")
