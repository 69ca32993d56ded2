"""What is kept of one trial: its figures, and the ticks that they come from."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from highfive.hil.sim.avatar import Pose
from highfive.hil.sim.contact_check import ContactReport
from highfive.mocap_bridge.frames import HumanArm, TrackedMarkers
from highfive.model.online.contact_forecast import ContactForecast


@dataclass(frozen=True)
class TrialResult:
    """One trial: its figures, and the T ticks that they come from; none where it was :meth:`condensed`.

    Attributes:
        number: counted from 0.
        title, emotion, cell, simulated, notes: from the partner; the emotion is the simulated person's own.
        style: in which the avatar answered, such as ``'angry'`` or ``'angry 0.5 + neutral 0.5'``.
        contact: what the contact check found in the scene.
        error: m, palm to palm at contact; where they did not meet, at the nearest approach.
        uncorrected_error: m, of the generated pose at its own nearest approach.
        true_error: m, at the nearest, to the person's true palm rather than the tracked one; NaN where not known.
        touch_error: m, between the played palm and the person's true palm in the tick in which the palms first touch by
            the contact check; NaN where they do not, or the true palm is not known.
        touch_speed: m/s, at which the played palm and the true one close in along their common normal over that tick;
            NaN likewise.
        palm_angle: rad, between the palms, 0 when they face each other.
        out_of_reach: the palm could not be reached at contact; ``error`` says by how much.
        why_not_met: why the palms did not meet, for people; '' where they did.
        contact_time: s, when the palms met in this trial, NaN if they did not.
        time_error: s, later (positive) than the palms met originally, NaN where not known.
        other_error: m, nearest approach of who met this hand originally, NaN where not known.
        speed_change: largest change of a joint's speed from tick to tick in the fade-in, rad/s.
        uncorrected_speed_change: the same of the generated motion, in the whole trial.
        markers_seen: share of the markers that were measured, over all ticks; NaN where there are none.
        times: (T,) s.
        people: the live person, a tick each.
        poses, generated: what was played, and what the model had answered.
        person_palm, palm, generated_palm: (T, 3) m.
        other_palm: (T, 3) m, or None.
        weight: (T,) share of the correction.
        expected: (T,) s, time to contact as the model says.
        markers: as tracked, a tick each.
        forecasts: of where and when the palms meet, a tick each; None where no hand approaches.
        tick_ms: (K,) ms, markers in to corrected pose out, of all ticks; K is T but where it was condensed.
    """

    number: int
    title: str
    emotion: str
    style: str
    cell: str
    simulated: bool
    notes: tuple[str, ...]
    contact: ContactReport
    error: float
    uncorrected_error: float
    true_error: float
    touch_error: float
    touch_speed: float
    palm_angle: float
    out_of_reach: bool
    why_not_met: str
    contact_time: float
    time_error: float
    other_error: float
    speed_change: float
    uncorrected_speed_change: float
    markers_seen: float
    times: Float[np.ndarray, " T"]
    people: tuple[HumanArm, ...]
    poses: tuple[Pose, ...]
    generated: tuple[Pose, ...]
    person_palm: Float[np.ndarray, "T 3"]
    palm: Float[np.ndarray, "T 3"]
    generated_palm: Float[np.ndarray, "T 3"]
    other_palm: Float[np.ndarray, "N 3"] | None
    weight: Float[np.ndarray, " T"]
    expected: Float[np.ndarray, " T"]
    markers: tuple[TrackedMarkers, ...]
    forecasts: tuple[ContactForecast | None, ...]
    tick_ms: Float[np.ndarray, " K"]

    @property
    def whole(self) -> bool:
        """Its ticks are there, and can be drawn."""
        return len(self.poses) > 0

    def condensed(self) -> TrialResult:
        """Its figures alone, with what each tick took: what a long session keeps of most of its trials."""
        nothing, none = np.zeros((0, 3)), np.zeros(0)
        return replace(
            self, times=none, people=(), poses=(), generated=(), person_palm=nothing, palm=nothing,
            generated_palm=nothing, other_palm=None, weight=none, expected=none, markers=(), forecasts=(),
        )  # fmt: skip
