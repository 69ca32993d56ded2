"""``highfive rig follow``: an arm that follows joint goals of another program, one JSON object a line.

Each line of standard input is answered by one on standard output:

- ``{"goal": {"waist": 0.1, "elbow": -0.4}}``, rad: the arm is led there; joints that are not named keep their goal.
- ``{}``: nothing but what the arm does.
- ``{"end": true}``: it goes back to where it rests, and the command ends. Where the input just ends, whoever spoke may
  be gone: the arm stays where it is.

An answer is ``{"positions": {…}, "goal": {…}, "age": s}``: what the servos said last, where the arm is led (on the
straight way, as far as that is free), and how old the positions are; or ``{"error": "…"}`` of a line that was not
understood, or ``{"stopped": "…"}``, after which the command ends. The first line comes once the arm follows, and has
its ``arm``, ``joints``, ``low`` and ``high`` (rad), too.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, TextIO

import numpy as np

from highfive.hil.arm.arm_options import VIRTUAL, ArmOptions
from highfive.hil.arm.calibrated import known_arm, trusted_calibration
from highfive.hil.arm.driven_arm import driven_arm, virtual_driven_arm
from highfive.hil.arm.emergency_stop import uninterrupted
from highfive.hil.arm.goal_course import GoalCourse
from highfive.hil.arm.lifecycle import virtual_rig
from highfive.hil.arm.posture_drive import PostureDrive
from highfive.hil.arm.preconditions import check_options
from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.arm_model.servo_arm import ServoArm
from highfive.hil.drivers.priority import going_first
from highfive.hil.runtime.interrupts import INTERRUPTS
from highfive.hil.runtime.threads import quick_switching
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

LONGEST = 1 << 16
"""A line has fewer characters."""

LINE_S = 1.0 / 30.0
"""That a line takes in virtual time, s."""

DEAF_S = 2.0
"""An answer that nobody reads for so long, s: whoever led the arm hangs."""
DEAF = "whoever leads the arm reads no answers; it stays where it is"
GONE = "whoever led the arm is gone (end of input); it stays where it is"


@dataclass(frozen=True)
class End:
    """How it ended.

    Attributes:
        stopped: why the arm was stopped, '' where it was not.
        heard: all answers were taken; else a thread still waits for that.
    """

    stopped: str
    heard: bool


def follow(options: ArmOptions, lines: TextIO, answer: Callable[[str], object]) -> End:
    """Follows goals until they end.

    Args:
        options: which arm.
        lines: what is asked.
        answer: gets each answer, a line without its end.

    Raises:
        HighFiveError: the arm cannot be used. Nothing has moved then.
    """
    limits, rig = check_options(options)
    folder = find_arm(options.arm)
    body = known_arm(folder, trusted_calibration(options, rig, datetime.now(UTC)))
    with uninterrupted() as from_now_on, ExitStack() as stack:
        drive = stack.enter_context(_drive(options, body))
        if options.port != VIRTUAL:  # there nobody hears a signal as a stop: it interrupts
            from_now_on()
        leader = Leader(drive, GoalCourse(body, limits, drive.positions), folder.names, answer)
        low, high = ([getattr(joint, end) for joint in limits.joints] for end in ("lowest", "highest"))
        leader.say({"arm": options.arm, "joints": folder.names, "low": low, "high": high, **leader.now()})
        stopped = ""
        try:
            if options.port == VIRTUAL:
                leader.lead_in_virtual_time(lines)
            else:
                stack.enter_context(quick_switching())
                threading.Thread(target=leader.listen, args=(lines,), daemon=True).start()
                with going_first():
                    leader.lead()
            if leader.gone:
                stopped = leader.gone
                drive.stay()
        except HighFiveError as error:
            stopped = str(error)
        heard = leader.end(stopped)
    return End(stopped, heard)


@contextmanager
def _drive(options: ArmOptions, body: ServoArm) -> Iterator[PostureDrive]:
    if options.port != VIRTUAL:
        with driven_arm(options, body, lambda: "", keys=False) as drive:
            yield drive
        return
    with (
        VirtualClock() as clock,
        clock.signals_to_first(INTERRUPTS),
        virtual_driven_arm(virtual_rig(clock, options), options, body, lambda: "") as drive,
    ):
        yield drive


class Leader:
    """Answers lines in a thread of its own, while the arm is driven tick by tick.

    Attributes:
        gone: why nobody leads any more, '' while somebody may.
    """

    def __init__(
        self, drive: PostureDrive, course: GoalCourse, names: tuple[str, ...], answer: Callable[[str], object]
    ) -> None:
        """The arm is ready; ``names`` are of its joints."""
        self._drive, self._course, self._names, self._answer = drive, course, names, answer
        self._saying = threading.Lock()
        self._said_ns: int | None = None  # when an answer was begun that nobody has read yet
        self._ended, self._over, self.gone = False, False, ""

    def lead(self) -> None:
        """Drives the arm until its goals end.

        Raises:
            HighFiveError: it was stopped.
        """
        while not (self._ended or self.gone):
            begun_ns = self._said_ns
            if begun_ns is not None and self._drive.clock.now() - begun_ns > 1e9 * DEAF_S:
                self.gone = DEAF
            self._drive.tick(self._course.at(self._drive.clock.now()))

    def lead_in_virtual_time(self, lines: TextIO) -> None:
        """Answers line by line, until the last; each takes :data:`LINE_S`.

        Raises:
            HighFiveError: the arm was stopped.
        """
        clock = self._drive.clock
        for line in _lines(lines):
            self.say(self.answered(line))
            if self._ended:
                return
            end = clock.now() + round(1e9 * LINE_S)
            while clock.now() < end:
                self._drive.tick(self._course.at(clock.now()))
        self.gone = GONE

    def listen(self, lines: TextIO) -> None:
        """Answers line by line, until the last."""
        try:
            for line in _lines(lines):
                self.say(self.answered(line))
                if self._ended:
                    return
            self.gone = GONE
        except (OSError, ValueError):  # nobody reads the answers, or what comes in is no text
            self.gone = GONE

    def answered(self, line: str) -> dict[str, Any]:
        """The answer to a line."""
        try:
            if len(line) >= LONGEST:
                raise HighFiveError(f"a line has {LONGEST} characters at most")
            request = json.loads(line)
            if not isinstance(request, dict) or not set(request) <= {"goal", "end"}:
                raise HighFiveError('a line is {"goal": {"JOINT": rad, …}}, {"end": true} or {}')
            goal = request.get("goal", {})
            if not isinstance(goal, dict):
                raise HighFiveError('"goal" holds an angle, rad, by joint')
            if goal:
                self._course.lead(goal, self._drive.reference, self._drive.clock.now())
        except (ValueError, RecursionError):
            return {"error": "a line of input is no JSON"}
        except HighFiveError as error:
            return {"error": str(error)}
        self._ended = self._ended or request.get("end") is True
        return self.now()

    def now(self) -> dict[str, Any]:
        """What the arm does."""
        measured = self._drive.measured
        age = 1e-9 * (self._drive.clock.now() - measured.time_ns)
        return {"positions": self._named(measured.positions), "goal": self._named(self._course.goal), "age": age}

    def say(self, what: dict[str, Any]) -> None:
        """A line of output; none after the last."""
        with self._saying:
            if not self._over:
                self._said_ns = self._drive.clock.now()
                self._answer(json.dumps(what))
                self._said_ns = None

    def end(self, stopped: str) -> bool:
        """Says why the arm was stopped, if it was, as the last line; whether the answers before it were taken."""
        self._ended = True
        if not self._saying.acquire(timeout=DEAF_S):
            return False
        self._over = True
        if stopped:
            with suppress(OSError):  # nobody may be there
                self._answer(json.dumps({"stopped": stopped}))
        self._saying.release()
        return True

    def _named(self, angles: Array) -> dict[str, float]:
        return dict(zip(self._names, np.round(angles, 6).tolist(), strict=True))


def _lines(lines: TextIO) -> Iterator[str]:
    """Line by line; of one that is too long its beginning, and nothing of its rest."""
    while line := lines.readline(LONGEST):
        yield line
        while len(line) >= LONGEST and not line.endswith("\n"):
            line = lines.readline(LONGEST)
