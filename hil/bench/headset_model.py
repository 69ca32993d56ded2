"""A headset that tracks hands as published ones do: when it sees them, how late, how often, and how far off.

What is published (Abdlkarim et al. 2023, Quest 2 against motion capture): fingertips 11 mm off on average, 45 ms late
(38 in the preprint); a Vision Pro some 128 ms late; hands at 30 Hz, or at 60. An error is drawn in parts that a hand
tracker's come in: what stays for a person (the hand's place and turn against the cameras, a model of the hand that is
not of her size), what wanders over some tenths of a second, and what differs from frame to frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from highfive.hil.sim.people.role import RATE_HZ, ActorMotion
from highfive.mocap_bridge.wire.headset import JOINTS, HeadsetPose
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

FINGERS = ("thumb", "index", "middle", "ring", "little")
EYES_IN_HEAD = np.array([0.09, 0.0, 0.09])
"""(3,) m, between the eyes, in the frame of the head's joint."""
XR_HZ = 72.0
AHEAD_S = 0.018
"""A frame is sent so long before the time for which it is predicted, s."""
NETWORK_S = (0.002, 0.0015)
"""Least way to the host, and mean of the exponential one on top, s."""
CLOCK_S = 0.001
"""Standard deviation by which the page is wrong about the host's clock, s."""

STAYS_M, STAYS_RAD, SIZE = 0.0035, 0.025, 0.03
WANDERS_M, WANDERS_RAD, WANDERS_S = 0.0025, 0.02, 0.4
JITTER_M = 0.001
"""Standard deviations of a coordinate of a hand's place, of a turn of it about the wrist, of its size over itself, and
of a joint from frame to frame; and the time over which what wanders does. Fingertips are then 11 mm off on average."""
HEAD_M, HEAD_RAD = 0.0015, 0.004
"""The same of what wanders in the head's pose."""
SEEN = np.radians([-65.0, 50.0, 70.0])
"""A hand is seen between these elevations against the head, and up to this far to either side, rad: before the face and
beside it, but not where an arm hangs."""


@dataclass(frozen=True)
class Device:
    """One headset.

    Attributes:
        rate_hz: at which hands are tracked; frames come at :data:`XR_HZ` and repeat a hand until there is a new one.
        late_ms: by how much a hand lags behind the time for which a frame is predicted, on average.
        told_ms: how much the host is told that it lags beyond what a headset usually does.
    """

    rate_hz: float
    late_ms: float
    told_ms: float = 0.0


