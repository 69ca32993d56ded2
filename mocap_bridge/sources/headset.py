"""A headset as motion capture: what its page says of head and hands, as markers with their covariance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.inferred_arm import EYE_HEIGHT, SIZES, elbow_of, shoulder_of
from highfive.mocap_bridge.sources.scheduler import THREADS, Now
from highfive.mocap_bridge.sources.scheme import Address, Scheme
from highfive.mocap_bridge.wire.errors import LinkError
from highfive.mocap_bridge.wire.headset import LIMBS, SIDES, HeadsetPose, decode_headset
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting

VIEWER = ("viewer", "viewer_left", "viewer_up")
"""Between the eyes, and :data:`APART` m to the left of it and above it."""
APART = 0.08
HAND = {"wrist": 0, "index_1": 6, "middle_1": 11, "ring_1": 16, "little_1": 21}
"""Markers of a hand, and their joints in the order of ``XRHand``: a joint named after a bone lies at its near end."""
NAMES = (*VIEWER, *(f"{side}_{name}" for side in SIDES for name in HAND), *LIMBS)
"""Of all markers that a headset gives."""
ADDRESS = "headset://page"
SILENT_S = 0.9
"""A headset that sends nothing for so long sleeps, or has been left, s."""
FIRST_PERIOD_MS, PACE_SHARE = 20.0, 0.05
"""From hand to hand before any has come, ms, and the share of a hand in the average."""
_IN_TIME_MS = 1000.0  # what holds for another time than so about now is not meant


@dataclass(frozen=True)
class HeadsetSettings(Settings):
    """How far off what a headset says is, and how late. See docs/performance.md for what they were chosen on."""

    late_ms: float = setting(25.0, "ms", least=0.0, most=200.0)
    periods: float = setting(0.6, least=0.0, most=5.0)
    """What hands lag behind the time for which they are said to hold: so many ms, and so many periods of the hand's
    tracking. That is 35 ms at 60 Hz and 45 at 30; a Quest 2 has 38 to 45 ms (Abdlkarim 2023)."""
    hand: float = setting(0.004, "m", above=0.0)
    """Standard deviation of a joint of the hand. From frame to frame it is a millimetre; but joints err together, and
    when they were seen is not known to some milliseconds."""
    head: float = setting(0.003, "m", above=0.0)
    """The same of the viewer."""
    body: float = setting(0.03, "m", above=0.0)
    """Of a shoulder or elbow that the browser's body tracking gives: it sees few of them itself."""
    shoulder: float = setting(0.045, "m", above=0.0)
    elbow: float = setting(0.065, "m", above=0.0)
    """Of those that are inferred."""
    lasting: float = setting(16.0, least=1.0)
    """Frames over which the error of what is inferred stays the same: so many of them say what one says."""
    repeat_ms: float = setting(50.0, "ms", least=0.0)
    """The very same hand is no new measurement, but after so long it rests."""


def headset_markers(pose: HeadsetPose, hand: str, settings: HeadsetSettings) -> tuple[Array, NDArray[np.bool_], Array]:
    """Positions (M, 3), m, validity (M,) and covariances (M, 3, 3), m², of :data:`NAMES`.

    Who gives the left hand is mirrored at the world's x–z plane: left is right, and the other way round.
    """
    points, seen, sigma = np.zeros((len(NAMES), 3)), np.zeros(len(NAMES), dtype=bool), np.zeros(len(NAMES))
    flip = np.array([1.0, -1.0 if hand == "left" else 1.0, 1.0])
    order = (1, 0) if hand == "left" else (0, 1)
    count, joints = len(VIEWER), list(HAND.values())
    eyes = pose.viewer[:3] * flip
    forward, up = (rotations.rotate(pose.viewer[3:], axis) * flip for axis in ((0.0, 0.0, -1.0), (0.0, 1.0, 0.0)))
    points[:count] = eyes + APART * np.array([np.zeros(3), np.cross(up, forward), up])
    seen[:count], sigma[:count] = pose.viewer_seen, settings.head
    for row, side in enumerate(order):
        place = slice(count + row * len(joints), count + (row + 1) * len(joints))
        points[place], seen[place], sigma[place] = (
            pose.hands[side, joints] * flip,
            pose.hands_seen[side, joints],
            settings.hand,
        )
    limbs = slice(len(NAMES) - len(LIMBS), len(NAMES))
    swapped = (2, 3, 0, 1) if hand == "left" else (0, 1, 2, 3)
    points[limbs], seen[limbs], sigma[limbs] = (
        pose.limbs[list(swapped)] * flip,
        pose.limbs_seen[list(swapped)],
        settings.body,
    )
    if pose.viewer_seen:
        _infer(points, seen, sigma, eyes, forward, up, settings)
    return np.where(seen[:, None], points, 0.0), seen, np.square(sigma)[:, None, None] * np.eye(3)


