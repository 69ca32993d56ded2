"""The model at its own rate, along frames that come at any.

The model's filter was trained for one step of time. Frames come at 30 to 500 Hz, late, early, or not at all. So the
model steps along a grid of its own: to each of its times the hand is interpolated between the frames on both sides
(:mod:`highfive.mocap_bridge.tracking.interpolation`), and what it answers is predicted from the last of them to the
time that is asked for. Frames at the model's rate lie on the grid, and nothing is interpolated or predicted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from highfive.hil.session.open_responder import ContinuousResponder
from highfive.mocap_bridge.frames import HumanArm, TrackedMarkers
from highfive.mocap_bridge.tracking.human_arm import HumanArmEstimator
from highfive.mocap_bridge.tracking.interpolation import between
from highfive.mocap_bridge.tracking.reacquisition import ReacquisitionSmoother
from highfive.model.geometry.rotations import Array
from highfive.model.online.arm_track import ArmPoints
from highfive.model.online.belief import HAND_VARIANCE
from highfive.model.online.reaction import Reaction
from highfive.model.settings import Settings, setting

HAND_COVARIANCE = HAND_VARIANCE * np.tile(np.eye(3), (2, 1, 1))
"""(2, 3, 3) m², of the hand points where every marker is seen; what the tracker does not know comes on top."""


@dataclass(frozen=True)
class PaceSettings(Settings):
    """How the model keeps up with the frames. Set by hand."""

    snap: float = setting(0.01, least=0.0, most=0.5)
    """A frame that is off the grid by no more than this share of a step moves the grid: stamps jitter and clocks drift
    by less, and a step is worth a millisecond of computing."""
    patience_ns: int = setting(50_000_000, "ns", above=0)
    """A hand of which nothing was heard for so long counts as hidden."""
    catch_up: int = setting(6, least=1)
    """Steps without a hand in one tick at most; a longer pause is one prediction: no burst of steps."""


class PacedResponder:
    """Feeds a responder with hands at its own rate; answers for any time after the newest."""

    def __init__(
        self,
        responder: ContinuousResponder,
        rate_hz: float,
        arm: HumanArmEstimator,
        settings: PaceSettings | None = None,
    ) -> None:
        """Args: ``rate_hz`` is the responder's rate; ``arm`` makes of markers what it sees of a person."""
        self._responder, self._arm, self.settings = responder, arm, settings or PaceSettings()
        self._seconds = 1.0 / rate_hz
        self._period_ns = 1e9 / rate_hz
        self._smoother = ReacquisitionSmoother()
        self.reset()

    @property
    def style(self) -> Array:
        """The style weights (K,) of the last answer."""
        return self._responder.style

    def set_style(self, style: str | Mapping[str, float] | ArrayLike) -> None:
        """Changes the style weights, at any time."""
        self._responder.set_style(style)

    def reset(self) -> None:
        """Nobody is there yet."""
        self._responder.reset()
        self.restart()
        self._reaction: Reaction | None = None

    def restart(self) -> None:
        """The frames' clock was set: their next one begins another grid. What is known of the person stays."""
        self._smoother.reset()
        self._time_ns: float | None = None  # of the last step
        self._before: TrackedMarkers | None = None

    def observe(self, markers: TrackedMarkers, person: HumanArm) -> None:
        """Takes in a frame.

        Args:
            markers: after the frame.
            person: what the arm estimator makes of them.
        """
        time, before = float(markers.time_ns), self._before
        self._before = markers
        if self._time_ns is None or before is None:
            self._step(person, time)
            return
        steps = (time - self._time_ns) / self._period_ns
        if time - before.time_ns > self.settings.patience_ns:
            self._hide(round(steps) - 1)
            self._step(person, time)
            return
        for _ in range(int(steps + self.settings.snap)):
            at = self._time_ns + self._period_ns
            if abs(at - time) <= self.settings.snap * self._period_ns:
                self._step(person, time)
            else:
                self._step(self._arm(between(before, markers, round(at))), at)

    def wait(self, time_ns: int) -> None:
        """Nothing has come until now: what lies back longer than the patience was hidden."""
        if self._time_ns is not None:
            steps = (time_ns - self.settings.patience_ns - self._time_ns) / self._period_ns
            self._hide(int(steps + self.settings.snap))

    def _hide(self, steps: int) -> None:
        """Some steps without a hand."""
        assert self._time_ns is not None
        if steps > self.settings.catch_up:
            self._responder.skip(steps - 1)
            self._time_ns += (steps - 1) * self._period_ns
            steps = 1
        for _ in range(steps):
            self._step(None, self._time_ns + self._period_ns)

    def answer(self, time_ns: int) -> Reaction:
        """The reaction at a time, predicted where that is after the last step; :meth:`observe` comes first."""
        if self._time_ns is None or self._reaction is None:
            self._step(None, float(time_ns))
        assert self._time_ns is not None and self._reaction is not None
        ahead = time_ns - self._time_ns
        if ahead <= self.settings.snap * self._period_ns:
            return self._reaction
        return self._responder.ahead(1e-9 * ahead)

    def _step(self, person: HumanArm | None, time_ns: float) -> None:
        self._time_ns = time_ns
        if person is None or not person.valid:
            self._smoother.reset()
            self._reaction = self._responder.step(None)
            return
        person = self._smoother(person, self._seconds)
        arm = ArmPoints(person.arm_points, person.arm_covariance) if person.whole else None
        self._reaction = self._responder.step(person.hand_points, HAND_COVARIANCE + person.hand_covariance, arm)
