"""One high five with the emulated rig in which things go wrong, in virtual time."""

from __future__ import annotations

import resource
import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.arm_trial import ArmTrial, ArmWatch
from highfive.hil.arm.lifecycle import emulator_options, virtual_arm
from highfive.hil.bench.black_box import BlackBox
from highfive.hil.bench.fault_laws import Laws, judge_body, judge_commands, judge_times
from highfive.hil.bench.fault_schedule import BUS, FULL_DISK, FaultSchedule, Happening
from highfive.hil.bench.faulty_frames import faulty_frames
from highfive.hil.bench.virtual_play import default_planner
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.emulator.emulator_process import make_bus
from highfive.hil.drivers.emulator.virtual_rig import VirtualRig
from highfive.hil.drivers.latch import Cause, Latch
from highfive.hil.recording.recorder import SessionRecorder
from highfive.hil.recording.recording import read_recording
from highfive.hil.runtime.virtual_clock import VirtualClock, VirtualTask
from highfive.hil.safety.limits_file import load_limits
from highfive.hil.session.session import RATE_HZ, Session
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.partners import Partner
from highfive.hil.trials.summary import SessionSettings
from highfive.hil.trials.trial import as_captured
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.source import C3DSource
from highfive.model import DEFAULT_MODEL
from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.store import load_model
from highfive.model.hgpdm.trained import HGPDM

BEFORE_S, AFTER_S = 1.8, 0.6
"""Of a high five what is played: so long before and after the contact, s."""

