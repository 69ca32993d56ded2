"""The limits of the arm: one validated file, ceilings that no file can raise, and a command line that can only lower.

What a limit is, in which unit, between which bounds and which way is safer, stands beside it as its :class:`Span`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

JOINTS = ("waist", "shoulder", "elbow", "forearm_roll", "wrist_angle", "wrist_rotate")
"""Joints in the order of every array."""

MECHANICAL = np.radians(
    [(-180.0, 180.0), (-106.0, 72.0), (-101.0, 92.0), (-180.0, 180.0), (-107.0, 128.0), (-180, 180)]
)
"""(J, 2) rad, lowest and highest position of each joint (the maker's limits of the ViperX 300 S)."""

STALL_CURRENTS = np.array([4.4, 4.4, 4.4, 4.4, 4.4, 2.3])
"""(J,) A at 12 V, of the joint's servos: XM540-W270, the last one XM430-W350 (the maker's tables)."""


USUAL_VOLTAGE = 12.0
"""V, of the servos that limits of voltages are for; those for others have the same shares of theirs."""


@dataclass(frozen=True)
class Ceilings:
    """An arm's joints, and what no limits file can raise.

    Attributes:
        names: of the joints, in the order of every array.
        mechanical: (J, 2) rad, lowest and highest position of each.
        stall_currents: (J,) A, of each of a joint's servos.
        voltages: (J,) V, usual for them.
    """

    names: tuple[str, ...] = JOINTS
    mechanical: tuple[tuple[float, float], ...] = tuple((float(low), float(high)) for low, high in MECHANICAL)
    stall_currents: tuple[float, ...] = tuple(STALL_CURRENTS.tolist())
    voltages: tuple[float, ...] = (USUAL_VOLTAGE,) * len(JOINTS)


Section = TypeVar("Section", bound="DataclassInstance")


class LimitsError(HighFiveError):
    """A limits file, or a change of a limit, that is refused."""


@dataclass(frozen=True)
class Span:
    """What a limit may be.

    Attributes:
        unit: as in the file.
        least, most: bounds of what any file may say.
        safer: which way is safer: -1 down, 1 up, 0 it cannot be changed at the command line.
    """

    unit: str
    least: float
    most: float
    safer: int


def _limit(unit: str, least: float, most: float, safer: int) -> Any:
    return field(metadata={"span": Span(unit, least, most, safer)})


@dataclass(frozen=True)
class Joint:
    """Limits of one joint.

    Attributes:
        lowest, highest: rad.
        speed: rad/s; 30 rpm is the velocity limit of every servo.
        acceleration: rad/s², most by which a joint may speed up or slow down.
        braking: rad/s², by which it can be relied on to slow down: before its limits, and in a controlled stop.
        current: A a servo, in free motion.
        contact_current: A a servo, whenever the hand is not known to be away: so that the palm yields.
    """

    lowest: float = _limit("rad", -math.pi, math.pi, 1)
    highest: float = _limit("rad", -math.pi, math.pi, -1)
    speed: float = _limit("rad/s", 0.01, math.pi, -1)
    acceleration: float = _limit("rad/s²", 0.5, 100.0, -1)
    braking: float = _limit("rad/s²", 0.5, 50.0, -1)
    current: float = _limit("A", 0.05, 4.4, -1)
    contact_current: float = _limit("A", 0.05, 2.0, -1)


@dataclass(frozen=True)
class Servo:
    """When a servo is no longer trusted.

    Attributes:
        temperature: °C.
        voltage_low, voltage_high: V at a servo for 12 V; at others the same shares of what they are for.
        following: rad between where a joint was commanded to be and where it is ...
        following_s: ... for longer than this, s.
        shadow: rad between the two servos of a joint ...
        shadow_s: ... for longer than this, s.
        shadow_rest: rad between them before the arm is switched on.
        silent_s: s without a reply.
        health_s: s, age of the newest temperatures and voltages.
    """

    temperature: float = _limit("°C", 30.0, 75.0, -1)
    voltage_low: float = _limit("V", 10.0, 14.0, 1)
    voltage_high: float = _limit("V", 10.0, 14.8, -1)
    following: float = _limit("rad", 0.02, 0.5, -1)
    following_s: float = _limit("s", 0.02, 0.5, -1)
    shadow: float = _limit("rad", 0.015, 0.05, -1)
    shadow_s: float = _limit("s", 0.02, 0.2, -1)
    shadow_rest: float = _limit("rad", 0.005, 0.02, -1)
    silent_s: float = _limit("s", 0.02, 0.1, -1)
    health_s: float = _limit("s", 0.1, 5.0, -1)


@dataclass(frozen=True)
class Posture:
    """What a posture that the servos claim may be, before the arm is switched on and right after.

    Attributes:
        rest: rad a joint, by which an arm that is held may be off the pose in which it rests.
        stop: rad, by which a joint that lies on its stop may be off it.
        touch: m of clearance from which on the arm may lie on something.
        through: m that the arm may seem to be inside floor, mount or itself; their shapes are generous.
        friction: of the servos' stall torque, that holds a joint, or keeps it from moving.
        model: of gravity's torque, by which the model of the arm, or what a current gives, may be off.
    """

    rest: float = _limit("rad", 0.01, 0.5, -1)
    stop: float = _limit("rad", 0.01, 0.1, -1)
    touch: float = _limit("m", 0.0, 0.05, -1)
    through: float = _limit("m", 0.0, 0.1, -1)
    friction: float = _limit("of stall", 0.01, 0.2, -1)
    model: float = _limit("of gravity", 0.05, 0.5, -1)


@dataclass(frozen=True)
class Contact:
    """How plate and hand may meet; the model is in :mod:`highfive.hil.safety.contact_force`.

    Attributes:
        force: N, quasi-static limit of hand and fingers.
        body_mass, robot_mass: kg, effective, of the hand and of the arm.
        stiffness: N/m, of the hand.
        speed: m/s, largest relative speed along the line between them, near contact.
        near: m between plate and palm, from which that speed holds.
        touching: m, nearer than this the line between them is no longer taken from where they are.
        braking: m/s², how fast the plate is taken to lose speed on its way there.
    """

    force: float = _limit("N", 1.0, 140.0, -1)
    body_mass: float = _limit("kg", 0.6, 0.6, 0)
    robot_mass: float = _limit("kg", 1.5, 10.0, 0)
    stiffness: float = _limit("N/m", 75e3, 75e3, 0)
    speed: float = _limit("m/s", 0.01, 0.78, -1)
    near: float = _limit("m", 0.05, 0.5, 1)
    touching: float = _limit("m", 0.01, 0.05, 0)
    braking: float = _limit("m/s²", 0.5, 10.0, -1)


@dataclass(frozen=True)
class Face:
    """The zone about the head, which moves with it.

    Attributes:
        force: N, limit of the face.
        body_mass, robot_mass: kg, effective, of the head and of the arm.
        stiffness: N/m, of the face.
        speed: m/s, largest speed of the plate, relative to the head where that comes nearer.
        radius: m about the head's centre: head, half of the plate, and what the tracker may err.
        braking: m/s², how fast the plate is taken to lose speed on its way there.
    """

    force: float = _limit("N", 1.0, 65.0, -1)
    body_mass: float = _limit("kg", 4.4, 4.4, 0)
    robot_mass: float = _limit("kg", 1.5, 10.0, 0)
    stiffness: float = _limit("N/m", 75e3, 75e3, 0)
    speed: float = _limit("m/s", 0.01, 0.22, -1)
    radius: float = _limit("m", 0.25, 1.5, 1)
    braking: float = _limit("m/s²", 0.5, 10.0, -1)


@dataclass(frozen=True)
class Stale:
    """When the person, or where the arm is requested to be, is no longer known.

    Attributes:
        hold_s: s, then the arm holds.
        retract_s: s, then it retracts.
    """

    hold_s: float = _limit("s", 0.02, 0.1, -1)
    retract_s: float = _limit("s", 0.1, 0.5, -1)


@dataclass(frozen=True)
class Motion:
    """How the arm moves where nobody leads it.

    Attributes:
        catch_up: rad/s, how much faster than what is requested of it a joint may go to make up for being behind.
        retract: rad/s of the fastest joint while the arm retracts.
        point_speed: m/s of every known point of the arm, wherever it is; lowered where nobody is tracked.
    """

    catch_up: float = _limit("rad/s", 0.05, 1.5, -1)
    retract: float = _limit("rad/s", 0.05, 0.6, -1)
    point_speed: float = _limit("m/s", 0.01, 3.0, -1)


@dataclass(frozen=True)
class Offset:
    """How far goals may go beyond where the joints shall be; see :mod:`highfive.hil.safety.feed_forward`.

    Attributes:
        largest: rad.
        speed, acceleration: rad/s and rad/s², by which the offset changes at most.
    """

    largest: float = _limit("rad", 0.0, 0.1, -1)
    speed: float = _limit("rad/s", 0.0, 1.0, -1)
    acceleration: float = _limit("rad/s²", 0.5, 20.0, -1)


@dataclass(frozen=True)
class Timing:
    """Of the loop and the bus.

    Attributes:
        period_s: s, between two commands.
        late_run: commands in a row that came more than half a period late, from which on the arm stops.
        watchdog_s: s without a command after which a servo stops by itself; in steps of 20 ms.
        estop_s: s from the pull of the emergency stop to the last motion command.
    """

    period_s: float = _limit("s", 0.002, 0.02, 0)
    late_run: float = _limit("commands", 1, 12, -1)
    watchdog_s: float = _limit("s", 0.06, 0.1, -1)
    estop_s: float = _limit("s", 0.001, 0.02, -1)


@dataclass(frozen=True)
class Limits:
    """All limits.

    Attributes:
        joints: one a joint, in the order of the ceilings' names.
        servo, posture, contact, face, stale, motion, feed_forward, timing: as said there.
        path: W poses (J,), rad, along which the arm retracts; in the last one it rests.
        ceilings: the arm that they are for.
    """

    joints: tuple[Joint, ...]
    servo: Servo
    posture: Posture
    contact: Contact
    face: Face
    stale: Stale
    motion: Motion
    feed_forward: Offset
    timing: Timing
    path: tuple[tuple[float, ...], ...]
    ceilings: Ceilings = field(default_factory=Ceilings)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the joints."""
        return self.ceilings.names

    @cached_property
    def lowest(self) -> Array:
        """(J,) rad."""
        return self._each("lowest")

    @cached_property
    def highest(self) -> Array:
        """(J,) rad."""
        return self._each("highest")

    @cached_property
    def speed(self) -> Array:
        """(J,) rad/s."""
        return self._each("speed")

    @cached_property
    def acceleration(self) -> Array:
        """(J,) rad/s²."""
        return self._each("acceleration")

    @cached_property
    def braking(self) -> Array:
        """(J,) rad/s²."""
        return self._each("braking")

    @cached_property
    def current(self) -> Array:
        """(J,) A, in free motion."""
        return self._each("current")

    @cached_property
    def contact_current(self) -> Array:
        """(J,) A, near a hand."""
        return self._each("contact_current")

    @cached_property
    def way_points(self) -> Array:
        """(W, J) rad, :attr:`path`."""
        return _fixed(np.array(self.path))

    def _each(self, name: str) -> Array:
        return _fixed(np.array([getattr(joint, name) for joint in self.joints]))


def _fixed(array: Array) -> Array:
    array.setflags(write=False)
    return array
