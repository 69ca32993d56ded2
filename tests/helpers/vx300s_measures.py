"""The servo arm in numbers: the one place where its measures are written down.

A six-jointed arm of ViperX 300 S class with a palm plate in place of the gripper. In the zero pose the upper arm stands
upright, the forearm points forward (+x), and every joint frame is parallel to the base: x forward, y left, z up.

Sources
    Lengths, limits, reach, payload and speed: the maker's published drawings and tables of the ViperX 300 S.
    Torque and no-load speed: the servo maker's manual (XM540-W270 and XM430-W350 at 12 V).
    Masses add up to the published moving mass; how they are shared among the links, their inertias, and the friction
    and reflected inertia of the gears are our own estimates.
"""

from __future__ import annotations

from typing import NamedTuple

Vector = tuple[float, float, float]

JOINTS = ("waist", "shoulder", "elbow", "forearm_roll", "wrist_angle", "wrist_rotate")
"""The joints from base to plate."""

AXES: tuple[Vector, ...] = ((0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0))
"""Axis of each joint in the zero pose; a positive turn of shoulder and elbow lowers the hand in front."""

OFFSETS: tuple[Vector, ...] = (
    (0.0, 0.0, 0.079),
    (0.0, 0.0, 0.048),
    (0.0596, 0.0, 0.300),
    (0.200, 0.0, 0.0),
    (0.100, 0.0, 0.0),
    (0.0697, 0.0, 0.0),
)
"""Centre of each joint in the frame of the one before it (the first: of the base), m."""

LIMITS_DEGREES = ((-180, 180), (-106, 72), (-101, 92), (-180, 180), (-107, 128), (-180, 180))
"""Range of each joint."""

GRIPPER = 0.0744
"""From the last joint to the tip of the gripper that the plate replaces, m: with it the published reach is full."""

REACH = 0.750
"""Published reach, shoulder to the gripper's tip with the arm stretched, m."""

PLATE_DISTANCE = 0.18
"""From the last joint to the plate's surface along the tool axis, m: found by the search for a mounting."""

PLATE_RADIUS, PLATE_THICKNESS = 0.065, 0.012
"""Of the round plate, m."""

SPEED_LIMIT = 3.1415926535897931
"""rad/s (30 rpm): the velocity limit that every servo is set to, and the no-load speed of the larger one."""


class Servo(NamedTuple):
    """A servo at 12 V: stall torque, N·m; no-load speed, rad/s; reflected inertia, kg·m²; friction, N·m and N·m·s."""

    stall: float
    no_load: float
    armature: float
    friction: float
    damping: float


XM540 = Servo(10.6, 3.1415926535897931, 0.012, 0.25, 0.15)
XM430 = Servo(4.1, 4.817, 0.006, 0.12, 0.06)

SERVOS = ((XM540, 1), (XM540, 2), (XM540, 2), (XM540, 1), (XM540, 1), (XM430, 1))
"""Each joint's servo, and how many of it share the load."""


class Link(NamedTuple):
    """What a joint carries: mass, kg; centre of mass in its frame, m; moments of inertia about it, kg·m²."""

    mass: float
    centre: Vector
    inertia: Vector


LINKS = (
    Link(0.80, (0.0, 0.0, 0.020), (0.0010, 0.0011, 0.0009)),
    Link(0.79, (0.012, 0.0, 0.205), (0.0090, 0.0092, 0.0006)),
    Link(0.32, (0.105, 0.0, 0.0), (0.0002, 0.0016, 0.0016)),
    Link(0.41, (0.055, 0.0, 0.0), (0.0003, 0.0008, 0.0008)),
    Link(0.115, (0.045, 0.0, 0.0), (0.00006, 0.00009, 0.00009)),
    Link(0.115, (0.060, 0.0, 0.0), (0.00005, 0.00045, 0.00045)),
)
"""The links, the last without its plate; together the published moving mass."""

MOVING_MASS = 2.55
"""Of all links without the plate, kg."""

PLATE_MASS = 0.150
"""kg"""


class Ball(NamedTuple):
    """A sphere on a link, for distances: the link (index of its joint), centre in its frame and radius, m."""

    link: int
    centre: Vector
    radius: float


BALLS = (
    Ball(2, (0.0, 0.0, 0.0), 0.060),
    Ball(2, (0.10, 0.0, 0.0), 0.050),
    Ball(4, (0.0, 0.0, 0.0), 0.055),
    Ball(5, (0.0, 0.0, 0.0), 0.050),
    Ball(5, (PLATE_DISTANCE - 0.04, 0.0, 0.0), 0.070),
)
"""What must not come near the floor, the mount, the upper arm (the last three) or a head."""

TURRET_RADIUS, UPPER_ARM_RADIUS, COLUMN_RADIUS = 0.065, 0.050, 0.060
"""Of the capsules around the base, the upper arm, and the column that the arm stands on, m."""
