"""A person's joint centres from landmarks in the pictures of one camera: a causal Kalman filter.

A picture shows rays, not points. How far along them a joint is comes from the lengths of bones, from what the two nets
make of depth, weakly, and from what arms do: elbow and hand are not behind the shoulder; without that rule the lengths
alone have a mirrored solution. What is wrong along the view is wrong for long, so each frame states a covariance that
is long along its ray. Extended Kalman filter, iterated: Jazwinski 1970, § 8.3.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.sources.camera_look import Look
from highfive.mocap_bridge.sources.camera_settings import (
    BONES,
    ELBOW,
    HEAD,
    HEAD_ABOVE,
    KNUCKLES,
    LEFT_SHOULDER,
    SHOULDER,
    SHOULDERS,
    WRIST,
    Camera,
    CameraSettings,
)
from highfive.model.geometry.rotations import Array

COUNT = 6
_SIZE = 3 * COUNT
_ROUNDS = 3
_NEAREST = 0.3  # m: nothing is nearer to the camera
_FIRST_ALONG, _FIRST_SPEED = 0.25, 1.0  # m and m/s, of a person who has just been found


class CameraState(NamedTuple):
    """Joints (6, 3), m, and speeds (6, 3), m/s, before the camera: mean (36,) and covariance (36, 36)."""

    mean: Array
    covariance: Array

    @property
    def points(self) -> Array:
        """(6, 3) m."""
        return self.mean[:_SIZE].reshape(COUNT, 3)


def first_camera_state(seen: Look, camera: Camera, settings: CameraSettings) -> CameraState | None:
    """Where a person is in the first picture; None where it does not show how far away she is."""
    if not np.isfinite(seen.distance) or not seen.seen[[SHOULDER, LEFT_SHOULDER]].all():
        return None
    depths = np.maximum(seen.distance + seen.depths, _NEAREST)
    mean = np.concatenate([camera.points(seen.pixels, depths).ravel(), np.zeros(_SIZE)])
    rays = np.concatenate([_along(camera, seen.pixels)] * 2)
    covariance = np.zeros((2 * _SIZE, 2 * _SIZE))
    for joint in range(COUNT):
        where, speed = slice(3 * joint, 3 * joint + 3), slice(_SIZE + 3 * joint, _SIZE + 3 * joint + 3)
        covariance[where, where] = 0.05**2 * np.eye(3) + _FIRST_ALONG**2 * np.outer(rays[joint], rays[joint])
        covariance[speed, speed] = _FIRST_SPEED**2 * np.eye(3)
    # All of a person is nearer or further at once.
    for one in range(COUNT):
        for other in range(COUNT):
            if one != other:
                covariance[3 * one : 3 * one + 3, 3 * other : 3 * other + 3] += (
                    0.9 * _FIRST_ALONG**2 * np.outer(rays[one], rays[other])
                )
    return CameraState(mean, covariance)


def predicted(state: CameraState, seconds: float, settings: CameraSettings) -> CameraState:
    """The state so much later: speeds wander (white acceleration)."""
    move = np.eye(2 * _SIZE)
    move[:_SIZE, _SIZE:] = seconds * np.eye(_SIZE)
    power = np.square(np.stack([settings.jerk, settings.jerk, settings.jerk_along], axis=1)).ravel()
    noise = np.zeros_like(move)
    noise[:_SIZE, :_SIZE] = np.diag(power * seconds**3 / 3.0)
    noise[:_SIZE, _SIZE:] = noise[_SIZE:, :_SIZE] = np.diag(power * seconds**2 / 2.0)
    noise[_SIZE:, _SIZE:] = np.diag(power * seconds)
    return CameraState(move @ state.mean, move @ state.covariance @ move.T + noise)


def corrected(state: CameraState, seen: Look, seconds: float, camera: Camera, settings: CameraSettings) -> CameraState:
    """The state after a picture that came ``seconds`` after the one before."""
    points = state.points.copy()
    mean, covariance = state
    for _ in range(_ROUNDS):
        misfit, jacobian, variance = _measured(points, seen, seconds, camera, settings)
        wide = np.zeros((len(misfit), 2 * _SIZE))
        wide[:, :_SIZE] = jacobian
        crossed = covariance @ wide.T
        total = wide @ crossed + np.diag(variance)
        # As if linearised about where the points are now, not about where they were expected.
        gap = misfit - jacobian @ (state.mean[:_SIZE] - points.ravel())
        mean = state.mean + crossed @ np.linalg.solve(total, gap)
        points = mean[:_SIZE].reshape(COUNT, 3).copy()
        points[:, 2] = np.maximum(points[:, 2], _NEAREST)
    after = covariance - crossed @ np.linalg.solve(total, crossed.T)
    mean = np.concatenate([points.ravel(), mean[_SIZE:]])
    return CameraState(mean, 0.5 * (after + after.T))


def _measured(
    points: Array, seen: Look, seconds: float, camera: Camera, settings: CameraSettings
) -> tuple[Array, Array, Array]:
    """Misfits (N,), their derivatives (N, 18) by the points, and variances (N,), at points (6, 3)."""
    rows: list[tuple[float, Array, float]] = []
    for joint in np.flatnonzero(seen.seen).tolist():
        rows += _ray(joint, points, seen, camera)
    wander = 1.0 + 2.0 * settings.steady_s / seconds
    for joint in (ELBOW, WRIST, KNUCKLES, SHOULDER, HEAD):
        if seen.seen[joint]:
            rows.append(_behind(joint, points, seen.depths[joint], settings.depth**2 * wander))
    if np.isfinite(seen.hand_distance):
        variance = (settings.hand_depth * seen.hand_distance) ** 2 * wander
        rows.append((seen.hand_distance - points[KNUCKLES, 2], _depth(KNUCKLES), variance))
    if np.isfinite(seen.distance):
        derivative = 0.5 * (_depth(SHOULDER) + _depth(LEFT_SHOULDER))
        variance = (settings.size_depth * seen.distance) ** 2 * (1.0 + 2.0 * settings.size_steady_s / seconds)
        rows.append((seen.distance - float(derivative @ points.ravel()), derivative, variance))
    for one, other, share in BONES:
        variance = settings.bone**2 * (1.0 + 2.0 * settings.bone_steady_s / seconds)
        rows.append(_length(one, other, points, share * settings.height, variance))
    variance = settings.girdle**2 * (1.0 + 2.0 * settings.girdle_steady_s / seconds)
    rows.append(_length(SHOULDER, LEFT_SHOULDER, points, SHOULDERS * settings.height, variance))
    rows.append(_head(points, HEAD_ABOVE * settings.height, variance))
    for joint in (ELBOW, WRIST):
        back = points[joint, 2] - points[SHOULDER, 2]
        if back > settings.front:
            rows.append((settings.front - back, _depth(joint) - _depth(SHOULDER), settings.front**2))
    misfits, derivatives, variances = zip(*rows, strict=True)
    return np.array(misfits), np.array(derivatives), np.array(variances)


def _ray(joint: int, points: Array, seen: Look, camera: Camera) -> list[tuple[float, Array, float]]:
    """Where a joint is in the picture, pixels."""
    x, y, z = points[joint]
    there = camera.pixels(points[joint])
    variance = (camera.focal * seen.across[joint] / z) ** 2
    rows = []
    for axis, value in enumerate((x, y)):
        derivative = np.zeros(_SIZE)
        derivative[3 * joint + axis] = camera.focal / z
        derivative[3 * joint + 2] = -camera.focal * value / z**2
        rows.append((float(seen.pixels[joint, axis] - there[axis]), derivative, variance))
    return rows


def _depth(joint: int) -> Array:
    derivative = np.zeros(_SIZE)
    derivative[3 * joint + 2] = 1.0
    return derivative


def _behind(joint: int, points: Array, depth: float, variance: float) -> tuple[float, Array, float]:
    """How far a joint is behind the shoulders' middle."""
    derivative = _depth(joint) - 0.5 * (_depth(SHOULDER) + _depth(LEFT_SHOULDER))
    return depth - float(derivative @ points.ravel()), derivative, variance


