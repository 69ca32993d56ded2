"""Keeps the avatar's right hand and forearm off the rest of its body.

The signed distance of a point from a convex body is a convex function of the point, so along a segment it has one
minimum, where it does not change along the segment. Capsules are segments with a radius; the palm, a flat ellipsoid, is
covered by three of them. Points outside and inside of an ellipsoid: Eberly 2013, "Distance from a point to an ellipse,
an ellipsoid, or a hyperellipsoid", its secular equation solved as by Moré & Sorensen 1983: from one side, so that the
steps need no bounds.

Each pair of shapes adds to the correction's cost

    strength · stiffness · softness · exp(-d / softness)

of their distance d, below 0 its Taylor polynomial of second degree. However strong what pulls them together, they stop
within a few times that softness, at a distance that grows with the logarithm of how weak it is: hand and body where the
palm's target lies in the body, or an elbow and the trunk where only the posture asks for it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from highfive.hil.sim.scene import Indices, Scene, own_pairs
from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, named_tuple, setting

PALM_RODS = ((-0.024, 0.022), (0.0, 0.036), (0.024, 0.022))
"""The palm's capsules: where across the hand and half the length along it, m; as thick as the hand."""
_CAPSULE, _ELLIPSOID = 0, 1

_Growing = tuple[float, float, float, float]
"""A signed distance, m, and the unit vector (x, y, z) in which it grows."""


@dataclass(frozen=True)
class OwnBodySettings(Settings):
    """How hand and forearm are kept off the own body. Set by hand.

    The defaults are compiled in: passed at run time, the compiler may order the sums otherwise, and poses differ in
    their last bits; to try another value, change its default.
    """

    softness: float = setting(0.005, "m", above=0.0)
    """Over which the force grows e-fold, ..."""
    stiffness: float = setting(0.1, "m", above=0.0)
    """... which is this at a distance of 0: as strong as the pull of a palm that is half of it off its target."""
    zone: float = setting(0.07, "m", above=0.0)
    """Beyond, the force is nothing."""


OwnBodySettingsValues = named_tuple(OwnBodySettings)
OWN_BODY = OwnBodySettings().compiled()
"""The defaults, as compiled code reads them."""


class _State(NamedTuple):
    """Views of MuJoCo's state: places (G, 3) and frames (G, 9) of all shapes, anchors and axes (J, 3) of all hinges."""

    places: Array
    frames: Array
    anchors: Array
    axes: Array


class _Shapes(NamedTuple):
    """What does not change: R rods of the arm, B shapes of the body, K joints.

    Attributes:
        rod_geoms: (R,) geom that a rod belongs to; the forearm's is the last.
        rods: (R, 7) start, end and radius, m, in the frame of that geom.
        geoms, kinds, sizes: (B,), (B,) and (B, 3) m of the shapes.
        joints: (K,) of the hinges that the correction moves.
        moves_rod, moves_shape: (R, K) and (B, K), 1 where a hinge moves it, else 0.
    """

    rod_geoms: Indices
    rods: Array
    geoms: Indices
    kinds: Indices
    sizes: Array
    joints: Indices
    moves_rod: Array
    moves_shape: Array


