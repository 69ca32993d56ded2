"""``highfive view``: a recording on the live page."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from highfive.hil.commands.page import open_page
from highfive.hil.commands.simulate_options import PageOptions
from highfive.hil.recording.session_reader import read_session
from highfive.hil.runtime.console import say_aside
from highfive.hil.sim.scene import build_scene
from highfive.hil.view import SHIPPED_RECORDING
from highfive.hil.view.player import play
from highfive.hil.view.recorded import RecordedTrials
from highfive.model.errors import HighFiveError


@dataclass(frozen=True)
class ViewOptions:
    """What to show, and where.

    Attributes:
        recording: an MCAP file, or a folder with one; None for the short one that comes with High Five.
        page: where it is shown.
    """

    recording: Path | None = None
    page: PageOptions = field(default_factory=PageOptions)


def view(options: ViewOptions) -> None:
    """Shows a recording until Ctrl-C, or the page's end button.

    Raises:
        HighFiveError: the recording cannot be shown, the port is in use, or the server was ended from outside.
    """
    name = options.recording.absolute().name if options.recording else ""
    say_aside(f"{name or 'the high fives that come along'}: read, then the page's address")
    session = read_session(options.recording or SHIPPED_RECORDING)
    trials = RecordedTrials(session, build_scene())
    if not session.complete:
        say_aside(f"{session.path} was cut short: it is shown up to its last whole half second", logging.WARNING)
    for number, why in trials.lacking.items():
        say_aside(f"high five {number + 1} is left out: {why}", logging.WARNING)
    about: dict[str, Any] = {"mode": "recording", "title": name}
    about["cut"] = not session.complete
    about["lacking"] = [number + 1 for number in trials.lacking]
    if trials.without_arm:
        say_aside(f"it is shown without its servo arm: {trials.without_arm}", logging.WARNING)
    about |= {"rig": trials.rig, "hand": trials.hand}
    with open_page(options.page, about) as page:
        play(page, trials)
        if not page.alive:
            raise HighFiveError("the live page is gone: its server was ended from outside; start highfive view again")
