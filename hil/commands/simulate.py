"""One simulated session: partner, tracker, responder, correction, MuJoCo; then report, film and recording."""

from __future__ import annotations

import gc
import logging
import shlex
import signal
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import cycle, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from highfive.hil.commands.live_options import check_live_options
from highfive.hil.commands.programme import Programme
from highfive.hil.commands.simulate_options import SimulateOptions
from highfive.hil.evaluation.reaction_models import is_plugin, open_model
from highfive.hil.recording.recording import SessionRecorder
from highfive.hil.runtime.console import Bar, say_aside
from highfive.hil.runtime.folders import results_folder
from highfive.hil.runtime.threads import quick_switching
from highfive.hil.session.session import RATE_HZ, Session, Tick, TickInput
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.people.grid import CELLS
from highfive.hil.sim.playout import KinematicPlayOut, PhysicsPlayOut, PlayOut
from highfive.hil.sim.scene import Scene, build_scene
from highfive.hil.trials.partners import Partner, recorded_partner, simulated_partners
from highfive.hil.trials.summary import SessionSettings, summarise
from highfive.hil.trials.trial import as_captured, run_trial, style_name
from highfive.hil.trials.trial_result import TrialResult
from highfive.hil.view.interruption import Interruption
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.sources.address import WEBCAM, is_live
from highfive.mocap_bridge.sources.source import C3DSource
from highfive.model import DEFAULT_MODEL
from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.style import style_weights
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Trial
from highfive.model.online.reaction import ReactionModel
from highfive.model.plugins import PluginError

if TYPE_CHECKING:
    from highfive.hil.arm.arm_options import ArmOptions
    from highfive.hil.arm.arm_trial import ArmTrial, ArmWatch
    from highfive.hil.report.film import Strip
    from highfive.hil.sim.rendering import NoPictures
    from highfive.hil.trials.live_partner import LivePerson
    from highfive.hil.trials.live_wiring import LiveWiring
    from highfive.hil.view.live_page import LivePage
    from highfive.hil.view.session_view import SessionView

# What only an arm, a live person or the report need is imported where it is needed: it takes seconds.


def which_model(name: str | None) -> Path | str:
    """What a user means by a model's ``name``: a file, a model of one's own, or, for None, the one that comes along."""
    return DEFAULT_MODEL if name is None else name if is_plugin(name) else Path(name)


@dataclass(frozen=True)
class _Played:
    """The trials that were finished, what the arm did in them (by number), and whether the session ended early."""

    results: list[TrialResult] = field(default_factory=list)
    arm: dict[int, ArmTrial] = field(default_factory=dict)
    interrupted: bool = False


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
    with ExitStack() as stack:
        check_live_options(options, live)
        if options.view is not None and options.arm is not None and options.arm.port == "virtual":
            raise HighFiveError(
                "--view shows what goes at the pace of the clock; --rig virtual does not: --rig emulated"
            )
        stack.enter_context(results_folder(folder, options.overwrite))
        if options.arm is not None:
            from highfive.hil.arm.emergency_stop import uninterrupted  # noqa: PLC0415
            from highfive.hil.arm.preconditions import check_arm  # noqa: PLC0415

            arm = replace(options.arm, person=str(options.source) if live else "")
            check_arm(arm)
            options = replace(options, arm=arm)
            stack.enter_context(uninterrupted((signal.SIGINT,), once=True))
        if options.source == WEBCAM:
            from highfive.hil.view.webcam_files import net_files  # noqa: PLC0415

            net_files()  # are they there?
        model, person = _model(options, bar), None
        if live and options.source != WEBCAM:
            from highfive.hil.commands.live_session import live_person  # noqa: PLC0415

            person = live_person(options, stack, wiring, _marker_set(options))
        return _simulate(options, model, folder, bar, person)


def _model(options: SimulateOptions, bar: Bar) -> HGPDM | ReactionModel:
    """The model that answers; one of the user's own learns here."""
    if options.data is None:
        return open_model(options.model)
    if not is_plugin(options.model):
        raise HighFiveError(f"--data is what a model of your own learns from; {options.model} has learned")
    return open_model(options.model, partial(_training_trials, options.data, bar))


def _training_trials(data: Path, bar: Bar) -> list[Trial]:
    from highfive.hil.datasets.training_data import load_trials  # noqa: PLC0415

    pairs = load_trials(data, progress=lambda total: bar("solving markers", total), learn_only=True)
    return [pair.trial for pair in pairs]


