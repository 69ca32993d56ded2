"""Rotations as unit quaternions (w, x, y, z), rotation vectors and matrices, batched over leading axes.

Conventions: right-handed, active rotations; ``multiply(a, b)`` rotates by ``b`` first. Angles are in radians. The
functions are written for the last axis and broadcast over all others.

Sources: Solà, "Quaternion kinematics for the error-state Kalman filter" (2017), eq. 101–105 (exp, log), 115 (matrix);
Shepperd 1978 for the matrix-to-quaternion branches.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

IDENTITY: Array = np.array([1.0, 0.0, 0.0, 0.0])
_AXIS = {"x": 0, "y": 1, "z": 2}


def normalize(quaternion: ArrayLike) -> Array:
    """Unit quaternion (..., 4) with a non-negative scalar part."""
    q: Array = np.asarray(quaternion, dtype=float)
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.where(q[..., :1] < 0.0, -q, q)


def multiply(a: ArrayLike, b: ArrayLike) -> Array:
    """Hamilton product (..., 4): rotate by ``b``, then by ``a``."""
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    aw, ax, ay, az = a[..., 0], a[..., 1], a[..., 2], a[..., 3]
    bw, bx, by, bz = b[..., 0], b[..., 1], b[..., 2], b[..., 3]
    return _last_axis(
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def conjugate(quaternion: ArrayLike) -> Array:
    """Inverse of a unit quaternion (..., 4)."""
    return np.asarray(quaternion, dtype=float) * np.array([1.0, -1.0, -1.0, -1.0])


def rotate(quaternion: ArrayLike, vector: ArrayLike) -> Array:
    """Vectors (..., 3) rotated by unit quaternions (..., 4)."""
    q, v = np.asarray(quaternion, dtype=float), np.asarray(vector, dtype=float)
    w, axis = q[..., :1], q[..., 1:]
    u = 2.0 * cross(axis, v)
    return v + w * u + cross(axis, u)


def cross(a: Array, b: Array) -> Array:
    """Cross product of vectors (..., 3); several times quicker than ``numpy.cross`` on small arrays."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return _last_axis(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)


def _last_axis(*parts: Array) -> Array:
    """Arrays (...) of one shape beside each other (..., n): ``numpy.stack``, several times quicker on small ones."""
    whole = np.empty((*parts[0].shape, len(parts)))
    for i, part in enumerate(parts):
        whole[..., i] = part
    return whole


def from_rotation_vector(rotation_vector: ArrayLike) -> Array:
    """Exponential map: rotation vectors (..., 3) in rad to unit quaternions (..., 4)."""
    v = np.asarray(rotation_vector, dtype=float)
    half = 0.5 * np.linalg.norm(v, axis=-1, keepdims=True)
    return np.concatenate([np.cos(half), 0.5 * v * np.sinc(half / np.pi)], axis=-1)


def to_rotation_vector(quaternion: ArrayLike) -> Array:
    """Logarithm: unit quaternions (..., 4) to rotation vectors (..., 3) of norm at most pi, in rad."""
    q = np.asarray(quaternion, dtype=float)
    q = np.where(q[..., :1] < 0.0, -q, q)
    sin_half = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sin_half, q[..., :1])
    # The series of angle / sin(angle / 2) at 0, for the places where the quotient would be 0 / 0.
    scale = np.where(sin_half > 1e-9, angle / np.maximum(sin_half, 1e-300), 2.0)
    return q[..., 1:] * scale


def to_matrix(quaternion: ArrayLike) -> Array:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    q = np.asarray(quaternion, dtype=float)
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return _last_axis(*(part for row in rows for part in row)).reshape(*w.shape, 3, 3)


def from_matrix(matrix: ArrayLike) -> Array:
    """Unit quaternions (..., 4) of rotation matrices (..., 3, 3), from the largest of the components (Shepperd)."""
    m = np.asarray(matrix, dtype=float)
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    squares = _last_axis(1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz)
    a, b, c = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    d, e, f = m[..., 0, 1] + m[..., 1, 0], m[..., 0, 2] + m[..., 2, 0], m[..., 1, 2] + m[..., 2, 1]
    ww, xx, yy, zz = squares[..., 0], squares[..., 1], squares[..., 2], squares[..., 3]
    candidates = _last_axis(ww, a, b, c, a, xx, d, e, b, d, yy, f, c, e, f, zz).reshape(*ww.shape, 4, 4)
    best = np.argmax(squares, axis=-1)
    return normalize(np.take_along_axis(candidates, best[..., None, None], axis=-2)[..., 0, :])


