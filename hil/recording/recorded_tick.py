"""What is recorded of a tick."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

from highfive.hil.session.contact_time import sure_contact_s
from highfive.hil.session.session import Sighting, Tick, TickInput
from highfive.hil.sim.avatar import Pose
from highfive.mocap_bridge.frames import HumanArm, MarkerFrame, TrackedMarkers
from highfive.model.online.contact_forecast import ContactForecast
from highfive.model.online.reaction import current_forecast


@dataclass(frozen=True)
class RecordedTick:
    """A tick of a trial.

    Attributes:
        frame: with which it began; None where none had come.
        time_ns: for which its pose is, ns on the clock of the frames' stamps.
        at_ns: the same time on the session's clock, ns.
        markers, person: as tracked.
        generated: what the model had answered.
        corrected: the pose that was requested.
        played: the pose that was really shown.
        forecast: of the contact; None where no hand approaches.
        phase: of the reach.
        weight: share of the correction.
        expected: s, time to contact as the model says.
        tick_ms: markers in to corrected pose out.
        sighting: the person at the frame's own time; None where no frame had come.
        sure: the time to contact can be said (:func:`highfive.hil.session.contact_time.sure_contact_s`).
    """

    frame: MarkerFrame | None
    time_ns: int
    at_ns: int
    markers: TrackedMarkers
    person: HumanArm
    generated: Pose
    corrected: Pose
    played: Pose
    forecast: ContactForecast | None
    phase: str
    weight: float
    expected: float
    tick_ms: float
    sighting: Sighting | None = None
    sure: bool = False

    @property
    def captured_ns(self) -> int:
        """When the person was seen as in ``sighting``, on the session's clock, ns."""
        return self.at_ns if self.sighting is None else self.at_ns - self.time_ns + self.sighting.markers.time_ns


def pose_digest(pose: Pose) -> str:
    """Of every bit of a pose: two with the same one are the same."""
    content = pose.root_in_world.tobytes() + pose.hinges.tobytes()
    return hashlib.blake2b(content, digest_size=8).hexdigest()


def recorded_tick(begins: TickInput, tick: Tick, played: Pose, tick_ms: float) -> RecordedTick:
    """Of what a session made of an input, and what was shown."""
    return RecordedTick(
        begins.frame, begins.time_ns, begins.at_ns, tick.markers, tick.person, tick.generated, tick.pose, played,
        current_forecast(tick.response), tick.target.phase.value, tick.target.weight, tick.response.time_to_contact,
        tick_ms, tick.sighting, sure_contact_s(tick.response, tick.target.phase) is not None,
    )  # fmt: skip
