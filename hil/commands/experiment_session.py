"""What an experiment's run is played with: page, person, model, scene and session, opened as ``simulate`` does."""

from __future__ import annotations

import shlex
import sys
from contextlib import ExitStack
from functools import partial
from typing import TYPE_CHECKING

from highfive.hil.commands.experiment_options import RunOptions
from highfive.hil.commands.experiment_stage import AvatarStage, stage_of
from highfive.hil.commands.headset_session import headset_wiring, wears_headset, with_page
from highfive.hil.commands.live_options import sees_webcam
from highfive.hil.commands.live_session import live_person
from highfive.hil.commands.page import open_page
from highfive.hil.commands.page_options import check_port
from highfive.hil.commands.session_outputs import (
    open_outlets,
    open_publishers,
    session_outputs,
)
from highfive.hil.commands.session_partners import worn_set
from highfive.hil.commands.simulate_options import SimulateOptions
from highfive.hil.commands.simulated_participant import participant_on_page
from highfive.hil.commands.typed_commands import TypedCommands
from highfive.hil.evaluation.reaction_models import open_model
from highfive.hil.experiments.desk import Desk
from highfive.hil.experiments.observer import SimulatedParticipant
from highfive.hil.experiments.protocol import Protocol
from highfive.hil.runtime.clock import MACHINE
from highfive.hil.runtime.console import say_aside
from highfive.hil.runtime.interrupts import interrupted_between_ticks
from highfive.hil.runtime.threads import quick_switching
from highfive.hil.session.reach import SEEN_LATE
from highfive.hil.session.session import UNSEEN_AT_REST, Session
from highfive.hil.sim.people.capture import PERSON_SET
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.summary import SessionSettings
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.sources.address import is_live
from highfive.mocap_bridge.tracking.filter_settings import HEADSET
from highfive.model.errors import HighFiveError

if TYPE_CHECKING:
    from highfive.hil.trials.live_partner import LivePerson
    from highfive.hil.trials.live_wiring import LiveWiring
    from highfive.hil.view.live_page import LivePage


def open_stage(
    options: RunOptions, protocol: Protocol, stack: ExitStack, participant: SimulatedParticipant | None,
    wiring: LiveWiring | None = None,
) -> tuple[Desk, AvatarStage]:  # fmt: skip
    """Opens all that a run needs until ``stack`` ends.

    Raises:
        HighFiveError: something does not fit, or is not there.
    """
    chain = options.chain
    assert chain is not None and chain.view is not None
    if chain.source is not None and not is_live(chain.source):
        raise HighFiveError(f"--source {chain.source}: people take part live; give an address, headset or webcam")
    worn, webcam = wears_headset(chain), sees_webcam(chain)
    chain = with_page(chain) if worn else chain
    assert chain.view is not None
    check_port(chain.view)
    stack.enter_context(interrupted_between_ticks())
    stack.enter_context(quick_switching())
    publishers = open_publishers(chain, stack)
    model, scene = open_model(chain.model), build_scene()
    _check_styles(protocol, model.emotions)
    page = _page(chain, protocol, stack, participant, tracks=worn or webcam)
    person = _person(chain, page, stack, wiring)
    worn_markers = load_marker_set(PERSON_SET) if person is None else person.marker_set
    publishers += open_outlets(chain, worn_markers.names, person, stack)
    session = Session(
        model, dict(protocol.styles[0].weights), worn_markers, scene,
        settings=UNSEEN_AT_REST if worn else None,
        tracking=HEADSET if worn else None if person is None else person.tracking,
        reach=SEEN_LATE if webcam else None,
    )  # fmt: skip
    settings = SessionSettings(
        seed=chain.seed, model=str(getattr(chain.model, "name", chain.model)), trials=0, style=None, corrected=True,
        physics=False, source=chain.source or "", command=shlex.join(["highfive", *sys.argv[1:]]),
    )  # fmt: skip
    desk = Desk(page, MACHINE, TypedCommands() if options.typed else lambda: ())
    outputs = partial(session_outputs, chain, publishers=publishers, person=person, clock=MACHINE)
    stage = stage_of(
        session, scene, page, desk, person, protocol, options.study, options.participant, options.session, settings,
        outputs, MACHINE, stack,
    )  # fmt: skip
    return desk, stage


def _check_styles(protocol: Protocol, known: tuple[str, ...]) -> None:
    wanted = {emotion for style in protocol.styles for emotion in style.weights}
    if protocol.morph is not None:
        wanted |= {protocol.morph.start, protocol.morph.end}
    if unknown := sorted(wanted - set(known)):
        raise HighFiveError(f"{protocol.name} shows {unknown[0]!r}; the model knows {', '.join(known)} (--model)")


def _page(
    chain: SimulateOptions, protocol: Protocol, stack: ExitStack, participant: SimulatedParticipant | None,
    *, tracks: bool,
) -> LivePage:  # fmt: skip
    assert chain.view is not None

    def takes_part(page: LivePage) -> None:
        assert participant is not None
        stack.enter_context(participant_on_page(participant, page.address))

    about = {
        "mode": "experiment", "title": protocol.name, "emotions": [], "cells": [], "arm": False, "rig": False,
        "tracks": wears_headset(chain), "webcam": sees_webcam(chain),
    }  # fmt: skip
    opened = None if participant is None else takes_part
    page = stack.enter_context(open_page(chain.view, about, opened=opened, tracks=tracks))
    say_aside(f"that is the experimenter's; the participant's: {page.address}&role=participant")
    return page


def _person(chain: SimulateOptions, page: LivePage, stack: ExitStack, wiring: LiveWiring | None) -> LivePerson | None:
    """Who is there; None where a simulated person moves."""
    if chain.source is None:
        return None
    if sees_webcam(chain):
        from highfive.hil.commands.webcam_session import webcam_person  # noqa: PLC0415

        return webcam_person(chain, page, stack)
    if wears_headset(chain):
        return live_person(chain, stack, headset_wiring(chain, page, wiring), worn_set(chain), page)
    return live_person(chain, stack, wiring, worn_set(chain))