def _simulate(
    options: SimulateOptions, model: HGPDM | ReactionModel, folder: Path, bar: Bar, person: LivePerson | None
) -> dict[str, Any]:
    with ExitStack() as stack:
        page = None
        if options.source == WEBCAM:  # who is seen by the page is there after the page
            from highfive.hil.commands.webcam_session import webcam_person  # noqa: PLC0415

            page = _page(options, model, None, stack)
            person = webcam_person(options, page, stack)
        partners = _partners(options, model, bar, person)
        scene = build_scene()
        settings = _settings(options, len(partners))
        watch = None if options.arm is None else _arm_watch(options.arm, bar, partners[0].marker_set, stack)
        # Before there is a recording: it compiles, and who interrupts that leaves nothing in the next attempt's way.
        session = _session(options, model, scene, partners[0], person)
        if page is None and options.view is not None:
            page = _page(options, model, watch, stack)
        recorder = SessionRecorder(folder / "session.mcap", settings)
        played = _run(options, session, scene, partners, person, recorder, bar, watch, page)
        if page is not None:
            page.tell("over", message=f"The session is over: {folder / 'report.html'}")
    return _report(options, played, settings, folder, bar, 0.0 if watch is None else watch.loop.retarget.settings.lag)


def _page(options: SimulateOptions, model: HGPDM | ReactionModel, watch: ArmWatch | None, stack: ExitStack) -> LivePage:
    """The live page; the session begins when somebody looks on."""
    from highfive.hil.commands.page import open_page  # noqa: PLC0415

    assert options.view is not None
    webcam = options.source == WEBCAM
    cells = list(options.cells or CELLS) if options.source is None else []
    about = {"mode": "session", "title": _shown(options.source), "emotions": list(model.emotions), "cells": cells}
    estop = None if watch is None else watch.loop.estop
    about |= {"arm": estop is not None, "rig": estop is not None, "webcam": webcam}
    opened = None
    if webcam and options.webcam.video is not None:
        from highfive.hil.commands.webcam_session import watch_video  # noqa: PLC0415

        opened = partial(watch_video, options, stack=stack)
    return stack.enter_context(open_page(options.view, about, estop, opened))


def _arm_watch(options: ArmOptions, bar: Bar, worn: MarkerSet, stack: ExitStack) -> ArmWatch:
    from highfive.hil.arm.arm_trial import ArmWatch  # noqa: PLC0415
    from highfive.hil.arm.lifecycle import ready_arm  # noqa: PLC0415

    return ArmWatch(stack.enter_context(ready_arm(options, bar, worn)))


def _report(
    options: SimulateOptions, played: _Played, settings: SessionSettings, folder: Path, bar: Bar, lag: float
) -> dict[str, Any]:
    """Writes report, figures and film; the summary."""
    from highfive.hil.report.report import write_report  # noqa: PLC0415

    arm, drawings = None, []
    if options.arm is not None:
        from highfive.hil.arm.arm_trial import arm_summary  # noqa: PLC0415
        from highfive.hil.report.arm_report import draw_arm  # noqa: PLC0415

        trials = list(played.arm.values())
        arm, drawings = arm_summary(trials, lag), draw_arm(trials, lag)
    summary = summarise(played.results, settings, interrupted=played.interrupted, arm=arm)
    strips, film = _pictures(options, played, folder, bar)
    write_report(folder, summary, played.results, settings, strips, film, drawings)
    return summary


def _settings(options: SimulateOptions, trials: int) -> SessionSettings:
    return SessionSettings(
        seed=options.seed,
        model=options.model if isinstance(options.model, str) else options.model.name,
        trials=trials,
        style=None if options.style is None else dict(options.style),
        corrected=options.correct,
        physics=options.physics,
        source=_shown(options.source),
        arm="" if options.arm is None else options.arm.port,
        command=shlex.join(["highfive", *sys.argv[1:]]),
    )


