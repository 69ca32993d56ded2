"""An arm given as data: links, joints, limits, motors."""

from __future__ import annotations

from typing import NamedTuple

from highfive.model.geometry.rotations import Array


class Arm(NamedTuple):
    """A mounted arm, packed.

    Attributes:
        axes: (J,) 0, 1, 2 for x, y, z: each joint turns about an axis of its own frame.
        offsets: (J, 3) m, each joint's centre in the frame before it.
        plate: m, from the last joint to the plate along the tool axis.
        base, base_axes: (3,) m and (3, 3), where the base stands, and its axes in columns.
        low, high: (J,) rad.
        speeds: (J,) rad/s, most that is requested.
        accelerations: (J,) rad/s².
        stall, no_load: (J,) N·m and rad/s of the torque–speed line.
        masses, centres, inertias: (J,) kg, (J, 3) m and (J, 3) kg·m² of the links in their frames.
        armature, friction, damping: (J,) kg·m², N·m, N·m·s of the gears.
        ball_links, balls: (B,) and (B, 4): spheres on the links, centre and radius, m.
        posts: (3,) m, radii of turret, upper arm and column.
    """

    axes: Array
    offsets: Array
    plate: float
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
    posts: Array
