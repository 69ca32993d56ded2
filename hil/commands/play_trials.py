"""The high fives of a session played one after the other: judged, recorded, shown, with an arm or without."""

from __future__ import annotations

import gc
import logging
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from highfive.hil.commands.programme import Programme
from highfive.hil.commands.simulate_options import SimulateOptions
from highfive.hil.publish.outputs import SessionOutputs
from highfive.hil.recording.background import said_in
from highfive.hil.recording.recorded_tick import recorded_tick
from highfive.hil.recording.recorder import TrialHead
from highfive.hil.runtime.clock import MACHINE
from highfive.hil.runtime.console import Bar, say_aside
from highfive.hil.runtime.threads import quick_switching
from highfive.hil.session.session import RATE_HZ, Session, Tick, TickInput
from highfive.hil.sim.playout import KinematicPlayOut, PhysicsPlayOut, PlayOut, PlayState
from highfive.hil.sim.scene import Scene
from highfive.hil.trials.events import TrialEvents
from highfive.hil.trials.partners import Partner
from highfive.hil.trials.trial import as_captured, run_trial, style_name
from highfive.hil.trials.trial_result import TrialResult
from highfive.hil.view.interruption import Interruption
from highfive.mocap_bridge.sources.source import C3DSource
from highfive.model.errors import HighFiveError
from highfive.model.plugins import PluginError

if TYPE_CHECKING:
    from highfive.hil.arm.arm_figures import ArmResults
    from highfive.hil.arm.arm_trial import ArmTrial, ArmWatch
    from highfive.hil.recording.replay import Replay
    from highfive.hil.trials.head_watch import DriftWatch
    from highfive.hil.trials.live_partner import LivePerson
    from highfive.hil.view.live_page import LivePage
    from highfive.hil.view.session_view import SessionView

WHOLE = 144
"""High fives whose every tick is kept for figures and film: four times the grid. Of more, a long session keeps the
figures only; the recording has all of them."""

# What only an arm or the live page need is imported where it is needed: it takes seconds.


@dataclass(frozen=True)
class Played:
    """The trials that were finished, what the arm did in them, and whether, and why, the session ended early."""

    results: list[TrialResult] = field(default_factory=list)
    arm: ArmResults | None = None
    interrupted: bool = False
    why: str = ""


def over_told(played: Played, folder: Path) -> dict[str, str]:
    """What the page is told at the end: whether the session ended early, and why, in words; and where the report is."""
    line = f"The session ended early: {played.why}." if played.interrupted and played.why else "The session is over."
    return {"message": line, "report": str((folder / "report.html").absolute())}


