"""The servo arm where it is mounted: kinematics, gravity, and postures that put its plate somewhere."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from highfive.hil.arm_model import distances, dynamics, inverse_kinematics, kinematics
from highfive.hil.arm_model.arm import Arm
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.scenes import servo_arm as measures

JOINTS = len(measures.JOINTS)
SPEED_SHARE = 0.97
"""Of the speed limit, that is requested: at the limit itself a servo has no torque left."""
TORQUE_SHARE = 0.7
"""Of the servos' torque, that is requested: a warm servo or a low supply has less than the table."""
ACCELERATIONS = (40.0, 35.0, 45.0, 80.0, 80.0, 80.0)
"""rad/s², most that is requested of each joint."""


@dataclass(frozen=True)
class Mount:
    """Where the arm stands.

    Attributes:
        position: (x, y, z) m of the base's underside in the world.
        yaw: rad about the vertical; 0 points the arm to the person (+x).
        tilt: rad, the base pitched forward after the yaw.
        roll: rad, the base rolled about its own x after both.
    """

    position: tuple[float, float, float]
    yaw: float = 0.0
    tilt: float = 0.0
    roll: float = 0.0

    @property
    def quaternion(self) -> Array:
        """(4,) orientation of the base in the world."""
        yawed = rotations.multiply(rotations.from_axis_angle("z", self.yaw), rotations.from_axis_angle("y", self.tilt))
        return rotations.multiply(yawed, rotations.from_axis_angle("x", self.roll))


@dataclass(frozen=True)
class PlatePose:
    """Where the plate is for a posture.

    Attributes:
        position: (3,) m, middle of its surface.
        normal: (3,) unit vector out of it.
        fingers: (3,) unit vector across it, upwards where the joints are zero.
        jacobian: (3, J) m/rad of the position.
        normal_jacobian: (3, J) 1/rad of the normal.
    """

    position: Array
    normal: Array
    fingers: Array
    jacobian: Array
    normal_jacobian: Array


@dataclass(frozen=True)
class ServoArm:
    """The arm on a mount, with a plate ``plate`` m beyond its last joint.

    ``fastest`` (J,) rad/s: no joint is planned to be faster; None for what the servos can.
    """

    mount: Mount
    plate: float = measures.PLATE_DISTANCE
    fastest: tuple[float, ...] | None = None

    @cached_property
    def packed(self) -> Arm:
        """What the compiled functions work on."""
        inertias, masses, centres = _links(self.plate)
        balls = [(*ball.centre, ball.radius) for ball in measures.BALLS]
        balls[-1] = (self.plate - 0.04, *balls[-1][1:])
        servos = [servo for servo, _ in measures.SERVOS]
        count = np.array([number for _, number in measures.SERVOS], float)
        low, high = np.radians(np.array(measures.LIMITS_DEGREES, float)).T
        speed = np.array([min(measures.SPEED_LIMIT, servo.no_load) for servo in servos])
        if self.fastest is not None:
            speed = np.minimum(speed, self.fastest)
        return Arm(
            joints=tuple(range(JOINTS)),
            axes=np.array(measures.AXES, float),
            offsets=np.array(measures.OFFSETS, float),
            plate=np.array([self.plate, 0.0, 0.0]),
            normal=np.array([1.0, 0.0, 0.0]),
            fingers=np.array([0.0, 0.0, 1.0]),
            base=np.array(self.mount.position, float),
            base_axes=np.ascontiguousarray(rotations.to_matrix(self.mount.quaternion)),
            low=np.ascontiguousarray(low),
            high=np.ascontiguousarray(high),
            speeds=SPEED_SHARE * speed,
            accelerations=np.array(ACCELERATIONS),
            stall=TORQUE_SHARE * count * np.array([servo.stall for servo in servos]),
            no_load=np.array([servo.no_load for servo in servos]),
            masses=masses,
            centres=centres,
            inertias=np.array([np.diag(of) for of in inertias]),
            armature=count * np.array([servo.armature for servo in servos]),
            friction=count * np.array([servo.friction for servo in servos]),
            damping=count * np.array([servo.damping for servo in servos]),
            ball_links=np.array([ball.link for ball in measures.BALLS], float),
            balls=np.array(balls, float),
            meets_upper=np.array([ball.link >= 4 for ball in measures.BALLS], float),
            posts=np.array([measures.TURRET_RADIUS, measures.UPPER_ARM_RADIUS, measures.COLUMN_RADIUS]),
            upper=np.array([1.0, 2.0]),
            met=np.array([4.0, 2.0, 5.0]),
        )

    def plate_at(self, joints: Array) -> PlatePose:
        """Forward kinematics of joints (J,), rad."""
        return PlatePose(*kinematics.plate_pose(self.packed, np.ascontiguousarray(joints, float)))

    def points(self, joints: Array) -> tuple[Array, Array]:
        """What may meet a person, the plate's middle first: places (P, 3), m, and Jacobians (P, 3, J), m/rad."""
        return kinematics.points_of_interest(self.packed, np.ascontiguousarray(joints, float))

    def gravity(self, joints: Array) -> Array:
        """Torques (J,), N·m, that hold the arm still."""
        return dynamics.dynamics(self.packed, np.ascontiguousarray(joints, float), np.zeros(JOINTS))[1]

    def clearance(self, joints: Array, head: Array | None = None, radius: float = 0.0) -> float:
        """Smallest gap, m, of a posture to floor, mount, the arm itself and a head: centre (3,) m, radius m."""
        ball = np.zeros(4) if head is None else np.array([*head, radius])
        return float(distances.clearance(self.packed, np.ascontiguousarray(joints, float), ball))

    def margins(self, joints: Array) -> Array:
        """Distance (J,), rad, of each joint from its nearer limit."""
        return np.minimum(joints - self.packed.low, self.packed.high - joints)


