"""The values that pass between marker sources, the tracker and the human arm."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Integer


@dataclass(frozen=True)
class MarkerFrame:
    """One frame of labelled markers, in the world frame.

    Attributes:
        names: M marker names (a source's own prefix already removed).
        positions: (M, 3) m; meaningless where ``valid`` is False (never NaN past the bridge).
        valid: (M,) bool, the marker was seen in this frame.
        number: the source's frame number; gaps in it are lost frames.
        source_time_ns: the source's own time stamp, ns.
        arrival_time_ns: when the frame arrived here, ns on this process's monotonic clock.
        unlabelled: (U, 3) m, points without a label (ghosts, or markers whose label was lost).
        counted: the source counts its frames itself; otherwise ``number`` follows from ``source_time_ns``, and a loss
            shows some time after it.
        impossible: markers that are not ``valid`` because their coordinates cannot be meant (infinite, or too far).
        latency_ns: from when the cameras saw it until the system sent it, ns, as the system says; 0 where it does not.
        covariance: (M, 3, 3) m², symmetric and positive definite, of each measured position, where the source knows how
            far its points are off; None where one standard deviation holds for all
            (``FilterSettings.marker_sigma``). Meaningless where ``valid`` is False.
        own_clock: ``source_time_ns`` is of this process's monotonic clock already.
    """

    names: tuple[str, ...]
    positions: Float[np.ndarray, "M 3"]
    valid: Bool[np.ndarray, " M"]
    number: int
    source_time_ns: int
    arrival_time_ns: int
    unlabelled: Float[np.ndarray, "U 3"]
    counted: bool = True
    impossible: int = 0
    latency_ns: int = 0
    covariance: Float[np.ndarray, "M 3 3"] | None = None
    own_clock: bool = False


@dataclass(frozen=True)
class TrackedMarkers:
    """Every marker of a set with its uncertainty, seen or not.

    Attributes:
        names: M marker names in the order of the marker set.
        positions: (M, 3) m, posterior mean.
        velocities: (M, 3) m/s, posterior mean.
        covariances: (M, 3, 3) m², posterior covariance of the positions.
        seen: (M,) bool, the marker was measured (and the measurement accepted) in this frame.
        age_ns: (M,) int, time since the marker was last measured; 0 where ``seen``, the largest integer where never.
        valid: (M,) bool, the estimate is good enough to use.
        rejected: (M,) bool, the marker's label was at a point that was not believed to be the marker in this frame.
        time_ns: source time of the frame, ns.
    """

    names: tuple[str, ...]
    positions: Float[np.ndarray, "M 3"]
    velocities: Float[np.ndarray, "M 3"]
    covariances: Float[np.ndarray, "M 3 3"]
    seen: Bool[np.ndarray, " M"]
    age_ns: Integer[np.ndarray, " M"]
    valid: Bool[np.ndarray, " M"]
    rejected: Bool[np.ndarray, " M"]
    time_ns: int


@dataclass(frozen=True)
class PalmPose:
    """Where a palm is and where it faces, in the world frame.

    Attributes:
        position: (3,) m, centre of the palm's surface.
        normal: (3,) unit vector out of the palm.
        fingers: (3,) unit vector from the wrist to the fingers, across ``normal``.
        velocity: (3,) m/s, velocity of ``position``.
    """

    position: Float[np.ndarray, "3"]
    normal: Float[np.ndarray, "3"]
    fingers: Float[np.ndarray, "3"]
    velocity: Float[np.ndarray, "3"]


@dataclass(frozen=True)
class HumanArm:
    """The live person as the rest of the system sees them: head, right arm and palm, in the world frame.

    Attributes:
        head_position: (3,) m, centre of the head.
        head_orientation: (4,) quaternion of the head (x forward out of the face, z up).
        shoulder, elbow, wrist: (3,) m, joint centres.
        knuckles: (3,) m, centre of the knuckles (heads of the second to fifth metacarpal).
        palm: pose of the palm.
        hand_points: (2, 3) m, wrist and knuckle centre: what the model sees of the person (the paper's Y², D = 6).
        valid: all of the above rests on usable markers.
        age_ns: age of the oldest marker that the hand rests on; the largest integer where none of them was ever seen.
        time_ns: source time, ns.
        hand_covariance: (2, 3, 3) m², of the hand points, as if the markers of each erred together; zero if not known.
        head_unseen_ns, hand_unseen_ns: ns since any marker on the head (where the set has none: any of those that stand
            in for it), or of wrist and hand, was last measured, whatever the estimate; the largest integer where none
            ever was.
        head_deviation, hand_deviation: m, standard deviation of the head's centre, and of wrist or knuckles, whichever
            is less sure, as if the markers erred together.
        whole: it is ``valid``, and each marker that it rests on was seen: elbow, shoulder and head are this person's.
        arm_covariance: (3, 3, 3) m², of the arm points, as ``hand_covariance``.
    """

    head_position: Float[np.ndarray, "3"]
    head_orientation: Float[np.ndarray, "4"]
    shoulder: Float[np.ndarray, "3"]
    elbow: Float[np.ndarray, "3"]
    wrist: Float[np.ndarray, "3"]
    knuckles: Float[np.ndarray, "3"]
    palm: PalmPose
    hand_points: Float[np.ndarray, "2 3"]
    valid: bool
    age_ns: int
    time_ns: int
    hand_covariance: Float[np.ndarray, "2 3 3"] = field(default_factory=lambda: np.zeros((2, 3, 3)))
    head_unseen_ns: int = 0
    hand_unseen_ns: int = 0
    head_deviation: float = 0.0
    hand_deviation: float = 0.0
    whole: bool = False
    arm_covariance: Float[np.ndarray, "3 3 3"] = field(default_factory=lambda: np.zeros((3, 3, 3)))

    @property
    def arm_points(self) -> Float[np.ndarray, "3 3"]:
        """(3, 3) m: elbow, shoulder and centre of the head."""
        return np.array([self.elbow, self.shoulder, self.head_position])
