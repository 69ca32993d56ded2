"""When the palms will meet, and where the avatar's palm should be until then and after.

The model says how long it is until contact and moves the hand there, a few centimetres off. The reach fades the miss in
as contact comes near: the palm is led to ``generated + weight * miss``, with

    miss = r + r' * remaining / 2,    r = person's palm - generated palm,

which is ``r`` itself at contact. The second term leaves the closing movement to the model: without it the palm
would run to the person's as soon as the weight is 1. A half, because a hand that comes in braking covers half of what
its speed says. Where the model forecasts the place of contact, that and the braking hand are weighed by what each is
worth: the forecast counts while contact is far, the hand when it is near. Where both palms close in slowly, the
avatar's is held back by what a least closing speed takes: palms that creep together touch by a millimetre too early,
and that is long.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from jaxtyping import Float

from highfive.hil.session.doubt import Doubt
from highfive.hil.session.reach_settings import ReachSettings
from highfive.hil.sim.profiles import minimum_jerk
from highfive.mocap_bridge.frames import PalmPose
from highfive.model.geometry.rotations import Array
from highfive.model.geometry.turns import turn_between, turned
from highfive.model.online.contact_forecast import believed


class Phase(Enum):
    """What the reach is doing."""

    IDLE = "idle"
    APPROACH = "approach"
    TOUCH = "touch"
    RELEASE = "release"


_LONGEST_STEP = 0.02
"""s, of the low pass of the miss: steps of more than 2 / ``steady``, 77 ms, would not settle."""
_CREEPING = 0.05
"""m/s; palms that close in more slowly are told from pressing ones by nothing."""


@dataclass(frozen=True)
class Expectation:
    """When and where contact is expected, as the model says.

    Attributes:
        time: s until contact, negative after it.
        deviation: s, its standard deviation.
        familiar: the person's hand does what hands did in training; otherwise the model's word counts for nothing.
        point, covariance: (3,) m and (3, 3) m², where in the world, if the model says.
        probability: that it is coming at all; None where the model does not say: every raised hand is met.
    """

    time: float
    deviation: float
    familiar: bool
    point: Float[np.ndarray, "3"] | None = None
    covariance: Float[np.ndarray, "3 3"] | None = None
    probability: float | None = None


@dataclass(frozen=True)
class ReachTarget:
    """Where the avatar's palm should be now.

    Attributes:
        phase: what the reach is doing.
        weight: fraction of the correction, 0 to 1.
        remaining: s until contact as the reach counts it; 0 in touch, infinite when idle.
        position: (3,) m, in the world.
        normal: (3,) unit vector out of the palm.
        rate: s per second, at which ``remaining`` runs out.
    """

    phase: Phase
    weight: float
    remaining: float
    position: Float[np.ndarray, "3"]
    normal: Float[np.ndarray, "3"]
    rate: float = 1.0


class Reach:
    """The course of one high five after another, tick by tick."""

    def __init__(self, settings: ReachSettings | None = None) -> None:
        """Starts idle, and compiles."""
        self.settings = settings or ReachSettings()
        self._doubt = Doubt()
        x, y, _ = np.eye(3)
        believed(turned(turn_between(x, y), x), 1.0, np.eye(3))
        self.reset()

    def reset(self) -> None:
        """Back to idle."""
        self._phase = Phase.IDLE
        self._since = 0.0
        self._length = self._remaining = self._rate = 0.0
        self._weight_at_release = 0.0
        self._gap: Array | None = None
        self._generated_before: Array | None = None
        self._gap_velocity = np.zeros(3)
        self._miss = np.zeros(3)
        self._miss_velocity = np.zeros(3)
        self._turn = np.zeros(3)
        self._touched = self._lost = False
        self._familiar = True
        self._doubt.reset()
        self._expects = np.inf
        self._told = (0.0, 0.0)
        self._ahead = 0.0
        self._slow = np.zeros((2, 3))
        self._ease = np.zeros((2, 3))

    @property
    def refused(self) -> bool:
        """The raised hand is no high five: nothing answers it."""
        return self._doubt.unlikely and self._phase is Phase.IDLE and not self._doubt.met

    def step(
        self, generated: PalmPose, person: PalmPose | None, expectation: Expectation, shoulder: Array, dt: float
    ) -> ReachTarget:
        """The target of this tick.

        Args:
            generated: the palm of the uncorrected pose.
            person: the person's palm; None when nobody knows where it is.
            expectation: what the model says of time and place.
            shoulder: (3,) m, the avatar's right shoulder: what can be reached is near it.
            dt: s since the last tick.
        """
        self._since += dt
        if person is not None:
            self._observe(generated, person, dt)
        self._familiar = expectation.familiar
        self._doubt.weigh(expectation.probability, expectation.familiar, dt)
        if person is not None and self._hangs(person) and _norm(person.velocity) < self.settings.rising:
            self._doubt.met = False
        if not expectation.familiar:
            expected = _led(person, shoulder, self.settings)
        else:
            expected = self._expected(expectation) + (0.0 if person is None else self._pressing(person.normal))
        self._expects = expected
        self._advance(person, expected, dt)
        if self._phase in (Phase.APPROACH, Phase.TOUCH):
            if person is None:
                self._lost = True
            else:
                self._aim(generated, person, expectation, dt)
        elif self._phase is Phase.RELEASE:
            self._miss = self._miss + self._miss_velocity * dt
            self._miss_velocity = self._miss_velocity * math.exp(-dt / self.settings.landing)
        weight = self._weight()
        if weight == 0.0:
            remaining = self._remaining if self._phase is Phase.APPROACH else np.inf
            return ReachTarget(self._phase, 0.0, remaining, generated.position, generated.normal, self._rate)
        normal = turned(weight * self._turn, generated.normal)
        remaining = np.inf if self._phase is Phase.RELEASE else self._remaining
        place = generated.position + weight * self._miss
        return ReachTarget(self._phase, weight, remaining, place, normal, self._rate)

    def _observe(self, generated: PalmPose, person: PalmPose, dt: float) -> None:
        if self._generated_before is not None:
            # The tracker knows the person's velocity better than differences of positions do.
            velocity = person.velocity - (generated.position - self._generated_before) / dt
            share = 1.0 - math.exp(-dt / self.settings.smoothing)
            self._gap_velocity = self._gap_velocity + share * (velocity - self._gap_velocity)
        self._generated_before = generated.position
        self._gap = person.position - generated.position

    def _expected(self, expectation: Expectation) -> float:
        """Time to contact, s: the model's, or where it does not know, that of the nearest approach of near palms."""
        gap, settings = self._gap, self.settings
        if gap is None:
            return np.inf
        if expectation.deviation < settings.sure:
            return max(expectation.time, 0.0) if expectation.time > -settings.late else np.inf
        distance, speed = _norm(gap), _norm(self._gap_velocity)
        if distance < settings.near:
            return 0.0
        closing = -float(gap @ self._gap_velocity) / max(speed, 1e-6) ** 2
        return closing if distance < settings.horizon and closing > 0.0 and speed > 0.1 else np.inf

    def _coming(self, person: PalmPose | None) -> bool:
        """The person's palm is raised or rising, and near or on its way: it will be here soon at its present speed."""
        gap = self._gap
        if gap is None or person is None:
            return False
        if self._hangs(person) or not self._doubt.likely:
            return False
        distance = _norm(gap)
        speed = -float(gap @ person.velocity) / max(distance, 1e-9)
        return not self._familiar or distance < self.settings.horizon or distance < self.settings.soon * speed

    def _hangs(self, person: PalmPose | None) -> bool:
        s = self.settings
        return person is not None and bool(person.position[2] < s.raised and person.velocity[2] < s.rising)

    def _advance(self, person: PalmPose | None, expected: float, dt: float) -> None:
        s = self.settings
        if self._phase is Phase.IDLE:
            if self._coming(person) and not self._touched and expected < s.fade_in:
                self._enter(Phase.APPROACH)
                self._lost, self._ease = False, np.zeros((2, 3))
                self._ahead = expected
                self._length = self._remaining = min(max(expected, s.shortest_fade_in), s.fade_in)
                self._rate = 1.0
            elif self._far():
                self._touched = False  # hands are apart again: ready for the next one
        elif self._phase is Phase.APPROACH:
            known = math.isfinite(expected)
            if not known and self._since > s.longest and self._hangs(person) and self._far():  # it was missed
                self._touched = True
                self._release()
                return
            target = s.target_rate(self._remaining, expected)
            if not known and self._familiar and not self._near():
                target = s.slowest  # the model will know more when the hands are closer
            elif not known and self._far():  # a hand that leaves: back the way it came, or after it while there is time
                target = -1.0 if self._weight() < 0.5 else s.fastest
            target = -1.0 if self._doubt.unlikely and self._weight() < 0.5 else target
            self._rate, before = s.next_rate(self._rate, target, dt), self._remaining
            self._remaining -= self._rate * dt
            if person is not None and _norm(person.velocity) > s.quickest:
                self._remaining = max(self._remaining, min(before, s.waiting))
            if self._remaining > self._length:
                self._enter(Phase.IDLE)
            if self._remaining <= 1e-9:
                self._remaining, self._touched, self._doubt.met = 0.0, True, True
                self._enter(Phase.TOUCH)
        elif self._phase is Phase.TOUCH and self._since >= s.touch - 1e-9:
            self._release()
        elif self._phase is Phase.RELEASE and self._since >= s.fade_out:
            self._enter(Phase.IDLE)

    def _near(self) -> bool:
        return self._gap is not None and _norm(self._gap) < 2.0 * self.settings.near

    def _far(self) -> bool:
        return self._gap is not None and _norm(self._gap) > 0.6

    def _enter(self, phase: Phase) -> None:
        self._phase, self._since = phase, 0.0

    def _release(self) -> None:
        self._weight_at_release = self._weight()
        self._enter(Phase.RELEASE)

    def _weight(self) -> float:
        if self._phase is Phase.APPROACH:
            return float(minimum_jerk(1.0 - self._remaining / self._length))
        if self._phase is Phase.RELEASE:
            return self._weight_at_release * float(1.0 - minimum_jerk(self._since / self.settings.fade_out))
        return float(self._phase is Phase.TOUCH)

    def _aim(self, generated: PalmPose, person: PalmPose, expectation: Expectation, dt: float) -> None:
        """The miss (m) and the turn (rotation vector, rad) that would bring palm to palm at contact."""
        gap = person.position - generated.position
        share = 1.0 - math.exp(-dt / self.settings.smoothing)
        self._ahead += share * (min(self._remaining, self._expects) - self._ahead)
        self._ahead = min(self._ahead, self._remaining)
        ahead = self._landing(self._ahead)
        closing = 0.5 * self._gap_velocity * ahead + self._held_back(person.normal, ahead)
        raw = self._bent(gap + closing + self._forecast(person, expectation, ahead, dt))
        miss = self._smooth(raw, dt)
        turn = turn_between(generated.normal, -person.normal)
        if self._lost:  # a hand that comes back is not where it was left: the difference runs out
            self._ease, self._lost = np.array([self._miss - miss, self._turn - turn]), False
        self._ease *= math.exp(-dt / self.settings.easing)
        miss, turn = miss + self._ease[0], turn + self._ease[1]
        self._miss_velocity = (miss - self._miss) / dt if self._since > 0.0 else np.zeros(3)
        self._miss, self._turn = miss, turn

    def _held_back(self, normal: Array, ahead: float) -> Array:
        """How far before the person's palm, along its ``normal``, the closing speed has to begin: (3,) m."""
        s = self.settings
        lacking = max(s.closing - 0.5 * float(self._gap_velocity @ normal), 0.0)
        return lacking * s.held * (1.0 - math.exp(-ahead / s.held)) * normal

    def _pressing(self, normal: Array) -> float:
        """How long palms that close in along the person's ``normal`` touch before they lie on each other, s: when they
        touch is what is foretold."""
        s = self.settings
        if s.touching == 0.0:
            return 0.0
        share = s.touching / (max(s.closing, 0.5 * float(self._gap_velocity @ normal), _CREEPING) * s.landing)
        x = math.sqrt(0.5 * share)
        for _ in range(2):  # of x² (2 - x), see _landing
            x = math.sqrt(share / (2.0 - min(x, 1.0)))
        return s.landing * min(x, 1.0)

    def _forecast(self, person: PalmPose, expectation: Expectation, ahead: float, dt: float) -> Array:
        """What the model's forecast adds to where a braking hand would be at contact: (3,) m."""
        if expectation.point is None or expectation.covariance is None or not expectation.familiar:
            self._told = (0.0, 0.0)
            return np.zeros(3)
        # It is told all at once, and believed behind two smoothings: the hand that goes there would jerk.
        share = 1.0 - math.exp(-2.0 * dt / self.settings.easing)
        first, second = self._told
        first += share * (1.0 - first)
        self._told = first, second + share * (first - second)
        beyond = expectation.point - (person.position + 0.5 * ahead * person.velocity)
        variance = (0.5 * self.settings.braking * ahead**2) ** 2
        return self._told[1] * believed(beyond, variance, np.ascontiguousarray(expectation.covariance))

    def _smooth(self, miss: Array, dt: float) -> Array:
        """The miss behind a critically damped low pass, and as it is in the last moment."""
        pull = self.settings.steady
        if self._since <= dt:
            self._slow = np.array([miss, np.zeros(3)])
        place, speed = self._slow
        parts = math.ceil(dt / _LONGEST_STEP)  # one long step after a tick that was late would throw the hand
        for _ in range(parts):
            speed = speed + (pull * pull * (miss - place) - 2.0 * pull * speed) * (dt / parts)
            place = place + speed * (dt / parts)
        self._slow = np.array([place, speed])
        homing = minimum_jerk(1.0 - self._remaining / self.settings.homing)
        return homing * miss + (1.0 - homing) * self._slow[0]

    def _bent(self, miss: Array) -> Array:
        """The miss, shortened where it is so long that it must be the extrapolation's; in full as the palms meet."""
        length, free = _norm(miss), self.settings.bend + 0.6 * self._weight() ** 2
        if length <= free or not self._familiar:
            return miss
        return miss / length * (free + self.settings.bend * math.tanh((length - free) / self.settings.bend))

    def _landing(self, remaining: float) -> float:
        """The remaining time, bent so that it comes to 0 without a corner: x² (2 - x) over the last stretch."""
        x = remaining / self.settings.landing
        return remaining if x >= 1.0 else self.settings.landing * x * x * (2.0 - x)


def _norm(vector: Array) -> float:
    return math.sqrt(vector.dot(vector))


def _led(person: PalmPose | None, shoulder: Array, settings: ReachSettings) -> float:
    """Time, s, until an unfamiliar raised hand will be nearest the avatar's shoulder, if it can be met there."""
    if person is None or person.position[2] < settings.raised:
        return np.inf
    offset, speed = person.position - shoulder, _norm(person.velocity)
    until = -float(offset @ person.velocity) / max(speed, 0.15) ** 2
    if until < 0.0 and speed > 0.3:  # on its way out
        return np.inf
    until = max(until, 0.0)
    return until if _norm(offset + until * person.velocity) < settings.arm else np.inf
