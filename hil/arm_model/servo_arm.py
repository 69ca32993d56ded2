"""The servo arm where it is mounted: kinematics, gravity, and postures that put its plate somewhere."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from highfive.hil.arm_model import distances, dynamics, inverse_kinematics, kinematics
from highfive.hil.arm_model.arm import Arm
from highfive.hil.arm_model.arm_folder import ArmFolder, find_arm
from highfive.hil.arm_model.corrections import Corrections, corrected
from highfive.hil.arm_model.from_mujoco import compiled_body
from highfive.hil.arm_model.mount import Mount
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

SPEED_SHARE = 0.97
"""Of the speed limit, that is requested: at the limit itself a servo has no torque left."""
TORQUE_SHARE = 0.7
"""Of the servos' torque, that is requested: a warm servo or a low supply has less than the table."""
GEARS = ("armature", "friction", "damping")


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
    """An arm on a mount.

    Attributes:
        mount: where it stands.
        plate: m, from the last joint to the plate along its normal; None for what the arm's model says.
        fastest: (J,) rad/s: no joint is planned to be faster; None for what the servos can.
        folder: what arm it is.
        corrections: by what this one differs from its drawing; None where it was not calibrated.
    """

    mount: Mount
    plate: float | None = None
    fastest: tuple[float, ...] | None = None
    folder: ArmFolder = field(default_factory=find_arm)
    corrections: Corrections | None = None

    @cached_property
    def packed(self) -> Arm:
        """What the compiled functions work on."""
        folder, body = self.folder, compiled_body(self.folder, self.plate)
        turns = np.broadcast_to(np.eye(3), (len(folder.joints), 3, 3))
        if self.corrections is not None:
            body, turns = corrected(body, self.corrections), self.corrections.turns
        stall, no_load = folder.each
        speed = np.minimum(folder.speed_limit, no_load)
        if self.fastest is not None:
            speed = np.minimum(speed, self.fastest)
        names = folder.names
        plate_link = len(names) - 1
        links = [plate_link if ball.on == "plate" else names.index(ball.on) for ball in folder.balls]
        shift = [body.plate if ball.on == "plate" else np.zeros(3) for ball in folder.balls]
        balls = [
            [*(moved + turns[link] @ ball.centre), ball.radius]
            for link, moved, ball in zip(links, shift, folder.balls, strict=True)
        ]
        gears = [[joint.servos * getattr(joint.servo, name) for joint in folder.joints] for name in GEARS]
        return Arm(
            joints=tuple(range(len(names))),
            axes=body.axes,
            offsets=body.offsets,
            plate=body.plate,
            normal=body.normal,
            fingers=body.fingers,
            base=np.array(self.mount.position, float),
            base_axes=np.ascontiguousarray(rotations.to_matrix(self.mount.quaternion)),
            low=body.low,
            high=body.high,
            speeds=SPEED_SHARE * speed,
            accelerations=np.array([joint.acceleration for joint in folder.joints]),
            stall=TORQUE_SHARE * stall,
            no_load=no_load,
            masses=body.masses,
            centres=body.centres,
            inertias=body.inertias,
            armature=np.array(gears[0]),
            friction=np.array(gears[1]),
            damping=np.array(gears[2]),
            ball_links=np.array(links, float),
            balls=np.array(balls).reshape(-1, 4),
            meets_upper=np.array([ball.upper for ball in folder.balls], float),
            posts=np.array(folder.posts),
            upper=np.array([names.index(name) for name in folder.between], float),
            facing=folder.facing,
            met=np.array([names.index(name) for name in folder.meeting], float),
        )

    @property
    def joints(self) -> int:
        """How many."""
        return len(self.folder.joints)

    @property
    def ready(self) -> Array:
        """(J,) rad, where it waits."""
        return np.array(self.folder.ready)

    @property
    def reach(self) -> float:
        """m, from the middle of its base to its plate when stretched out."""
        packed = self.packed
        return float(np.linalg.norm(packed.offsets, axis=1).sum() + np.linalg.norm(packed.plate))

    def plate_at(self, joints: Array) -> PlatePose:
        """Forward kinematics of joints (J,), rad."""
        return PlatePose(*kinematics.plate_pose(self.packed, np.ascontiguousarray(joints, float)))

    def points(self, joints: Array) -> tuple[Array, Array]:
        """What may meet a person, the plate's middle first: places (P, 3), m, and Jacobians (P, 3, J), m/rad."""
        return kinematics.points_of_interest(self.packed, np.ascontiguousarray(joints, float))

    def gravity(self, joints: Array) -> Array:
        """Torques (J,), N·m, that hold the arm still."""
        return dynamics.dynamics(self.packed, np.ascontiguousarray(joints, float), np.zeros(self.joints))[1]

    @property
    def compliance(self) -> Array:
        """(J,) rad/(N·m), by which joints give way that their encoders do not see."""
        return np.zeros(self.joints) if self.corrections is None else self.corrections.compliance

    def standing(self, encoders: Array) -> Array:
        """Where joints (J,), rad, stand whose encoders say (J,), rad: gravity bends what these do not see."""
        return encoders if self.corrections is None else encoders - self.compliance * self.gravity(encoders)

    def clearance(self, joints: Array, head: Array | None = None, radius: float = 0.0) -> float:
        """Smallest gap, m, of a posture to floor, mount, the arm itself and a head: centre (3,) m, radius m."""
        ball = np.zeros(4) if head is None else np.array([*head, radius])
        return float(distances.clearance(self.packed, np.ascontiguousarray(joints, float), ball))

    def margins(self, joints: Array) -> Array:
        """Distance (J,), rad, of each joint from its nearer limit."""
        return np.minimum(joints - self.packed.low, self.packed.high - joints)


def solve(arm: ServoArm, position: Array, normal: Array, start: Array, steps: int = 40) -> tuple[Array, float]:
    """Joints (J,) near ``start`` that put the plate at a position facing a normal, and what is left, m.

    A turn of the normal by a radian counts as the arm's ``facing``. Not for the tick.
    """
    place, out, begin = (np.asarray(value, float) for value in (position, normal, start))
    joints, left = inverse_kinematics.posture(arm.packed, place, out, begin, steps)
    return joints, float(left)


DEFAULT_MOUNT = find_arm().mount
"""Of the arm that a session has unless it is told otherwise."""


def default_arm() -> ServoArm:
    """That arm on its mount."""
    return mounted(find_arm())


def mounted(folder: ArmFolder) -> ServoArm:
    """An arm on the mount that its folder says."""
    return ServoArm(folder.mount, folder=folder)
