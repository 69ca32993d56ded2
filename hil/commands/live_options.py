"""What of a session's options concerns a live person."""

from __future__ import annotations

from highfive.hil.commands.simulate_options import SimulateOptions
from highfive.model.errors import HighFiveError

LONGEST_LATENCY_MS = 200.0
"""Over more than this nobody can predict a hand."""


def check_live_options(options: SimulateOptions, live: bool) -> None:
    """What goes with a live person only, or not with what else was requested.

    Raises:
        HighFiveError: something does not.
    """
    if options.place is not None and not live:
        raise HighFiveError("--place keeps where a live person stands; add --source ADDRESS")
    if options.latency_ms and not live:
        raise HighFiveError("--latency is of a live person's system; add --source ADDRESS")
    if not 0.0 <= options.latency_ms <= LONGEST_LATENCY_MS:
        raise HighFiveError(f"--latency {options.latency_ms:g} ms; expected 0 to {LONGEST_LATENCY_MS:g}")
    if options.place is not None and options.arm is not None and options.arm.registration is not None:
        raise HighFiveError("--place and --registration both say where the person stands; give one")
