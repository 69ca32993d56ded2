"""What a session under faults leaves on the disk, which may be full.

As in the product each tick, and what the arm did meanwhile, is recorded as it comes, on the way back, too; in virtual
time the recorder writes at once. What has to be there is judged by what the recorder was given, and by what the arm's
driver has done itself.
"""

from __future__ import annotations

import itertools
import resource
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from highfive.hil.arm.arm_trial import ArmWatch
from highfive.hil.bench.laws import Laws
from highfive.hil.drivers.bus.arm_host import ArmHost
from highfive.hil.drivers.bus.cycle_ring import Cycle
from highfive.hil.recording.background import BackgroundRecorder
from highfive.hil.recording.recorded_tick import recorded_tick
from highfive.hil.recording.recorder import CHUNK_NS, SessionRecorder, TrialHead
from highfive.hil.recording.recording import SessionRecording, read_recording
from highfive.hil.runtime.console import LOGGER
from highfive.hil.session.session import Tick, TickInput
from highfive.hil.trials.partners import Partner
from highfive.hil.trials.summary import SessionSettings

LOST, CUT = "recorded messages that are lost or out of order", "recording lost before a kill or a full disk, s"
"""Laws; of the second :data:`~highfive.hil.recording.recorder.CHUNK_NS` are allowed."""

BEHIND, TICKS_S = "recording behind the arm at a kill, s", 0.05
"""A law, by what the driver has done, and by how much more than the last chunk it may be, s: an overdue tick."""


class FaultRecording:
    """The recording of a session under faults; close it, or use it in ``with``.

    Attributes:
        ticks, arm_ticks, cycles: ns of the clock, of each that was given.
        numbers: of the cycles, as the driver counted them.
        expected: number of the first cycle of the high five, and the newest one that there was when it ended, or when
            the host was killed; by the driver.
    """

    def __init__(self, path: Path, about: SessionSettings, partner: Partner, room: int | None) -> None:
        """Begins; ``room`` as of :meth:`fill`.

        Raises:
            HighFiveError: not even that fits on the disk.
        """
        self._path, self._killed, self._most = path, path.with_name("killed.mcap"), room
        self.ticks, self.arm_ticks, self.cycles, self.numbers = list[int](), list[int](), list[int](), list[int]()
        self.expected: tuple[int, Cycle | None] = 0, None
        self._driver: ArmHost | None = None
        self._over = self._stalled = False
        with self._disk():
            self._recorder = BackgroundRecorder(SessionRecorder(path, about), paced=False)
            self._recorder.begin_trial(TrialHead(0, partner, partner.emotion, {partner.emotion: 1.0}, paced=True))

    @property
    def trouble(self) -> str:
        """Why no more is recorded, in one line; '' as long as it is."""
        return self._recorder.trouble

    def fill(self, room: int) -> None:
        """The disk takes no more than so many bytes from now on."""
        self._most = self._path.stat().st_size + room

    def begins(self, driver: ArmHost | None) -> None:
        """A high five begins: cycles that are noted from now on are of it."""
        newest = None if driver is None else driver.newest()
        self._driver, self.expected = driver, (0 if newest is None else newest.number + 1, None)

    def ends(self) -> None:
        """It is over, and the arm rests."""
        if self._driver is not None and not self._over:
            self._over, self.expected = True, (self.expected[0], self._driver.newest())

    def record(self, begins: TickInput, tick: Tick, watch: ArmWatch) -> None:
        """A tick, and what the arm did since the one before."""
        if not self.trouble:
            self.ticks.append(begins.at_ns)
        with self._disk():
            self._recorder.record_tick(recorded_tick(begins, tick, tick.pose, 0.0))
        self.record_arm(watch)

    def record_arm(self, watch: ArmWatch) -> None:
        """What the arm did since the last tick."""
        if not self.ticks:
            return
        ticks, cycles = watch.fresh()
        if not self.trouble:
            self.arm_ticks += [tick.frame_ns for tick in ticks]
            self.cycles += [cycle.state.time_ns for cycle in cycles]
            self.numbers += [cycle.number for cycle in cycles]
        with self._disk():
            self._recorder.record_arm(ticks, cycles)

    def kill(self, *, stalled: bool) -> None:
        """The host is killed now: keeps the file as it is, before anything closes it. ``stalled``: it stood still."""
        self.ends()
        self._stalled = stalled
        shutil.copyfile(self._path, self._killed)

    def __enter__(self) -> FaultRecording:
        """Self."""
        return self

    def __exit__(self, *_: object) -> None:
        """Closes."""
        with self._disk():
            self._recorder.close()

    def judge(self, laws: Laws) -> None:
        """What was given can be read, in order; of a host that was killed, or a full disk, all but the last chunk."""
        if not self.ticks:
            return
        killed = self._killed.exists()
        found = read_recording(self._killed if killed else self._path)
        cut = killed or (self._most is not None and (bool(self.trouble) or not found.complete))
        first, newest = self.expected
        numbers = [first - 1, *self.numbers]
        if newest is not None and not cut:
            numbers.append(newest.number + 1)
        lost = sum(max(0, b - a - 1) for a, b in itertools.pairwise(numbers))  # that never came to be recorded
        for topic, given in (("/tick", self.ticks), ("/safety", self.arm_ticks), ("/arm", self.cycles)):
            expected, times = [max(0, at - self.ticks[0]) for at in given], _times(found, topic)
            lost += sum(a != b for a, b in zip(expected, times, strict=False)) + max(0, len(times) - len(expected))
            lost += 0 if cut else max(0, len(expected) - len(times))
        laws.judge(LOST, float(lost), 0.0)
        if not cut:
            return
        for topic, given in (("/tick", self.ticks), ("/safety", self.arm_ticks), ("/arm", self.cycles)):
            # The last one, which came or did not come into a chunk by a hair, is what made that long enough.
            missing = given[len(_times(found, topic)) : -1]
            laws.judge(CUT, 1e-9 * (missing[-1] - missing[0]) if missing else 0.0, 1e-9 * CHUNK_NS)
        if killed and newest is not None and not (self._stalled or self._most is not None):
            recorded = self.ticks[0] + max(_times(found, "/arm"), default=0)
            laws.judge(BEHIND, 1e-9 * (newest.state.time_ns - recorded), 1e-9 * CHUNK_NS + TICKS_S)

    @contextmanager
    def _disk(self) -> Iterator[None]:
        """Files cannot grow beyond what the disk takes; what the recorder says of that is asked for, not shown."""
        if self._most is None:
            yield
            return
        before, shown = resource.getrlimit(resource.RLIMIT_FSIZE), LOGGER.disabled
        resource.setrlimit(resource.RLIMIT_FSIZE, (self._most, before[1]))  # Python ignores SIGXFSZ
        LOGGER.disabled = True
        try:
            yield
        finally:
            LOGGER.disabled = shown
            resource.setrlimit(resource.RLIMIT_FSIZE, before)


def _times(found: SessionRecording, topic: str) -> list[int]:
    """ns of the recording's clock."""
    return [message.time_ns for message in found.channels[topic]]