def _infer(
    points: Array, seen: NDArray[np.bool_], sigma: Array, eyes: Array, forward: Array, up: Array,
    settings: HeadsetSettings,
) -> None:  # fmt: skip
    """Puts in shoulders and elbows that are not seen; an elbow only where there is a wrist."""
    size = float(np.clip(eyes[2] / EYE_HEIGHT, *SIZES))
    apart = np.sqrt(settings.lasting)
    for side in SIDES:
        shoulder, elbow, wrist = (NAMES.index(f"{side}_{name}") for name in ("shoulder", "elbow", "wrist"))
        if not seen[shoulder]:
            points[shoulder] = shoulder_of(eyes, forward, up, side, size)
            seen[shoulder], sigma[shoulder] = True, settings.shoulder * apart
        if not seen[elbow] and seen[wrist]:
            points[elbow] = elbow_of(points[shoulder], points[wrist], side, forward, size)
            seen[elbow], sigma[elbow] = True, settings.elbow * apart


class HeadsetLink:
    """What comes through the page (see :class:`highfive.mocap_bridge.sources.live.Link`).

    Attributes:
        dropped: messages that were none of a headset's, or said what cannot be.
    """

    rate_hz = 0.0

    def __init__(
        self,
        take: Callable[[float], Sequence[bytes]],
        hand: str = "right",
        now: Now = THREADS.now,
        settings: HeadsetSettings | None = None,
    ) -> None:
        """Args: ``take`` waits so many s at most for messages; ``hand`` is given; ``now`` is the clock, ns."""
        self._take, self._hand, self._now = take, hand, now
        self._settings = settings or HeadsetSettings()
        self._last: HeadsetPose | None = None
        self._came, self._number = now(), 0
        self._period_ms = FIRST_PERIOD_MS
        self.dropped = 0

    def receive(self, timeout_s: float) -> Sequence[MarkerFrame]:
        """Frames that have come; those that repeat a hand to the bit are none.

        Raises:
            LinkError: nothing has come for :data:`SILENT_S`.
        """
        frames = list[MarkerFrame]()
        for data in self._take(timeout_s):
            try:
                pose = decode_headset(data)
            except LinkError:
                self.dropped += 1
                continue
            if abs(pose.holds_ms - 1e-6 * self._now()) > _IN_TIME_MS:
                self.dropped += 1
                continue
            self._came = self._now()
            if self._last is None or not self._repeats(self._last, pose):
                frames.append(self._frame(pose))
        if self._now() - self._came > SILENT_S * 1e9:
            raise LinkError("the headset sends nothing: it sleeps, or has left the page; put it on and enter again")
        return frames

    def close(self) -> None:
        """Nothing to let go of: the page goes on."""

    def _repeats(self, last: HeadsetPose, pose: HeadsetPose) -> bool:
        side = SIDES.index(self._hand)
        same = bool(pose.hands_seen[side, 0]) and np.array_equal(last.hands[side], pose.hands[side])
        return same and last.place == pose.place and pose.holds_ms - last.holds_ms < self._settings.repeat_ms

    def _frame(self, pose: HeadsetPose) -> MarkerFrame:
        if self._last is not None and 5.0 < (period := pose.holds_ms - self._last.holds_ms) < self._settings.repeat_ms:
            self._period_ms += PACE_SHARE * (period - self._period_ms)
        late_ms = self._settings.late_ms + self._settings.periods * self._period_ms
        self._last, self._number = pose, self._number + 1
        points, seen, covariance = headset_markers(pose, self._hand, self._settings)
        return MarkerFrame(
            NAMES, points, seen, self._number, round(1e6 * pose.holds_ms), self._now(), np.zeros((0, 3)),
            counted=False, latency_ns=round(1e6 * late_ms), covariance=covariance, own_clock=True,
        )  # fmt: skip


def _unreachable(address: Address) -> HeadsetLink:
    raise LinkError(f"{address}: a headset comes through the live page: highfive simulate --source headset")


SCHEME = Scheme(
    example="headset://page",
    connect=_unreachable,
    options={"hand": ("right", "left")},
)