def _links(plate: float) -> tuple[Array, Array, Array]:
    """Moments of inertia (J, 3), masses (J,) and centres (J, 3) of the links, the plate being a part of the last."""
    masses = np.array([link.mass for link in measures.LINKS])
    centres = np.array([link.centre for link in measures.LINKS])
    inertias = np.array([link.inertia for link in measures.LINKS])
    disc, radius = measures.PLATE_MASS, measures.PLATE_RADIUS
    at = plate - 0.5 * measures.PLATE_THICKNESS
    whole = masses[-1] + disc
    middle = (masses[-1] * centres[-1, 0] + disc * at) / whole
    spread = masses[-1] * (centres[-1, 0] - middle) ** 2 + disc * (at - middle) ** 2
    inertias[-1] += np.array([0.5, 0.25, 0.25]) * disc * radius**2 + np.array([0.0, spread, spread])
    masses[-1], centres[-1, 0] = whole, middle
    return inertias, masses, centres


def solve(arm: ServoArm, position: Array, normal: Array, start: Array, steps: int = 40) -> tuple[Array, float]:
    """Joints (J,) near ``start`` that put the plate at a position facing a normal, and what is left, m.

    A turn of the normal by a radian counts as 0.2 m. For searches and starting postures, not for the tick.
    """
    place, out, begin = (np.asarray(value, float) for value in (position, normal, start))
    joints, left = inverse_kinematics.posture(arm.packed, place, out, begin, steps)
    return joints, float(left)


DEFAULT_MOUNT = Mount((-0.0745, -0.0793, 1.28), float(np.radians(8.0)), float(np.radians(15.0)))
"""Chosen by a search: docs/decisions/2026-11-22-arm-mounting.md."""
READY = np.array([-0.703, 0.357, 0.714, -1.401, -1.273, 0.0])
"""(J,) rad, where the arm on that mount waits: behind the middle of the grid, about facing the person."""


def default_arm() -> ServoArm:
    """The arm on its default mount."""
    return ServoArm(DEFAULT_MOUNT)
