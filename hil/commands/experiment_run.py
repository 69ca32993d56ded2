"""What ``highfive experiment run`` does: one participant is taken through her plan."""

from __future__ import annotations

import hashlib
import logging
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from highfive.hil.commands.experiment_options import RunOptions
from highfive.hil.commands.simulated_participant import PageInProcess
from highfive.hil.experiments.conduct import Conducted, conduct
from highfive.hil.experiments.desk import Desk
from highfive.hil.experiments.observer import SimulatedParticipant, check_labels, read_observer
from highfive.hil.experiments.protocol import Motion, Protocol
from highfive.hil.experiments.stage import EmptyStage, RunFailedError, Stage
from highfive.hil.experiments.study import (
    LOG,
    check_planned,
    participant_folder,
    session_folder,
    stored_plan,
    study_protocol,
)
from highfive.hil.experiments.trial_log import RunHead, open_log
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.runtime.console import Bar, ask_line, confirm, counted, say, say_aside
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.trials.summary import versions
from highfive.model.errors import HighFiveError

if TYPE_CHECKING:
    from highfive.hil.trials.live_wiring import LiveWiring

DRY_LOOK_NS = 100_000_000
"""Without an avatar the page is looked at so often, ns of virtual time: what an answer says of its time counts."""


def run(options: RunOptions, bar: Bar, wiring: LiveWiring | None = None) -> dict[str, Any]:
    """Takes a participant through what is left of her plan.

    Raises:
        HighFiveError: something does not fit, is not there, or cannot be written; what was asked is in the log.
    """
    protocol, plan = study_protocol(options.study), stored_plan(options.study, options.participant)
    check_planned(options.study, protocol)
    observer = None if options.simulated is None else read_observer(options.simulated)
    if observer is not None:
        check_labels(observer, protocol.labels, str(options.simulated))
    _check(options, protocol)
    language = _language(options, protocol)
    consent = _consent(options, plan.consent)
    begun = (session_folder(options.study, options.participant, options.session) / LOG).is_file()
    head = RunHead(
        options.participant, options.session, consent, str(versions()["high-five"]), _calibration(options),
        simulated=observer is not None or (options.chain is not None and options.chain.source is None),
        language=language,
    )  # fmt: skip
    participant = None if observer is None else SimulatedParticipant(observer, options.participant)
    with ExitStack() as stack:
        clock: Clock = stack.enter_context(VirtualClock()) if options.dry else MACHINE
        staged = ExitStack()
        stack.push(staged)  # where the log refuses the run after all
        opened: list[tuple[Desk, Stage]] = []

        def ready() -> None:
            opened.append(_opened(options, protocol, participant, bar, wiring, clock, staged))

        log = stack.enter_context(open_log(options.study, head, _resumes(options, begun), clock, ready))
        stack.push(staged)  # closed before the log, which lets the next run begin
        ((desk, stage),) = opened
        for line in log.told:
            say_aside(line, logging.WARNING)
        advance = bar(f"trials of {options.participant}", len(plan.trials))
        advance(done=len(plan.trials) - len(log.left))
        try:
            done = conduct(options.study, log, protocol, desk, stage, clock, language=language, advance=advance)
        except RunFailedError as error:
            raise HighFiveError(f"{error}; the trial is marked; put that right, and resume (--resume)") from None
        return _result(options, done, log.path)


def _opened(
    options: RunOptions, protocol: Protocol, participant: SimulatedParticipant | None, bar: Bar,
    wiring: LiveWiring | None, clock: Clock, stack: ExitStack,
) -> tuple[Desk, Stage]:  # fmt: skip
    """Who asks, and where trials are played; closed with ``stack``."""
    if options.dry:
        assert participant is not None
        return Desk(PageInProcess(participant, clock), clock, look_ns=DRY_LOOK_NS), EmptyStage(clock)
    from highfive.hil.commands.experiment_session import open_stage  # noqa: PLC0415 (session and MuJoCo)

    return open_stage(options, protocol, stack, participant, bar, wiring)


def _check(options: RunOptions, protocol: Protocol) -> None:
    """What does not go together."""
    if options.dry and options.simulated is None:
        raise HighFiveError("--no-avatar is for simulated participants; add --simulate-participant FILE.toml")
    if options.dry:
        return
    if options.tap_switch is not None and protocol.motion is not Motion.CLIPS:
        raise HighFiveError(f"{protocol.name} shows no clips, and nobody taps: leave out --tap-switch")
    if (protocol.motion is Motion.CLIPS) is (options.clips is None):
        shows = "shows clips: give --clips DIR with " if options.clips is None else "shows no clips: leave out --clips"
        named = f"{protocol.styles[0].name}_1.c3d and so on, or --clips simulated" if options.clips is None else ""
        raise HighFiveError(f"{protocol.name} {shows}{named}")
    if options.chain is not None:
        from highfive.hil.commands.experiment_session import check_chain  # noqa: PLC0415 (session and MuJoCo)

        check_chain(options.chain, protocol)


def _consent(options: RunOptions, wanted: str) -> str:
    """The version that she signed; of a simulated participant the one that is wanted."""
    if options.consent is not None:
        return options.consent
    if options.simulated is not None:
        return wanted
    return ask_line(f"version of the consent form that {options.participant} signed") or ""


def _resumes(options: RunOptions, begun: bool) -> bool:
    """Whether it goes on with a session that has begun: as asked for, or as is answered."""
    if begun and not options.resume:
        return confirm(f"{options.participant} has begun session {options.session} already. Resume it?") is True
    return options.resume


def _language(options: RunOptions, protocol: Protocol) -> str:
    there = sorted(protocol.instructions)
    chosen = options.language or ("en" if "en" in there else there[0])
    if chosen not in there:
        raise HighFiveError(f"--language {chosen}: there are instructions in {', '.join(there)}")
    return chosen


def _calibration(options: RunOptions) -> str:
    """12 digits of the placement in use; empty where there is none."""
    place = None if options.chain is None else options.chain.place
    return "" if place is None or not place.is_file() else hashlib.sha256(place.read_bytes()).hexdigest()[:12]


def _result(options: RunOptions, done: Conducted, log: Path) -> dict[str, Any]:
    return {
        "study": str(options.study),
        "participant": options.participant,
        "session": options.session,
        "asked": done.asked,
        "broken_off": done.broken_off,
        "excluded": done.excluded,
        "left": done.left,
        "sourceless": done.sourceless,
        "why": done.why,
        "simulated": options.simulated is not None,
        "log": str(log),
        "folder": str(participant_folder(options.study, options.participant)),
    }


def print_run(result: dict[str, Any]) -> None:
    """The same for people."""
    who = f"{result['participant']}, session {result['session']}"
    say(
        f"{who}: {counted(result['asked'], 'trial')} asked, {result['broken_off']} broken off, "
        f"{result['excluded']} without an answer that counts, {result['left']} left of the plan"
    )
    if count := result["sourceless"]:
        say(f"{counted(count, 'replay')} not asked: what they would show again was broken off, or has been deleted")
    if result["why"]:
        say(f"{result['why']}{'; go on with --resume' if result['left'] else '; nothing of the plan is left'}")
    say(f"log: {result['log']}")