LASTS_S = BEFORE_S + AFTER_S
_LONGEST_S, _BOOTED_S = 30.0, 0.4
_LOOKED_ON_S = 1.2  # a joint whose horn slips at the very end settles by the servo's integral, which takes longest
_FULL_BYTES = 20_000  # of a recording that the disk takes


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
    """

    def __init__(self, job: FaultJob) -> None:
        """Not begun."""
        self._schedule, self._partner = job.schedule, job.partner
        first = max(0, job.partner.contact_frame - round(BEFORE_S * RATE_HZ))
        source = C3DSource(job.partner.recording, RATE_HZ)
        last = min(len(source), first + round(LASTS_S * RATE_HZ))
        self._frames: list[MarkerFrame] = [source.frame(number) for number in range(first, last)]
        start = self._frames[0].source_time_ns
        self._due_ns = [frame.source_time_ns - start for frame in self._frames]
        self._contact = job.partner.contact_frame - first
        self.laws, self.said = Laws(), list[str]()
        self._begun_ns: int | None = None
        self._trial: ArmTrial | None = None
        self._host: VirtualTask | None = None

    def run(self) -> None:
        """From switching on to looking on after the end, and once more with all mended."""
        with VirtualClock(self._schedule.seed) as clock:
            bus = make_bus(emulator_options(ArmOptions()))
            box, estop = BlackBox(bus, load_rig()), Latch(clock)
            virtual = VirtualRig(clock, bus, box.look)
            self._host = host = clock.start("host", lambda: self._play(virtual, estop))
            for happening in self._schedule.happenings:
                clock.start(happening.kind, lambda it=happening: self._happen(it, virtual, estop))
            end = clock.now() + round(1e9 * _LONGEST_S)
            while host.alive and clock.now() < end:
                clock.wait_until(clock.now() + 10_000_000)
            self.laws.judge("the program does not end", float(host.alive), 0.0)
            clock.wait_until(clock.now() + round(1e9 * _LOOKED_ON_S))
            self._judge_errors(virtual)
            if self._begun_ns is not None:
                judge_times(self.laws, self._schedule, box, self._begun_ns, estop.pulled_ns)
            limits = load_limits()
            judge_body(self.laws, box, limits)
            if self._trial is not None:
                judge_commands(self.laws, self._trial, limits, default_planner().arm)
                self._record(self._trial)
            self._start_again(virtual)

    def _play(self, virtual: VirtualRig, estop: Latch) -> None:
        """What a session does; ends as that does when it is interrupted."""
        session = _session(self._partner)
        session.reset()
        with virtual_arm(virtual, retarget=default_planner(), estop=estop, has_host=self._has_host) as loop:
            watch = ArmWatch(loop)
            watch.begin()
            self._begun_ns = virtual.clock.now()
            frames = faulty_frames(self._frames, self._due_ns, self._schedule, virtual.clock)
            try:
                for begins in watch.inputs(as_captured(frames)):
                    watch.watch(session.step(begins.frame, begins.time_ns))
                contact = self._contact
            except KeyboardInterrupt:
                contact = -1  # it may not have come so far
            if loop.trouble:
                self.said.append(loop.trouble)
            self._trial = watch.end(self._partner.emotion, self._partner.cell, contact)

    def _has_host(self) -> bool:
        return self._host is None or self._host.alive

    def _happen(self, it: Happening, virtual: VirtualRig, estop: Latch) -> None:
        """Waits until it is time, and lets it happen."""
        clock, host = virtual.clock, self._host
        assert host is not None
        while self._begun_ns is None:
            if not host.alive:
                return
            clock.wait_until(clock.now() + 1_000_000)
        if it.kind in BUS:
            virtual.bus.add_faults([it.bus_fault()], self._begun_ns - virtual.since_ns(0))
            return
        at = self._begun_ns + round(1e9 * it.at_s)
        clock.wait_until(at)
        until, driver = clock.now() + round(1e9 * it.lasts_s), None if virtual.arm is None else virtual.arm.task
        if it.kind in ("host stall", "machine stall"):
            host.hold(until)
        if it.kind in ("driver stall", "machine stall") and driver is not None:
            driver.hold(until)
        elif it.kind == "host killed":
            host.kill()
        elif it.kind == "driver killed" and driver is not None:
            driver.kill()
        elif it.kind == "emergency stop":
            estop.pull()
        elif it.kind == "Ctrl-C":
            estop.pull(Cause.SIGNAL)
            host.interrupt(KeyboardInterrupt())

    def _judge_errors(self, virtual: VirtualRig) -> None:
        """Nothing ends by an error that is none of ours, and each of ours is one line."""
        host, arm = self._host, virtual.arm
        error = None if host is None else host.error
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
        stopped = self._trial is not None and self._trial.broken_off
        self.laws.judge("stopped without a reason", float(stopped and not self.said), 0.0)

    def _record(self, trial: ArmTrial) -> None:
        """Every tick and cycle is in the recording; where the disk is full, what came before is."""
        with TemporaryDirectory() as folder:
            path = Path(folder) / "arm.mcap"
            full = bool(self._schedule.of(FULL_DISK))
            about = SessionSettings(seed=self._schedule.seed, model="none", trials=2)
            try:
                with SessionRecorder(path, about) as recorder:
                    recorder.record_played(trial)
                    if full:
                        with _full_disk(path.stat().st_size + _FULL_BYTES):
                            recorder.record_played(trial)
            except HighFiveError as error:
                self.said.append(str(error))
            found = read_recording(path).channels
            lost = max(len(trial.ticks) - len(found["/safety"]), len(trial.cycles) - len(found["/arm"]))
            self.laws.judge("recorded messages that are lost", float(max(0, lost)), 0.0)

    def _start_again(self, virtual: VirtualRig) -> None:
        """With all mended and the servos switched off and on the arm can be used again."""
        clock, bus = virtual.clock, virtual.bus
        end = clock.now() + 5_000_000_000
        while virtual.arm is not None and virtual.arm.task.alive and clock.now() < end:
            clock.wait_until(clock.now() + 10_000_000)
        bus.set_faults([], virtual.now())
        try:
            self._begin(virtual)
            return
        except HighFiveError as error:
            refused = str(error)
        for servo in bus.servos:
            servo.reboot(virtual.now())
        clock.wait_until(clock.now() + round(1e9 * _BOOTED_S))
        try:
            self._begin(virtual)
        except HighFiveError as error:
            self.said.append(f"not started again ({refused}), nor after switching off and on ({error})")
            self.laws.judge("the arm cannot be started again", 1.0, 0.0)

    def _begin(self, virtual: VirtualRig) -> None:
        with virtual_arm(virtual, retarget=default_planner()) as loop:
            loop.begin()


@contextmanager
def _full_disk(size: int) -> Iterator[None]:
    """Files cannot grow beyond that, bytes, as on a disk that is full."""
    before, handler = resource.getrlimit(resource.RLIMIT_FSIZE), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


@cache
def _model() -> HGPDM:
    return load_model(DEFAULT_MODEL)


_sessions: dict[str, Session] = {}


def _session(partner: Partner) -> Session:
    """One for each emotion: it takes a while to make."""
    if partner.emotion not in _sessions:
        _sessions[partner.emotion] = Session(_model(), {partner.emotion: 1.0}, partner.marker_set, build_scene())
    return _sessions[partner.emotion]


def run_schedule(job: FaultJob) -> tuple[Laws, Sequence[str]]:
    """The laws as they were kept, and what was said."""
    run = FaultRun(job)
    run.run()
    return run.laws, run.said
