"""Plays an experiment's trials through the session's chain: source, tracker, model, scene, page, recording."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from highfive.hil.arm_model.arm_folder import DEFAULT_ARM
from highfive.hil.commands.clips import Clip, TappedClip, going_on, shoulders, tapping
from highfive.hil.commands.play_trials import Kept
from highfive.hil.commands.shown_again import RecordedMotion, ShownAgain, at_rest, for_as_long, recorded_motion
from highfive.hil.commands.trial_witness import TrialWitness
from highfive.hil.experiments.desk import Desk
from highfive.hil.experiments.protocol import Mode, Protocol
from highfive.hil.experiments.stage import Asked, Played, RunFailedError, RunStoppedError, TrialBrokenOffError
from highfive.hil.experiments.trial_row import TrialRow
from highfive.hil.publish.outputs import SessionOutputs
from highfive.hil.recording.background import BackgroundRecorder
from highfive.hil.recording.recorder import SessionRecorder, TrialHead
from highfive.hil.runtime.clock import Clock
from highfive.hil.runtime.console import say_aside
from highfive.hil.session.session import RATE_HZ, Session, Tick, TickInput
from highfive.hil.sim.people.capture import PERSON_SET
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.playout import KinematicPlayOut, PlayState
from highfive.hil.sim.scene import Scene
from highfive.hil.trials.live_partner import LivePerson, LiveTrial
from highfive.hil.trials.partners import Partner, simulated_partner
from highfive.hil.trials.summary import SessionSettings
from highfive.hil.trials.trial import as_captured, run_trial, style_name
from highfive.hil.view.commands import Command
from highfive.hil.view.interruption import Interruption
from highfive.hil.view.page_shown import PageShown
from highfive.hil.view.session_view import SessionView, ShowingPage
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.sources.source import C3DSource
from highfive.mocap_bridge.tracking.human_arm import HumanArmEstimator
from highfive.mocap_bridge.tracking.tracker import Tracker
from highfive.model.errors import HighFiveError

if TYPE_CHECKING:
    from highfive.hil.commands.arm_in_run import ArmInRun
    from highfive.hil.commands.tap_switch import TapSwitch
    from highfive.hil.trials.head_watch import DriftWatch
    from highfive.hil.view.wire import PoseMessage

S = 1_000_000_000
TAPPING = "B3"
"""Where a simulated person, who only knows high fives, raises her hand to tap: the avatar's right shoulder."""
_MOST_SHOWN = 4096


class StagePage:
    """The page as a trial sees it: what is asked for there goes to the run's desk, and a trial hears of it by that."""

    def __init__(self, page: ShowingPage, desk: Desk) -> None:
        """Of a run."""
        self._page, self._desk = page, desk

    def show(self, message: PoseMessage) -> None:
        """See :class:`LivePage`."""
        self._page.show(message)

    def tell(self, kind: str, **fields: object) -> None:
        """See :class:`LivePage`."""
        self._page.tell(kind, **fields)

    def shown(self) -> list[PageShown]:
        """See :class:`LivePage`."""
        return self._page.shown()

    def said(self) -> list[str]:
        """See :class:`LivePage`."""
        return self._page.said()

    @property
    def alive(self) -> bool:
        """See :class:`LivePage`."""
        return self._page.alive

    def commands(self) -> list[Command]:
        """Whether the trial is to be broken off."""
        self._desk.look()
        self._page.commands()  # what else a session's page may ask for has no place here; after the look: it takes all
        return [Command("next")] if self._desk.breaks_off else []


