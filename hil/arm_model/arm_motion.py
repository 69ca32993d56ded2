"""The arm's machine code: kinematics, dynamics, distances, and the plan of the next moments.

It stands in one file because compiled code is stored by source file (:mod:`highfive.model.compiled`). World frame, SI
units; J = 6 joints. What is written for people is in :mod:`highfive.hil.arm_model.servo_arm` and
:mod:`highfive.hil.arm.planner`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry.rotations import Array


class Arm(NamedTuple):
    """A mounted arm, packed.

    Attributes:
        axes: (J,) 0, 1, 2 for x, y, z: each joint turns about an axis of its own frame.
        offsets: (J, 3) m, each joint's centre in the frame before it.
        plate: m, from the last joint to the plate along the tool axis.
        base, base_axes: (3,) m and (3, 3), where the base stands, and its axes in columns.
        low, high: (J,) rad.
        speeds: (J,) rad/s, most that is asked for.
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


GRAVITY = 9.81
"""m/s²"""


@compiled
def _frames(arm: Arm, joints: Array) -> tuple[Array, Array]:
    """Centre (J, 3) and axes (J, 3, 3), in columns, of every joint's frame after its own turn."""
    count = len(joints)
    centres, frames = np.empty((count, 3)), np.empty((count, 3, 3))
    for j in range(count):
        before = arm.base_axes if j == 0 else frames[j - 1]
        start = arm.base if j == 0 else centres[j - 1]
        for r in range(3):
            total = start[r]
            for c in range(3):
                total += before[r, c] * arm.offsets[j, c]
            centres[j, r] = total
        axis = int(arm.axes[j])
        one, two = (axis + 1) % 3, (axis + 2) % 3
        cosine, sine = math.cos(joints[j]), math.sin(joints[j])
        for r in range(3):
            frames[j, r, axis] = before[r, axis]
            frames[j, r, one] = cosine * before[r, one] + sine * before[r, two]
            frames[j, r, two] = cosine * before[r, two] - sine * before[r, one]
    return centres, frames


@compiled
def _axis(arm: Arm, frames: Array, joint: int) -> tuple[float, float, float]:
    axis = int(arm.axes[joint])
    return frames[joint, 0, axis], frames[joint, 1, axis], frames[joint, 2, axis]


@compiled
def _moves(arm: Arm, centres: Array, frames: Array, link: int, point: Array, out: Array) -> None:
    """Writes the Jacobian (3, J) of a point (3,) of a link into ``out``."""
    for j in range(len(centres)):
        if j > link:
            out[0, j] = out[1, j] = out[2, j] = 0.0
            continue
        ax, ay, az = _axis(arm, frames, j)
        x, y, z = point[0] - centres[j, 0], point[1] - centres[j, 1], point[2] - centres[j, 2]
        out[0, j], out[1, j], out[2, j] = ay * z - az * y, az * x - ax * z, ax * y - ay * x


@compiled
def _plate(arm: Arm, centres: Array, frames: Array) -> tuple[Array, Array]:
    """Centre and normal of the plate's surface, (3,) each."""
    point, normal = np.empty(3), np.empty(3)
    for r in range(3):
        normal[r] = frames[5, r, 0]
        point[r] = centres[5, r] + arm.plate * normal[r]
    return point, normal


@compiled
def _plate_moves(arm: Arm, centres: Array, frames: Array, point: Array, normal: Array) -> tuple[Array, Array]:
    """Jacobians (3, J) of the plate's centre and normal."""
    of_point, of_normal = np.empty((3, 6)), np.empty((3, 6))
    _moves(arm, centres, frames, 5, point, of_point)
    for j in range(6):
        ax, ay, az = _axis(arm, frames, j)
        x, y, z = normal[0], normal[1], normal[2]
        of_normal[0, j], of_normal[1, j], of_normal[2, j] = ay * z - az * y, az * x - ax * z, ax * y - ay * x
    return of_point, of_normal