class OwnBody:
    """The pairs of shapes that must not touch: those that the scene calls unwanted contacts of the own body."""

    def __init__(self, scene: Scene, data: mujoco.MjData) -> None:
        """Reads the shapes from ``scene`` and compiles; ``data``, of the same scene, is what is looked at later."""
        model, pairs = scene.model, own_pairs(scene.skeleton)
        rods = [(name, rod) for name in dict.fromkeys(first for first, _ in pairs) for rod in _rods(model, name)]
        bodies = [model.geom(name) for name in dict.fromkeys(second for _, second in pairs)]
        self.rods = [name for name, _ in rods]
        self.shapes = [geom.name for geom in bodies]
        self._count = len(rods), len(bodies), len(scene.arm_dofs)
        rod_geoms, shape_geoms = np.array([model.geom(n).id for n in self.rods]), np.array([g.id for g in bodies])
        ellipsoid = np.array([geom.type[0] == mujoco.mjtGeom.mjGEOM_ELLIPSOID for geom in bodies])
        turning = model.dof_bodyid[scene.arm_dofs]
        self._state = _State(data.geom_xpos, data.geom_xmat, data.xanchor, data.xaxis)
        self._shapes = _Shapes(
            rod_geoms,
            np.array([rod for _, rod in rods]),
            shape_geoms,
            np.where(ellipsoid, _ELLIPSOID, _CAPSULE),
            np.array([geom.size for geom in bodies]),
            model.dof_jntid[scene.arm_dofs].astype(np.int64),
            _moves(model, turning, rod_geoms),
            _moves(model, turning, shape_geoms),
        )
        mujoco.mj_kinematics(model, data)
        self.keep_off(1.0, np.zeros(self._count[2]), np.zeros((self._count[2], self._count[2])))

    def distances(self) -> tuple[Array, Array]:
        """Distances (R, B) m of ``rods`` from ``shapes``, and their gradients (R, B, 18) m/rad by the arm's hinges.

        Negative where they overlap. The data need their kinematics.
        """
        distances, gradients = np.empty(self._count[:2]), np.zeros(self._count)
        _distances(self._state, self._shapes, distances, gradients)
        return distances, gradients

    def keep_off(self, strength: float, gradient: Array, hessian: Array) -> float:
        """The pairs' cost; adds half its gradient to ``gradient`` (18,) and half its second derivatives, those of the
        distances left out, to ``hessian`` (18, 18). The data need their kinematics."""
        return _keep_off(self._state, self._shapes, strength, gradient, hessian)


def _rods(model: mujoco.MjModel, name: str) -> list[Array]:
    """Capsules (7,) that a contact shape of the arm consists of: start and end in the geom's frame and radius, m."""
    size = model.geom(name).size
    if model.geom(name).type[0] == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return [np.array([0.0, 0.0, -size[1], 0.0, 0.0, size[1], size[0]])]
    return [np.array([across, 0.0, -half, across, 0.0, half, size[1]]) for across, half in PALM_RODS]


def _moves(model: mujoco.MjModel, turning: NDArray[np.int32], geoms: Indices) -> Array:
    """(G, 18): 1 where a hinge of a body in ``turning`` (18,) moves a geom."""
    result = np.zeros((len(geoms), len(turning)))
    for i, geom in enumerate(geoms):
        body = int(model.geom_bodyid[geom])
        while body:
            result[i, turning == body] = 1.0
            body = int(model.body_parentid[body])
    return result


@compiled
def _from_ellipsoid(x: float, y: float, z: float, a: float, b: float, c: float) -> _Growing:
    """Signed distance of a point from an ellipsoid at the origin, and the unit normal at its nearest point."""
    u, v, w = a * max(abs(x), 1e-9), b * max(abs(y), 1e-9), c * max(abs(z), 1e-9)
    aa, bb, cc = a * a, b * b, c * c
    shift = max(u - aa, v - bb, w - cc)
    for _ in range(40):
        i, j, k = 1.0 / (shift + aa), 1.0 / (shift + bb), 1.0 / (shift + cc)
        p, q, r = (u * i) ** 2, (v * j) ** 2, (w * k) ** 2
        square = p + q + r
        length = math.sqrt(square)
        if length - 1.0 < 1e-10:
            break
        shift += (length - 1.0) * square / (p * i + q * j + r * k)
    i, j, k = 1.0 / (shift + aa), 1.0 / (shift + bb), 1.0 / (shift + cc)
    # The nearest point is (a u i, b v j, c w k); the normal there (u i / a, v j / b, w k / c), with the point's signs.
    nx, ny, nz = math.copysign(u * i / a, x), math.copysign(v * j / b, y), math.copysign(w * k / c, z)
    scale = math.sqrt(nx * nx + ny * ny + nz * nz)
    return shift * scale, nx / scale, ny / scale, nz / scale


@compiled
def _from_segment(x: float, y: float, z: float, half: float) -> _Growing:
    """Distance of a point from the segment of z within ±half, and the unit vector from there."""
    z -= min(max(z, -half), half)
    length = max(math.sqrt(x * x + y * y + z * z), 1e-12)
    return length, x / length, y / length, z / length


