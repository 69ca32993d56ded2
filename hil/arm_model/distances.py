"""Distances of an arm from itself, its mount, the floor and a head."""

from __future__ import annotations

import math

import numpy as np

from highfive.hil.arm_model.arm import Arm
from highfive.hil.arm_model.kinematics import link_frames, point_jacobian
from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry.rotations import Array


@compiled
def to_segment(point: Array, start: Array, end: Array, away: Array) -> tuple[float, float]:
    """Distance of a point from a segment, m, and where on it (0 to 1); the unit vector from there into ``away``."""
    length, along = 0.0, 0.0
    for r in range(3):
        length += (end[r] - start[r]) ** 2
        along += (point[r] - start[r]) * (end[r] - start[r])
    share = min(1.0, max(0.0, along / max(length, 1e-12)))
    distance = 0.0
    for r in range(3):
        away[r] = point[r] - start[r] - share * (end[r] - start[r])
        distance += away[r] ** 2
    distance = math.sqrt(distance)
    for r in range(3):
        away[r] /= max(distance, 1e-9)
    return distance, share


@compiled
def arm_gaps(  # noqa: PLR0912 (a kernel)
    arm: Arm,
    centres: Array,
    frames: Array,
    head: Array,
    near: float,
    gaps: Array,
    jacobians: Array,
    with_jacobians: bool,
) -> None:
    """Distances (B, 4), m, of the spheres from floor, mount, upper arm and head (4,): centre and radius.

    ``jacobians`` (B, 4, J) are given (``with_jacobians``) where a gap is below ``near``. Column and turret are one
    mount; a pair that cannot meet is 1 m apart.
    """
    count = len(arm.joints)
    ball, away, of_point, of_other = np.empty(3), np.empty(3), np.empty((3, count)), np.empty((3, count))
    foot, shoulder, elbow = np.empty(3), centres[int(arm.upper[0])], centres[int(arm.upper[1])]
    other = np.empty(3)
    foot[0], foot[1], foot[2] = arm.base[0], arm.base[1], 0.0
    for b in range(len(arm.balls)):
        link, radius = int(arm.ball_links[b]), arm.balls[b, 3]
        for r in range(3):
            ball[r] = centres[link, r]
            for c in range(3):
                ball[r] += frames[link, r, c] * arm.balls[b, c]
        for kind in range(4):
            share = 0.0
            if kind == 0:
                away[0], away[1], away[2] = 0.0, 0.0, 1.0
                gap = ball[2] - radius
            elif kind == 1:
                below, _ = to_segment(ball, foot, arm.base, other)
                beside, _ = to_segment(ball, arm.base, shoulder, away)
                gap = beside - radius - arm.posts[0]
                if below - radius - arm.posts[2] < gap:
                    gap = below - radius - arm.posts[2]
                    away[0], away[1], away[2] = other[0], other[1], other[2]
            elif kind == 2:
                gap = 1.0
                if arm.meets_upper[b] > 0.0:
                    gap, share = to_segment(ball, shoulder, elbow, away)
                    gap -= radius + arm.posts[1]
            else:
                gap = 1.0
                if head[3] > 0.0:
                    gap, _ = to_segment(ball, head[:3], head[:3], away)
                    gap -= radius + head[3]
            gaps[b, kind] = gap
            if not with_jacobians or gap >= near:
                continue
            point_jacobian(arm, centres, frames, link, ball, of_point)
            if kind == 2:  # the upper arm moves, too
                for r in range(3):
                    other[r] = shoulder[r] + share * (elbow[r] - shoulder[r])
                point_jacobian(arm, centres, frames, int(arm.upper[1]) - 1, other, of_other)
                for r in range(3):
                    for j in range(count):
                        of_point[r, j] -= of_other[r, j]
            along(arm, away, of_point, jacobians[b, kind])


@compiled
def along(arm: Arm, direction: Array, of_point: Array, out: Array) -> None:
    """Adds to ``out`` (J,) how fast each joint brings a point with Jacobian ``of_point`` along a direction."""
    for j in range(len(arm.joints)):
        out[j] = direction[0] * of_point[0, j] + direction[1] * of_point[1, j] + direction[2] * of_point[2, j]


@compiled
def smallest_gap(arm: Arm, joints: Array, head: Array) -> float:
    """Smallest gap of a posture, m."""
    centres, frames = link_frames(arm, joints)
    gaps, jacobians = np.empty((len(arm.balls), 4)), np.empty((0, 4, len(arm.joints)))
    arm_gaps(arm, centres, frames, head, 0.0, gaps, jacobians, False)
    least = 1.0
    for b in range(len(gaps)):
        for kind in range(4):
            least = min(least, gaps[b, kind])
    return least


@compiled_entry
def clearance(arm: Arm, joints: Array, head: Array) -> float:
    """Smallest gap, m, between the arm and floor, mount, itself or a head (4,): centre and radius, m."""
    return smallest_gap(arm, joints, head)