@compiled_entry
def plate_pose(arm: Arm, joints: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Plate's centre (3,), m, normal (3,), direction of its fingers (3,), Jacobians (3, J) of centre and normal."""
    centres, frames = _frames(arm, joints)
    point, normal = _plate(arm, centres, frames)
    of_point, of_normal = _plate_moves(arm, centres, frames, point, normal)
    return point, normal, frames[5, :, 2].copy(), of_point, of_normal


@compiled_entry
def joint_centres(arm: Arm, joints: Array) -> Array:
    """Centres of the joints, (J, 3) m."""
    return _frames(arm, joints)[0]


@compiled_entry
def points_of_interest(arm: Arm, joints: Array) -> tuple[Array, Array]:
    """Plate, wrist, elbow and the outermost point of the tool's shaft: places (4, 3), m, and Jacobians (4, 3, J)."""
    centres, frames = _frames(arm, joints)
    places, moves = np.empty((4, 3)), np.empty((4, 3, 6))
    places[0] = _plate(arm, centres, frames)[0]
    places[1], places[2], places[3] = centres[4], centres[2], centres[5]
    _moves(arm, centres, frames, 5, places[0], moves[0])
    _moves(arm, centres, frames, 3, places[1], moves[1])
    _moves(arm, centres, frames, 1, places[2], moves[2])
    _moves(arm, centres, frames, 4, places[3], moves[3])
    return places, moves


@compiled
def _torques(arm: Arm, centres: Array, frames: Array, speeds: Array, push: Array, torques: Array) -> None:
    """Writes the torques (J,) that accelerations ``push`` (J,) take with gravity: recursive Newton–Euler."""
    count = len(speeds)
    turn, spin = np.zeros(3), np.zeros(3)  # angular velocity and acceleration of the link
    pull = np.zeros(3)  # acceleration of the joint's centre, gravity as a push upwards
    pull[2] = GRAVITY
    lever, accelerated, force, moment = np.empty(3), np.empty(3), np.empty((count, 3)), np.empty((count, 3))
    for j in range(count):
        if j > 0:
            for r in range(3):
                lever[r] = centres[j, r] - centres[j - 1, r]
            _carried(turn, spin, lever, pull)
        ax, ay, az = _axis(arm, frames, j)
        v, a = speeds[j], push[j]
        spin[0] += v * (turn[1] * az - turn[2] * ay) + a * ax
        spin[1] += v * (turn[2] * ax - turn[0] * az) + a * ay
        spin[2] += v * (turn[0] * ay - turn[1] * ax) + a * az
        turn[0] += v * ax
        turn[1] += v * ay
        turn[2] += v * az
        for r in range(3):
            lever[r] = 0.0
            for c in range(3):
                lever[r] += frames[j, r, c] * arm.centres[j, c]
            accelerated[r] = pull[r]
            moment[j, r] = 0.0
        _carried(turn, spin, lever, accelerated)
        for k in range(3):  # about the link's own axes, in which its inertia is diagonal
            one, two = (k + 1) % 3, (k + 2) % 3
            change = along = across = 0.0
            for r in range(3):
                change += frames[j, r, k] * spin[r]
                along += frames[j, r, one] * turn[r]
                across += frames[j, r, two] * turn[r]
            own = arm.inertias[j, k] * change + (arm.inertias[j, two] - arm.inertias[j, one]) * along * across
            for r in range(3):
                moment[j, r] += frames[j, r, k] * own
        for r in range(3):
            force[j, r] = arm.masses[j] * accelerated[r]
        moment[j, 0] += lever[1] * force[j, 2] - lever[2] * force[j, 1]
        moment[j, 1] += lever[2] * force[j, 0] - lever[0] * force[j, 2]
        moment[j, 2] += lever[0] * force[j, 1] - lever[1] * force[j, 0]
    for back in range(count):
        j = count - 1 - back
        ax, ay, az = _axis(arm, frames, j)
        torques[j] = ax * moment[j, 0] + ay * moment[j, 1] + az * moment[j, 2] + arm.armature[j] * push[j]
        if j > 0:
            x, y, z = (
                centres[j, 0] - centres[j - 1, 0],
                centres[j, 1] - centres[j - 1, 1],
                centres[j, 2] - centres[j - 1, 2],
            )
            moment[j - 1, 0] += moment[j, 0] + y * force[j, 2] - z * force[j, 1]
            moment[j - 1, 1] += moment[j, 1] + z * force[j, 0] - x * force[j, 2]
            moment[j - 1, 2] += moment[j, 2] + x * force[j, 1] - y * force[j, 0]
            for r in range(3):
                force[j - 1, r] += force[j, r]


@compiled
def _masses(arm: Arm, centres: Array, frames: Array) -> Array:
    """Mass matrix (J, J) with the gears' inertia, from each link's Jacobians."""
    count = len(centres)
    mass, of_point, com = np.zeros((count, count)), np.empty((3, count)), np.empty(3)
    inertia = np.empty((3, 3))
    for j in range(count):
        for r in range(3):
            com[r] = centres[j, r]
            for c in range(3):
                com[r] += frames[j, r, c] * arm.centres[j, c]
                inertia[r, c] = 0.0
                for k in range(3):
                    inertia[r, c] += frames[j, r, k] * arm.inertias[j, k] * frames[j, c, k]
        _moves(arm, centres, frames, j, com, of_point)
        for a in range(j + 1):
            axis = _axis(arm, frames, a)
            for b in range(a + 1):
                other, total = _axis(arm, frames, b), 0.0
                for r in range(3):
                    total += arm.masses[j] * of_point[r, a] * of_point[r, b]
                    for c in range(3):
                        total += axis[r] * inertia[r, c] * other[c]
                mass[a, b] += total
    for a in range(count):
        mass[a, a] += arm.armature[a]
        for b in range(a):
            mass[b, a] = mass[a, b]
    return mass


@compiled
def _dynamics(arm: Arm, centres: Array, frames: Array, speeds: Array) -> tuple[Array, Array]:
    """Mass matrix (J, J) with the gears' inertia, and Coriolis, centrifugal and gravity torques (J,)."""
    bias = np.empty(len(speeds))
    _torques(arm, centres, frames, speeds, np.zeros(len(speeds)), bias)
    return _masses(arm, centres, frames), bias


@compiled
def _carried(turn: Array, spin: Array, arm: Array, acceleration: Array) -> None:
    """Adds to an acceleration (3,) what a lever ``arm`` (3,) of a turning body adds: α × r + ω × (ω × r)."""
    x = turn[1] * arm[2] - turn[2] * arm[1]
    y = turn[2] * arm[0] - turn[0] * arm[2]
    z = turn[0] * arm[1] - turn[1] * arm[0]
    acceleration[0] += spin[1] * arm[2] - spin[2] * arm[1] + turn[1] * z - turn[2] * y
    acceleration[1] += spin[2] * arm[0] - spin[0] * arm[2] + turn[2] * x - turn[0] * z
    acceleration[2] += spin[0] * arm[1] - spin[1] * arm[0] + turn[0] * y - turn[1] * x


@compiled_entry
def dynamics(arm: Arm, joints: Array, speeds: Array) -> tuple[Array, Array]:
    """Mass matrix (J, J), kg·m², and Coriolis, centrifugal and gravity torques (J,), N·m; friction is not in them."""
    centres, frames = _frames(arm, joints)
    return _dynamics(arm, centres, frames, speeds)


@compiled
def _rub(arm: Arm, joint: int, speed: float) -> float:
    """Torque, N·m, that friction takes, smoothed about standstill."""
    return arm.damping[joint] * speed + arm.friction[joint] * math.tanh(speed / 0.05)


@compiled
def _strength(arm: Arm, joint: int, speed: float, sign: float) -> float:
    """Torque, N·m, available in the direction ``sign``: stall torque less what back-EMF takes at this speed."""
    return arm.stall[joint] * min(1.0, max(0.0, 1.0 - sign * speed / arm.no_load[joint]))


@compiled
def _to_segment(point: Array, start: Array, end: Array, away: Array) -> tuple[float, float]:
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
def _gaps(  # noqa: PLR0912 (a kernel)
    arm: Arm, centres: Array, frames: Array, head: Array, near: float, gaps: Array, slopes: Array, wanted: bool
) -> None:
    """Distances (B, 4), m, of the spheres from floor, mount, upper arm and head (4,): centre and radius.

    ``slopes`` (B, 4, J) are their derivatives, if ``wanted`` where a gap is below ``near``. Column and turret are one
    mount; a pair that cannot meet is 1 m apart.
    """
    ball, away, of_point, of_other = np.empty(3), np.empty(3), np.empty((3, 6)), np.empty((3, 6))
    foot, shoulder, elbow, other = np.empty(3), centres[1], centres[2], np.empty(3)
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
                below, _ = _to_segment(ball, foot, arm.base, other)
                beside, _ = _to_segment(ball, arm.base, shoulder, away)
                gap = beside - radius - arm.posts[0]
                if below - radius - arm.posts[2] < gap:
                    gap = below - radius - arm.posts[2]
                    away[0], away[1], away[2] = other[0], other[1], other[2]
            elif kind == 2:
                gap = 1.0
                if link >= 4:
                    gap, share = _to_segment(ball, shoulder, elbow, away)
                    gap -= radius + arm.posts[1]
            else:
                gap = 1.0
                if head[3] > 0.0:
                    gap, _ = _to_segment(ball, head[:3], head[:3], away)
                    gap -= radius + head[3]
            gaps[b, kind] = gap
            if not wanted or gap >= near:
                continue
            _moves(arm, centres, frames, link, ball, of_point)
            if kind == 2:  # the upper arm moves, too
                for r in range(3):
                    other[r] = shoulder[r] + share * (elbow[r] - shoulder[r])
                _moves(arm, centres, frames, 1, other, of_other)
                for r in range(3):
                    for j in range(6):
                        of_point[r, j] -= of_other[r, j]
            _along(away, of_point, slopes[b, kind])


@compiled
def _along(direction: Array, of_point: Array, out: Array) -> None:
    for j in range(len(out)):
        out[j] = direction[0] * of_point[0, j] + direction[1] * of_point[1, j] + direction[2] * of_point[2, j]


@compiled
def _clearance(arm: Arm, joints: Array, head: Array) -> float:
    """Smallest gap of a posture, m."""
    centres, frames = _frames(arm, joints)
    gaps, slopes = np.empty((len(arm.balls), 4)), np.empty((0, 4, 6))
    _gaps(arm, centres, frames, head, 0.0, gaps, slopes, False)
    least = 1.0
    for b in range(len(gaps)):
        for kind in range(4):
            least = min(least, gaps[b, kind])
    return least


@compiled_entry
def clearance(arm: Arm, joints: Array, head: Array) -> float:
    """Smallest gap, m, between the arm and floor, mount, itself or a head (4,): centre and radius, m."""
    return _clearance(arm, joints, head)


@compiled
def _runs(arm: Arm, start: Array, way: Array, seconds: float) -> bool:
    """Whether a minimum-jerk movement along ``way`` stays inside speed and torque–speed line."""
    joints, speeds, pulls = np.empty(6), np.empty(6), np.empty(6)
    for sample in range(17):
        s = sample / 16.0
        share = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        rate = 30.0 * s**2 * (1.0 - s) ** 2 / seconds
        change = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / seconds**2
        for j in range(6):
            joints[j] = start[j] + share * way[j]
            speeds[j], pulls[j] = rate * way[j], change * way[j]
            if abs(speeds[j]) > arm.speeds[j]:
                return False
        centres, frames = _frames(arm, joints)
        mass, torque = _dynamics(arm, centres, frames, speeds)
        for j in range(6):
            torque[j] += _rub(arm, j, speeds[j])
            for k in range(6):
                torque[j] += mass[j, k] * pulls[k]
            sign = 1.0 if torque[j] > 0.0 else -1.0
            if abs(torque[j]) > _strength(arm, j, speeds[j], sign):
                return False
    return True


@compiled_entry
def quickest(arm: Arm, start: Array, end: Array) -> float:
    """Duration, s, of the quickest minimum-jerk movement of all joints together that the servos can follow."""
    way, low, high = end - start, 0.02, 4.0
    for _ in range(14):
        middle = 0.5 * (low + high)
        if _runs(arm, start, way, middle):
            high = middle
        else:
            low = middle
    return high


@compiled
def _factored(matrix: Array, lower: Array) -> bool:
    """Writes the Cholesky factor of a symmetric matrix (n, n) into ``lower``; False where it is not positive."""
    count = len(matrix)
    for j in range(count):
        for i in range(j, count):
            total = matrix[i, j]
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                lower[i, i] = math.sqrt(total)
            else:
                lower[i, j] = total / lower[j, j]
    return True


@compiled
def _solved(lower: Array, vector: Array) -> None:
    """Replaces a vector by the solution of the factored system."""
    count = len(vector)
    for i in range(count):
        for k in range(i):
            vector[i] -= lower[i, k] * vector[k]
        vector[i] /= lower[i, i]
    for back in range(count):
        i = count - 1 - back
        for k in range(i + 1, count):
            vector[i] -= lower[k, i] * vector[k]
        vector[i] /= lower[i, i]


ROUND = 0.2
"""m that a turn of the normal by a radian counts as much as."""


@compiled
def _missed(arm: Arm, joints: Array, position: Array, normal: Array, residual: Array, slope: Array) -> float:
    """Squared miss of the plate; writes residual (6,) and Jacobian (6, J)."""
    centres, frames = _frames(arm, joints)
    point, out = _plate(arm, centres, frames)
    of_point, of_normal = _plate_moves(arm, centres, frames, point, out)
    total = 0.0
    for r in range(3):
        residual[r], residual[3 + r] = point[r] - position[r], ROUND * (out[r] - normal[r])
        total += residual[r] ** 2 + residual[3 + r] ** 2
        for j in range(6):
            slope[r, j], slope[3 + r, j] = of_point[r, j], ROUND * of_normal[r, j]
    return total


@compiled_entry
def posture(arm: Arm, position: Array, normal: Array, start: Array, steps: int) -> tuple[Array, float]:
    """Joints (J,) near ``start`` that put the plate there, and what is left (m, with the normal's turn as metres).

    Levenberg's damped Gauss–Newton steps, cut at the limits.
    """
    return _posture(arm, position, normal, start, steps)


@compiled
def _posture(arm: Arm, position: Array, normal: Array, start: Array, steps: int) -> tuple[Array, float]:
    joints, tried, damping = start.copy(), start.copy(), 1e-4
    residual, slope, left, ahead = np.empty(6), np.empty((6, 6)), np.empty(6), np.empty((6, 6))
    matrix, lower, step = np.empty((6, 6)), np.zeros((6, 6)), np.empty(6)
    cost = _missed(arm, joints, position, normal, residual, slope)
    for _ in range(steps):
        for i in range(6):
            step[i] = 0.0
            for r in range(6):
                step[i] -= slope[r, i] * residual[r]
            for j in range(6):
                matrix[i, j] = damping if i == j else 0.0
                for r in range(6):
                    matrix[i, j] += slope[r, i] * slope[r, j]
        if not _factored(matrix, lower):
            break
        _solved(lower, step)
        longest = 0.0
        for j in range(6):
            longest = max(longest, abs(step[j]))
        share = min(1.0, 0.5 / max(longest, 1e-9))
        for j in range(6):
            tried[j] = min(max(joints[j] + share * step[j], arm.low[j]), arm.high[j])
        now = _missed(arm, tried, position, normal, left, ahead)
        if now < cost:
            cost, damping = now, max(0.2 * damping, 1e-9)
            joints, tried, residual, left, slope, ahead = tried, joints, left, residual, ahead, slope
        else:
            damping *= 10.0
        if cost < 1e-12 or damping > 1e4:
            break
    return joints, math.sqrt(cost)


class Task(NamedTuple):
    """What the next moments are for.

    Attributes:
        time: s until the plate should meet the hand, negative once it is due; infinite: it shall rest.
        point, normal: (3,) m and unit vector, where it should be then, and facing where.
        covariance, sharpness: (3, 3) m² and m, how sure the place is, and what is not told from none.
        firm: weight of the normal's deviation.
        closing: m/s, speed along the normal at which it closes on the hand.
        settle: s before that from which on it is in front of the hand, ``standoff`` m away, and goes with it.
        press: m, that it goes on through the hand; ``pressed``: it should be there at once.
        away, drift: (3,) m and m/s, place and velocity of the path to be followed until then, from the point.
        loose: m, deviation from that path that counts 1.
        hand, hand_velocity: (3,) m and m/s, the person's palm when the arm obeys.
        braked: (3,) m/s, its velocity at contact.
        cap: m/s, largest speed relative to that palm where the plate touches it; infinite: no palm.
        rest, rest_weight: (J,) rad, the ready posture, and how much it counts.
        head: (4,) centre and radius, m, of a head to keep away from; radius 0: none.
        face: (3,) m/s that the plate may have near that head, m from its centre where it may, m/s² to get there.
        effort, calm: s⁴/rad² and s²/rad², weights of joint accelerations and speeds.
        seconds: s between knots.
    """

    time: float
    point: Array
    normal: Array
    covariance: Array
    sharpness: float
    firm: float
    closing: float
    settle: float
    standoff: float
    press: float
    pressed: bool
    away: Array
    drift: Array
    loose: float
    hand: Array
    hand_velocity: Array
    braked: Array
    cap: float
    rest: Array
    rest_weight: float
    head: Array
    face: Array
    effort: float
    calm: float
    seconds: float


class Aim(NamedTuple):
    """What a plan of N knots, ``seconds`` apart, the first that far from now, is after.

    Costs are squares in units of what is tolerated: a metre counts ``point_weights``, and so on.

    Attributes:
        seconds: s between knots.
        points, point_weights: (N, 3) m and (N, 3, 3) 1/m², where the plate shall be and how much that counts.
        normals, normal_weights: (N, 3) and (N,), where it shall face.
        velocities, velocity_weights: (N, 3) m/s and (N,) s²/m², of the plate.
        hands, hand_velocities: (N, 3) m and m/s, the person's palm.
        caps: (N,) m/s, largest speed at which plate and palm may close in where they are near; infinite: no palm.
        rest, rest_weight: (J,) rad, the ready posture, and how much it counts.
        head: (4,) centre and radius, m, of a head to keep away from; radius 0: none.
        face: (3,) m/s that the plate may have near that head, m from its centre where it may, m/s² to get there.
        effort, calm: s⁴/rad² and s²/rad², weights of joint accelerations and speeds.
    """

    seconds: float
    points: Array
    point_weights: Array
    normals: Array
    normal_weights: Array
    velocities: Array
    velocity_weights: Array
    hands: Array
    hand_velocities: Array
    caps: Array
    rest: Array
    rest_weight: float
    head: Array
    face: Array
    effort: float
    calm: float


STOP_MARGIN, STOP_WEIGHT = 0.06, 1e4
"""rad before a joint's stop where it begins to count, and by how much."""
SPEED_SHARE, SPEED_WEIGHT = 0.93, 300.0
GAP_MARGIN, GAP_WEIGHT = 0.05, 1e4
"""m of gap where nearness begins to count."""
TORQUE_WEIGHT = 0.3
CAP_WEIGHT = 400.0
YIELD = 6.0
"""m/s²: a plate that is not yet near the hand may be faster, by what this takes off on the way there."""
NEAR, TOUCHING = 0.15, 0.03
"""m from the hand at which its cap holds; nearer than the second the line between them is the normal that is wanted."""
BORDER = 0.05
"""m from the zone around a head within which passing by counts the less."""
HARD_GAP = 0.015
"""m of gap that no step goes below."""
SPARED = 3
"""Times that torques are looked at and what is too much is taken from the joint itself, before all are shortened."""
BRAKES = 0.5
"""Share of a joint's acceleration that is kept for stopping before a limit."""


@compiled
def _add_square(weight: float, error: float, slope: Array, gradient: Array, matrix: Array) -> None:
    """Adds weight × error² / 2 of an error with derivative ``slope`` (J,)."""
    for i in range(6):
        gradient[i] += weight * error * slope[i]
        for j in range(6):
            matrix[i, j] += weight * slope[i] * slope[j]


@compiled
def _state_cost(  # noqa: PLR0912, PLR0915 (a kernel)
    arm: Arm, aim: Aim, knot: int, centres: Array, frames: Array, joints: Array, speeds: Array, slopes: bool,
    by_joints: Array, by_speeds: Array, joints_twice: Array, speeds_twice: Array,
) -> float:  # fmt: skip
    """Cost of being there at a knot; with ``slopes`` also its gradients (J,) and Gauss–Newton matrices (J, J)."""
    cost = 0.0
    point, normal = _plate(arm, centres, frames)
    of_point, of_normal = _plate_moves(arm, centres, frames, point, normal)
    weights = aim.point_weights[knot]
    for r in range(3):
        pulled = 0.0
        for c in range(3):
            pulled += weights[r, c] * (point[c] - aim.points[knot, c])
        cost += 0.5 * pulled * (point[r] - aim.points[knot, r])
        if slopes:
            for j in range(6):
                by_joints[j] += of_point[r, j] * pulled
                weighed = (
                    weights[r, 0] * of_point[0, j] + weights[r, 1] * of_point[1, j] + weights[r, 2] * of_point[2, j]
                )
                for i in range(6):
                    joints_twice[i, j] += of_point[r, i] * weighed
    weight = aim.normal_weights[knot]
    if weight > 0.0:
        for r in range(3):
            error = normal[r] - aim.normals[knot, r]
            cost += 0.5 * weight * error**2
            if slopes:
                _add_square(weight, error, of_normal[r], by_joints, joints_twice)
    plate, line, apart, towards, fleeing = np.empty(3), np.empty(3), 0.0, 0.0, 0.0
    for r in range(3):
        speed = 0.0
        for j in range(6):
            speed += of_point[r, j] * speeds[j]
        plate[r], line[r] = speed, aim.hands[knot, r] - point[r]
        apart += line[r] ** 2
        weight = aim.velocity_weights[knot]
        if weight > 0.0:
            error = speed - aim.velocities[knot, r]
            cost += 0.5 * weight * error**2
            if slopes:
                _add_square(weight, error, of_point[r], by_speeds, speeds_twice)
    if aim.caps[knot] < math.inf:
        apart = math.sqrt(apart)
        for r in range(3):
            line[r] = line[r] / apart if apart > TOUCHING else aim.normals[knot, r]
            towards += line[r] * plate[r]
            fleeing += line[r] * aim.hand_velocities[knot, r]
        there = max(0.0, aim.caps[knot] + fleeing)  # a hand that is faster by itself is not run away from
        room = 4.0 * YIELD * max(0.0, apart - NEAR)
        over = towards - 0.5 * (there + fleeing + math.sqrt((there - fleeing) ** 2 + room))
        if over > 0.0:
            cost += 0.5 * CAP_WEIGHT * over**2
            if slopes:
                faster = np.empty(6)
                _along(line, of_point, faster)
                _add_square(CAP_WEIGHT, over, faster, by_speeds, speeds_twice)
    if aim.head[3] > 0.0:
        for r in range(3):
            line[r] = aim.head[r] - point[r]
        over, fast = _over_near_face(aim.face, line, plate)
        if over > 0.0:
            cost += 0.5 * CAP_WEIGHT * over**2
            if slopes:
                faster = np.empty(6)
                for r in range(3):
                    plate[r] /= fast
                _along(plate, of_point, faster)
                _add_square(CAP_WEIGHT, over, faster, by_speeds, speeds_twice)
    for j in range(6):
        away = aim.rest_weight * (joints[j] - aim.rest[j])
        cost += 0.5 * away * (joints[j] - aim.rest[j])
        beyond = max(0.0, joints[j] - arm.high[j] + STOP_MARGIN) - max(0.0, arm.low[j] + STOP_MARGIN - joints[j])
        top = SPEED_SHARE * arm.speeds[j]
        fast = max(0.0, speeds[j] - top) - max(0.0, -top - speeds[j])
        cost += 0.5 * (STOP_WEIGHT * beyond**2 + SPEED_WEIGHT * fast**2 + aim.calm * speeds[j] ** 2)
        if slopes:
            by_joints[j] += away + STOP_WEIGHT * beyond
            by_speeds[j] += SPEED_WEIGHT * fast + aim.calm * speeds[j]
            joints_twice[j, j] += aim.rest_weight + (STOP_WEIGHT if beyond != 0.0 else 0.0)
            speeds_twice[j, j] += aim.calm + (SPEED_WEIGHT if fast != 0.0 else 0.0)
    gaps, wider = np.empty((len(arm.balls), 4)), np.empty((len(arm.balls) if slopes else 0, 4, 6))
    _gaps(arm, centres, frames, aim.head, GAP_MARGIN, gaps, wider, slopes)
    for b in range(len(gaps)):
        for kind in range(4):
            if gaps[b, kind] < GAP_MARGIN:
                error = gaps[b, kind] - GAP_MARGIN
                cost += 0.5 * GAP_WEIGHT * error**2
                if slopes:
                    _add_square(GAP_WEIGHT, error, wider[b, kind], by_joints, joints_twice)
    return cost


@compiled
def _over_near_face(face: Array, line: Array, plate: Array) -> tuple[float, float]:
    """m/s by which a plate of velocity ``plate`` (3,) is too fast for a head ``line`` (3,) m away; and its speed.

    As :func:`highfive.hil.safety.people.face_zone_share` has it, for a head at rest.
    """
    away = fast = along = 0.0
    for r in range(3):
        away += line[r] ** 2
        fast += plate[r] ** 2
        along += line[r] * plate[r]
    away, fast = math.sqrt(away), math.sqrt(fast)
    way = max(0.0, away - face[1])
    straight = max(along / max(away * fast, 1e-9), 1.0 - way / BORDER)
    if straight <= 1e-3 or fast <= face[0]:
        return 0.0, fast
    there = straight * face[0]
    return fast - 0.5 * (there + math.sqrt(there**2 + 4.0 * straight * face[2] * way)) / straight, fast


@compiled
def _push_cost(
    arm: Arm, effort: float, centres: Array, frames: Array, speeds: Array, push: Array, slopes: bool,
    by_push: Array, by_speeds: Array, push_twice: Array, cross: Array, speeds_twice: Array,
) -> float:  # fmt: skip
    """Cost of accelerations ``push`` (J,): effort, and torque beyond the torque–speed line."""
    cost, torques, weighed = 0.0, np.empty(6), False
    _torques(arm, centres, frames, speeds, push, torques)
    mass = np.empty((0, 0))
    for j in range(6):
        cost += 0.5 * effort * push[j] ** 2
        torque = torques[j] + _rub(arm, j, speeds[j])
        sign = 1.0 if torque > 0.0 else -1.0
        over = sign * torque - _strength(arm, j, speeds[j], sign)
        if over > 0.0:
            cost += 0.5 * TORQUE_WEIGHT * over**2
        if not slopes:
            continue
        by_push[j] += effort * push[j]
        push_twice[j, j] += effort
        if over > 0.0:
            if not weighed:
                mass, weighed = _masses(arm, centres, frames), True
            slower = sign * arm.stall[j] / arm.no_load[j]  # strength lost by a faster joint
            by_speeds[j] += TORQUE_WEIGHT * over * slower
            speeds_twice[j, j] += TORQUE_WEIGHT * slower**2
            for i in range(6):
                by_push[i] += TORQUE_WEIGHT * over * sign * mass[j, i]
                cross[i, j] += TORQUE_WEIGHT * sign * mass[j, i] * slower
                for k in range(6):
                    push_twice[i, k] += TORQUE_WEIGHT * mass[j, i] * mass[j, k]
    return cost


@compiled
def _rolled(
    arm: Arm, aim: Aim, path: Array, pushes: Array, share: float, feed: Array, gains: Array, new_path: Array,
    new_pushes: Array,
) -> float:  # fmt: skip
    """Rolls the plan out with ``share`` of the improvement; path (N + 1, 2, J). Returns its cost."""
    cost, seconds = 0.0, aim.seconds
    no, nothing = np.zeros(6), np.zeros((6, 6))
    for j in range(6):
        new_path[0, 0, j], new_path[0, 1, j] = path[0, 0, j], path[0, 1, j]
    centres, frames = _frames(arm, new_path[0, 0])
    for k in range(len(pushes)):
        for i in range(6):
            push = pushes[k, i] + share * feed[k, i]
            for j in range(6):
                push += gains[k, i, j] * (new_path[k, 0, j] - path[k, 0, j])
                push += gains[k, i, 6 + j] * (new_path[k, 1, j] - path[k, 1, j])
            push = min(max(push, -arm.accelerations[i]), arm.accelerations[i])
            new_pushes[k, i] = push
            speed = new_path[k, 1, i]
            new_path[k + 1, 0, i] = new_path[k, 0, i] + seconds * speed + 0.5 * seconds**2 * push
            new_path[k + 1, 1, i] = speed + seconds * push
        cost += _push_cost(
            arm, aim.effort, centres, frames, new_path[k, 1], new_pushes[k], False, no, no, nothing, nothing, nothing
        )
        joints, speeds = new_path[k + 1, 0], new_path[k + 1, 1]
        centres, frames = _frames(arm, joints)
        cost += _state_cost(arm, aim, k, centres, frames, joints, speeds, False, no, no, nothing, nothing)
    return cost


class Slopes(NamedTuple):
    """Derivatives of a plan's cost, by knot.

    Attributes:
        states, states_twice: (N, 2, J) and (N, 2, J, J), by joints and by speeds after each push.
        pushes, pushes_twice: (N, 2, J) and (N, 3, J, J), by push and speeds before it; by both.
    """

    states: Array
    states_twice: Array
    pushes: Array
    pushes_twice: Array


@compiled
def _slopes(arm: Arm, aim: Aim, path: Array, pushes: Array) -> Slopes:
    """The derivatives along a path."""
    count = len(pushes)
    found = Slopes(
        np.zeros((count, 2, 6)), np.zeros((count, 2, 6, 6)), np.zeros((count, 2, 6)), np.zeros((count, 3, 6, 6))
    )
    centres, frames = _frames(arm, path[0, 0])
    for k in range(count):
        one, two = found.pushes[k], found.pushes_twice[k]
        _push_cost(
            arm, aim.effort, centres, frames, path[k, 1], pushes[k], True, one[0], one[1], two[0], two[1], two[2]
        )
        joints, speeds, one, two = path[k + 1, 0], path[k + 1, 1], found.states[k], found.states_twice[k]
        centres, frames = _frames(arm, joints)
        _state_cost(arm, aim, k, centres, frames, joints, speeds, True, one[0], one[1], two[0], two[1])
    return found


@compiled
def _improvement(  # noqa: PLR0912 (a kernel)
    arm: Arm, slopes: Slopes, h: float, damping: float, pushes: Array, feed: Array, gains: Array
) -> bool:
    """The Riccati sweep (iterative LQR, Li & Todorov 2004): writes feed-forward (N, J) and gains (N, J, 2 J).

    ``damping`` counts a way of the joints from the old path, squared (Tassa et al. 2012); pushes that would go beyond a
    joint's acceleration stop there, and the others know it (Tassa et al. 2014, one guess of the active set).
    """
    value, twice = np.zeros((2, 6)), np.zeros((2, 2, 6, 6))  # gradient and matrix of the cost to go, by (q, v)
    new, new_twice = np.zeros((2, 6)), np.zeros((2, 2, 6, 6))
    mixed, push_twice, by_push = np.empty((6, 12)), np.empty((6, 6)), np.empty(6)  # by push and (q, v), by push
    lower, right, free = np.zeros((6, 6)), np.empty(6), np.ones(6)
    for back in range(len(pushes)):
        k = len(pushes) - 1 - back
        for half in range(2):
            for i in range(6):
                value[half, i] += slopes.states[k, half, i]
                for j in range(6):
                    twice[half, half, i, j] += slopes.states_twice[k, half, i, j]
        for i in range(6):
            twice[0, 0, i, i] += damping
            by_push[i] = slopes.pushes[k, 0, i] + 0.5 * h * h * value[0, i] + h * value[1, i]
            new[0, i], new[1, i] = value[0, i], h * value[0, i] + value[1, i] + slopes.pushes[k, 1, i]
        for i in range(6):
            for j in range(6):
                qq, qv, vq, vv = twice[0, 0, i, j], twice[0, 1, i, j], twice[1, 0, i, j], twice[1, 1, i, j]
                push_twice[i, j] = slopes.pushes_twice[k, 0, i, j]
                push_twice[i, j] += 0.25 * h**4 * qq + 0.5 * h**3 * (qv + vq) + h * h * vv
                mixed[i, j] = 0.5 * h * h * qq + h * vq
                mixed[i, 6 + j] = 0.5 * h * h * (h * qq + qv) + h * (h * vq + vv) + slopes.pushes_twice[k, 1, i, j]
                new_twice[0, 0, i, j] = qq
                new_twice[0, 1, i, j] = h * qq + qv
                new_twice[1, 0, i, j] = h * qq + vq
                new_twice[1, 1, i, j] = h * h * qq + h * (qv + vq) + vv + slopes.pushes_twice[k, 2, i, j]
        if not _boxed(arm, push_twice, by_push, pushes[k], lower, right, free):
            return False
        for i in range(6):
            feed[k, i] = right[i]
        for column in range(12):
            for i in range(6):
                right[i] = -free[i] * mixed[i, column]
            _solved(lower, right)
            for i in range(6):
                gains[k, i, column] = free[i] * right[i]
        # The cost to go of these steps, whether or not they are the best ones.
        for half in range(2):
            for i in range(6):
                for c in range(6):
                    new[half, i] += mixed[c, 6 * half + i] * feed[k, c]
                    pull = by_push[c]
                    for d in range(6):
                        pull += push_twice[c, d] * feed[k, d]
                    new[half, i] += gains[k, c, 6 * half + i] * pull
                for other in range(2):
                    for j in range(6):
                        for c in range(6):
                            new_twice[half, other, i, j] += mixed[c, 6 * half + i] * gains[k, c, 6 * other + j]
        value, new = new, value
        twice, new_twice = new_twice, twice
    return True


@compiled
def _boxed(arm: Arm, matrix: Array, gradient: Array, push: Array, lower: Array, step: Array, free: Array) -> bool:
    """Writes the step (J,) that is best inside the accelerations, the factor of what is free, and what is (1 or 0)."""
    part = np.empty((6, 6))
    for j in range(6):
        free[j] = 1.0
    for turn in range(2):
        for i in range(6):
            step[i] = -gradient[i] if free[i] > 0.0 else step[i]
        for i in range(6):
            for j in range(6):
                part[i, j] = matrix[i, j] if free[i] * free[j] > 0.0 else (1.0 if i == j else 0.0)
                if free[i] > 0.0 and free[j] == 0.0:
                    step[i] -= matrix[i, j] * step[j]
        if not _factored(part, lower):
            return False
        _solved(lower, step)
        out = False
        for j in range(6):
            most = arm.accelerations[j]
            inside = min(max(push[j] + step[j], -most), most) - push[j]
            if abs(inside - step[j]) > 1e-9:
                step[j] = inside
                if turn == 0:
                    free[j], out = 0.0, True
        if not out:
            break
    return True


ACCELERATION, SPEED, STOP, TORQUE, NEARNESS = 1, 2, 4, 8, 16
"""Bits that say which limit shortened a step."""


@compiled
def _keeps(arm: Arm, joint: int, place: float, speed: float, push: float, seconds: float) -> bool:
    """Whether the joint can still stop before its limits after a step."""
    brake = BRAKES * arm.accelerations[joint]
    after = place + seconds * speed + 0.5 * seconds**2 * push
    faster = speed + seconds * push
    way = 0.5 * faster * (abs(faster) / brake + seconds)  # the last step of braking takes a whole one
    return arm.low[joint] <= min(after, after + way) and max(after, after + way) <= arm.high[joint]


@compiled
def _allowed(  # noqa: PLR0912  (a kernel)
    arm: Arm, joints: Array, speeds: Array, push: Array, seconds: float, head: Array, torques: Array
) -> int:
    """Shortens accelerations (J,) until every limit holds after the step; returns the bits of those that did it.

    Writes the torques (J,) that the step takes into ``torques``.
    """
    active, brakes = 0, np.empty(6)
    for j in range(6):
        most = arm.accelerations[j]
        brakes[j] = min(max(-speeds[j] / seconds, -BRAKES * most), BRAKES * most)
        low, high = -most, most
        if not math.isfinite(push[j]):
            push[j] = brakes[j]
        if abs(push[j]) > most:
            active |= ACCELERATION
        fastest, slowest = (arm.speeds[j] - speeds[j]) / seconds, (-arm.speeds[j] - speeds[j]) / seconds
        if push[j] > fastest or push[j] < slowest:
            active |= SPEED
        wanted = min(max(push[j], low, slowest), high, fastest)
        if not _keeps(arm, j, joints[j], speeds[j], wanted, seconds):
            active |= STOP
            good, bad = brakes[j], wanted
            for _ in range(20):
                middle = 0.5 * (good + bad)
                if _keeps(arm, j, joints[j], speeds[j], middle, seconds):
                    good = middle
                else:
                    bad = middle
            wanted = good
        push[j] = wanted
    centres, frames = _frames(arm, joints)
    if _spared(arm, centres, frames, speeds, brakes, push):
        active |= TORQUE
    slow = np.empty(6)
    for j in range(6):  # what stays as it is, where that does not lead into a stop
        slow[j] = 0.0 if _keeps(arm, j, joints[j], speeds[j], 0.0, seconds) else brakes[j]
    share = _share(arm, centres, frames, speeds, push, slow)
    if share <= 0.0:
        slow = brakes
        share = _share(arm, centres, frames, speeds, push, slow)
    if share < 1.0:
        active |= TORQUE
    for j in range(6):
        push[j] = slow[j] + share * (push[j] - slow[j])
    stopped = np.empty(6)
    for j in range(6):
        after = speeds[j] + seconds * push[j]
        stopped[j] = joints[j] + seconds * speeds[j] + 0.5 * seconds**2 * push[j]
        stopped[j] += after * abs(after) / (2.0 * BRAKES * arm.accelerations[j])
    gap = _clearance(arm, stopped, head)
    if gap < HARD_GAP and gap < _clearance(arm, joints, head):
        active |= NEARNESS
        for j in range(6):
            push[j] = brakes[j]
    _torques(arm, centres, frames, speeds, push, torques)
    for j in range(6):
        torques[j] += _rub(arm, j, speeds[j])
    return active


@compiled
def _spared(arm: Arm, centres: Array, frames: Array, speeds: Array, brakes: Array, push: Array) -> bool:
    """Takes from each joint that asks too much of its servo what is too much, towards braking; whether one did."""
    torques, spared = np.empty(6), False
    mass = np.empty((0, 0))
    for _ in range(SPARED):
        _torques(arm, centres, frames, speeds, push, torques)
        for j in range(6):
            torque = torques[j] + _rub(arm, j, speeds[j])
            sign = 1.0 if torque > 0.0 else -1.0
            over = sign * torque - _strength(arm, j, speeds[j], sign)
            if over <= 0.0:
                continue
            if not spared:
                mass, spared = _masses(arm, centres, frames), True
            less = push[j] - sign * over / mass[j, j]
            push[j] = max(less, min(brakes[j], push[j])) if sign > 0.0 else min(less, max(brakes[j], push[j]))
    return spared


@compiled
def _share(arm: Arm, centres: Array, frames: Array, speeds: Array, push: Array, slow: Array) -> float:
    """How far from accelerations ``slow`` (J,) to ``push`` (J,) the torques stay inside their line: 0 to 1."""
    wanted, least = np.empty(6), np.empty(6)
    _torques(arm, centres, frames, speeds, push, wanted)
    _torques(arm, centres, frames, speeds, slow, least)
    share = 1.0
    for j in range(6):
        rub = _rub(arm, j, speeds[j])
        sign = 1.0 if wanted[j] + rub > 0.0 else -1.0
        limit = _strength(arm, j, speeds[j], sign)
        if sign * (wanted[j] + rub) > limit:
            way = sign * (wanted[j] - least[j])
            share = min(share, max(0.0, (limit - sign * (least[j] + rub)) / way)) if way > 1e-9 else 0.0
    return share


@compiled_entry
def moved_on(
    arm: Arm, joints: Array, speeds: Array, push: Array, seconds: float, head: Array
) -> tuple[Array, Array, Array, int]:
    """Joints and speeds (J,) a step later, with accelerations ``push`` (J,) as far as limits allow.

    Also the torques (J,), N·m, that it takes, and the bits of the limits that shortened it.
    """
    return _moved_on(arm, joints, speeds, push, seconds, head)


@compiled
def _moved_on(
    arm: Arm, joints: Array, speeds: Array, push: Array, seconds: float, head: Array
) -> tuple[Array, Array, Array, int]:
    push, torques = push.copy(), np.empty(6)
    active = _allowed(arm, joints, speeds, push, seconds, head, torques)
    place, speed = joints.copy(), speeds.copy()
    for j in range(6):
        place[j] += seconds * speeds[j] + 0.5 * seconds**2 * push[j]
        speed[j] += seconds * push[j]
    return place, speed, torques, active


class Planned(NamedTuple):
    """A plan and its first step.

    Attributes:
        joints, speeds: (J,) rad and rad/s, one tick from now.
        torques: (J,) N·m, that this takes.
        pushes: (N, J) rad/s², the plan.
        guess: (J,) rad, a posture that meets the hand.
        plate: (3,) m, where the plate is one tick from now.
        miss: m, distance of the plate from where it should be, at the knot of the meeting.
        cost: of the plan.
        active: bits of the limits that shortened the first step.
    """

    joints: Array
    speeds: Array
    torques: Array
    pushes: Array
    guess: Array
    plate: Array
    miss: float
    cost: float
    active: int


FADING = 0.1
"""s in which a hand's velocity fades beyond the contact, and three times that before it."""
GUESS_STEPS = 4
MEETING_WEIGHT = 5.0
"""s²/m², of the plate's velocity as it meets the hand."""
BEFORE = 0.05
"""Share of the normal's weight that counts before."""
BEFOREHAND = 0.15
"""m/s by which the place in front of the hand is less strict for each s before the contact."""
WAITED = 0.05
"""m: a hand that is further than this from where it will be met is waited for this far before."""
STYLE_KNOT = 0.05
"""s of the path that count as one knot."""


@compiled
def _aimed(task: Task, count: int) -> Aim:  # noqa: PLR0912 (a kernel)
    """The task, knot by knot."""
    aim = Aim(
        task.seconds, np.zeros((count, 3)), np.zeros((count, 3, 3)), np.empty((count, 3)), np.zeros(count),
        np.zeros((count, 3)), np.zeros(count), np.empty((count, 3)), np.empty((count, 3)),
        np.full(count, task.cap), task.rest, task.rest_weight, task.head, task.face, task.effort, task.calm,
    )  # fmt: skip
    sure, lower, column = np.zeros((3, 3)), np.zeros((3, 3)), np.empty(3)
    for r in range(3):
        for c in range(3):
            sure[r, c] = task.covariance[r, c]
        sure[r, r] += task.sharpness**2
    known, doubt = _factored(sure, lower), (sure[0, 0] + sure[1, 1] + sure[2, 2]) / 3.0
    for c in range(3):
        for r in range(3):
            column[r] = 1.0 if r == c else 0.0
        if known:
            _solved(lower, column)
        for r in range(3):
            sure[r, c] = column[r]
    settled = task.time - task.settle
    length, calm = max(settled, task.seconds), 3.0 * FADING
    end, pace = np.empty(3), np.empty(3)
    if settled < math.inf:
        _awaited(task, max(settled, 0.0), end, pace)
    for k in range(count):
        t = (k + 1) * task.seconds
        fading = math.exp(-t / calm)
        for r in range(3):
            aim.normals[k, r] = task.normal[r]
            aim.hands[k, r] = task.hand[r] + task.hand_velocity[r] * calm * (1.0 - fading)
            aim.hand_velocities[k, r] = task.hand_velocity[r] * fading
        if task.time == math.inf:
            continue
        if task.cap < math.inf:
            _met_hand(task, t, aim.hands[k], aim.hand_velocities[k])
        past = t - task.time
        aim.normal_weights[k] = BEFORE * task.firm
        if t - settled < -0.5 * task.seconds:  # on the way
            x = t / length
            for r in range(3):
                stop = end[r] - task.standoff * task.normal[r]
                cubic = stop + (task.point[r] + task.away[r] - stop) * (1.0 - x) ** 2 * (1.0 + 2.0 * x)
                cubic += length * x * (1.0 - x) * (task.drift[r] * (1.0 - x) - pace[r] * x)
                aim.points[k, r] = cubic
                aim.point_weights[k, r, r] = task.seconds / STYLE_KNOT / task.loose**2
            continue
        aim.normal_weights[k] = task.firm
        if abs(past) < 1.5 * task.seconds:
            aim.velocity_weights[k] = MEETING_WEIGHT
        through = task.press if task.pressed else min(task.closing * past, task.press)
        _awaited(task, t, aim.points[k], aim.velocities[k])
        for r in range(3):
            aim.points[k, r] += max(through, -task.standoff) * task.normal[r]
            aim.velocities[k, r] = task.braked[r] + task.closing * task.normal[r]
            for c in range(3):
                aim.point_weights[k, r, c] = sure[r, c] * doubt / (doubt + (BEFOREHAND * min(past, 0.0)) ** 2)
    return aim


@compiled
def _awaited(task: Task, t: float, place: Array, pace: Array) -> None:
    """Writes where the plate is in front of, (3,) m, and its velocity (3,): the hand, when it is near the contact.

    A plate cannot go with a hand that comes fast; it waits where they will meet.
    """
    _met_hand(task, t, place, pace)
    if t >= task.time:
        return
    away = 0.0
    for r in range(3):
        away += (place[r] - task.point[r]) ** 2
    away = math.sqrt(away)
    if away > WAITED:
        for r in range(3):
            place[r] = task.point[r] + WAITED / away * (place[r] - task.point[r])
            pace[r] *= (WAITED / away) ** 2


@compiled
def _met_hand(task: Task, t: float, place: Array, pace: Array) -> None:
    """Writes where the hand is in t s, (3,) m, and its velocity (3,): a cubic from now to the contact, then fading."""
    past = t - task.time
    if past >= 0.0 or task.cap == math.inf:
        gone = past if past < 0.0 else FADING * (1.0 - math.exp(-past / FADING))
        for r in range(3):
            place[r], pace[r] = task.point[r] + gone * task.braked[r], task.braked[r]
        return
    length, x = task.time, t / task.time
    for r in range(3):
        way = task.point[r] - task.hand[r]
        begin, end = length * task.hand_velocity[r], length * task.braked[r]
        place[r] = task.hand[r] + x * (begin + x * (3.0 * way - 2.0 * begin - end + x * (begin + end - 2.0 * way)))
        pace[r] = (begin + x * (2.0 * (3.0 * way - 2.0 * begin - end) + 3.0 * x * (begin + end - 2.0 * way))) / length


@compiled
def _afresh(arm: Arm, task: Task, guess: Array, path: Array, pushes: Array) -> None:
    """Writes the pushes (N, J) of a cubic in the joints to a posture, at the plate's velocity, and nothing after."""
    centres, frames = _frames(arm, guess)
    point, normal = _plate(arm, centres, frames)
    of_point, _ = _plate_moves(arm, centres, frames, point, normal)
    square, lower, pull, arrival = np.empty((3, 3)), np.zeros((3, 3)), np.empty(3), np.zeros(6)
    for r in range(3):
        pull[r] = task.braked[r] + task.closing * task.normal[r]
        for c in range(3):
            square[r, c] = 1e-2 if r == c else 0.0
            for j in range(6):
                square[r, c] += of_point[r, j] * of_point[c, j]
    if _factored(square, lower):
        _solved(lower, pull)
        for j in range(6):
            for r in range(3):
                arrival[j] += of_point[r, j] * pull[r]
    length = max(task.time, task.seconds)
    for j in range(6):
        length = max(length, 1.3 * abs(guess[j] - path[0, 0, j]) / arm.speeds[j])
    for k in range(len(pushes)):
        t = (k + 0.5) * task.seconds
        for j in range(6):
            way, begin, end = guess[j] - path[0, 0, j], path[0, 1, j], arrival[j]
            push = (6.0 * way / length - 4.0 * begin - 2.0 * end) / length
            push += t / length**2 * (6.0 * (begin + end) - 12.0 * way / length)
            pushes[k, j] = push if t < length else 0.0


DAMPINGS = 3
SHARES = 2


@compiled
def _better(arm: Arm, aim: Aim, cost: float, path: Array, plan: Array, other: Array, trial: Array) -> float:
    """Writes an improved path and plan into ``other`` and ``trial``; returns its cost, or ``cost`` if there is none."""
    slopes = _slopes(arm, aim, path, plan)
    feed, gains = np.zeros((len(plan), 6)), np.zeros((len(plan), 6, 12))
    damping = 0.0
    for _ in range(DAMPINGS):
        if _improvement(arm, slopes, aim.seconds, damping, plan, feed, gains):
            share = 1.0
            for _ in range(SHARES):
                now = _rolled(arm, aim, path, plan, share, feed, gains, other, trial)
                if now < cost:
                    return now
                share *= 0.35
        damping = 0.1 * cost if damping == 0.0 else 30.0 * damping
    return cost


@compiled_entry
def planned(
    arm: Arm, task: Task, joints: Array, speeds: Array, pushes: Array, guess: Array, tick: float, rounds: int
) -> Planned:
    """Improves a plan ``rounds`` times from joints and speeds (J,) of now, and takes its first step of ``tick`` s.

    The plan, or a new one to the posture that ``guess`` is improved to: whichever costs less.
    """
    count = len(pushes)
    aim = _aimed(task, count)
    path, other = np.empty((count + 1, 2, 6)), np.empty((count + 1, 2, 6))
    plan, trial = np.empty((count, 6)), np.empty((count, 6))
    feed, gains = np.zeros((count, 6)), np.zeros((count, 6, 12))
    for k in range(count + 1):
        for j in range(6):
            path[k, 0, j], path[k, 1, j] = joints[j], speeds[j]
            other[k, 0, j], other[k, 1, j] = joints[j], speeds[j]
    cost = _rolled(arm, aim, path, pushes, 0.0, feed, gains, other, plan)
    path, other = other, path
    if task.time > 2.0 * tick and task.time < math.inf:
        guess, _ = _posture(arm, task.point, task.normal, guess, GUESS_STEPS)
        fresh = np.empty((count, 6))
        _afresh(arm, task, guess, path, fresh)
        for k in range(count + 1):
            for j in range(6):
                other[k, 0, j], other[k, 1, j] = joints[j], speeds[j]
        spare = np.empty((count + 1, 2, 6))
        now = _rolled(arm, aim, other, fresh, 0.0, feed, gains, spare, trial)
        if not cost <= now:
            cost, path, plan, trial = now, spare, trial, plan
    for _ in range(rounds):
        now = _better(arm, aim, cost, path, plan, other, trial)
        gained = cost - now
        if not gained > 0.0:
            break
        cost, path, other, plan, trial = now, other, path, trial, plan
        if gained < 1e-4 * cost:
            break
    place, speed, torques, active = _moved_on(arm, joints, speeds, plan[0], tick, aim.head)
    centres, frames = _frames(arm, place)
    plate, _ = _plate(arm, centres, frames)
    miss = 0.0
    if task.time < math.inf:
        knot = min(max(round(task.time / task.seconds) - 1, 0), count - 1)
        centres, frames = _frames(arm, path[knot + 1, 0])
        point, _ = _plate(arm, centres, frames)
        for r in range(3):
            miss += (point[r] - aim.points[knot, r]) ** 2
    return Planned(place, speed, torques, plan, guess, plate, math.sqrt(miss), cost, active)
