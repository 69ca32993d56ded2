"""Leads the palm in task space, tick by tick; see :mod:`highfive.model.hgpdm.task_space`."""

from __future__ import annotations

import math

import numpy as np

from highfive.model.geometry.arm_chain import brought
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.dataset import CLOCK_SCALE, Channels
from highfive.model.hgpdm.task_space import APART, BEGIN, END, TaskSpace, led_channels, time_weights
from highfive.model.online.contact_forecast import ContactForecast

SMOOTHING = 0.025
"""s, time constant of each of two smoothings of the change: a forecast comes anew each tick."""
EDGE = 0.1
"""s, over which the change comes and goes where the clock enters the approach, or both times drift apart."""


class Leading:
    """The change of root and joints that leads the palm, behind two smoothings."""

    def __init__(self, space: TaskSpace, channels: Channels, rate_hz: float) -> None:
        """Works out what does not change from tick to tick, and compiles."""
        self._space, self._where = space, channels
        self._columns = led_channels(space.chain, channels)
        self._share = 1.0 - math.exp(-1.0 / rate_hz / SMOOTHING)
        self.reset()
        self._change_for(np.zeros(channels.size), np.zeros(3))

    def reset(self) -> None:
        """Forgets the person."""
        self._smoothed = np.zeros((2, len(self._columns)))

    @property
    def change(self) -> Array:
        """(3 + 3 n,) of the last tick."""
        return self._smoothed[1]

    def time(self, avatar: Array) -> float:
        """Time left, s, by the clock among the channels (C,); infinite outside the approach."""
        clock = float(avatar[self._where.clock])
        time = CLOCK_SCALE * math.atanh(clock) if abs(clock) < 1.0 else math.inf
        return time if END < time < BEGIN else math.inf

    def step(self, avatar: Array, forecast: ContactForecast | None) -> Array:
        """The channels (C,) with the palm led, one tick later; ``forecast`` is None where nobody comes."""
        towards = np.zeros(len(self._columns))
        time = self.time(avatar)
        if forecast is not None and (weight := _weight(time, forecast.time)) > 0.0:
            where, space = self._where, self._space
            first, second = space.slopes @ time_weights(np.array([0.5 * (forecast.time + time)]))[0]
            palm = avatar[where.palm]
            target = palm + first * (forecast.point - avatar[where.contact]) + second * (forecast.point - palm)
            towards = weight * self._change_for(avatar, target)
        self._smoothed[0] += self._share * (towards - self._smoothed[0])
        self._smoothed[1] += self._share * (self._smoothed[0] - self._smoothed[1])
        return self.led(avatar, 1.0)

    def led(self, avatar: Array, share: float) -> Array:
        """The channels (C,) with a ``share`` of the last tick's change."""
        led = avatar.copy()
        led[self._columns] += share * self._smoothed[1]
        return led

    def _change_for(self, avatar: Array, target: Array) -> Array:
        values = np.ascontiguousarray(avatar[self._columns])
        return brought(self._space.chain, self._space.covariance, values[:3], values[3:].reshape(-1, 3), target)


def _weight(time: float, forecast: float) -> float:
    """How much the palm is led with so much time left, s, by the clock and by the forecast."""
    inside = min(time - END, BEGIN - time, APART - abs(forecast - time)) / EDGE
    return min(max(inside, 0.0), 1.0)
