"""One simulated session: partner, tracker, responder, correction, MuJoCo; then report, film and recording."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from highfive.hil.commands.headset_beside import registered_headset
from highfive.hil.commands.headset_session import SCHEME, headset_wiring, wears_headset, with_page
from highfive.hil.commands.live_options import check_live_options, sees_webcam
from highfive.hil.commands.page_options import check_port
from highfive.hil.commands.play_trials import Played, over_told, play
from highfive.hil.commands.replay_session import check_replay_options, replay_of
from highfive.hil.commands.session_arm import arm_watch, with_arm
from highfive.hil.commands.session_outputs import check_output_options, open_outlets, open_publishers, session_outputs
from highfive.hil.commands.session_partners import partners_of, worn_set
from highfive.hil.commands.simulate_options import PageOptions, SimulateOptions
from highfive.hil.evaluation.reaction_models import is_plugin, open_model
from highfive.hil.recording.background import BackgroundRecorder
from highfive.hil.recording.one_recording import SUFFIX, one_recording
from highfive.hil.recording.recorder import SessionRecorder
from highfive.hil.recording.replay import Replay
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.runtime.console import Bar, given_command, say_aside
from highfive.hil.runtime.folders import results_folder
from highfive.hil.runtime.interrupts import interrupted_between_ticks
from highfive.hil.session.reach_settings import SEEN_LATE
from highfive.hil.session.session import UNSEEN_AT_REST, Session
from highfive.hil.sim.people.grid import CELLS
from highfive.hil.sim.scene import Scene, build_scene
from highfive.hil.sim.viewpoint import viewpoint
from highfive.hil.trials.partners import Partner
from highfive.hil.trials.summary import SessionSettings, summarise
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.sources.address import is_live
from highfive.mocap_bridge.tracking.filter_settings import HEADSET
from highfive.model import DEFAULT_MODEL
from highfive.model.compiled import when_compiling
from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Trial
from highfive.model.online.reaction import ReactionModel

if TYPE_CHECKING:
    from highfive.calibration.headset_file import KeptRegistration
    from highfive.hil.arm.arm_trial import ArmWatch
    from highfive.hil.arm.planner import Retarget
    from highfive.hil.publish.outputs import SessionOutputs
    from highfive.hil.report.film import Strip
    from highfive.hil.sim.rendering import NoPictures
    from highfive.hil.trials.head_watch import DriftWatch
    from highfive.hil.trials.live_partner import LivePerson
    from highfive.hil.trials.live_wiring import LiveWiring
    from highfive.hil.view.live_page import LivePage

RECORDING = "session.mcap"
"""In a session's folder."""
PREPARING = (
    "model, scene and people are prepared, then the page's address follows; the first time after installing it takes "
    "minutes, for then it compiles"
)
"""Is said before that; simulated people take most of it."""

# What only an arm, a live person or the report need is imported where it is needed: it takes seconds.


def which_model(name: str | None) -> Path | str:
    """What a user means by a model's ``name``: a file, a model of one's own, or, for None, the one that comes along."""
    return DEFAULT_MODEL if name is None else name if is_plugin(name) else Path(name)


