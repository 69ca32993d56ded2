"""From a marker to the arm's plate and back: the parts of a rig's latency, and whether they add up.

All parts but one go by this computer's clock: command to encoder, encoder to the arrival of the plate's markers (the
age of the motion capture), arrival of a marker to its command. The whole is measured within the motion capture's own
stream, where the arm follows a marker: wand to plate, one clock for both. Parts and whole disagree where a stamp is
wrong.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from highfive.calibration.servo_lag import ServoLag
from highfive.calibration.stream_delay import StreamDelay
from highfive.model.errors import HighFiveError

MOST_APART = 0.002
"""s: parts and whole that differ by more do not belong together."""


@dataclass(frozen=True)
class ArmLatency:
    """What was measured of a rig.

    Attributes:
        joints: the servos' lag, a joint's name each.
        mocap: from the encoder to the arrival of the markers: the motion capture's age.
        host: s from a frame's arrival to its command, median.
        whole: from the wand to the plate by the joint ``followed``, in the motion capture's own time; None where
            nothing was followed.
        followed: name of the joint that followed the wand.
    """

    joints: Mapping[str, ServoLag]
    mocap: StreamDelay
    host: float
    whole: ServoLag | None = None
    followed: str = ""

    @property
    def parts(self) -> float:
        """s that mocap, host and the servo that followed add up to."""
        return self.mocap.delay + self.host + self.joints[self.followed].lag

    @property
    def disagreement(self) -> float:
        """s by which the whole is more than its parts; 0 where nothing was followed."""
        return 0.0 if self.whole is None else self.whole.lag - self.parts

    def check(self) -> None:
        """Whether the parts add up.

        Raises:
            HighFiveError: they do not, by more than :data:`MOST_APART`.
        """
        if self.whole is not None and abs(self.disagreement) > MOST_APART:
            raise HighFiveError(
                f"the parts add up to {1e3 * self.parts:.1f} ms (motion capture {1e3 * self.mocap.delay:.1f}, "
                f"host {1e3 * self.host:.1f}, {self.followed} {1e3 * self.joints[self.followed].lag:.1f}), the whole "
                f"is {1e3 * self.whole.lag:.1f} ms; expected the same within {1e3 * MOST_APART:.0f} ms: a stamp "
                "is wrong, or the motion capture's delay changed between the two"
            )