@compiled
def _from_shape(kind: int, size: Array, x: float, y: float, z: float) -> _Growing:
    """Signed distance of a point, in the shape's frame, from its surface, and the direction in which it grows."""
    if kind == _ELLIPSOID:
        return _from_ellipsoid(x, y, z, size[0], size[1], size[2])
    length, nx, ny, nz = _from_segment(x, y, z, size[1])
    return length - size[0], nx, ny, nz


@compiled
def _local(frame: Array, vector: Array, x: float, y: float, z: float) -> None:
    """Writes a vector of the world into ``vector``, as seen in a frame (9,)."""
    vector[0] = frame[0] * x + frame[3] * y + frame[6] * z
    vector[1] = frame[1] * x + frame[4] * y + frame[7] * z
    vector[2] = frame[2] * x + frame[5] * y + frame[8] * z


@compiled
def _world(frame: Array, vector: Array, x: float, y: float, z: float) -> None:
    """Writes a vector in a frame (9,) into ``vector``, as the world sees it."""
    vector[0] = frame[0] * x + frame[1] * y + frame[2] * z
    vector[1] = frame[3] * x + frame[4] * y + frame[5] * z
    vector[2] = frame[6] * x + frame[7] * y + frame[8] * z


@compiled
def _place(rod: Array, place: Array, frame: Array, work: Array) -> None:
    """Writes a rod's start and the way along it, m in the world, into rows 0 and 1 of ``work`` (6, 3)."""
    _world(frame, work[0], rod[0], rod[1], rod[2])
    _world(frame, work[1], rod[3] - rod[0], rod[4] - rod[1], rod[5] - rod[2])
    for k in range(3):
        work[0, k] += place[k]


@compiled
def _nearest(radius: float, kind: int, size: Array, at: Array, frame: Array, enough: float, work: Array) -> float:
    """Signed distance, m, of the rod in rows 0 and 1 of ``work`` from a shape, infinite where it is beyond ``enough``.

    Writes the nearest point of the rod's axis into row 2 and the direction in which the distance grows into row 3, both
    in the world.
    """
    i, j, k = work[0, 0] - at[0], work[0, 1] - at[1], work[0, 2] - at[2]
    u, v, w = work[1]
    reach = 0.5 * math.sqrt(u * u + v * v + w * w)
    largest = max(size[0], size[1], size[2]) if kind == _ELLIPSOID else size[0] + size[1]
    far = enough + reach + radius
    if (i + 0.5 * u) ** 2 + (j + 0.5 * v) ** 2 + (k + 0.5 * w) ** 2 > (largest + far) ** 2:
        return np.inf
    _local(frame, work[2], i, j, k)
    _local(frame, work[3], u, v, w)
    x, y, z = work[2]
    u, v, w = work[3]
    if _from_shape(kind, size, x + 0.5 * u, y + 0.5 * v, z + 0.5 * w)[0] > far:
        return np.inf
    low, high, t = 0.0, 1.0, 0.0
    distance, nx, ny, nz = _from_shape(kind, size, x, y, z)
    slope_low = nx * u + ny * v + nz * w
    if slope_low < 0.0:
        t = 1.0
        distance, nx, ny, nz = _from_shape(kind, size, x + u, y + v, z + w)
        slope_high = nx * u + ny * v + nz * w
        if slope_high > 0.0:  # regula falsi; a side that stays for a second time counts half (Illinois)
            side = 0
            for _ in range(30):
                t = (low * slope_high - high * slope_low) / (slope_high - slope_low)
                distance, nx, ny, nz = _from_shape(kind, size, x + t * u, y + t * v, z + t * w)
                slope = nx * u + ny * v + nz * w
                if abs(slope) < 1e-5 * reach or high - low < 1e-7:
                    break
                if slope > 0.0:
                    high, slope_high = t, slope
                    slope_low *= 0.5 if side == 1 else 1.0
                    side = 1
                else:
                    low, slope_low = t, slope
                    slope_high *= 0.5 if side == -1 else 1.0
                    side = -1
    for m in range(3):
        work[2, m] = work[0, m] + t * work[1, m]
    _world(frame, work[3], nx, ny, nz)
    return distance - radius