def simulate(options: SimulateOptions, folder: Path, bar: Bar, wiring: LiveWiring | None = None) -> dict[str, Any]:
    """Runs the session into ``folder`` and returns the summary; Ctrl-C ends it early and writes what there is.

    With an arm only the first Ctrl-C interrupts: who stops an arm presses more than once.

    Args:
        options: what to simulate.
        folder: for the results.
        bar: shows how far it is.
        wiring: of a live person; None for this computer's.

    Raises:
        HighFiveError: something requested does not exist or does not fit; the folder holds something already or
            cannot be written.
    """
    live = options.source is not None and is_live(options.source)
    worn = live and wears_headset(options)
    options = with_page(options) if worn else options if live else _without_folder(options)
    again = options.source is not None and not live and options.source.endswith(SUFFIX)
    with ExitStack() as stack, when_compiling(lambda: say_aside("compiling, once after installing: a minute or two")):
        stack.enter_context(interrupted_between_ticks())  # first: an arm's handlers of Ctrl-C call this one
        _check(options, live, again)
        beside = registered_headset(options, live)
        if beside is not None and options.view is None:
            options = replace(options, view=PageOptions())
        stack.enter_context(results_folder(folder, options.overwrite))
        options = with_arm(options, live, stack, wiring)
        if sees_webcam(options):
            from highfive.hil.view.webcam_files import net_files  # noqa: PLC0415

            net_files()  # are they there?
        model, scene, watch, page, person = _model(options, bar), build_scene(), None, None, None
        with ExitStack() as parts:
            publishers = open_publishers(options, parts)
            if worn:  # the page is what tracks her
                watch = arm_watch(options, bar, load_marker_set(SCHEME), parts)
                page = _page(options, model, watch, parts)
                wiring = headset_wiring(options, page, wiring)
            if sees_webcam(options):  # who is seen by the page is there after the page
                from highfive.hil.commands.webcam_session import webcam_person  # noqa: PLC0415

                page = _page(options, model, None, parts)
                person = webcam_person(options, page, parts)
            elif live:
                from highfive.hil.commands.live_session import live_person  # noqa: PLC0415

                person = live_person(options, parts, wiring, worn_set(options), page)
            replay = replay_of(options, _name(options)) if again else None
            partners = partners_of(options, model, bar, person) if replay is None else replay.partners(options.trials)
            settings = _settings(options, len(partners))
            publishers += open_outlets(options, partners[0].marker_set.names, person, parts)
            if not worn:
                watch = arm_watch(options, bar, partners[0].marker_set, parts)
            # Before there is a recording: it compiles; who interrupts that leaves nothing in the next attempt's way.
            clock = MACHINE if wiring is None else wiring.clock
            clock = clock if watch is None else watch.loop.clock
            session = _session(options, model, scene, partners[0], person, clock, replay)
            if options.view is not None and page is None:
                page = _page(options, model, watch, parts, None if beside is None else (beside, person))
                _let_speak(person, page)
            drift = None if beside is None else _drift(beside, person, page)
            paced = publishers or options.record_lsl or person is not None or watch is not None or page is not None
            recorder = BackgroundRecorder(
                SessionRecorder(folder / RECORDING, settings, session.chain), paced=bool(paced)
            )
            outputs = session_outputs(options, recorder, publishers, person, clock)
            played = play(options, session, scene, partners, person, outputs, bar, watch, page, replay, drift)
            if page is not None:
                page.tell("over", **over_told(played, folder))
        planned, replayed = None if watch is None else watch.loop.retarget, replay and replay.summary()
        return _report(options, played, outputs, recorder.trouble, replayed, settings, folder, bar, planned)


def _check(options: SimulateOptions, live: bool, again: bool) -> None:
    """That the options go together."""
    viewpoint(options.film_view)
    check_live_options(options, live)
    check_output_options(options, again=again)
    if again:
        check_replay_options(options)
    if options.view is not None:
        check_port(options.view)
    if options.view is not None and options.arm is not None and options.arm.port == "virtual":
        raise HighFiveError("--view shows what goes at the pace of the clock; --rig virtual does not: --rig emulated")


def _without_folder(options: SimulateOptions) -> SimulateOptions:
    """A folder as the source is the recording in it."""
    if options.source is None or not Path(options.source).is_dir():
        return options
    return replace(options, source=str(one_recording(Path(options.source))))


def _model(options: SimulateOptions, bar: Bar) -> HGPDM | ReactionModel:
    """The model that answers; one of the user's own learns here. It takes a while from here on, so that is said."""
    if options.view is not None:
        say_aside(PREPARING)
    if options.data is None:
        return open_model(options.model)
    if not is_plugin(options.model):
        raise HighFiveError(f"--data is what a model of your own learns from; {options.model} has learned")
    return open_model(options.model, partial(_training_trials, options.data, bar))


def _training_trials(data: Path, bar: Bar) -> list[Trial]:
    from highfive.hil.datasets.training_data import load_trials  # noqa: PLC0415

    pairs = load_trials(data, progress=lambda total: bar("solving markers", total), learn_only=True)
    return [pair.trial for pair in pairs]


def _let_speak(person: LivePerson | None, page: LivePage) -> None:
    """What a live person is told from now on is on the page, too."""
    if person is not None:
        from highfive.hil.commands.page import saying_to  # noqa: PLC0415

        person.say = saying_to(page)


def _drift(kept: KeptRegistration, person: LivePerson | None, page: LivePage | None) -> DriftWatch:
    from highfive.hil.commands.headset_beside import drift_watch  # noqa: PLC0415

    assert person is not None and page is not None
    return drift_watch(kept, person, page)


def _page(
    options: SimulateOptions, model: HGPDM | ReactionModel, watch: ArmWatch | None, stack: ExitStack,
    beside: tuple[KeptRegistration, LivePerson | None] | None = None,
) -> LivePage:  # fmt: skip
    """The live page; the session begins when somebody looks on. ``beside`` is a headset that shows it, and whom."""
    from highfive.hil.commands.session_page import session_page  # noqa: PLC0415

    cells = list(options.cells or CELLS) if options.source is None else []
    about = {"mode": "session", "title": _shown(options.source), "emotions": list(model.emotions), "cells": cells}
    return session_page(options, about, watch, stack, beside)


