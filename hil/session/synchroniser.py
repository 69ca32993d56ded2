"""Puts the avatar's poses and the person's arm on one time line (the paper's synchronisation server).

The two come with time stamps of their own: poses when the model has answered, the arm as the markers come in. Whoever
shows both (MuJoCo, a viewer, the servo rig) asks for one time and gets both as they were then.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from dataclasses import dataclass, replace
from typing import TypeVar

from highfive.hil.sim.avatar import Pose
from highfive.mocap_bridge.frames import HumanArm, PalmPose
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations

KEPT = 64
"""Samples of each stream that are remembered: half a second at 120 Hz."""

AHEAD_NS = 25_000_000
"""Beyond its newest sample a stream goes on as it was going for so long at the most, then stays."""

Sample = TypeVar("Sample")


@dataclass(frozen=True)
class Moment:
    """Avatar and person at one time.

    Attributes:
        time_ns: the time requested, ns.
        pose: the avatar.
        person: the person.
    """

    time_ns: int
    pose: Pose
    person: HumanArm


class Synchroniser:
    """Remembers the newest samples of both streams and answers for any time near them."""

    def __init__(self) -> None:
        """Starts empty."""
        self.reset()

    def reset(self) -> None:
        """Forgets both streams."""
        self._poses: deque[tuple[int, Pose]] = deque(maxlen=KEPT)
        self._people: deque[tuple[int, HumanArm]] = deque(maxlen=KEPT)

    def add(self, time_ns: int, pose: Pose) -> None:
        """A pose of the avatar; one that is not newer than the last is dropped."""
        if not self._poses or time_ns > self._poses[-1][0]:
            self._poses.append((time_ns, pose))

    def add_person(self, person: HumanArm) -> None:
        """The person's arm at its source time; one that is not newer than the last is dropped."""
        if not self._people or person.time_ns > self._people[-1][0]:
            self._people.append((person.time_ns, person))

    def at(self, time_ns: int) -> Moment:
        """Both at ``time_ns``: between samples by interpolation, before the oldest the oldest.

        Raises:
            HighFiveError: one of the streams has not begun.
        """
        if not self._poses or not self._people:
            missing = "poses of the avatar" if not self._poses else "frames of the person"
            raise HighFiveError(
                f"there are no {missing} yet; both streams have to run before they can be shown together"
            )
        (early, late, part), (first, second, share) = _around(self._poses, time_ns), _around(self._people, time_ns)
        pose = early if part == 0.0 else _mix_poses(early, late, part)
        person = first if share == 0.0 else _mix_people(first, second, share, time_ns)
        return Moment(time_ns, pose, person)


def _around(samples: deque[tuple[int, Sample]], time_ns: int) -> tuple[Sample, Sample, float]:
    """Two neighbouring samples and where ``time_ns`` lies from the first (0) to the second (1), or beyond it."""
    times = [time for time, _ in samples]
    index = bisect_right(times, time_ns) - 1
    if index < 0:
        return samples[0][1], samples[0][1], 0.0
    if times[index] == time_ns or len(times) == 1:
        return samples[index][1], samples[index][1], 0.0
    index = min(index, len(times) - 2)
    reached = min(time_ns, times[-1] + AHEAD_NS)
    part = (reached - times[index]) / (times[index + 1] - times[index])
    return samples[index][1], samples[index + 1][1], part


def _mix_poses(a: Pose, b: Pose, part: float) -> Pose:
    return Pose(
        a.root_in_world + part * (b.root_in_world - a.root_in_world),
        a.hinges + part * (b.hinges - a.hinges),
    )


def _mix_people(a: HumanArm, b: HumanArm, part: float, time_ns: int) -> HumanArm:
    points = ("head_position", "shoulder", "elbow", "wrist", "knuckles", "hand_points")
    mixed = {name: getattr(a, name) + part * (getattr(b, name) - getattr(a, name)) for name in points}
    return replace(
        b,
        **mixed,
        head_orientation=rotations.slerp(a.head_orientation, b.head_orientation, part),
        palm=_mix_palms(a.palm, b.palm, part),
        valid=a.valid and b.valid,
        time_ns=time_ns,
    )


def _mix_palms(a: PalmPose, b: PalmPose, part: float) -> PalmPose:
    normal, fingers = a.normal + part * (b.normal - a.normal), a.fingers + part * (b.fingers - a.fingers)
    normal = normal / (normal @ normal) ** 0.5
    fingers = fingers - normal * (fingers @ normal)
    return PalmPose(
        a.position + part * (b.position - a.position),
        normal,
        fingers / (fingers @ fingers) ** 0.5,
        a.velocity + part * (b.velocity - a.velocity),
    )
