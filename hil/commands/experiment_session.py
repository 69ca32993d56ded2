"""What an experiment's run is played with: page, person, model, scene and session, opened as ``simulate`` does."""

from __future__ import annotations

import logging
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from highfive.hil.commands.arm_in_run import ArmInRun
from highfive.hil.commands.clips import SIMULATED, load_clips
from highfive.hil.commands.experiment_options import RunOptions
from highfive.hil.commands.experiment_stage import AvatarStage
from highfive.hil.commands.headset_beside import drift_watch, registered_headset
from highfive.hil.commands.headset_session import SCHEME, headset_wiring, wears_headset, with_page
from highfive.hil.commands.live_options import check_live_options, sees_webcam
from highfive.hil.commands.live_session import live_person
from highfive.hil.commands.page import saying_to
from highfive.hil.commands.page_options import check_port
from highfive.hil.commands.session_arm import arm_watch, with_arm
from highfive.hil.commands.session_outputs import check_output_options, open_outlets, open_publishers, session_outputs
from highfive.hil.commands.session_page import session_page
from highfive.hil.commands.session_partners import worn_set
from highfive.hil.commands.simulate_options import SimulateOptions
from highfive.hil.commands.simulated_participant import participant_on_page
from highfive.hil.commands.typed_commands import TypedCommands
from highfive.hil.evaluation.reaction_models import open_model
from highfive.hil.experiments.desk import Desk
from highfive.hil.experiments.observer import SimulatedParticipant
from highfive.hil.experiments.protocol import Mode, Motion, Protocol
from highfive.hil.experiments.study import session_folder
from highfive.hil.runtime.clock import MACHINE
from highfive.hil.runtime.console import Bar, given_command, say_aside
from highfive.hil.runtime.interrupts import interrupted_between_ticks
from highfive.hil.runtime.threads import quick_switching
from highfive.hil.session.reach_settings import SEEN_LATE
from highfive.hil.session.session import UNSEEN_AT_REST, Session
from highfive.hil.sim.people.capture import PERSON_SET
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.summary import SessionSettings
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.sources.address import is_live
from highfive.mocap_bridge.tracking.filter_settings import HEADSET
from highfive.model.compiled import when_compiling
from highfive.model.errors import HighFiveError

if TYPE_CHECKING:
    from highfive.hil.trials.live_partner import LivePerson
    from highfive.hil.trials.live_wiring import LiveWiring
    from highfive.hil.view.live_page import LivePage


def check_chain(chain: SimulateOptions, protocol: Protocol) -> None:
    """What does not go together of source, page, arm and outputs, as ``simulate`` refuses it, or with the experiment.

    Raises:
        HighFiveError: something does not.
    """
    if chain.source is not None and not is_live(chain.source):
        raise HighFiveError(f"--source {chain.source}: people take part live; give an address, headset or webcam")
    live = chain.source is not None
    check_live_options(chain, live)
    check_output_options(chain)
    registered_headset(chain, live)
    worn = wears_headset(chain)
    if worn:
        with_page(chain)
    if (worn or chain.headset is not None) and protocol.replay.viewpoint == "recorded":
        raise HighFiveError(
            "a headset shows what its wearer looks at, so a recorded viewpoint cannot be shown; plan with "
            '[replay] viewpoint = "live"'
        )
    if chain.arm is None:
        return
    if protocol.motion is Motion.CLIPS:
        raise HighFiveError(f"{protocol.name} shows clips of an avatar that turns round; no arm does: leave out --rig")
    if chain.arm.port == "virtual":
        raise HighFiveError("a run goes at the pace of the clock; --rig virtual does not: --rig emulated")
    if any(block.mode is Mode.NO_CONTINGENCY for block in protocol.blocks):
        raise HighFiveError(
            f"{protocol.name} has blocks in which she acts and is not answered (no_contingency): an arm that does not "
            "answer must not be within her reach; leave out --rig, or plan without them"
        )
    if any(block.mode in (Mode.OWN_REPLAY, Mode.OTHER_REPLAY) for block in protocol.blocks) and live:
        say_aside("in replays the arm does not answer: she has to stand where it does not reach", logging.WARNING)


