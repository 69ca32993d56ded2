"""What ``highfive experiment run`` is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from highfive.hil.commands.simulate_options import SimulateOptions


@dataclass(frozen=True)
class RunOptions:
    """Who takes part, and how.

    Attributes:
        study: its folder.
        participant: her code.
        session: which of hers, from 1.
        resume: go on with a session that has begun; else it is asked, where somebody is there to be asked.
        consent: version of the form that she signed; None asks.
        language: of the instructions; None for English, or the only one.
        simulated: file of a simulated participant; None for a real one.
        dry: no avatar, in virtual time.
        typed: answers and commands are typed at this terminal, too.
        clips: folder of the clips that are shown, or ``simulated``; None of an experiment without.
        tap_switch: name of the LSL stream of a switch that says the tap; None has her hand tell.
        chain: source, model and page, as of ``simulate``; its view is where the pages are.
    """

    study: Path
    participant: str
    session: int = 1
    resume: bool = False
    consent: str | None = None
    language: str | None = None
    simulated: Path | None = None
    dry: bool = False
    typed: bool = False
    clips: str | None = None
    tap_switch: str | None = None
    chain: SimulateOptions | None = None
