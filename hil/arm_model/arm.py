"""An arm given as data: links, joints, limits, motors."""

from __future__ import annotations

from typing import NamedTuple

from highfive.model.geometry.rotations import Array


class Arm(NamedTuple):
    """A mounted arm, packed.

    Attributes:
        joints: 0 … J - 1. A tuple's length is a constant to the compiler, so that loops over joints are unrolled.
        axes: (J, 3) unit vectors that the joints turn about, in the frame before (the first: the base's). Frames are
            parallel to the base where all joints are zero.
        offsets: (J, 3) m, each joint's centre in the frame before it.
        plate, normal, fingers: (3,) m, middle of the plate's surface, and unit vectors out of it and across it, where
            fingers would point; in the last link's frame.
        base, base_axes: (3,) m and (3, 3), where the base stands, and its axes in columns.
        low, high: (J,) rad.
        speeds: (J,) rad/s, most that is requested.
        accelerations: (J,) rad/s².
        stall, no_load: (J,) N·m and rad/s of the torque–speed line.
        masses, centres, inertias: (J,) kg, (J, 3) m and (J, 3, 3) kg·m² about the centres, of links in their frames.
        armature, friction, damping: (J,) kg·m², N·m, N·m·s of the gears.
        ball_links, balls: (B,) and (B, 4): spheres on the links, centre and radius, m.
        meets_upper: (B,) 1 for a sphere that could meet the upper arm, else 0.
        posts: (3,) m, radii of turret, upper arm and column.
        upper: (2,) joints between which the upper arm lies; the turret reaches from the base to the first of them.
        facing: m that a turn of the plate's normal by a radian counts as much as.
        met: (P,) joints whose centres, beside the plate, may meet a person.
    """

    joints: tuple[int, ...]
    axes: Array
    offsets: Array
    plate: Array
    normal: Array
    fingers: Array
    base: Array
    base_axes: Array
    low: Array
    high: Array
    speeds: Array
    accelerations: Array
    stall: Array
    no_load: Array
    masses: Array
    centres: Array
    inertias: Array
    armature: Array
    friction: Array
    damping: Array
    ball_links: Array
    balls: Array
    meets_upper: Array
    posts: Array
    upper: Array
    facing: float
    met: Array
