"""From a marker to the arm's plate and back: the parts of a rig's latency, and whether they add up.

The parts go by this computer's clock: a marker to the arrival of its frame (the motion capture's age), arrival to the
bus's cycle that has the command, that command to the encoder. The whole is measured within the motion capture's own
stream, where the arm follows a marker: wand to plate, one clock for both. Parts and whole disagree where a stamp is
wrong.
"""

from __future__ import annotations

from dataclasses import dataclass

from highfive.model.errors import HighFiveError

SERVO_LAG = "_lag_s"
"""What the names of joints' own lags end with in a calibration: the arm's, whatever motion capture sees it."""

MOST_APART = 0.002
"""s: parts and whole that differ by more do not belong together."""


@dataclass(frozen=True)
class ArmLatency:
    """What was measured while an arm followed a wand.

    Attributes:
        mocap: s, the motion capture's age.
        host: s, from a frame's arrival to its command.
        servo: s, from command to encoder, of the joint that followed.
        whole: s, from the wand to the plate.
        followed: name of that joint.
    """

    mocap: float
    host: float
    servo: float
    whole: float
    followed: str

    @property
    def parts(self) -> float:
        """s that they add up to."""
        return self.mocap + self.host + self.servo

    @property
    def disagreement(self) -> float:
        """s by which the whole is more than its parts."""
        return self.whole - self.parts

    def check(self) -> None:
        """Whether the parts add up.

        Raises:
            HighFiveError: they do not, by more than :data:`MOST_APART`.
        """
        if abs(self.disagreement) > MOST_APART:
            raise HighFiveError(
                f"the parts add up to {1e3 * self.parts:.1f} ms (motion capture {1e3 * self.mocap:.1f}, "
                f"host {1e3 * self.host:.1f}, {self.followed} {1e3 * self.servo:.1f}), the whole "
                f"is {1e3 * self.whole:.1f} ms; expected the same within {1e3 * MOST_APART:.0f} ms: a stamp "
                "is wrong, or the motion capture's delay changed between the two"
            )
