"""Lets a style keep its own pace on the way back from a high five.

The model's hand leaves as the person's does. Once palms have been together the avatar goes back from the pose in which
they were, in the time that the style's actors take (:mod:`highfive.model.online.return_pace`), whatever the person
does; it is the model's again when its own hand is down too, when the next reach begins, or where the person's face
comes near: the model knows how hands pass a face, a course between two poses does not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from highfive.hil.session.reach import Phase
from highfive.hil.sim.avatar import Pose, between
from highfive.hil.sim.profiles import minimum_jerk
from highfive.model.geometry.rotations import Array
from highfive.model.online.inertialization import run_out
from highfive.model.online.return_pace import ReturnPace
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class StyleReturnSettings(Settings):
    """How the way back is handed over, by hand."""

    easing: float = setting(0.2, "s", above=0.0)
    """In which the difference in place and speed runs out, when the palms part and when the model takes over again."""
    down: float = setting(0.15, above=0.0, most=1.0)
    """Of the way from rest: a model's pose that is nearer to rest than this is down, too."""
    face: float = setting(0.3, "m", least=0.0)
    """A palm that is nearer to the middle of the person's head than this, and than the model's, is in the way."""


AWAY = math.inf, math.inf


class StyleReturn:
    """The way back of one high five after another, tick by tick."""

    def __init__(self, pace: ReturnPace | None, settings: StyleReturnSettings | None = None) -> None:
        """Without a ``pace`` poses stay as they are."""
        self._pace, self._settings = pace, settings or StyleReturnSettings()
        self.reset()

    def reset(self) -> None:
        """No high five yet."""
        self._away: Array | None = None  # from the waiting pose, where it goes back from, while it does
        self._over = False  # the way back of this high five has begun
        self._said: Array | None = None
        self._followed_before: tuple[Array, Array] | None = None  # the model's pose and the waiting one, a tick ago
        self._velocity = self._offset = self._drift = np.zeros(0)
        self._since = self._eased = 0.0

    def step(
        self, pose: Pose, waiting: Pose, style: Array, phase: Phase, dt: float, face: tuple[float, float] = AWAY
    ) -> Pose:
        """The pose of this tick.

        Args:
            pose: the model's.
            waiting: the one in which the style waits.
            style: (K,) weights.
            phase: what the reach was doing a tick ago.
            dt: s since then.
            face: m, to the middle of the person's head from the palm a tick ago, and from the model's own.
        """
        if self._pace is None:
            return pose
        before, self._since, target = self._away, self._since + dt, pose
        values, rest = _values(pose), _values(waiting)
        model_before, rest_before = self._followed_before or (values, rest)
        self._followed_before, speed = (values, rest), (values - model_before) / dt
        if phase in (Phase.APPROACH, Phase.TOUCH):
            self._away, self._over = None, False
        elif phase is Phase.RELEASE and before is None and not self._over:
            self._away, self._since, self._over = values - rest, 0.0, True
        if self._away is not None:
            onset, duration = self._pace.of(style)
            done = (self._since - onset) / duration
            in_the_way = face[0] < self._settings.face and (before is None or face[0] < face[1])
            if in_the_way or (done >= 1.0 and self._down(values - rest)):
                self._away = None
            else:
                left = 1.0 - float(minimum_jerk(done))
                target, speed = between(waiting, _pose(rest + self._away), left), (rest - rest_before) / dt
        return self._followed(target, None if self._away is before else speed, dt)

    def _followed(self, target: Pose, jumps: Array | None, dt: float) -> Pose:
        """The pose for a target that goes on, or ``jumps`` to one of this speed, without a step in place or speed."""
        said = values = _values(target)
        if jumps is not None and self._said is not None:
            self._offset, self._eased = self._said + self._velocity * dt - values, 0.0
            self._drift = (self._velocity - jumps) * self._settings.easing
        if len(self._offset):
            said = values + run_out(self._offset, self._drift, self._eased / self._settings.easing)
            self._eased += dt
            if self._eased > self._settings.easing:
                self._offset = np.zeros(0)
        self._velocity = np.zeros_like(said) if self._said is None else (said - self._said) / dt
        self._said = said
        if said is values:
            return target
        return between(target, _pose(said), 1.0)

    def _down(self, away: Array) -> bool:
        assert self._away is not None
        return bool(np.linalg.norm(away[3:]) <= self._settings.down * np.linalg.norm(self._away[3:]))


def _values(pose: Pose) -> Array:
    return np.concatenate([pose.root_in_world, pose.hinges.ravel()])


def _pose(values: Array) -> Pose:
    return Pose(values[:3], values[3:].reshape(-1, 3))