def open_stage(
    options: RunOptions, protocol: Protocol, stack: ExitStack, participant: SimulatedParticipant | None, bar: Bar,
    wiring: LiveWiring | None = None,
) -> tuple[Desk, AvatarStage]:  # fmt: skip
    """Opens all that a run needs until ``stack`` ends.

    Raises:
        HighFiveError: something does not fit, or is not there.
    """
    chain = options.chain
    assert chain is not None and chain.view is not None
    live, worn, webcam = chain.source is not None, wears_headset(chain), sees_webcam(chain)
    chain = with_page(chain) if worn else chain
    assert chain.view is not None
    check_port(chain.view)
    stack.enter_context(interrupted_between_ticks())  # first: an arm's handlers of Ctrl-C call this one
    stack.enter_context(quick_switching())
    beside = registered_headset(chain, live)
    chain = with_arm(chain, live, stack, wiring)
    publishers = open_publishers(chain, stack)
    stack.enter_context(when_compiling(lambda: say_aside("compiling, once after installing: a minute or two")))
    model, scene = open_model(chain.model), build_scene()
    clips = None if options.clips is None else load_clips(options.clips, protocol)
    if clips is None:
        _check_styles(protocol, model.emotions)
    opened = None if participant is None else partial(_takes_part, participant, stack)
    about = {"mode": "experiment", "title": protocol.name, "emotions": [], "cells": []}
    person, watch = None, None
    if worn or webcam:  # the page is what tracks her
        watch = arm_watch(chain, bar, load_marker_set(SCHEME), stack) if worn else None
        page = session_page(chain, about, watch, stack, opened=opened)
        person = _tracked_by(chain, page, stack, wiring)
    else:
        person = live_person(chain, stack, wiring, worn_set(chain)) if live else None
        watch = arm_watch(chain, bar, _markers(person), stack)
        page = session_page(chain, about, watch, stack, None if beside is None else (beside, person), opened)
        if person is not None:
            person.say = saying_to(page)
    publishers += open_outlets(chain, _markers(person).names, person, stack)
    session = Session(
        model, dict(protocol.styles[0].weights) if clips is None else {model.emotions[0]: 1.0}, _markers(person), scene,
        settings=UNSEEN_AT_REST if worn else None,
        tracking=HEADSET if worn else None if person is None else person.tracking,
        reach=SEEN_LATE if webcam else None,
    )  # fmt: skip
    settings = SessionSettings(
        seed=chain.seed, model=_motion_of(chain, options.clips), trials=0, style=None, corrected=True,
        physics=False, source=chain.source or "", command=given_command(),
        arm="" if chain.arm is None else chain.arm.port, arm_name="" if chain.arm is None else chain.arm.arm,
    )  # fmt: skip
    switch = None
    if options.tap_switch is not None:
        from highfive.hil.commands.tap_switch import TapSwitch  # noqa: PLC0415 (LSL takes half a second)

        switch = TapSwitch(options.tap_switch)
        stack.callback(switch.close)
        switch.wait()
    desk = Desk(page, MACHINE, TypedCommands() if options.typed else lambda: ())
    outputs = partial(session_outputs, chain, publishers=publishers, person=person, clock=MACHINE)
    stage = AvatarStage(
        session, scene, page, desk, person, protocol,
        session_folder(options.study, options.participant, options.session), settings, outputs, MACHINE,
        None if watch is None or chain.arm is None else ArmInRun(watch, live=live, never_silent=chain.arm.never_silent),
        None if beside is None or person is None else drift_watch(beside, person, page), clips, switch,
    )  # fmt: skip
    stack.callback(stage.close)
    stage.stand(_markers(person).names)
    return desk, stage


def _motion_of(chain: SimulateOptions, clips: str | None) -> str:
    """What recordings say that the motion is of."""
    if clips is None:
        return str(getattr(chain.model, "name", chain.model))
    return "simulated clips" if clips == SIMULATED else f"clips of {Path(clips).name}"


def _markers(person: LivePerson | None) -> MarkerSet:
    return load_marker_set(PERSON_SET) if person is None else person.marker_set


def _check_styles(protocol: Protocol, known: tuple[str, ...]) -> None:
    wanted = {emotion for style in protocol.styles for emotion in style.weights}
    if protocol.morph is not None:
        wanted |= {protocol.morph.start, protocol.morph.end}
    if unknown := sorted(wanted - set(known)):
        raise HighFiveError(f"{protocol.name} shows {unknown[0]!r}; the model knows {', '.join(known)} (--model)")


def _takes_part(participant: SimulatedParticipant, stack: ExitStack, page: LivePage) -> None:
    stack.enter_context(participant_on_page(participant, page.address))


def _tracked_by(chain: SimulateOptions, page: LivePage, stack: ExitStack, wiring: LiveWiring | None) -> LivePerson:
    """Who comes through the page: by its camera, or by a headset."""
    if sees_webcam(chain):
        from highfive.hil.commands.webcam_session import webcam_person  # noqa: PLC0415

        return webcam_person(chain, page, stack)
    return live_person(chain, stack, headset_wiring(chain, page, wiring), worn_set(chain), page)