def play(
    options: SimulateOptions,
    session: Session,
    scene: Scene,
    partners: list[Partner],
    person: LivePerson | None,
    recorder: SessionOutputs,
    bar: Bar,
    watch: ArmWatch | None,
    page: LivePage | None,
    replay: Replay | None = None,
    drift: DriftWatch | None = None,
) -> Played:
    """Plays the partners in order; Ctrl-C, a broken-off high five or a stopped arm ends the session early.

    The high fives of a ``replay`` begin with what the recorded ones began with. ``drift`` watches a headset that is
    worn beside a lab's system.

    Raises:
        HighFiveError: not even the first high five could be played.
    """
    played = Played() if watch is None else Played(arm=_nothing_yet())
    results, begun = played.results, list[Kept]()
    with recorder, said_in(recorder), quick_switching():
        try:
            playout: PlayOut = PhysicsPlayOut(scene) if options.physics else KinematicPlayOut(scene)
            advance = bar("high fives", len(partners))
            view = None if page is None else _view(options, page, session, playout, scene, watch, recorder)
            programme = Programme(options, partners, view, () if replay is None else replay.styles)
            # What was built until now is not garbage: a collection in the tick need not look at it.
            gc.collect()
            gc.freeze()
            recorder.record_event("session_start")
            while programme:
                partner, style = programme.take()
                session.set_style(style)
                called, number = style_name(style), programme.number
                try:
                    programme.begin(partner, style)
                    paced = recorder.paced or person is not None or watch is not None or view is not None
                    head = TrialHead(number, partner, called, style, session.corrects, paced)
                    begun[:] = [kept := Kept(recorder, head, watch, session, replay)]
                    result, trouble = _trial(
                        number, partner, called, session, playout, person, watch, view, drift, kept, replay
                    )
                except Interruption as asked:
                    recorder.record_event("trial_broken_off", trial=number, detail=f"{asked.wish} was asked for")
                    programme.follow(asked.wish, partner)
                    continue
                except PluginError as error:  # a model of the user's own
                    result, trouble = None, str(error)
                if result is None:  # a high five that was broken off says nothing of how well palms meet
                    _add_broken_off(played, kept, watch)
                    _tell_broken_off(
                        options, number, trouble, recorder, watch, view, first=not results, empty=not kept.begun
                    )
                    return replace(played, interrupted=True, why=trouble)
                result = replace(result, style=kept.called)
                kept.end(result)
                arm = None if watch is None else _arm_of(number, watch, result.style, partner, recorder)
                results.append(result if len(results) < WHOLE else result.condensed())
                if watch is not None and arm is not None and played.arm is not None:
                    played.arm.add(number, arm, watch.loop.retarget, watch.loop.limits, watch.loop.trouble)
                advance()
                if watch is not None and watch.loop.trouble:
                    why = f"the arm was stopped: {watch.loop.trouble}"
                    _tell_stopped(options, number, why, arm, recorder, watch, view)
                    return replace(played, interrupted=True, why=why)
                programme.judged(result, partner)
        except KeyboardInterrupt:
            _cut_short(options, played, begun, recorder, watch)
            return replace(played, interrupted=True, why="interrupted at the computer that ran it")
        finally:
            recorder.end()
            gc.unfreeze()
    return replace(played, interrupted=programme.ended, why="ended on the page" if programme.ended else "")


def _arm_of(number: int, watch: ArmWatch, style: str, partner: Partner, recorder: SessionOutputs) -> ArmTrial | None:
    """What the arm did; says where it was never found fit to follow."""
    if watch.kept_back:
        recorder.record_event("fault", trial=number, detail=watch.kept_back)
        say_aside(f"the arm did not take part: {watch.kept_back}", logging.WARNING)
    return watch.end(style, partner.cell, partner.contact_frame)


def _add_broken_off(played: Played, kept: Kept, watch: ArmWatch | None) -> None:
    """What the arm did in a high five that was broken off counts among its cycles, not among those that met."""
    if not kept.begun or kept.over:
        return
    partner, number = kept.head.partner, kept.head.number
    arm = None if watch is None else watch.end(kept.called, partner.cell, partner.contact_frame)
    if watch is not None and arm is not None and played.arm is not None:
        broken_off = replace(arm, broken_off=True)
        played.arm.add(number, broken_off, watch.loop.retarget, watch.loop.limits, watch.loop.trouble)


def _cut_short(
    options: SimulateOptions, played: Played, begun: list[Kept], recorder: SessionOutputs, watch: ArmWatch | None
) -> None:
    """The high five that Ctrl-C broke off; the same has stopped an arm."""
    for kept in begun:
        _add_broken_off(played, kept, watch)
        if watch is not None and watch.loop.trouble:
            why = f"the arm was stopped: {watch.loop.trouble}"
            _tell_stopped(options, kept.head.number, why, None, recorder, watch, None)


def _nothing_yet() -> ArmResults:
    from highfive.hil.arm.arm_figures import ArmResults  # noqa: PLC0415

    return ArmResults()


