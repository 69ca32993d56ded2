"""Where an arm is led by goals that come now and then, such as a policy's thirty a second.

From goal to goal it goes straight, in as long as goals are apart: the way of a leader arm, without a stop at each. What
is no way for it is cut off here: limits of position, floor, mount and the arm itself. How fast it may go is the safety
envelope's business (:mod:`highfive.hil.safety.envelope`), which has the last word about all of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from threading import Lock

import numpy as np

from highfive.hil.arm.free_postures import last_free
from highfive.hil.arm_model.servo_arm import ServoArm
from highfive.hil.safety.limits import Limits
from highfive.hil.safety.motion import target_position
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting

TURN = 2.0 * math.pi
"""rad: no servo's goal is further; degrees are."""


@dataclass(frozen=True)
class CourseSettings(Settings):
    """How goals are followed."""

    clearance: float = setting(0.015, "m", above=0.0)
    """Kept from floor, mount and the arm itself, as in retargeting (``hard_gap``); where it is nearer already, it comes
    no nearer."""
    longest: float = setting(0.1, "s", above=0.0)
    """Goals that are further apart are gone to as if they were so far apart: they are no stream."""
    pace: float = setting(0.9, above=0.0, most=1.0)
    """Of a joint's greatest speed, for what is too far to be reached by then."""
    off: float = setting(0.03, "rad", above=0.0)
    """Where the commanded position is further from the course than this, the next goal is gone to from there."""
    step: float = setting(0.02, "rad", above=0.0)
    """Between two postures on the way that are looked at."""


COURSE = CourseSettings()


class GoalCourse:
    """The way of an arm from where it stands. Goals may come from another thread than asks for the way."""

    def __init__(self, arm: ServoArm, limits: Limits, start: Array, settings: CourseSettings = COURSE) -> None:
        """The arm stands at ``start`` (J,), rad; outside the limits of position, it is led within them."""
        self._arm, self._limits, self.settings = arm, limits, settings
        self._names = arm.folder.names
        self._start = self._goal = target_position(limits, start)[0]
        self._begun_ns = self._last_ns = 0
        self._seconds = 0.0
        self._lock = Lock()

    @property
    def goal(self) -> Array:
        """(J,) rad, where the arm is led."""
        return self._goal

    def lead(self, goals: dict[str, float], reference: Array, now_ns: int) -> Array:
        """Leads the arm to a goal, or to the last posture that is free on the straight way there.

        Args:
            goals: rad, by joint; a joint that is not named keeps its goal.
            reference: (J,) rad, where it is commanded to be now.
            now_ns: of the clock that :meth:`at` goes by, ns.

        Returns:
            (J,) rad, where it is led.

        Raises:
            HighFiveError: no such joint, or what is no number. It is led where it was led before.
        """
        wanted = self._goal.copy()
        for name, angle in goals.items():
            if name not in self._names:
                raise HighFiveError(f"no joint {name}; there are {', '.join(self._names)}")
            if isinstance(angle, bool) or not isinstance(angle, int | float) or not abs(angle) <= TURN:
                raise HighFiveError(f"{name}: {angle!r} is no angle in rad within a turn")
            wanted[self._names.index(name)] = angle
        within = target_position(self._limits, wanted)[0]
        with self._lock:
            start = self._at(now_ns)
            if float(np.abs(start - reference).max()) > self.settings.off:
                start = reference
            period, longest = self._limits.timing.period_s, self.settings.longest
            apart = min(max(1e-9 * (now_ns - self._last_ns), period), longest)
            self._last_ns = self._begun_ns = now_ns
            self._start, self._goal = start, self._free(start, within)
            change = np.abs(self._goal - self._start)
            self._seconds = max(apart, float((change / (self.settings.pace * self._limits.speed)).max()))
            return self._goal

    def at(self, now_ns: int) -> Array:
        """(J,) rad, where the arm is to be now."""
        with self._lock:
            return self._at(now_ns)

    def _at(self, now_ns: int) -> Array:
        share = min(1.0, 1e-9 * (now_ns - self._begun_ns) / self._seconds) if self._seconds else 1.0
        return self._start + share * (self._goal - self._start)

    def _free(self, start: Array, end: Array) -> Array:
        """The last posture on the straight way that can be reached clear of everything."""
        least = min(self.settings.clearance, self._arm.clearance(start))
        return last_free(self._arm, start, end, least, self.settings.step)
