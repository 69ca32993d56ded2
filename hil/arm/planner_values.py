"""What goes into a tick of the plan of the servo arm, what it hands on, and what comes out."""

from __future__ import annotations

from dataclasses import dataclass

from highfive.hil.safety.people import Sighting
from highfive.mocap_bridge.frames import PalmPose
from highfive.model.geometry.rotations import Array
from highfive.model.gp.mixture import GaussianMixture

KNOTS = 12
CONTACT_KNOT = 10
"""Of those, the one at the expected contact, as long as it is further than so many ticks away."""


@dataclass(frozen=True)
class ExpectedContact:
    """Where and when the palms will meet.

    Attributes:
        point: (3,) m, in the world.
        covariance: (3, 3) m².
        normal: (3,) unit vector out of the plate.
        time: s from now; 0 while the palms touch.
    """

    point: Array
    covariance: Array
    normal: Array
    time: float


@dataclass(frozen=True)
class PalmGoal:
    """What the session asks of the arm in one tick.

    Attributes:
        palm: the avatar's palm.
        person: the person's palm; None where nobody knows it.
        head: (3,) m, centre of the person's head, or None.
        contact: None while no high five is on, or it is not yet known where.
        hypotheses: where palms may meet while that is not known; None: nobody is waited for.
        person_seen, head_seen: how well palm and head are known, as of the tick's frame; None: measured in it where
            they are given.
    """

    palm: PalmPose
    person: PalmPose | None = None
    head: Array | None = None
    contact: ExpectedContact | None = None
    hypotheses: GaussianMixture | None = None
    person_seen: Sighting | None = None
    head_seen: Sighting | None = None


@dataclass(frozen=True)
class ConstraintRelaxation:
    """What a high five had to give up.

    Attributes:
        scale: size of the plate's path beside the avatar's palm's.
        delay: s, by how much the plate came late.
        time_scale: the time that the approach took over the time that was left when it began.
        miss: m, distance of the commanded plate from the place of contact when contact was due.
        limits: bits of :mod:`highfive.hil.arm.planning_limits` of the limits that shortened a step.
    """

    scale: float = 1.0
    delay: float = 0.0
    time_scale: float = 1.0
    miss: float = 0.0
    limits: int = 0

    @property
    def limit_names(self) -> tuple[str, ...]:
        """The limits in words."""
        names = ("acceleration", "speed", "joint stop", "torque", "nearness")
        return tuple(name for bit, name in enumerate(names) if self.limits >> bit & 1)


@dataclass(frozen=True)
class RetargetState:
    """What one tick hands to the next.

    Attributes:
        joints, speeds: (J,) rad and rad/s, as commanded.
        accelerations: (N, J) rad/s², the plan; its knots are ``knot`` s apart.
        guess: (J,) rad, a posture that meets the hand.
        knot: s.
        scale: of the avatar's path about the contact; None between high fives.
        given: s that were left when this approach began.
        late: s since contact was due.
        together: s since the commanded plate was there.
        relaxation: of the high five that is on, or was last.
        said: the contact that is expected, if one is.
        unsaid: s since it was last spoken of.
    """

    joints: Array
    speeds: Array
    accelerations: Array
    guess: Array
    knot: float = 0.05
    scale: float | None = None
    given: float = 0.0
    late: float = 0.0
    together: float = 0.0
    relaxation: ConstraintRelaxation = ConstraintRelaxation()
    said: ExpectedContact | None = None
    unsaid: float = 0.0


@dataclass(frozen=True)
class ArmStep:
    """One tick's command.

    Attributes:
        positions: (J,) rad, the command: where the joints shall be, and beyond by what they give way.
        joints, speeds: (J,) rad and rad/s, where they shall be a lag after the end of the tick.
        torques: (J,) N·m, that this takes, gravity and friction included.
        time: s until the commanded plate should meet the hand; infinite between high fives.
        miss: m, planned distance from the place of contact then.
        limits: bits of the limits that shortened this step.
    """

    positions: Array
    joints: Array
    speeds: Array
    torques: Array
    time: float
    miss: float
    limits: int
