"""One tick of a session: markers in, corrected pose out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.runtime.threads import use_one_blas_thread
from highfive.hil.session.contact_correction import ContactCorrection
from highfive.hil.session.open_responder import open_responder
from highfive.hil.session.paced_responder import PacedResponder
from highfive.hil.session.reach import Expectation, Reach, ReachTarget
from highfive.hil.session.reach_settings import ReachSettings
from highfive.hil.session.style_timing import timing_of
from highfive.hil.sim.avatar import Pose, between
from highfive.hil.sim.scene import Scene
from highfive.mocap_bridge.frames import HumanArm, MarkerFrame, PalmPose, TrackedMarkers
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.tracking.filter_settings import FilterSettings
from highfive.mocap_bridge.tracking.human_arm import HumanArmEstimator
from highfive.mocap_bridge.tracking.palm_filter import PalmFilter, PalmFilterSettings
from highfive.mocap_bridge.tracking.reacquisition import ReacquisitionSmoother
from highfive.mocap_bridge.tracking.tracker import Tracker
from highfive.model.errors import HighFiveError
from highfive.model.geometry.hinges import hinges_towards
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.online.reaction import Reaction, ReactionModel, current_forecast, probability_of_contact
from highfive.model.settings import Settings, setting

RATE_HZ = 120.0
"""Of the model, and of what is recorded or simulated; live frames come at any rate."""

PERIOD_NS = round(1e9 / RATE_HZ)
STALLED_NS = 3 * PERIOD_NS
"""Whatever plays a recording in time and is behind by more, after a pause of the machine, does not make up for it."""
LONGEST_STEP_NS = 1_000_000_000
"""A tick that is later than the one before by more than this, or earlier, begins another time: a clock was set."""


QUICK_PALM = PalmFilterSettings(faster=250.0, fastest=150.0)
"""An avatar's hand may be as quick as a person's. Chosen on simulated high fives of seed 5."""


@dataclass(frozen=True)
class PoseSettings(Settings):
    """What keeps the generated pose calm. Set by hand."""

    quickest: float = setting(30.0, "rad/s", above=0.0)
    """No hinge of the generated pose turns faster than this; a simulated angry elbow reaches some 20."""
    acquaint: float = setting(0.0, "s", least=0.0)
    """A hand that comes into sight is not gone to for so long, unless the model knows what it does: where a hanging arm
    is not seen the model knows no beginning, and a raised hand of which nothing else is known is met at once."""
    calming: float = setting(0.12, "s", above=0.0)
    """Time constant with which the avatar goes from the model's pose to a calm one and back."""


UNSEEN_AT_REST = PoseSettings(acquaint=0.1)
"""For a headset, whose cameras do not see a hanging arm: a quick hand is seen a third of a second before contact.

Chosen on simulated high fives of seed 7: after 0.2, 0.3 or 0.45 s more of them are met late, on the hand's way back."""


@dataclass(frozen=True)
class CalmGoal:
    """What is reached for, as servos can follow it.

    Attributes:
        palm: the person's.
        target: where the palm should be.
    """

    palm: PalmPose
    target: ReachTarget


@dataclass(frozen=True)
class Sighting:
    """The person as a frame shows her, at the frame's own time; neither predicted nor steadied."""

    markers: TrackedMarkers
    person: HumanArm


@dataclass(frozen=True)
class Tick:
    """What one frame led to, or the time that passed without one.

    Attributes:
        time_ns: for which all of it holds, ns on the clock of the frames' stamps.
        markers: every marker of the set, seen or not.
        person: the live person.
        calm: the same for a servo arm: steadier, and later.
        response: what the model answers.
        generated: its pose, inside the joint limits, before correction.
        generated_palm: the palm of ``generated``.
        target: where the palm should be.
        pose: the pose that is played.
        palm: its palm.
        miss: m, distance of ``palm`` from ``target``.
        out_of_reach: the target cannot be reached.
        sighting: what the frame showed; None where none had come.
    """

    time_ns: int
    markers: TrackedMarkers
    person: HumanArm
    calm: CalmGoal
    response: Reaction
    generated: Pose
    generated_palm: PalmPose
    target: ReachTarget
    pose: Pose
    palm: PalmPose
    miss: float
    out_of_reach: bool
    sighting: Sighting | None = None


@dataclass(frozen=True)
class TickInput:
    """What a tick begins with; see :meth:`Session.step`.

    Attributes:
        frame: the newest frame; None where none has come since the last tick.
        time_ns: for when the pose is, ns on the clock of the frames' stamps.
        at_ns: the same time on this process's monotonic clock, ns.
    """

    frame: MarkerFrame | None
    time_ns: int
    at_ns: int

    @property
    def ahead_ns(self) -> int:
        """How far the tick lies ahead of what was measured for it, ns; 0 where nothing was."""
        return 0 if self.frame is None else self.time_ns - self.frame.source_time_ns


