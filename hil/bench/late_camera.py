"""Cameras that see a hidden arm's plate, and a wand, some time before anybody hears of it: exposed, solved, sent."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

import numpy as np

from highfive.hil.arm.hidden_arm import TEMPLATE, HiddenTruth
from highfive.hil.drivers.emulator.virtual_rig import VirtualRig
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.sim.arm_plant import ArmPlant
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.model.geometry.rotations import Array

STAMPS_NS = 7_000_000_000_000
"""What the system's own clock is ahead of this one's."""
WAND = "wand"


class LateCamera:
    """A :class:`highfive.hil.trials.frame_link.Camera`. Its task begins with it, and ends with the clock."""

    def __init__(
        self,
        clock: VirtualClock,
        truth: HiddenTruth,
        body: tuple[VirtualRig, ArmPlant],
        age_s: float,
        jitter_s: float = 0.0,
        stamps_off: Callable[[float], float] = lambda seconds: 0.0,
        rate_hz: float = 120.0,
        wand: Callable[[float], Array] | None = None,
    ) -> None:
        """From now on.

        Args:
            clock: of all.
            truth: of the arm.
            body: its rig and its plant.
            age_s: s, from the exposure until a frame is here, at the least.
            jitter_s: s, mean of what a frame takes longer.
            stamps_off: s, by which stamps are wrong, s from the beginning.
            rate_hz: of the frames.
            wand: (3,) m, of its marker in the world, s from the beginning; None for no wand.
        """
        self._clock, self._truth, (self._rig, self._plant) = clock, truth, body
        self.age_s, self._jitter, self._stamps_off, self._wand = age_s, jitter_s, stamps_off, wand
        self._period_ns, self._begun = round(1e9 / rate_hz), clock.now()
        self._rng, self._sent = np.random.default_rng((truth.seed, 17)), deque[MarkerFrame]()
        self.names = (*TEMPLATE.names, *([WAND] if wand is not None else []))
        clock.start("cameras", self._expose)

    @property
    def next_ns(self) -> int | None:
        """Arrival of the next frame."""
        return self._sent[0].arrival_time_ns if self._sent else self._clock.now() + self._period_ns

    def arrived(self, now_ns: int) -> Sequence[MarkerFrame]:
        """Those that are here."""
        found = []
        while self._sent and self._sent[0].arrival_time_ns <= now_ns:
            found.append(self._sent.popleft())
        return found

    def _expose(self) -> None:
        number = 0
        while True:
            number += 1
            self._clock.wait_until(self._begun + number * self._period_ns)
            now = self._clock.now()
            self._rig.bus.advance(self._rig.now())
            before = self._sent[-1].arrival_time_ns if self._sent else 0
            late = self.age_s + (self._rng.exponential(self._jitter) if self._jitter else 0.0)
            seconds = 1e-9 * (now - self._begun)
            places = self._places(seconds) + self._rng.normal(0.0, 0.0005, (len(self.names), 3))
            self._sent.append(
                MarkerFrame(
                    names=self.names,
                    positions=places,
                    valid=self._rng.random(len(places)) >= 0.02,
                    number=number,
                    source_time_ns=now + STAMPS_NS + round(1e9 * self._stamps_off(seconds)),
                    arrival_time_ns=max(now + round(1e9 * late), before),
                    unlabelled=np.zeros((0, 3)),
                )
            )

    def _places(self, seconds: float) -> Array:
        pose = self._plant.plate()
        axes = np.stack([pose.normal, np.cross(pose.fingers, pose.normal), pose.fingers], axis=1)
        own = pose.position + (TEMPLATE.places + self._truth.glue) @ axes.T
        wand = np.zeros((0, 3)) if self._wand is None else self._wand(seconds)[None]
        return self._truth.in_mocap(np.concatenate([own, wand]))
