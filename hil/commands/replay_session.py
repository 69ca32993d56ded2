"""A recorded session as the source of another one."""

from __future__ import annotations

import logging
from pathlib import Path

from highfive.hil.commands.session_partners import worn_set
from highfive.hil.commands.simulate_options import SimulateOptions
from highfive.hil.recording.replay import Replay, open_replay
from highfive.hil.recording.session_reader import read_session
from highfive.hil.runtime.console import say_aside
from highfive.model.errors import HighFiveError


def check_replay_options(options: SimulateOptions) -> None:
    """What does not go with a recorded session.

    Raises:
        HighFiveError: something does not.
    """
    if options.cells or options.emotions or options.human is not None:
        raise HighFiveError("a recorded session is played as it was: leave out --cell, --emotion and --human")
    if options.view is not None:
        raise HighFiveError(f"a recorded session is seen with: highfive view {options.source}")
    if options.arm is not None:
        raise HighFiveError(f"a recorded session is played to an arm with: highfive rig play {options.source}")


def replay_of(options: SimulateOptions, model: str) -> Replay:
    """The high fives of the recording that the options name; ``model`` is the name of what answers now.

    Raises:
        HighFiveError: it cannot be read, or cannot be played again.
    """
    assert options.source is not None
    path = Path(options.source)
    session = read_session(path)
    replay = open_replay(session, model, options.correct, worn_set(options))
    if not session.complete:
        say_aside(f"{path} has no end: its last high five is played as far as it was recorded", logging.WARNING)
    if options.style is not None:
        replay.differs.append("another style, as was asked for")
    return replay