class Kept:
    """A high five on its way into the recording, tick by tick; in a ``with``, however it ends: so does the arm's way
    back to where it rests.

    Attributes:
        head: number, person and style.
        style: in which the avatar answers now: another one than at first where somebody changed it.
        paced: its ticks go by the clock.
        streams: events of the sources.
        over: it was judged.
    """

    def __init__(
        self,
        recorder: SessionOutputs,
        head: TrialHead,
        watch: ArmWatch | None,
        session: Session,
        replay: Replay | None,
    ) -> None:
        """Begins with the first tick."""
        self.paced, self.streams = head.paced, recorder.streams
        self._recorder, self.head, self._watch = recorder, head, watch
        self._session, self._replay = session, replay
        self._asked, self.style = (session.weights, session.corrects), head.style
        self._events, self._about = TrialEvents(), {"trial": head.number, "emotion": head.partner.emotion}
        self._begun = self.over = False
        self._met_in: str | None = None

    def __call__(self, begins: TickInput, tick: Tick, state: PlayState, tick_ms: float) -> None:
        """A tick."""
        if not self._begun:
            self._recorder.begin_trial(self.head)
        self._recorder.record_tick(recorded_tick(begins, tick, state.pose, tick_ms))
        first, self._begun = not self._begun, True
        self.record_arm()
        happened = self._events(tick, state)
        if "contact" in happened:
            self._met_in = self.style
        for event in ["trial_start", *happened] if first else happened:
            self._recorder.record_event(event, begins.at_ns, style=self.style, **self._about)
        if (asked := (self._session.weights, self._session.corrects)) != self._asked:
            self._asked, self.style = asked, style_name(asked[0])
            about = {"weights": dict(asked[0]), "corrects": asked[1], **self._about}
            self._recorder.record_event("answer_changed", begins.at_ns, style=self.style, **about)
        if self._replay is not None:
            self._replay.check(self.head.number, tick)

    @property
    def called(self) -> str:
        """The style that it is called by: in which palms met, and else the last; somebody may change it meanwhile."""
        return self.style if self._met_in is None else self._met_in

    @property
    def begun(self) -> bool:
        """A tick of it was recorded."""
        return self._begun

    def __enter__(self) -> Kept:
        """Self."""
        if self._watch is not None:
            self._watch.record = self.record_arm
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """The arm goes to where it rests, if it is not there."""
        if self._watch is not None:
            self._watch.rest()
        if kind is KeyboardInterrupt and self._begun:
            detail = "interrupted at the computer that ran it"
            self._recorder.record_event("trial_broken_off", trial=self.head.number, detail=detail)

    def end(self, result: TrialResult) -> None:
        """It is over, and judged."""
        self.over = True
        self.record_arm()
        self._recorder.end_trial(result)
        self._recorder.record_event("trial_end", style=result.style, **self._about)

    def record_arm(self) -> None:
        """What the arm did since the last call; after the first tick."""
        if self._watch is not None and self._begun:
            self._recorder.record_arm(*self._watch.fresh())


def _view(
    options: SimulateOptions, page: LivePage, session: Session, playout: PlayOut, scene: Scene, watch: ArmWatch | None,
    recorder: SessionOutputs,
) -> SessionView:  # fmt: skip
    from highfive.hil.view.session_view import SessionView  # noqa: PLC0415

    view = SessionView(
        page, session, playout, scene, arm=None if watch is None else watch.joints,
        rig="" if options.arm is None else options.arm.arm,
        trouble=lambda: "" if watch is None else watch.loop.trouble,
        shown=lambda told: recorder.record_shown(told.page, told.shown, told.bound_ns, tracks=told.tracks),
    )  # fmt: skip
    recorder.on_streams = view.streams
    return view


def _tell_stopped(
    options: SimulateOptions, number: int, why: str, arm: ArmTrial | None, recorder: SessionOutputs, watch: ArmWatch,
    view: SessionView | None,
) -> None:  # fmt: skip
    recorder.record_event("fault", trial=number, detail=watch.loop.trouble)
    say_aside(why, logging.WARNING)
    _advise(_remedy(watch, arm, options))
    if view is not None:
        view.ends(why, stopped=True)


