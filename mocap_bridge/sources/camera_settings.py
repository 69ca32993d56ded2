"""What the filter of a webcam's landmarks is tuned by."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting

JOINTS = (
    "RightShoulder", "RightElbow", "RightWrist", "RightMiddle1", "LeftShoulder", "Head",
)  # fmt: skip
"""Of the filter's state."""
SHOULDER, ELBOW, WRIST, KNUCKLES, LEFT_SHOULDER, HEAD = range(6)
MARKERS = (*JOINTS, "Neck")
"""Of the frames: joint centres by names that :mod:`highfive.mocap_bridge.markers.joint_names` knows."""


@dataclass(frozen=True)
class CameraSettings(Settings):
    """For a rendered person. First chosen on the 36 high fives on which figures are measured now, then held against 18
    others (``hil/bench/webcam_choice.npz``): there nothing here is better by half as much again, or a third less, but
    ``depth`` by a little, with which fewer hands were met; and what is stated of each joint is true."""

    height: float = setting(1.75, "m", least=1.0, most=2.3)
    """Of the person. Who is another one is seen so much further or nearer in all; the placement takes that out."""
    field_of_view: float = setting(70.0, "°", least=30.0, most=120.0)
    """Across the picture. Laptops have 60 to 78; 10 % wrong shifts depth by 10 %, and the placement takes that out."""
    across: tuple[float, ...] = setting((0.014, 0.04, 0.016, 0.009, 0.014, 0.02), "m", above=0.0)
    """Standard deviation of each joint across the view, at full visibility; of the wrist by the pose's net."""
    hand_wrist: float = setting(0.012, "m", above=0.0)
    """The same of the wrist by the hand's net."""
    depth: float = setting(0.08, "m", above=0.0)
    """Standard deviation of a joint's depth against the shoulders by the pose's net."""
    hand_depth: float = setting(0.09, above=0.0)
    """That of the hand's distance by its size, over itself."""
    size_depth: float = setting(0.05, above=0.0)
    """That of the person's distance by the trunk's size, over itself."""
    steady_s: float = setting(0.4, "s", least=0.0)
    """Time over which errors of depth hang together: they are no noise, and so many pictures count as one."""
    size_steady_s: float = setting(0.6, "s", least=0.0)
    """The same of the distance by size."""
    bone: float = setting(0.03, "m", above=0.0)
    """Standard deviation of a bone's length about that of people of this height."""
    girdle: float = setting(0.025, "m", above=0.0)
    """The same of the shoulders' distance, and of the head's from them: girdle and neck move."""
    bone_steady_s: float = setting(0.6, "s", least=0.0)
    """Time over which a bone is the longer or shorter: shoulders move, and the nets' joints do on the bones."""
    girdle_steady_s: float = setting(0.6, "s", least=0.0)
    """The same of shoulders and head."""
    front: float = setting(0.07, "m", above=0.0)
    """Elbow and hand are not further behind the shoulder than this; and how surely."""
    jerk: tuple[float, ...] = setting((0.4, 2.2, 7.0, 8.0, 0.4, 0.4), "m/s^1.5", above=0.0)
    """Of each joint, how fast its speed wanders: white acceleration's spectral density."""
    jerk_along: tuple[float, ...] = setting((0.1, 1.2, 3.0, 3.5, 0.1, 0.1), "m/s^1.5", above=0.0)
    """The same along the view: who stands before a camera does not walk, and her shoulders' depth is seen worst."""
    visible: float = setting(0.5, least=0.0, most=1.0)
    """A joint whose visibility is less is not measured."""
    margin: float = setting(0.05, least=0.0)
    """Share of a picture's height beyond its edge up to which a landmark counts as seen: the nets guess there."""
    hand_near: float = setting(0.25, above=0.0)
    """A hand belongs to the pose's wrist within this share of the shoulders' distance in the picture."""
    hand_score: float = setting(0.5, least=0.0, most=1.0)
    """A hand that is less sure is none."""
    exchanged: float = setting(0.5, above=0.0, most=1.0)
    """Left and right count as exchanged where that explains the picture with this share of the misfit."""
    out_along: float = setting(0.03, "m", above=0.0)
    """Least standard deviation along the view that a frame states; the filter's own is 10 to 20 cm, and holds."""
    out_across: float = setting(0.01, "m", above=0.0)
    """Least standard deviation across the view that a frame states."""
    lost_s: float = setting(0.5, "s", above=0.0)
    """A joint that was not seen for so long is hidden; the person likewise, and the filter begins anew."""


UPPER_ARM, FOREARM, HAND = 0.186, 0.146, 0.0562
SHOULDERS, HEAD_ABOVE, TRUNK, NECK_ABOVE, HEAD_UP = 0.214, 0.125, 0.30, 0.025, 0.945
"""Over the body's height: of the joint centres of ``mocap_bridge/markers/marker_sets/joint_centres.toml`` (1.75 m),
within 1 % of Drillis & Contini 1966 where they give them. The head stands for the middle of the ears; the trunk goes
from the shoulders' middle to where the net has the hips', 2.5 cm below their centres."""
BONES = ((SHOULDER, ELBOW, UPPER_ARM), (ELBOW, WRIST, FOREARM), (WRIST, KNUCKLES, HAND))


@dataclass(frozen=True)
class Camera:
    """A pinhole: how a point in front of it, x to the right, y down, z away, m, comes to lie in its picture.

    Attributes:
        focal: pixels.
        centre: (2,) pixels.
    """

    focal: float
    centre: Array

    @classmethod
    def of(cls, size: tuple[int, int], field_of_view: float) -> Camera:
        """With square pixels and a ``field_of_view``, °, across the longer side."""
        return cls(0.5 * max(size) / math.tan(0.5 * math.radians(field_of_view)), 0.5 * np.array(size, dtype=float))

    def pixels(self, points: Array) -> Array:
        """(..., 2) of points (..., 3)."""
        return self.centre + self.focal * points[..., :2] / points[..., 2:]

    def points(self, pixels: Array, depth: Array | float) -> Array:
        """(..., 3), m, of pixels (..., 2) at a depth, m."""
        depth = np.broadcast_to(np.asarray(depth, dtype=float), pixels.shape[:-1])[..., None]
        return np.concatenate([(pixels - self.centre) / self.focal * depth, depth], axis=-1)