class AvatarStage:
    """One run's stage; closes its recording with :meth:`close`."""

    def __init__(
        self, session: Session, scene: Scene, page: ShowingPage, desk: Desk, person: LivePerson | None,
        protocol: Protocol, folder: Path, settings: SessionSettings,
        outputs: Callable[[BackgroundRecorder], SessionOutputs], clock: Clock,
        arm: ArmInRun | None = None, drift: DriftWatch | None = None,
        clips: Mapping[tuple[str, int], Clip] | None = None, switch: TapSwitch | None = None,
    ) -> None:  # fmt: skip
        """Of a session that answers ``person``, or simulated people where there is none; records into ``folder``.

        ``outputs`` hands on what goes into a first recording; it is called once. ``arm`` takes part, and ``drift``
        watches a headset that is worn beside a lab's system. ``clips`` are shown in place of the model's answer, from
        when her hand, or a ``switch``, taps.
        """
        self._session, self._person, self._protocol, self._clock = session, person, protocol, clock
        self._desk, self._folder, self._settings = desk, folder, settings
        self._playout = KinematicPlayOut(scene)
        self._pictures: list[PageShown] = []
        self._arm, self._drift, self._clips, self._switch = arm, drift, clips, switch
        self._view = SessionView(
            StagePage(page, desk), session, self._playout, scene, clock=clock, shown=self._picture,
            arm=None if arm is None else arm.watch.joints, rig=settings.arm_name or DEFAULT_ARM,
            trouble=lambda: "" if arm is None else arm.watch.loop.trouble,
        )  # fmt: skip
        self._open_outputs = outputs
        self._outputs: SessionOutputs | None = None
        self._recorder: BackgroundRecorder | None = None
        self._block, self._file = "", ""
        self._at: TickInput | None = None  # of the last trial: the frame in which palms met, or the motion ended

    def play(self, asked: Asked, cue: Callable[[], None]) -> Played:
        """See :class:`highfive.hil.experiments.stage.Stage`."""
        self._record_block(asked)
        source = None if asked.source is None else self._place(asked.source)
        motion = None if source is None else self._motion(*source)
        partner = self._partner(asked, motion)
        live = None if self._person is None else self._person.trial()
        if live is not None and not live.begins():
            raise RunFailedError(live.trouble)
        self._look_at_switch()
        if self._arm is not None:
            try:
                self._arm.begin(source, motion)
            except RunFailedError as error:
                self._record_event("fault", trial=asked.ask - 1, detail=str(error))
                raise
        if self._clips is None:
            self._session.set_style(asked.weights)
        witness = TrialWitness(live, asked.trial.mode == Mode.INTERACTIVE.value)
        try:
            self._play(asked, partner, live, motion, witness, cue)
        except Interruption:
            self._record_event("trial_broken_off", trial=asked.ask - 1, detail="by the experimenter")
            if self._desk.stopping:
                raise RunStoppedError("stopped by the experimenter") from None
            raise TrialBrokenOffError("broken off by the experimenter") from None
        except TrialBrokenOffError as late:
            self._record_event("trial_broken_off", trial=asked.ask - 1, detail=str(late))
            raise
        if live is not None and live.trouble:
            raise RunFailedError(live.trouble)
        if self._recorder is not None and self._recorder.trouble:
            raise RunFailedError(self._recorder.trouble)
        return self._played(witness)

    def stand(self, names: tuple[str, ...]) -> None:
        """Shows the avatar, and somebody before it, as they stand before the first trial.

        No marker of ``names``, which are the person's, has been seen yet.
        """
        nobody = MarkerFrame(
            names, np.zeros((len(names), 3)), np.zeros(len(names), dtype=bool), 0, 0, 0, np.zeros((0, 3))
        )
        clip = None if self._clips is None else next(iter(self._clips.values()))
        chain = self._session if clip is None else TappedClip(self._session, clip)
        chain.reset()
        worn, partner = load_marker_set(PERSON_SET), self._simulated("", clip, 0)
        person = HumanArmEstimator(worn)(
            Tracker(worn, RATE_HZ).update(next(iter(C3DSource(partner.recording, RATE_HZ))))
        )
        tick = replace(chain.step(nobody, 0), person=person)
        self._playout.reset(tick.pose, tick.person, tick.time_ns)
        self._view.show(tick)

    def shown_ns(self) -> int | None:
        """See :class:`highfive.hil.experiments.stage.Stage`."""
        self._view.hear_shown()
        at = self._at
        shown = [one.shown.display_ns for one in self._pictures if at is not None and one.shown.pose_ns >= at.at_ns]
        return min(shown, default=None)

    def close(self) -> None:
        """No more trials."""
        self._block = ""
        if self._outputs is not None:
            self._outputs.end()
            self._outputs.__exit__(None, None, None)
            self._outputs = None

    def _play(
        self, asked: Asked, partner: Partner, live: LiveTrial | None, motion: RecordedMotion | None,
        witness: TrialWitness, cue: Callable[[], None],
    ) -> None:  # fmt: skip
        trial = asked.trial
        assert self._outputs is not None
        clip = None
        if self._clips is not None and motion is None:
            clip = TappedClip(self._session, self._clips[trial.style, trial.clip], self._switched())
        chain: Session | ShownAgain | TappedClip = clip or self._session
        if motion is not None:
            chain = witness.again = self._shown_again(asked, motion)
        head = TrialHead(
            asked.ask - 1, partner, style_name(asked.weights), asked.weights, self._session.corrects, paced=True
        )
        kept = Kept(self._outputs, head, None if self._arm is None else self._arm.watch, self._session, None)
        self._view.begin(asked.ask - 1, asked.ask, trial.cell, asked.weights)
        cue()
        until_ns = self._clock.now() + round(S * self._protocol.timing.trial_s)

        def keep(begins: TickInput, tick: Tick, state: PlayState, tick_ms: float) -> None:
            kept(begins, tick, state, tick_ms)
            witness(begins, tick, state)
            if clip is not None and clip.tapped and witness.met is None:
                witness.met = replace(begins, frame=begins.frame or (witness.last.frame if witness.last else None))
                witness.switched_ns = clip.tapped_ns
                self._record_event(
                    "tapped", at_ns=clip.tapped_ns, trial=asked.ask - 1, detail=f"clip {trial.style} {trial.clip}"
                )

        def seen(tick: Tick) -> None:
            if live is not None and clip is None:  # a clip says itself when it is over
                live.watch(tick)
            if self._arm is not None:
                self._arm.seen(tick)
            if self._drift is not None:
                self._drift.watch(tick)
            self._view.watch(tick)
            if self._desk.breaks_off:  # of a page with an arm on it the view leaves that to others
                raise Interruption("next")
            if self._clock.now() > until_ns:
                raise TrialBrokenOffError(f"it took longer than {self._protocol.timing.trial_s:g} s")

        inputs: Iterable[TickInput] = live or as_captured(self._view.in_time(C3DSource(partner.recording, RATE_HZ)))
        inputs = inputs if motion is None else for_as_long(inputs, motion)
        inputs = inputs if clip is None else clip.until_over(inputs)
        inputs = inputs if self._arm is None else self._arm.watch.inputs(inputs)
        try:
            with kept:
                result = run_trial(asked.ask - 1, partner, chain, self._playout, self._view.inputs(inputs), seen, keep)
        except (RunFailedError, TrialBrokenOffError) as error:
            self._look_at_switch()
            event = "fault" if self._arm is not None and self._arm.watch.loop.trouble else "trial_broken_off"
            self._record_event(event, trial=asked.ask - 1, detail=str(error))
            raise
        if clip is not None and not clip.over:
            self._look_at_switch()
            raise TrialBrokenOffError("the shoulder was not tapped" if not clip.tapped else "the clip was not over")
        kept.end(replace(result, style=head.style))
        self._look_at_arm(asked)

    def _shown_again(self, asked: Asked, motion: RecordedMotion) -> ShownAgain:
        """What shows a recorded trial in place of the model's answer: to her who watches, with its contact."""
        watches, replay = asked.trial.mode != Mode.NO_CONTINGENCY.value, self._protocol.replay
        return ShownAgain(
            self._session, motion, recorded_head=watches and replay.viewpoint == "recorded",
            recorded_arm=watches and replay.own_arm == "ghost",
            contact_ns=asked.source.contact_ns if watches and asked.source is not None else None,
        )  # fmt: skip

    def _switched(self) -> Callable[[], int | None] | None:
        """When the switch said that the shoulder was tapped, from now on."""
        switch, since_ns = self._switch, self._clock.now()
        return None if switch is None else lambda: switch.tapped_since(since_ns)

    def _look_at_switch(self) -> None:
        """A switch that is gone is as a source that is gone: the run ends, and goes on with it again.

        Raises:
            RunFailedError: no tap would be heard.
        """
        if self._switch is not None and self._switch.trouble:
            raise RunFailedError(self._switch.trouble)

    def _look_at_arm(self, asked: Asked) -> None:
        """After a trial.

        Raises:
            RunFailedError: it did not take part.
        """
        if self._arm is None:
            return
        if why := self._arm.watch.kept_back:
            self._record_event("fault", trial=asked.ask - 1, detail=why)
            raise RunFailedError(f"the arm did not take part: {why}")
        if why := self._arm.stopped():  # on its way back: the trial itself counts
            self._record_event("fault", trial=asked.ask - 1, detail=why)
            say_aside(why, logging.WARNING)

    def _place(self, source: TrialRow) -> tuple[Path, str]:
        """Recording of a trial that is shown again, and its title there."""
        folder = self._folder.parents[1] / source.participant / f"session-{source.session}"
        return folder / source.recording, _title(source.trial, source.ask)

    def _motion(self, path: Path, title: str) -> RecordedMotion:
        try:
            return recorded_motion(path, title)
        except HighFiveError as error:
            raise TrialBrokenOffError(str(error)) from None

    def _partner(self, asked: Asked, motion: RecordedMotion | None) -> Partner:
        """Who raises the hand, or only watches."""
        if self._person is not None:
            partner = self._person.partner("")
        else:
            clip = None if self._clips is None else self._clips[asked.trial.style, asked.trial.clip]
            partner = self._simulated(asked.trial.cell, clip, asked.ask)
            if motion is not None and asked.trial.mode != Mode.NO_CONTINGENCY.value:
                partner = at_rest(partner, motion)
        return replace(partner, title=_title(asked.trial.name, asked.ask), cell=asked.trial.cell)

    def _simulated(self, cell: str, clip: Clip | None, ask: int) -> Partner:
        """A simulated person who raises her hand, or taps the shoulder that the clip shows first."""
        emotion, cell = next(iter(EMOTIONS)), cell or ("B2" if clip is None else TAPPING)
        partner = simulated_partner(emotion, cell, 0, np.random.default_rng([self._settings.seed, ask]))
        if clip is None:
            return partner
        return going_on(tapping(partner, shoulders(clip.poses[0])[0]), self._protocol.timing.trial_s)

    def _played(self, witness: TrialWitness) -> Played:
        at = self._at = witness.met or witness.last
        frame = None if at is None else at.frame
        contact_ns = None if witness.met is None else witness.met.at_ns
        return Played(
            ended_ns=witness.ended_ns, contact_ns=contact_ns if witness.switched_ns is None else witness.switched_ns,
            peak_speed=round(witness.peak_speed, 5), longest_gap_s=round(1e-9 * witness.longest_gap_ns, 5),
            stalled_s=round(1e-9 * witness.stalled_ns, 5),
            frame=None if frame is None else frame.number,
            source_ns=witness.own_stamp_ns, arrival_ns=None if frame is None else frame.arrival_time_ns,
            tick_ns=None if at is None else at.at_ns, recording=self._file,
        )  # fmt: skip

    def _record_block(self, asked: Asked) -> None:
        """A recording a block: one that is over is whole, whatever happens to those after it."""
        self._pictures.clear()
        if asked.trial.block == self._block:
            return
        number, name = 1, f"{asked.trial.block}.mcap"
        while (self._folder / name).exists():
            number += 1
            name = f"{asked.trial.block}-{number}.mcap"
        recorder = SessionRecorder(self._folder / name, self._settings, self._session.chain)
        background = BackgroundRecorder(recorder, paced=True)
        if self._outputs is None:
            try:
                outputs = self._open_outputs(background).__enter__()
            except BaseException:
                background.discard()  # nothing was played: no empty recording stays
                raise
            self._outputs = outputs
            outputs.record_event("session_start")
        else:
            self._outputs.go_on_in(background)
        self._block, self._file, self._recorder = asked.trial.block, name, background

    def _picture(self, told: PageShown) -> None:
        if len(self._pictures) < _MOST_SHOWN:
            self._pictures.append(told)
        if self._outputs is not None:
            self._outputs.record_shown(told.page, told.shown, told.bound_ns, tracks=told.tracks)

    def _record_event(self, event: str, **about: Any) -> None:
        if self._outputs is not None:
            self._outputs.record_event(event, **about)


def _title(trial: str, ask: int) -> str:
    """By which a recording knows a trial."""
    return f"{trial}, asked as {ask}"