def _length(one: int, other: int, points: Array, length: float, variance: float) -> tuple[float, Array, float]:
    """How long a bone is."""
    arrow = points[other] - points[one]
    now = max(float(np.linalg.norm(arrow)), 1e-3)
    derivative = np.zeros(_SIZE)
    derivative[3 * other : 3 * other + 3] = arrow / now
    derivative[3 * one : 3 * one + 3] = -arrow / now
    return length - now, derivative, variance


def _head(points: Array, length: float, variance: float) -> tuple[float, Array, float]:
    """How far the head is from the shoulders' middle."""
    arrow = points[HEAD] - 0.5 * (points[SHOULDER] + points[LEFT_SHOULDER])
    now = max(float(np.linalg.norm(arrow)), 1e-3)
    derivative = np.zeros(_SIZE)
    derivative[3 * HEAD : 3 * HEAD + 3] = arrow / now
    for shoulder in (SHOULDER, LEFT_SHOULDER):
        derivative[3 * shoulder : 3 * shoulder + 3] = -0.5 * arrow / now
    return length - now, derivative, variance


def _along(camera: Camera, pixels: Array) -> Array:
    """(..., 3) unit vectors of the rays through pixels."""
    rays = camera.points(pixels, 1.0)
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def stated(state: CameraState, across: Array, settings: CameraSettings) -> Array:
    """(6, 3, 3) m², covariance that is said of each joint: short across its ray, long along it.

    Args:
        state: of the person.
        across: (6,) m, standard deviation across the view, of the last picture that showed each joint.
        settings: what is stated at least.
    """
    points = state.points
    rays = points / np.linalg.norm(points, axis=-1, keepdims=True)
    result = np.empty((COUNT, 3, 3))
    for joint, ray in enumerate(rays):
        block = state.covariance[3 * joint : 3 * joint + 3, 3 * joint : 3 * joint + 3]
        along = max(float(ray @ block @ ray) ** 0.5, settings.out_along)
        wide = np.sqrt(max(0.5 * float(np.trace(block) - ray @ block @ ray), 0.0))
        side = max(settings.out_across, float(across[joint]), wide)
        result[joint] = side**2 * np.eye(3) + (max(along, side) ** 2 - side**2) * np.outer(ray, ray)
    return result


def hidden(ages_s: Array, settings: CameraSettings) -> NDArray[np.bool_]:
    """(6,) which joints nobody has seen for too long."""
    return ages_s > settings.lost_s
