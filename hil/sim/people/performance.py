"""What one actor does: the palm comes to its place at contact, and the body with it.

Joints move along minimum-jerk splines between key poses (Flash & Hogan 1985); the arms at the keys are solved for the
palm, so that palms meet.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import BPoly, make_interp_spline
from scipy.optimize import minimize

from highfive.hil.sim.avatar import right_palm
from highfive.hil.sim.limb_ik import solve_arm, solve_leg
from highfive.hil.sim.people.emotions import EmotionStyle
from highfive.hil.sim.people.posture import BodyMotion
from highfive.hil.sim.people.role import RATE_HZ, ActorMotion, Individual, PalmTarget, Role
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.geometry.skeleton import Skeleton

_MARGIN = np.radians(3.0)


def comfortable_palm(
    skeleton: Skeleton, style: EmotionStyle, individual: Individual, point: Array, normal: Array
) -> PalmTarget:
    """Finger direction, elbow swivel and lean that put the palm at ``point`` facing ``normal`` inside the limits."""
    up = np.array([0.0, 0.0, 1.0]) - normal * normal[2]
    up = up / np.linalg.norm(up)
    desired = np.radians(style.elbow_out) + individual.elbow_out

    best: tuple[float, PalmTarget] | None = None
    for lean in np.radians([0.0, 5.0, 10.0, 15.0]):

        def target(choice: Array, lean: float = lean) -> PalmTarget:
            fingers = rotations.rotate(rotations.from_rotation_vector(normal * choice[1]), up)
            return PalmTarget(point, normal, fingers, float(choice[0]), float(lean))

        body = BodyMotion(Role(skeleton, style, individual, target(np.zeros(2)), 1.0, 2.0, 0.2))
        clavicle, limits = body.clavicle(1.0), skeleton.hinge_limits[body.arm]

        def beyond(choice: Array, clavicle=clavicle, limits=limits, target=target) -> float:
            palm = target(choice)
            angles = solve_arm(skeleton, clavicle, point, normal, palm.fingers, palm.elbow_out)
            stretched = max(0.0, angles[1, 0] + np.radians(20.0))
            over = np.maximum(0.0, np.maximum(limits[..., 0] + _MARGIN - angles, angles - limits[..., 1] + _MARGIN))
            return float((over**2).sum() + stretched**2)

        def discomfort(choice: Array, beyond=beyond) -> float:
            return 50.0 * beyond(choice) + 2e-3 * float(choice[1] ** 2 + (choice[0] - desired) ** 2)

        starts = [np.array([e, f]) for e in np.radians([-10, 10, 30, 60]) for f in np.radians([-60, -30, 0, 30])]
        options = {"maxfev": 50, "xatol": 1e-3, "fatol": 1e-9}
        choice = minimize(discomfort, min(starts, key=discomfort), method="Nelder-Mead", options=options).x
        left = beyond(choice)
        if best is None or left < 0.5 * best[0]:
            best = (left, target(choice))
        if left < _MARGIN**2:
            break
    assert best is not None
    return best[1]


def reach_duration(
    skeleton: Skeleton, style: EmotionStyle, individual: Individual, palm: PalmTarget, peak_speed: float
) -> float:
    """Duration, s, of a reach from rest to ``palm`` whose hand peaks at ``peak_speed`` m/s."""
    duration = 1.0
    for _ in range(3):
        # Again and again, because the speed requested at contact keeps the peak from scaling as 1 / duration.
        role = Role(skeleton, style, individual, palm, duration + 0.2, 2.0 * duration + 0.8, 0.2)
        times = np.linspace(role.onset_s, role.contact_s, 60)
        root, angles = _upper_body(role, times)
        centre, _, _ = right_palm(skeleton, *skeleton.forward_kinematics(root, skeleton.from_hinges(angles)))
        peak = np.linalg.norm(np.diff(centre, axis=0), axis=-1).max() / (times[1] - times[0])
        duration = float(np.clip(duration * peak / peak_speed, 0.25, 4.0))
    return duration


def hanging_arm(style: EmotionStyle) -> Array:
    """Hinge angles (9,), rad, of a right arm that hangs straight down whatever the trunk does, clear of the thigh."""
    degrees = [2.0 - style.trunk_lean, -9.0 - 0.3 * style.left_arm_out, 0, -style.rest_elbow, 0, 15, 0, 0, 0]
    return np.radians(degrees)


def with_arm(role: Role, body: BodyMotion, arm: Callable[[Array], Array]) -> ActorMotion:
    """The whole motion of an actor whose right arm moves as ``arm`` says: times (T,), s, to angles (T, 9), rad."""
    times = np.arange(round(role.end_s * RATE_HZ) + 1) / RATE_HZ
    angles = body.without_arm(times)
    angles[:, body.arm] = arm(times).reshape(-1, 3, 3)
    return _standing(role.skeleton, body.root(times), angles)


def _upper_body(role: Role, times: Array) -> tuple[Array, Array]:
    """Pelvis (T, 3) m and hinge angles (T, 53, 3) rad with the legs still straight."""
    body = BodyMotion(role)
    angles = body.without_arm(times)
    angles[:, body.arm] = _arm_motion(role, body)(times).reshape(-1, 3, 3)
    return body.root(times), angles


def perform(role: Role) -> ActorMotion:
    """The whole motion of one actor."""
    body = BodyMotion(role)
    return with_arm(role, body, _arm_motion(role, body))


def _standing(skeleton: Skeleton, root: Array, angles: Array) -> ActorMotion:
    """The motion with legs that stand: pelvis (T, 3), m, and hinge angles (T, 53, 3), rad, with the legs straight."""
    pelvis = (root, rotations.from_euler(skeleton.hinge_orders[0], angles[:, 0]))
    for side in ("right", "left"):
        leg = [skeleton.index(f"{side}_{n}") for n in ("hip", "knee", "ankle")]
        angles[:, leg] = solve_leg(skeleton, side, pelvis, _standing_ankle(skeleton, side))
    return ActorMotion(skeleton, root, skeleton.from_hinges(skeleton.clamp(angles)))


def _standing_ankle(skeleton: Skeleton, side: str) -> Array:
    """Where the ankle of ``side`` stands, (3,) m: the left foot a little in front."""
    ankle = sum(skeleton.offsets[skeleton.index(n)] for n in ("pelvis", f"{side}_hip", f"{side}_knee", f"{side}_ankle"))
    return ankle + (np.array([0.06, 0.02, 0.0]) if side == "left" else np.array([-0.04, -0.02, 0.0]))


def _arm_motion(role: Role, body: BodyMotion) -> Callable[[Array], Array]:
    """Hinge angles of shoulder, elbow and wrist (T, 9), rad, as a function of times (T,)."""
    style, palm, wobble = role.style, role.palm, role.individual.wobble

    def solve(time: float, offset: Array) -> Array:
        position = palm.position + offset
        clavicle = body.clavicle(time)
        return solve_arm(role.skeleton, clavicle, position, palm.normal, palm.fingers, palm.elbow_out).ravel()

    def velocity(time: float, speed: Array) -> Array:
        step = 1e-3
        return (solve(time + step, speed * step) - solve(time - step, -speed * step)) / (2.0 * step)

    first, last = hanging_arm(style) + role.individual.rest_arm
    start, contact, bounce = role.onset_s, role.contact_s, 0.05
    strike = style.contact_speed * palm.normal
    coming, going = velocity(contact, strike), velocity(contact + bounce, -strike)
    # Drawn back early for a strike, late for a plain reach, whose hand then follows one minimum-jerk curve.
    wind_up_s = start + (0.80 - 2.0 * style.wind_up) * (contact - start)
    # Both swing wide of the face.
    back = -(style.wind_up + 0.06) * palm.normal + [0.0, -0.05, -0.07] + wobble
    middle = make_interp_spline(
        [start, wind_up_s, contact],
        [first, solve(wind_up_s, back), solve(contact, np.zeros(3))],
        k=5,
        bc_type=([(1, np.zeros(9)), (2, np.zeros(9))], [(1, coming), (2, np.zeros(9))]),
    )
    follow_s = contact + bounce + 0.25 * (role.end_s - 0.25 - contact - bounce)
    follow = style.follow_through * np.array([-0.3, -1.0, -1.2]) - 0.10 * palm.normal + wobble
    after = make_interp_spline(
        [contact + bounce, follow_s, role.end_s - 0.2],
        [solve(contact + bounce, np.zeros(3)), solve(follow_s, follow), last],
        k=5,
        bc_type=(
            [(1, going), (2, np.zeros(9))],
            [(1, np.zeros(9)), (2, np.zeros(9))],
        ),
    )
    touch = BPoly.from_derivatives(
        [contact, contact + bounce],
        [
            [middle(contact), coming, np.zeros(9)],
            [after(contact + bounce), going, np.zeros(9)],
        ],
    )

    def angles(times: Array) -> Array:
        t = times[:, None]
        moving = np.where(
            t < contact,
            middle(np.clip(times, start, contact)),
            after(np.clip(times, contact + bounce, role.end_s - 0.2)),
        )
        return np.where(
            (t >= contact) & (t < contact + bounce), touch(np.clip(times, contact, contact + bounce)), moving
        )

    return angles
