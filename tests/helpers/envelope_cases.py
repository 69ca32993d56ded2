"""An arm that goes where it is commanded, a person, and a loop, for tests of the safety envelope."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from highfive.hil.drivers.values import JointCommand, JointHealth, JointState
from highfive.hil.safety.envelope import Kinematics, step
from highfive.hil.safety.limits import Limits
from highfive.hil.safety.limits_file import load_limits
from highfive.hil.safety.people import Human
from highfive.hil.safety.startup import Check
from highfive.hil.safety.states import State
from highfive.hil.safety.values import EnvelopeState, Inputs, Report, standing
from highfive.model.geometry.rotations import Array

TICK_NS = 8_333_333
READY_POSE = np.array([0.0, -0.6, 0.6, 0.0, 0.0, 0.0])
REST = np.array([0.0, -1.3, 1.3, 0.0, 0.0, 0.0])
LIMITS = replace(load_limits(), path=(tuple(READY_POSE.tolist()), tuple(REST.tolist())))
"""Those that come with the project, but for a way back that suits the arm of these tests."""

AXES = np.array([(0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0)], dtype=float)
OFFSETS = np.array(
    [(0, 0, 1.079), (0, 0, 0.048), (0.0596, 0, 0.3), (0.2, 0, 0), (0.1, 0, 0), (0.0697, 0, 0), (0.2, 0, 0)]
)


def turned(axis: Array, angle: float) -> Array:
    """Rotation matrix by Rodrigues' formula."""
    x, y, z = axis
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def cross(a: Array, b: Array) -> Array:
    """Cross product of two vectors (3,); NumPy's own takes 20 µs."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def kinematics(positions: Array) -> tuple[Array, Array]:
    """Plate and wrist of an arm of this class, 1 m above the floor at the origin; and their Jacobians."""
    turn, place, axes, centres, places = np.eye(3), np.zeros(3), [], [], []
    for offset, axis, angle in zip(OFFSETS, AXES, positions, strict=False):
        place = place + turn @ offset
        axes.append(turn @ axis)
        centres.append(place)
        turn = turn @ turned(axis, angle)
    places = np.array([place + turn @ OFFSETS[-1], centres[4]])
    jacobians = np.zeros((2, 3, 6))
    for point, joints in ((0, 6), (1, 4)):
        for joint in range(joints):
            jacobians[point, :, joint] = cross(axes[joint], places[point] - centres[joint])
    return places, jacobians


def plate(positions: Array) -> Array:
    """(3,) m."""
    return kinematics(positions)[0][0]


FAR = Human(np.array([3.0, 0.0, 1.7]), np.array([2.5, -0.2, 1.4]), np.zeros(3), 0)
"""Somebody who is not near."""


def said(positions: Array, now_ns: int, velocities: Array | None = None) -> JointState:
    """What servos say that are well and where they were commanded to be."""
    return JointState(
        now_ns,
        positions.copy(),
        np.zeros(6) if velocities is None else velocities,
        np.zeros(6),
        np.zeros(6, dtype=np.int64),
        np.ones(6, dtype=bool),
        np.zeros(6, dtype=bool),
        np.zeros(6),
    )


def well(now_ns: int) -> JointHealth:
    """Servos that are well."""
    return JointHealth(now_ns, np.full(6, 35.0), np.full(6, 12.0))


@dataclass
class Loop:
    """The loop around the envelope: the arm is where it was commanded a tick ago, and gives way by what goals lead."""

    limits: Limits = LIMITS
    start: Array = field(default_factory=REST.copy)
    now_ns: int = 10**9
    human: Human | None = FAR
    run: bool = True
    before: EnvelopeState = field(init=False)
    measured: Array = field(init=False)
    commanded: list[Array] = field(default_factory=list)
    times: list[int] = field(default_factory=list)
    reports: list[Report] = field(default_factory=list)
    check: Check | None = None
    kinematics: Kinematics = field(default=kinematics)

    def __post_init__(self) -> None:
        self.before = standing(self.now_ns, len(LIMITS.joints))
        self.measured = self.start.copy()

    @property
    def state(self) -> State:
        return self.before.state

    def inputs(self, requested: Array | None, **other: Any) -> Inputs:
        """What is known in a tick in which all is well."""
        now = self.now_ns
        usual = Inputs(
            requested, said(self.measured, now), well(now), self.human, self.run, self.check, None, acknowledge=False
        )
        return replace(usual, **other)

    def tick(self, requested: Array | None = None, elapsed_ns: int = TICK_NS, **other: Any) -> JointCommand | None:
        """One tick; ``other`` replaces what is known in it."""
        self.now_ns += elapsed_ns
        self.before, command, report = step(
            self.limits, self.kinematics, self.before, self.inputs(requested, **other), self.now_ns
        )
        self.reports.append(report)
        if command is not None:
            assert report.reference is not None
            self.measured = report.reference.copy()
            self.commanded.append(command.positions)
            self.times.append(self.now_ns)
        return command

    @property
    def report(self) -> Report:
        return self.reports[-1]

    def ready(self) -> Loop:
        """Checked, and standing."""
        self.check = Check(self.now_ns, ())
        self.run, run = False, self.run
        self.tick(self.measured)
        assert self.state is State.READY
        self.run = run
        return self

    def tracking(self) -> Loop:
        """Following, from where it stands."""
        self.ready()
        self.run = True
        self.tick(self.measured)
        assert self.state is State.TRACKING, self.report
        return self

    def follow(self, requested: Array, ticks: int, **other: Any) -> Loop:
        """Wants the same for some ticks."""
        for _ in range(ticks):
            self.tick(requested, **other)
        return self

    def speeds(self) -> Array:
        """(T, J) rad/s, between one command and the next."""
        return np.diff(self.commanded, axis=0) / np.diff(self.times)[:, None] * 1e9