def _pictures(
    options: SimulateOptions, played: _Played, folder: Path, bar: Bar
) -> tuple[Sequence[Strip] | NoPictures, Path | NoPictures]:
    from highfive.hil.sim.rendering import NoPictures  # noqa: PLC0415

    results = played.results
    if not options.pictures or not results:
        none = NoPictures("pictures left out: " + ("no trial was finished" if options.pictures else "--no-pictures"))
        return none, none
    try:
        from highfive.hil.arm_model.servo_arm import DEFAULT_MOUNT  # noqa: PLC0415
        from highfive.hil.report.film import Arms, make_film, picture_strips  # noqa: PLC0415
        from highfive.hil.report.report import FILM  # noqa: PLC0415
        from highfive.hil.sim.arm_body import arm_in_scene  # noqa: PLC0415

        visible = build_scene(visible=True)
        arms = Arms(arm_in_scene(DEFAULT_MOUNT, avatar=False, visible=True), played.arm) if played.arm else None
        film = folder / FILM
        return picture_strips(visible, results, arms), make_film(visible, results, film, bar, arms)
    except KeyboardInterrupt:
        none = NoPictures("pictures left out: interrupted")
        return none, none


def _partners(
    options: SimulateOptions, model: HGPDM | ReactionModel, bar: Bar, person: LivePerson | None
) -> list[Partner]:
    emotions = options.emotions or (_leading(options.style),) if options.style else options.emotions or model.emotions
    for emotion in (*emotions, *(options.style or {})):
        if emotion not in model.emotions:
            raise HighFiveError(f"unknown emotion {emotion!r}; the model knows {', '.join(model.emotions)}")
    if options.style is not None:
        style_weights(options.style, model.emotions)
    if options.trials is not None and options.trials < 1:
        raise HighFiveError(f"{options.trials} trials; ask for at least one")
    if options.source is None:
        absent = [emotion for emotion in emotions if emotion not in EMOTIONS]
        if absent:
            raise HighFiveError(f"the simulated person does not know {absent[0]!r}; she knows {', '.join(EMOTIONS)}")
        cells = options.cells or CELLS
        strange = [cell for cell in cells if cell not in CELLS]
        if strange:
            raise HighFiveError(f"unknown cell {strange[0]!r}; the grid has {', '.join(CELLS)}")
        count = options.trials or len(cells) * len(emotions)
        return simulated_partners(count, emotions, cells, options.seed, lambda total: bar("people", total))
    if options.cells:
        raise HighFiveError("--cell goes with the simulated person; a real one raises the hand where she does")
    if person is not None:
        return [person.partner(emotion) for emotion in islice(cycle(emotions), options.trials or len(emotions))]
    first = recorded_partner(Path(options.source), options.human, _marker_set(options), emotions[0])
    return [first.in_emotion(emotion) for emotion in emotions][: options.trials]


def _marker_set(options: SimulateOptions) -> MarkerSet | None:
    return load_marker_set(options.marker_set) if options.marker_set else None


def _shown(source: str | None) -> str:
    """A source as figures show it: an address, or a file without its folders."""
    return "" if source is None else source if is_live(source) else Path(source).name


def _leading(style: Mapping[str, float]) -> str:
    return max(style, key=lambda emotion: style[emotion])


def _run(
    options: SimulateOptions,
    session: Session,
    scene: Scene,
    partners: list[Partner],
    person: LivePerson | None,
    recorder: SessionRecorder,
    bar: Bar,
    watch: ArmWatch | None,
    page: LivePage | None,
) -> _Played:
    played = _Played()
    results = played.results
    with recorder, quick_switching():
        try:
            playout: PlayOut = PhysicsPlayOut(scene) if options.physics else KinematicPlayOut(scene)
            advance = bar("high fives", len(partners))
            view = None if page is None else _view(page, session, playout, scene, watch)
            programme = Programme(options, partners, view)
            # What was built until now is not garbage: a collection in the tick need not look at it.
            gc.collect()
            gc.freeze()
            while programme:
                partner, style = programme.take()
                session.set_style(style)
                called, number = style_name(style), programme.number
                try:
                    programme.begin(partner, style)
                    result, trouble = _trial(number, partner, called, session, playout, person, watch, view)
                except Interruption as asked:
                    programme.follow(asked.wish, partner)
                    continue
                except PluginError as error:  # a model of the user's own
                    result, trouble = None, str(error)
                if result is None:  # a high five that was broken off says nothing of how well palms meet
                    _tell_broken_off(number, trouble, recorder, watch, first=not results)
                    return replace(played, interrupted=True)
                result = replace(result, style=programme.style_name(style))
                arm = None if watch is None else watch.end(result.style, partner.cell, partner.contact_frame)
                recorder.record_trial(result, arm)
                results.append(result)
                if arm is not None:
                    played.arm[number] = arm
                advance()
                if watch is not None and watch.loop.trouble:
                    say_aside(f"the arm was stopped: {watch.loop.trouble}", logging.WARNING)
                    _advise(_remedy(watch, arm))
                    if view is not None:
                        view.stopped()
                    return replace(played, interrupted=True)
                programme.judged(result, partner)
        except KeyboardInterrupt:
            return replace(played, interrupted=True)
        finally:
            gc.unfreeze()
    return replace(played, interrupted=programme.ended)


