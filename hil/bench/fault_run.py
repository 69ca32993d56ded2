"""A session of one high five with the emulated rig in which things go wrong, in virtual time.

The session is the product's: a live source follows the person, its frames begin the ticks of a live trial, the arm
takes part in it, goes back to where it rests, what it did is recorded, and it is let go of. Nothing in it goes by the
time of day: the one place that reads it compares the age of a registration of the room, in days, which an emulated arm
has not; so no schedule sets the host's clock, only the source's.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.arm_trial import ArmTrial, ArmWatch
from highfive.hil.arm.lifecycle import emulator_options, virtual_arm
from highfive.hil.bench.black_box import BlackBox
from highfive.hil.bench.fault_laws import judge_body, judge_commands
from highfive.hil.bench.fault_recording import FaultRecording
from highfive.hil.bench.fault_schedule import (
    BUS,
    DEATHS,
    FOLLOWING,
    FULL_DISK,
    PHASES,
    RETURNING,
    STOPS,
    SWITCHING_ON,
    FaultSchedule,
    Happening,
)  # fmt: skip
from highfive.hil.bench.fault_times import DRIVERLESS, judge_times
from highfive.hil.bench.faulty_camera import FaultyCamera
from highfive.hil.bench.laws import Laws
from highfive.hil.bench.live_people import here, parts
from highfive.hil.bench.motion_laws import judge_body_motion
from highfive.hil.bench.session_phases import Occurrence, SessionPhases
from highfive.hil.bench.virtual_play import default_planner
from highfive.hil.drivers.bus.cycle_ring import Mode
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.emulator.emulator_process import make_bus
from highfive.hil.drivers.emulator.virtual_rig import VirtualRig
from highfive.hil.drivers.latch import Cause, Latch
from highfive.hil.runtime.virtual_clock import VirtualClock, VirtualTask
from highfive.hil.runtime.virtual_scheduler import VirtualScheduler
from highfive.hil.safety.limits_file import load_limits
from highfive.hil.safety.states import HALTED
from highfive.hil.session.session import RATE_HZ, Session, TickInput
from highfive.hil.trials.frame_link import FrameLink
from highfive.hil.trials.live_partner import LiveTrial
from highfive.hil.trials.live_settings import LiveSettings
from highfive.hil.trials.partners import Partner
from highfive.hil.trials.summary import SessionSettings
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.model.errors import HighFiveError

_LIVE = LiveSettings(longest=PHASES[FOLLOWING])
_LONGEST_S, _BOOTED_S = 40.0, 0.4  # s, of a session in which nothing stands still
_LOOKED_ON_S = 1.2  # a joint whose horn slips at the very end settles by the servo's integral, which takes longest


@dataclass(frozen=True)
class FaultJob:
    """A schedule, and the partner whom it meets."""

    schedule: FaultSchedule
    partner: Partner


class FaultRun:
    """One schedule as it goes on.

    Attributes:
        laws: what was found.
        said: why the arm was stopped, one line a reason.
        occurred: what of the schedule came to pass.
        box: what the servos were commanded, and where the body was.
        trial: what the arm did; None where it did not follow.
    """

    def __init__(self, job: FaultJob, folder: Path) -> None:
        """Not begun; the session is recorded in an empty ``folder``."""
        self._schedule, self._partner, self._path = job.schedule, job.partner, folder / "arm.mcap"
        self.laws, self.said, self.occurred = Laws(), list[str](), list[Occurrence]()
        self.box = BlackBox(make_bus(emulator_options(ArmOptions())), load_rig())
        self.trial: ArmTrial | None = None
        self._watch: ArmWatch | None = None
        self._recording: FaultRecording | None = None
        self._room: int | None = None  # bytes that the disk still takes
        self._camera: FaultyCamera | None = None
        self._host: list[VirtualTask] = []  # the process's tasks

    def run(self) -> None:
        """From switching on to looking on after the end, and once more with all mended."""
        with VirtualClock(self._schedule.seed) as clock:
            virtual, estop = VirtualRig(clock, self.box.bus, self.box.look), Latch(clock)
            phases, scheduler = SessionPhases(clock), VirtualScheduler(clock)
            host = clock.start("host", lambda: self._play(virtual, estop, phases, scheduler))
            self._host = scheduler.tasks  # of the same process: its source's
            self._host.append(host)
            for happening in self._schedule.happenings:
                clock.start(happening.kind, lambda it=happening: self._happen(it, virtual, estop, phases))
            longest = _LONGEST_S + sum(it.lasts_s for it in self._schedule.happenings)
            end = clock.now() + round(1e9 * longest)
            while host.alive and clock.now() < end:
                clock.wait_until(clock.now() + 10_000_000)
            self.laws.judge("the program does not end", float(host.alive), 0.0)
            lasting = [it.until_ns for it in self.occurred if it.happening.kind in BUS]
            clock.wait_until(max([clock.now(), *lasting]) + round(1e9 * _LOOKED_ON_S))
            if self.trial is None and self._watch is not None:
                self.trial = self._done(self._watch)  # of a host that was killed
            self._judge_errors(host, virtual)
            self._judge(estop)
            self._start_again(virtual)

    def _play(self, virtual: VirtualRig, estop: Latch, phases: SessionPhases, scheduler: VirtualScheduler) -> None:
        """What a session does; ends as that does when it is interrupted."""
        try:
            phases.begin(SWITCHING_ON)
            clock, session = virtual.clock, _session(self._partner)
            session.reset()
            self._camera = FaultyCamera(self._partner, self._schedule, phases.begun, clock.now())
            link = FrameLink(clock, RATE_HZ, self._camera)
            about = SessionSettings(seed=self._schedule.seed, model="none", trials=1)
            with (
                closing(LiveSource("simulated", lambda: link, None, RATE_HZ, scheduler)) as source,
                FaultRecording(self._path, about, self._partner, self._room) as recording,
                virtual_arm(virtual, retarget=default_planner(), estop=estop, has_host=self._has_host) as loop,
            ):
                self._recording = recording
                source.first()
                self._watch = watch = ArmWatch(loop)
                watch.begin()
                watch.record = lambda: recording.record_arm(watch)
                recording.begins(virtual.arm)
                phases.begin(FOLLOWING)
                live = LiveTrial(source, here(), clock, settings=_LIVE)
                try:
                    self._follow(live, session, watch, recording, phases)
                finally:
                    troubles = (loop.trouble, live.trouble, recording.trouble, watch.kept_back)
                    self.said += [line for line in troubles if line]
                self.trial = self._done(watch)
        finally:
            phases.end()

    def _follow(
        self, live: LiveTrial, session: Session, watch: ArmWatch, recording: FaultRecording, phases: SessionPhases
    ) -> None:
        """A high five, and the way back from it; recorded as :class:`highfive.hil.commands.play_trials.Kept` does."""
        try:
            for begins in watch.inputs(_followed_by(live, phases)) if live.begins() else ():
                tick = session.step(begins.frame, begins.time_ns)
                live.watch(tick)
                watch.watch(tick)
                recording.record(begins, tick, watch)
        finally:
            watch.rest()
            recording.ends()

    def _done(self, watch: ArmWatch) -> ArmTrial | None:
        """What the arm did; the frame of the contact is found by its time, if it came so far."""
        contact_ns = None if self._camera is None else self._camera.contact_ns
        first, last = watch.span_ns
        met = (
            -1
            if contact_ns is None or not first <= contact_ns <= last
            else round(1e-9 * (contact_ns - first) * RATE_HZ)
        )
        return watch.end(self._partner.emotion, self._partner.cell, met)

    @property
    def _stalled(self) -> bool:
        """The host stood still at some time: it could not take what the driver did meanwhile."""
        return any(it.happening.kind in ("host stall", "machine stall") for it in self.occurred)

    def _has_host(self) -> bool:
        return all(task.alive for task in self._host[:1])

    def _happen(self, it: Happening, virtual: VirtualRig, estop: Latch, phases: SessionPhases) -> None:
        """Waits until it is time, and lets it happen."""
        begun = phases.wait(it.phase)
        if begun is None:
            return
        clock, host = virtual.clock, self._host[0]
        at = begun + round(1e9 * it.at_s)
        until = at + round(1e9 * it.lasts_s)
        if it.kind in BUS:
            virtual.bus.add_faults([it.bus_fault()], begun - virtual.since_ns(0))
            self.occurred.append(Occurrence(it, at, until))  # it comes even where the session is over before
            return
        clock.wait_until(at)
        driver = None if virtual.arm is None else virtual.arm.task
        if it.kind not in (*DEATHS, *STOPS):
            self.occurred.append(Occurrence(it, at, until))
        if it.kind in ("host stall", "machine stall"):
            for task in self._host:
                task.hold(until)
        if it.kind in ("driver stall", "machine stall") and driver is not None:
            driver.hold(until)
        elif it.kind == FULL_DISK:
            self._room = round(it.amount)
            if self._recording is not None:
                self._recording.fill(self._room)
        elif it.kind in (*DEATHS, *STOPS):
            first = driver if it.kind == "driver killed" else host
            if first is None or not first.alive:
                return

            def end() -> None:
                now = clock.now()
                self.occurred.append(Occurrence(it, now, now))
                if it.kind in STOPS:
                    estop.pull(Cause.SIGNAL if it.kind == "Ctrl-C" else Cause.PROGRAM)
                if it.kind == "Ctrl-C":
                    host.interrupt(KeyboardInterrupt())
                if it.kind in ("host killed", "machine killed"):
                    if self._recording is not None:
                        self._recording.kill(stalled=self._stalled)
                    for task in self._host:
                        task.kill()
                if it.kind in ("driver killed", "machine killed") and driver is not None:
                    driver.kill()

            if it.looks:
                first.after_looks(it.looks, end)
            else:
                end()

    def _judge(self, estop: Latch) -> None:
        limits, planner = load_limits(), default_planner()
        judge_times(self.laws, self.occurred, self.box, self.trial, estop.pulled_ns)
        judge_body(self.laws, self.box, limits)
        if self.trial is not None:
            judge_commands(self.laws, self.trial, limits, planner.arm)
            stopping = (*BUS, *DRIVERLESS, *DEATHS, "host stall")
            led = [it.at_ns for it in self.occurred if it.happening.kind in stopping]
            led += [] if estop.pulled_ns is None else [estop.pulled_ns]  # from which on it may brake as hard as it can
            until_ns = min(led, default=self.box.times[-1])
            judge_body_motion(self.laws, self.trial, self.box, limits, planner.arm, until_ns)
        if self._recording is not None:
            self._recording.judge(self.laws)
        if self.occurred and all(it.happening.kind == FULL_DISK for it in self.occurred):
            self.laws.judge("a full disk stops the arm", float(self._recording is not None and self._stopped), 0.0)

    def _judge_errors(self, host: VirtualTask, virtual: VirtualRig) -> None:
        """Nothing ends by an error that is none of ours, and each of ours is one line."""
        arm, error = virtual.arm, host.error
        if isinstance(error, HighFiveError):
            self.said.append(str(error))
        strange = error is not None and not isinstance(error, (HighFiveError, KeyboardInterrupt))
        if strange:
            self.said.append(repr(error))
        self.laws.judge("the host ends by an unexpected error", float(strange), 0.0)
        broken = arm is not None and arm.task.error is not None
        if broken and arm is not None:
            self.said.append(repr(arm.task.error))
        self.laws.judge("the driver ends by an unexpected error", float(broken), 0.0)
        long = max((line.count("\n") for line in self.said), default=0)
        self.laws.judge("lines that a reason takes beyond one", float(long), 0.0)
        gone = any(it.happening.kind in ("Ctrl-C", "host killed", "machine killed") for it in self.occurred)
        silent = self._stopped and not self.said and not gone  # who is gone says nothing more
        self.laws.judge("stopped without a reason", float(silent), 0.0)

    @property
    def _stopped(self) -> bool:
        """The arm was kept from following, or stopped, be it once palms had met or on the way back."""
        if self.trial is None or self.trial.broken_off:
            return True
        whole = self.trial.with_back
        return whole.ticks[-1].report.state in HALTED or whole.cycles[-1].mode in (Mode.STOPPED, Mode.PORT_LOST)

    def _start_again(self, virtual: VirtualRig) -> None:
        """With all mended, and where that is not enough the servos switched off and on, the arm can be used again."""
        clock, bus = virtual.clock, virtual.bus
        stalled = [it.until_ns for it in self.occurred]  # a driver that stands still keeps its port
        end = max([clock.now(), *stalled]) + 5_000_000_000
        while virtual.arm is not None and virtual.arm.task.alive and clock.now() < end:
            clock.wait_until(clock.now() + 10_000_000)
        bus.set_faults([], virtual.now())
        refused = self._refused(virtual)
        if refused:
            for servo in bus.servos:
                servo.reboot(virtual.now())
            clock.wait_until(clock.now() + round(1e9 * _BOOTED_S))
            if again := self._refused(virtual):
                self.said.append(f"not started again ({refused}), nor after switching off and on ({again})")
            refused = again
        self.laws.judge("the arm cannot be started again", float(bool(refused)), 0.0)

    def _refused(self, virtual: VirtualRig) -> str:
        """Why it cannot be started, '' where it can."""
        try:
            self._begin(virtual)
        except HighFiveError as error:
            return str(error)
        return ""

    def _begin(self, virtual: VirtualRig) -> None:
        with virtual_arm(virtual, retarget=default_planner()) as loop:
            loop.begin()


def _followed_by(live: LiveTrial, phases: SessionPhases) -> Iterator[TickInput]:
    """A trial's inputs, after which the way back begins."""
    yield from live
    phases.begin(RETURNING)


_sessions: dict[str, Session] = {}


def _session(partner: Partner) -> Session:
    """One for each emotion: it takes a while to make."""
    if partner.emotion not in _sessions:
        model, scene = parts()
        _sessions[partner.emotion] = Session(model, {partner.emotion: 1.0}, partner.marker_set, scene)
    return _sessions[partner.emotion]


def run_schedule(job: FaultJob) -> tuple[Laws, Sequence[str]]:
    """The laws as they were kept, and what was said."""
    with TemporaryDirectory() as folder:
        run = FaultRun(job, Path(folder))
        try:
            run.run()
        except Exception as error:
            error.add_note(f"of {job.schedule}")  # its seed, without which nobody could play it again
            raise
    return run.laws, run.said