@compiled
def _growth(work: Array, anchor: Array, axis: Array) -> float:
    """How a distance grows as its rod turns about a hinge, m/rad."""
    x, y, z = work[2, 0] - anchor[0], work[2, 1] - anchor[1], work[2, 2] - anchor[2]
    return (
        work[3, 0] * (axis[1] * z - axis[2] * y)
        + work[3, 1] * (axis[2] * x - axis[0] * z)
        + work[3, 2] * (axis[0] * y - axis[1] * x)
    )


@compiled
def _gradient(state: _State, shapes: _Shapes, r: int, b: int, work: Array, row: Array) -> None:
    """Writes how the distance of a rod from a shape grows with the joints, m/rad, into ``row``."""
    for k in range(len(row)):
        # What turns both changes nothing: the rod's nearest point is taken as fixed to the one and the other.
        share, joint = shapes.moves_rod[r, k] - shapes.moves_shape[b, k], shapes.joints[k]
        row[k] = share * _growth(work, state.anchors[joint], state.axes[joint]) if share != 0.0 else 0.0


@compiled
def _distance(state: _State, shapes: _Shapes, r: int, b: int, enough: float, work: Array) -> float:
    """See :func:`_nearest`."""
    rod, geom = shapes.rod_geoms[r], shapes.geoms[b]
    _place(shapes.rods[r], state.places[rod], state.frames[rod], work)
    radius, place, frame = shapes.rods[r, 6], state.places[geom], state.frames[geom]
    return _nearest(radius, shapes.kinds[b], shapes.sizes[b], place, frame, enough, work)


@compiled
def _hand_radius(state: _State, shapes: _Shapes, hand: int, work: Array) -> float:
    """Radius, m, of a sphere about the first rod's geom that holds the first ``hand`` rods."""
    radius, centre = 0.0, state.places[shapes.rod_geoms[0]]
    for r in range(hand):
        rod = shapes.rod_geoms[r]
        _place(shapes.rods[r], state.places[rod], state.frames[rod], work)
        start = end = 0.0
        for k in range(3):
            start += (work[0, k] - centre[k]) ** 2
            end += (work[0, k] + work[1, k] - centre[k]) ** 2
        radius = max(radius, math.sqrt(max(start, end)) + shapes.rods[r, 6])
    return radius


@compiled_entry
def _distances(state: _State, shapes: _Shapes, distances: Array, gradients: Array) -> None:
    work = np.empty((4, 3))
    for r in range(len(shapes.rods)):
        for b in range(len(shapes.geoms)):
            distances[r, b] = _distance(state, shapes, r, b, np.inf, work)
            _gradient(state, shapes, r, b, work, gradients[r, b])


@compiled_entry
def _keep_off(state: _State, shapes: _Shapes, strength: float, gradient: Array, hessian: Array) -> float:
    work, row = np.empty((4, 3)), np.empty(len(shapes.joints))
    hand = len(shapes.rods) - 1
    radius, centre = _hand_radius(state, shapes, hand, work), state.places[shapes.rod_geoms[0]]
    cost = 0.0
    for b in range(len(shapes.geoms)):
        place, frame = state.places[shapes.geoms[b]], state.frames[shapes.geoms[b]]
        for k in range(3):
            work[0, k], work[1, k] = centre[k], 0.0
        away = _nearest(radius, shapes.kinds[b], shapes.sizes[b], place, frame, OWN_BODY.zone, work) >= OWN_BODY.zone
        for r in range(hand if away else 0, len(shapes.rods)):
            distance = _distance(state, shapes, r, b, OWN_BODY.zone, work)
            if distance >= OWN_BODY.zone:
                continue
            part = distance / OWN_BODY.softness
            if part > 0.0:
                value = slope = curve = math.exp(-part)
            else:
                value, slope, curve = 1.0 - part + 0.5 * part * part, 1.0 - part, 1.0
            cost += strength * OWN_BODY.stiffness * OWN_BODY.softness * value
            slope *= -0.5 * strength * OWN_BODY.stiffness
            curve *= 0.5 * strength * OWN_BODY.stiffness / OWN_BODY.softness
            _gradient(state, shapes, r, b, work, row)
            for k in range(len(row)):
                gradient[k] += slope * row[k]
                if row[k] != 0.0:
                    for m in range(len(row)):
                        hessian[k, m] += curve * row[k] * row[m]
    return cost
