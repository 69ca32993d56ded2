"""The live person of a session: found, placed, and kept for the next time."""

from __future__ import annotations

import logging
from contextlib import ExitStack, closing
from datetime import UTC, datetime

from highfive.calibration.arm_file import ArmCalibration, load_arm
from highfive.calibration.placement_file import load_placement, save_placement
from highfive.hil.arm.calibrated import MOCAP_LATE, session_calibration
from highfive.hil.commands.headset_session import HERE, hand_of, wait_until_worn
from highfive.hil.commands.page import saying_to
from highfive.hil.commands.session_outputs import known_of
from highfive.hil.commands.simulate_options import SimulateOptions
from highfive.hil.runtime.console import confirm, say_aside
from highfive.hil.session.session_streams import PERSON
from highfive.hil.trials.live_partner import LivePerson, live_source
from highfive.hil.trials.live_settings import LIVE, WORN
from highfive.hil.trials.live_wiring import MACHINE_WIRING, LiveWiring
from highfive.hil.view.live_page import LivePage
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.sources.address import parse_address
from highfive.model.errors import HighFiveError


def late_by(found: ArmCalibration | None, options: SimulateOptions) -> int:
    """ns, by which an arm's calibration says that frames are late; 0 where ``--latency`` says what they are."""
    late_s = 0.0 if found is None or options.latency_ms else max(0.0, found.latency.get(MOCAP_LATE, 0.0))
    if late_s:
        say_aside(f"its frames are {1e3 * late_s:.1f} ms late, as calibrate latency measured: made up for")
    return round(1e9 * late_s)


def live_person(
    options: SimulateOptions, stack: ExitStack, wiring: LiveWiring | None, marker_set: MarkerSet | None,
    page: LivePage | None = None,
) -> LivePerson:  # fmt: skip
    """Who is there: followed until ``stack`` ends, found and placed in the world; ``page`` tracks her headset.

    Raises:
        HighFiveError: nothing comes, nobody can be placed, or a file says otherwise.
    """
    wiring = wiring or MACHINE_WIRING
    file = None if options.arm is None else session_calibration(options.arm)
    system = parse_address(str(options.source)).scheme
    found = None if file is None else load_arm(file)
    plate = () if found is None else found.marker_names
    source = stack.enter_context(closing(live_source(str(options.source), options.human, wiring, plate)))
    registered = None if found is None else found.registration.placement
    if file is not None and options.place is not None:
        raise HighFiveError(f"--place, and {file}, both say where the person stands; leave out --place")
    if options.place is not None and options.place.exists():
        registered = load_placement(options.place, system)
    if page is not None:
        wait_until_worn(source, page, wiring.clock)
        registered = HERE
    measured = known_of(options).get(PERSON)
    late_ns = late_by(found, options) if measured is None else measured.latency_ns
    person = LivePerson(
        source, str(options.source), marker_set, registered, wiring.clock, round(1e6 * options.latency_ms), late_ns,
        confirm, saying_to(page), settings=LIVE if page is None else WORN,
        hand="right" if page is None else hand_of(options),
    )  # fmt: skip
    if options.place is not None and registered is None:
        if person.guessed:
            say_aside(f"not kept in {options.place}: the place was guessed, and nobody confirmed it", logging.WARNING)
        else:
            save_placement(options.place, person.placement, system, datetime.now(UTC))
            say_aside(f"kept in {options.place}")
    return person