class Wearer:
    """Where head and hands of a simulated person truly are, and what a headset makes of it."""

    def __init__(self, motion: ActorMotion, rng: np.random.Generator) -> None:
        """Draws what stays the same for her."""
        skeleton = motion.skeleton
        places, turns = skeleton.forward_kinematics(motion.root_in_world, motion.quaternions)
        times = np.arange(len(places)) / RATE_HZ
        joints = [[skeleton.index(f"{side}_{name}") for name in ("wrist", *_KNUCKLES)] for side in ("left", "right")]
        head = turns[:, skeleton.index("head")]
        eyes = places[:, skeleton.index("head")] + rotations.rotate(head, EYES_IN_HEAD)
        axes = np.stack([rotations.rotate(head, axis) for axis in np.eye(3)], axis=1)
        self.end = float(times[-1])
        self._hands = CubicSpline(times, places[:, joints])
        self._eyes, self._axes = CubicSpline(times, eyes), CubicSpline(times, axes)
        self._rng = rng
        self._stays = rng.normal(0.0, STAYS_M, (2, 3))
        self._turned = rng.normal(0.0, STAYS_RAD, (2, 3))
        self._size = rng.normal(1.0, SIZE)

    def hands(self, at: Array) -> Array:
        """True wrists and knuckles (T, 2, 5, 3), m: wrist, index, middle, ring and little finger."""
        return self._hands(np.clip(at, 0.0, self.end))

    def head(self, at: Array) -> tuple[Array, Array]:
        """The true point between the eyes (T, 3), m, and the head's axes forward, left and up in the world (T, 3, 3), a
        row each."""
        at = np.clip(at, 0.0, self.end)
        return self._eyes(at), rotations.to_matrix(rotations.from_matrix(np.swapaxes(self._axes(at), 1, 2))).swapaxes(
            1, 2
        )

    def measured(self, at: Array) -> Array:
        """Hands (T, 2, 5, 3), m, as a headset would have them at times that are evenly apart."""
        true, step = self.hands(at), float(at[1] - at[0])
        shift = self._stays + _wandering(self._rng, WANDERS_M, (len(at), 2, 3), step)
        turn = self._turned + _wandering(self._rng, WANDERS_RAD, (len(at), 2, 3), step)
        wrist = true[:, :, :1]
        arrows = rotations.rotate(rotations.from_rotation_vector(turn)[:, :, None], self._size * (true - wrist))
        return wrist + arrows + shift[:, :, None] + self._rng.normal(0.0, JITTER_M, true.shape)

    def seen(self, at: Array) -> Array:
        """Which hands (T, 2) the cameras see."""
        eyes, axes = self.head(at)
        to_hand = self.hands(at)[:, :, 0] - eyes[:, None]
        ahead, left, up = np.moveaxis(np.einsum("tij,thj->thi", axes, to_hand), -1, 0)
        elevation, aside = np.arctan2(up, np.hypot(ahead, left)), np.abs(np.arctan2(left, ahead))
        low, high, widest = SEEN
        return (elevation > low) & (elevation < high) & (aside < widest)

    def poses(self, device: Device, before_s: float) -> list[tuple[float, float, HeadsetPose]]:
        """What the page sends, from ``before_s`` before she begins on.

        Returns:
            for each message when it arrives and what it is said to hold for, s after she begins, and the pose; the time
            in the pose is 0.
        """
        rng = self._rng
        half = 0.5 / XR_HZ  # a hand waits for so long on average until there is a frame
        exposures = np.arange(
            -before_s - 0.5 + rng.uniform(0.0, 1.0 / device.rate_hz), self.end + 0.5, 1.0 / device.rate_hz
        )
        hands, seen = self.measured(exposures), self.seen(exposures)
        frames = np.arange(-before_s, self.end, 1.0 / XR_HZ)
        eyes, axes = self.head(frames)
        eyes = eyes + _wandering(rng, HEAD_M, eyes.shape, 1.0 / XR_HZ)
        tilt = rotations.to_matrix(rotations.from_rotation_vector(_wandering(rng, HEAD_RAD, eyes.shape, 1.0 / XR_HZ)))
        viewer = rotations.from_matrix(tilt @ np.swapaxes(axes, 1, 2) @ _VIEWER_IN_HEAD)
        newest = np.searchsorted(exposures, frames - 1e-3 * device.late_ms + half, side="right") - 1
        wrong, arrives, found = rng.normal(0.0, CLOCK_S), -np.inf, []
        for number, (frame, hand) in enumerate(zip(frames, newest, strict=True)):
            pose = HeadsetPose(
                number, 0, 0.0, np.concatenate([eyes[number], viewer[number]]), True,
                _all_joints(hands[hand]), np.repeat(seen[hand][:, None], JOINTS, axis=1),
                np.zeros((4, 3)), np.zeros(4, dtype=bool),
            )  # fmt: skip
            arrives = max(arrives, frame - AHEAD_S + NETWORK_S[0] + rng.exponential(NETWORK_S[1]))
            found.append((arrives, frame + wrong, pose))
        return found


_KNUCKLES = tuple(f"{finger}_1" for finger in FINGERS[1:])
# The viewer's axes (x right, y up, z backward), columns, in the head's (x forward, y left, z up).
_VIEWER_IN_HEAD = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def _all_joints(hands: Array) -> Array:
    """Hands (2, 25, 3) of which wrist and knuckles (2, 5, 3) are true; the other joints lie between."""
    joints = np.repeat(hands[:, :1], JOINTS, axis=1)
    for finger in range(4):
        joints[:, 5 + 5 * finger] = 0.5 * (hands[:, 0] + hands[:, 1 + finger])
        joints[:, 6 + 5 * finger : 10 + 5 * finger] = hands[:, 1 + finger, None]
    return joints


def _wandering(rng: np.random.Generator, sigma: float, shape: tuple[int, ...], step: float) -> Array:
    """Ornstein-Uhlenbeck noise of that deviation over the first axis, ``step`` s apart."""
    keep = float(np.exp(-step / WANDERS_S))
    noise = rng.normal(0.0, sigma, shape)
    noise[1:] *= np.sqrt(1.0 - keep**2)
    return lfilter([1.0], [1.0, -keep], noise, axis=0)