def _tell_broken_off(
    options: SimulateOptions, number: int, trouble: str, recorder: SessionOutputs, watch: ArmWatch | None,
    view: SessionView | None, *, first: bool, empty: bool,
) -> None:  # fmt: skip
    """A high five that was broken off; ``empty``: before its first tick.

    Raises:
        HighFiveError: it was the first one.
    """
    remedy = "" if watch is None else _remedy(watch, None, options)
    if view is not None:
        view.ends(trouble, stopped=watch is not None and bool(watch.loop.trouble))
    if first and empty:
        recorder.discard()  # it would only be in the way of the next attempt
    else:
        recorder.record_event("trial_broken_off", trial=number, detail=trouble)
    if first:
        kept = "" if empty else "; what there was of it is recorded"
        raise HighFiveError(f"no high five could be played: {trouble}{remedy and '; ' + remedy}{kept}")
    say_aside(f"high five {number + 1} was broken off and does not count: {trouble}", logging.WARNING)
    _advise(remedy)


def _remedy(watch: ArmWatch, arm: ArmTrial | None, options: SimulateOptions) -> str:
    from highfive.hil.arm.busy import too_busy  # noqa: PLC0415

    cycles = [*watch.fresh()[1], *watch.loop.cycles()]
    idle = options.arm is not None and options.arm.never_silent
    return too_busy(arm, cycles, watch.loop.stopped_by, gone=watch.loop.gone, never_silent=idle)


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
    drift: DriftWatch | None,
    kept: Kept,
    replay: Replay | None,
) -> tuple[TrialResult | None, str]:
    """A trial, or None and why it was broken off."""
    if not kept.paced:
        recorded = None if replay is None else replay.inputs(number, session)
        return run_trial(number, partner, session, playout, recorded, keep=kept), ""
    try:
        if watch is not None:
            watch.begin()
    except HighFiveError as error:
        return None, str(error)
    live = None if person is None else person.trial()
    inputs: Iterable[TickInput] = _recorded(partner, watch, view) if live is None else live
    watchers = [each for each in (live, watch, view, drift) if each is not None]
    for each in (watch, view):
        inputs = inputs if each is None else each.inputs(inputs)

    def seen(tick: Tick) -> None:
        for each in watchers:
            each.watch(tick)

    if live is None:
        with kept:
            return run_trial(number, partner, session, playout, inputs, seen, kept), ""
    assert person is not None
    told = len(kept.streams.events)
    person.say(f"high five {number + 1}, {style}: raise the {person.hand} hand")
    with kept:
        result = run_trial(number, partner, session, playout, inputs, seen, kept) if live.begins() else None
    if result is None or live.trouble:
        return None, live.trouble
    ahead = float(np.median(live.ahead_ms))
    note = (
        f"{live.count} ticks, {live.late} late, {live.predicted} between frames, {live.stale} of them stale; "
        f"poses {ahead:.1f} ms ahead of the newest frame"
    )
    result = replace(result, notes=(*result.notes, note, *(event.text for event in kept.streams.events[told:])))
    if person.camera is not None:
        from highfive.hil.trials.screen_contact import seen_on_screen  # noqa: PLC0415

        result = seen_on_screen(result, person.camera)
    return result, ""


def _recorded(partner: Partner, watch: ArmWatch | None, view: SessionView | None) -> Iterable[TickInput]:
    """The partner's recording at the pace of the clock; the arm's, where there is one."""
    source = C3DSource(partner.recording, RATE_HZ)
    if watch is None and view is not None:
        return as_captured(view.in_time(source))
    from highfive.hil.arm.lifecycle import at_their_time  # noqa: PLC0415

    return as_captured(at_their_time(source, MACHINE if watch is None else watch.loop.clock))