def nearest_rotation(matrix: ArrayLike) -> Array:
    """Rotation matrices (..., 3, 3) nearest to matrices (..., 3, 3) of any unit, in least squares.

    R = U diag(1, 1, det UVᵀ) Vᵀ of U S Vᵀ (Kabsch 1976). Of Σ b aᵀ it turns points a nearest to points b, both about
    their middles.
    """
    u, _, vt = np.linalg.svd(np.asarray(matrix, dtype=float))
    u[..., 2] *= np.sign(np.linalg.det(u @ vt))[..., None]
    return u @ vt


def from_axis_angle(axis: str, angle: ArrayLike) -> Array:
    """Quaternions (..., 4) of a rotation by ``angle`` (rad) about the coordinate axis ``'x'``, ``'y'`` or ``'z'``."""
    angle = np.asarray(angle, dtype=float)
    q = np.zeros((*angle.shape, 4))
    q[..., 0], q[..., 1 + _AXIS[axis]] = np.cos(0.5 * angle), np.sin(0.5 * angle)
    return q


def from_euler(order: str, angles: ArrayLike) -> Array:
    """Quaternions (..., 4) of Euler angles (..., 3), rad, intrinsic.

    ``order``, such as ``'yxz'``, names the axes from parent to child.
    """
    angles = np.asarray(angles, dtype=float)
    first, second, third = (from_axis_angle(axis, angles[..., i]) for i, axis in enumerate(order))
    return multiply(multiply(first, second), third)


def to_euler(order: str, quaternion: ArrayLike) -> Array:
    """Euler angles (..., 3), rad, intrinsic, of three different axes (Tait–Bryan); the second lies in [-pi/2, pi/2].

    Inverse of :func:`from_euler` away from the singularity at a second angle of ±pi/2.
    """
    i, j, k = (_AXIS[axis] for axis in order)
    sign = 1.0 if (i, j, k) in ((0, 1, 2), (1, 2, 0), (2, 0, 1)) else -1.0
    m = to_matrix(quaternion)
    second = np.arcsin(np.clip(sign * m[..., i, k], -1.0, 1.0))
    first = np.arctan2(-sign * m[..., j, k], m[..., k, k])
    third = np.arctan2(-sign * m[..., i, j], m[..., i, i])
    return _last_axis(first, second, third)


def slerp(a: ArrayLike, b: ArrayLike, fraction: ArrayLike) -> Array:
    """Shortest-arc interpolation (..., 4) from ``a`` (fraction 0) to ``b`` (fraction 1)."""
    step = to_rotation_vector(multiply(conjugate(a), b))
    return multiply(a, from_rotation_vector(np.asarray(fraction, dtype=float)[..., None] * step))


def rotation_between(a: ArrayLike, b: ArrayLike) -> Array:
    """Smallest rotation (..., 4) that turns unit vectors ``a`` (..., 3) into unit vectors ``b`` (..., 3)."""
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    cosine = np.sum(a * b, axis=-1, keepdims=True)
    q = np.concatenate([1.0 + cosine, cross(a, b)], axis=-1)
    opposite = cosine < -1.0 + 1e-9
    if opposite.any():  # no unique rotation: half a turn about any axis across ``a``
        across = cross(a, np.where(np.abs(a[..., :1]) < 0.6, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
        q = np.where(opposite, np.concatenate([np.zeros_like(cosine), across], axis=-1), q)
    return normalize(q)


def frame_from(forward: ArrayLike, up: ArrayLike) -> Array:
    """Quaternion (..., 4) of the frame whose x axis is ``forward`` and whose z axis is as near ``up`` as can be."""
    x = np.asarray(forward, dtype=float)
    x = x / np.linalg.norm(x, axis=-1, keepdims=True)
    y = cross(np.asarray(up, dtype=float), x)
    y = y / np.linalg.norm(y, axis=-1, keepdims=True)
    return from_matrix(np.stack([x, y, cross(x, y)], axis=-1))