class Session:
    """The chain from a marker frame to the pose that is played, at the times at which frames come.

    Attributes:
        chain: values of the settings of pose, tracker and reach, by name, each by field.
        weights: of the style, by emotion.
    """

    def __init__(
        self,
        model: HGPDM | ReactionModel,
        style: Mapping[str, float],
        marker_set: MarkerSet,
        scene: Scene,
        *,
        correct: bool = True,
        settings: PoseSettings | None = None,
        tracking: FilterSettings | None = None,
        clock: Clock = MACHINE,
        reach: ReachSettings | None = None,
    ) -> None:
        """Loads nothing and waits for nothing later: what has to be compiled is compiled here.

        Args:
            model: answers.
            style: weights by emotion.
            marker_set: the person's.
            scene: the avatar's.
            correct: the hand is corrected.
            settings: of the pose.
            tracking: of the tracker, where markers are not a motion capture system's.
            clock: by which a model of somebody else's has to keep up.
            reach: when and how the palm is led to the person's, where that is not usual.

        Raises:
            HighFiveError: the model was trained for another skeleton, or the style does not fit it; a model of
                somebody else's fails.
        """
        use_one_blas_thread()
        self._settings, reach = settings or PoseSettings(), reach or ReachSettings()
        self.chain = {
            "pose": self._settings.values(),
            "tracking": (tracking or FilterSettings()).values(),
            "reach": reach.values(),
        }
        self.weights: Mapping[str, float] = dict(style)
        self._tracker = Tracker(marker_set, RATE_HZ, tracking)
        self._arm = HumanArmEstimator(marker_set)
        self._return = ReacquisitionSmoother()
        self._palm, self._calm_palm = PalmFilter(QUICK_PALM), PalmFilter()
        self._responder = PacedResponder(open_responder(model, style, RATE_HZ, clock=clock), RATE_HZ, self._arm)
        self._timing = timing_of(model)
        # An arm's plan closes in by itself: what it is aimed at is not held back.
        self._reach, self._calm_reach = Reach(reach), Reach(replace(reach, closing=0.0, touching=0.0))
        self._correction = ContactCorrection(scene)
        self._correct = correct
        waiting = self._timing.waiting(self._responder.style)
        hinges_towards(waiting.hinges, between(waiting, waiting, 0.5).hinges, 1.0)  # nothing is left to compile
        self.reset()

    def set_style(self, style: Mapping[str, float]) -> None:
        """Changes the style weights, at any time."""
        self._responder.set_style(style)
        self.weights = dict(style)

    @property
    def corrects(self) -> bool:
        """The hand is corrected."""
        return self._correct

    def set_correct(self, correct: bool) -> None:
        """Whether the hand is corrected from now on."""
        self._correct = correct

    def reset(self) -> None:
        """A new trial: nobody is there yet."""
        self._tracker.reset()
        self._return.reset()
        self._palm.reset()
        self._calm_palm.reset()
        self._trust = [0.0, 0.0]
        self._seen_s = 0.0  # for how long the hand has been in sight
        self._responder.reset()
        self._last = self._timing.waiting(self._responder.style)
        self._reach.reset()
        self._calm_reach.reset()
        self._correction.reset()
        self._captured_ns: int | None = None  # the newest frame's stamp
        self._late_ns = 0  # by how much that lay behind the tick that took the frame in
        self._time_ns = 0  # of the last tick

    def step(self, frame: MarkerFrame | None, time_ns: int | None = None) -> Tick:
        """One tick.

        Args:
            frame: the newest frame; None where none has come since the last tick: the person is predicted.
            time_ns: for when the pose is, ns on the clock of the frames' stamps: from when the cameras saw the person
                until the pose is shown. The person is predicted over it. By default, the frame's own stamp.

        Raises:
            HighFiveError: there is neither frame nor time.
        """
        time_ns, dt = self._elapsed(frame, time_ns)
        sighting = None
        if frame is not None:
            markers = self._tracker.update(frame)
            self._late_ns = time_ns - frame.source_time_ns
            person = self._arm(markers)
            sighting = Sighting(markers, person)
            self._responder.observe(markers, person)
            if time_ns > frame.source_time_ns:
                ahead = self._tracker.at(time_ns)
                markers = replace(ahead, seen=markers.seen, rejected=markers.rejected)
                person = self._arm(markers)
        else:
            markers = self._tracker.at(time_ns)
            person = self._arm(markers)
            self._responder.wait(time_ns - self._late_ns)
        person, calm_palm = self._steady(person, dt)
        response = self._responder.answer(time_ns)
        familiar = response.in_distribution
        generated = self._pose(response, familiar and not self._reach.refused, dt)
        palm = self._correction.palm_of(generated)
        self._seen_s = self._seen_s + dt if person.valid else 0.0
        seen = person.palm if person.valid and (familiar or self._seen_s >= self._settings.acquaint) else None
        expectation = _expectation(response, familiar)
        shoulder = self._correction.shoulder
        target = self._reach.step(palm, seen, expectation, shoulder, dt)
        calm_seen = None if seen is None else calm_palm
        calm = CalmGoal(calm_palm, self._calm_reach.step(palm, calm_seen, expectation, shoulder, dt))
        if not self._correct:
            return Tick(
                time_ns, markers, person, calm, response, generated, palm, target, generated, palm, 0.0, False, sighting
            )
        corrected = self._correction.solve(generated, target.position, target.normal, target.weight, dt)
        return Tick(
            time_ns, markers, person, calm, response, generated, palm, target,
            corrected.pose, corrected.palm, corrected.miss, corrected.out_of_reach, sighting,
        )  # fmt: skip

    def _elapsed(self, frame: MarkerFrame | None, time_ns: int | None) -> tuple[int, float]:
        """The time of this tick, ns, and how long it is after the last one, s."""
        if frame is None and (time_ns is None or self._captured_ns is None):
            raise HighFiveError("a tick without a frame needs a time, and a frame before it")
        captured, before = self._captured_ns if frame is None else frame.source_time_ns, self._captured_ns
        assert captured is not None
        time_ns = captured if time_ns is None else max(time_ns, captured)
        begins = before is None or (frame is not None and not 0 < captured - before <= LONGEST_STEP_NS)
        if begins and before is not None:
            self._responder.restart()
        elapsed, self._captured_ns, self._time_ns = time_ns - self._time_ns, captured, time_ns
        return time_ns, 1e-9 * (PERIOD_NS if begins or not 0 < elapsed <= LONGEST_STEP_NS else elapsed)

    def _steady(self, person: HumanArm, dt: float) -> tuple[HumanArm, PalmPose]:
        """The person with a hand that does not jump and a palm that does not shake; the calm palm for a servo arm."""
        if not person.valid:
            self._return.reset()
            self._palm.reset()
            self._calm_palm.reset()
            return person, person.palm
        # A source that is late by itself hides nothing: only what comes on top of that does.
        longest = self._late_ns + self._responder.settings.patience_ns
        ahead = min(person.time_ns - (self._captured_ns or 0), longest)
        person = self._return(person, dt, ahead)
        return replace(person, palm=self._palm(person.palm, dt)), self._calm_palm(person.palm, dt)

    def _pose(self, response: Reaction, answers: bool, dt: float) -> Pose:
        """The model's pose in the style's timing; to a stranger, and to a hand that comes for something else than a
        high five, the pose in which it waits."""
        style = self._responder.style
        waiting = self._timing.waiting(style)
        pose = self._timing.answering(response, style, waiting)
        # Far from what it has learned the model may leap; no arm does.
        hinges = hinges_towards(self._last.hinges, pose.hinges, self._settings.quickest * dt)
        self._last = pose = Pose(pose.root_in_world, hinges)
        share = 1.0 - math.exp(-dt / self._settings.calming)
        # Two smoothings in a row: the pose sets off and arrives without a jerk.
        self._trust[0] += share * (float(answers) - self._trust[0])
        self._trust[1] += share * (self._trust[0] - self._trust[1])
        return between(waiting, pose, self._trust[1])


def tick_times(ticks: Sequence[Tick]) -> Array:
    """(T,) s, of ticks from the first of them on; where the frames' clock was set, a tick takes its usual time."""
    steps = np.diff(np.array([tick.time_ns for tick in ticks], dtype=np.int64))
    steps = np.where((steps > 0) & (steps <= LONGEST_STEP_NS), steps, PERIOD_NS)
    return 1e-9 * np.concatenate([[0.0], np.cumsum(steps, dtype=float)])


def _expectation(response: Reaction, familiar: bool) -> Expectation:
    contact, probability = current_forecast(response), probability_of_contact(response)
    if contact is None:
        time, deviation = response.time_to_contact, response.time_to_contact_std
        return Expectation(time, deviation, familiar, probability=probability)
    return Expectation(
        contact.time, contact.deviation, familiar, contact.point, contact.covariance[:3, :3], probability
    )