def _view(page: LivePage, session: Session, playout: PlayOut, scene: Scene, watch: ArmWatch | None) -> SessionView:
    from highfive.hil.view.session_view import SessionView  # noqa: PLC0415

    return SessionView(page, session, playout, scene, arm=None if watch is None else watch.joints)


def _tell_broken_off(
    number: int, trouble: str, recorder: SessionRecorder, watch: ArmWatch | None, *, first: bool
) -> None:
    """A high five that was broken off.

    Raises:
        HighFiveError: it was the first one.
    """
    remedy = "" if watch is None else _remedy(watch, None)
    if first:
        recorder.discard()  # an empty recording would only be in the way of the next attempt
        raise HighFiveError(f"no high five could be played: {trouble}{remedy and '; ' + remedy}")
    say_aside(f"high five {number + 1} was broken off and does not count: {trouble}", logging.WARNING)
    _advise(remedy)


def _remedy(watch: ArmWatch, arm: ArmTrial | None) -> str:
    from highfive.hil.arm.busy import too_busy  # noqa: PLC0415

    return too_busy(arm, watch.loop.cycles(), watch.loop.stopped_by)


def _advise(remedy: str) -> None:
    if remedy:
        say_aside(remedy)


def _trial(
    number: int,
    partner: Partner,
    style: str,
    session: Session,
    playout: PlayOut,
    person: LivePerson | None,
    watch: ArmWatch | None,
    view: SessionView | None,
) -> tuple[TrialResult | None, str]:
    """A trial, or None and why it was broken off."""
    if person is None and watch is None and view is None:
        return run_trial(number, partner, session, playout), ""
    try:
        if watch is not None:
            watch.begin()
    except HighFiveError as error:
        return None, str(error)
    live = None if person is None else person.trial()
    inputs: Iterable[TickInput] = _recorded(partner, watch, view) if live is None else live
    watchers = [each for each in (live, watch, view) if each is not None]
    for each in (watch, view):
        inputs = inputs if each is None else each.inputs(inputs)

    def seen(tick: Tick) -> None:
        for each in watchers:
            each.watch(tick)

    if live is None:
        return run_trial(number, partner, session, playout, inputs, seen), ""
    assert person is not None
    person.say(f"high five {number + 1}, {style}: raise the right hand")
    result = run_trial(number, partner, session, playout, inputs, seen) if live.begins() else None
    if result is None or live.trouble:
        return None, live.trouble
    ahead = float(np.median(live.ahead_ms))
    note = (
        f"{live.count} ticks, {live.late} late, {live.predicted} between frames, {live.stale} of them stale; "
        f"poses {ahead:.1f} ms ahead of the newest frame"
    )
    result = replace(result, notes=(*result.notes, note))
    if person.camera is not None:
        from highfive.hil.trials.screen_contact import seen_on_screen  # noqa: PLC0415

        result = seen_on_screen(result, person.camera)
    return result, ""


def _recorded(partner: Partner, watch: ArmWatch | None, view: SessionView | None) -> Iterable[TickInput]:
    """The partner's recording at the pace of the clock; the arm's, where there is one."""
    source = C3DSource(partner.recording, RATE_HZ)
    if watch is not None:
        from highfive.hil.arm.lifecycle import at_their_time  # noqa: PLC0415

        return as_captured(at_their_time(source, watch.loop.clock))
    assert view is not None
    return as_captured(view.in_time(source))


def _session(
    options: SimulateOptions, model: HGPDM | ReactionModel, scene: Scene, partner: Partner, person: LivePerson | None
) -> Session:
    style = options.style or {partner.emotion: 1.0}
    tracking = None if person is None else person.tracking
    return Session(model, style, partner.marker_set, scene, correct=options.correct, tracking=tracking)