def _report(
    options: SimulateOptions,
    played: Played,
    outputs: SessionOutputs,
    unrecorded: str,
    replayed: dict[str, Any] | None,
    settings: SessionSettings,
    folder: Path,
    bar: Bar,
    retarget: Retarget | None,
) -> dict[str, Any]:
    """Writes report, figures and film; the summary."""
    from highfive.hil.report.report import write_report  # noqa: PLC0415

    arm, drawings = None, []
    if played.arm is not None and retarget is not None:
        from highfive.hil.arm.arm_figures import arm_summary  # noqa: PLC0415
        from highfive.hil.arm_model.arm_folder import find_arm  # noqa: PLC0415
        from highfive.hil.report.arm_report import draw_arm  # noqa: PLC0415

        figures = played.arm.figures
        assert options.arm is not None
        names = find_arm(options.arm.arm).names
        arm, whole = arm_summary(figures, retarget, options.arm.lower), list(played.arm.whole.values())
        drawings = draw_arm(whole, retarget.settings.lag, figures, names)
    summary = summarise(
        played.results, settings, interrupted=played.interrupted, unrecorded=unrecorded, replayed=replayed, arm=arm,
        streams=outputs.stream_rows(),
    )  # fmt: skip
    if played.interrupted and options.pictures:
        say_aside("interrupted: report and film of what was played are made; Ctrl-C again leaves out the pictures")
    strips, film = _pictures(options, played, folder, bar)
    write_report(folder, summary, played.results, settings, strips, film, drawings)
    return summary


def _name(options: SimulateOptions) -> str:
    """Of the model."""
    return options.model if isinstance(options.model, str) else options.model.name


def _settings(options: SimulateOptions, trials: int) -> SessionSettings:
    return SessionSettings(
        seed=options.seed,
        model=_name(options),
        trials=trials,
        style=None if options.style is None else dict(options.style),
        corrected=options.correct,
        physics=options.physics,
        source=_shown(options.source),
        arm="" if options.arm is None else options.arm.port,
        arm_name="" if options.arm is None else options.arm.arm,
        command=given_command(),
    )


def _pictures(
    options: SimulateOptions, played: Played, folder: Path, bar: Bar
) -> tuple[Sequence[Strip] | NoPictures, Path | NoPictures]:
    from highfive.hil.sim.rendering import NoPictures  # noqa: PLC0415

    results = played.results
    if not options.pictures or not results:
        none = NoPictures("pictures left out: " + ("no trial was finished" if options.pictures else "--no-pictures"))
        return none, none
    try:
        from highfive.hil.arm_model.arm_folder import find_arm  # noqa: PLC0415
        from highfive.hil.report.film import Arms, make_film, picture_strips  # noqa: PLC0415
        from highfive.hil.report.report import FILM  # noqa: PLC0415
        from highfive.hil.sim.arm_body import arm_in_scene  # noqa: PLC0415

        visible = build_scene(visible=True)
        view = viewpoint(options.film_view)
        view.apply(visible.model)
        whole = {} if played.arm is None else played.arm.whole
        arms = None
        if options.arm is not None and whole:
            which = find_arm(options.arm.arm)
            arms = Arms(arm_in_scene(which.mount, avatar=False, visible=True, folder=which), whole)
            view.apply(arms.scene.model)
        film = folder / FILM
        return picture_strips(visible, results, arms), make_film(visible, results, film, bar, arms)
    except KeyboardInterrupt:
        none = NoPictures("pictures left out: interrupted")
        return none, none


def _shown(source: str | None) -> str:
    """A source as figures show it: an address, or a file without its folders."""
    return "" if source is None else source if is_live(source) else Path(source).name


def _session(
    options: SimulateOptions, model: HGPDM | ReactionModel, scene: Scene, partner: Partner, person: LivePerson | None,
    clock: Clock, replay: Replay | None,
) -> Session:  # fmt: skip
    style = options.style or {partner.emotion: 1.0}
    worn = wears_headset(options)
    settings, tracking = (UNSEEN_AT_REST, HEADSET) if worn else (None, None if person is None else person.tracking)
    reach = SEEN_LATE if sees_webcam(options) else None
    if replay is not None:
        settings, tracking, reach = replay.pose, replay.tracking, replay.reach
    return Session(
        model, style, partner.marker_set, scene,
        correct=options.correct, settings=settings, tracking=tracking, reach=reach, clock=clock,
    )  # fmt: skip
