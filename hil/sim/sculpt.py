"""Smooth bodies from a few blobs: signed distances, their smooth union, a surface, and its weights on the bones.

A blob is a tapered capsule in the frame of a joint. The blobs of a part (a shirt, a hand) are put where the joints are
in a bind pose, joined by a smooth minimum, and turned into triangles; every vertex then follows the joints whose blobs
are near it. So shoulders, elbows and knuckles bend without gaps.

Sources: Quilez, "Smooth minimum" (quadratic polynomial); Gibson, "Constrained Elastic Surface Nets" (1998), the form
without relaxation, for the surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.geometry.skeleton import Skeleton
from highfive.scenes.appearance import Blob, Part

FAR = 10.0
BLOCK = 4
"""Grid points along the edge of a block."""
BONES = 4
"""Joints at most that a vertex moves with: more are not drawn in browsers and by game engines (glTF 2.0, 3.7.3.3)."""
SOFTNESS = 0.4
"""Distance over which a vertex passes from one joint to the next, as a fraction of the limb's radius."""


@dataclass(frozen=True)
class Surface:
    """A closed triangle surface in the bind pose.

    Attributes:
        vertices: (V, 3) m.
        faces: (F, 3) vertex indices, counter-clockwise from outside.
        weights: (V, J) weight of each joint on each vertex; rows sum to one.
    """

    vertices: Array
    faces: NDArray[np.int64]
    weights: Array


@dataclass(frozen=True)
class BindPose:
    """Positions (J, 3), m, and orientations (J, 4) of all joints while a part is sculpted."""

    skeleton: Skeleton
    positions: Array
    orientations: Array

    def local(self, points: Array, joint: str) -> Array:
        """Points (..., 3) of the world in the frame of ``joint``."""
        i = self.skeleton.index(joint)
        return (points - self.positions[i]) @ rotations.to_matrix(self.orientations[i])

    def world(self, point: Sequence[float], joint: str) -> Array:
        """A point (3,) of the frame of ``joint`` in the world."""
        i = self.skeleton.index(joint)
        return self.positions[i] + rotations.rotate(self.orientations[i], point)


def blob_distance(points: Array, blob: Blob) -> Array:
    """Signed distance (N,), m, of points in the blob's joint frame (a lower bound where the blob is squashed)."""
    squash = np.array(blob.squash)
    start, end = np.array(blob.start) / squash, np.array(blob.end) / squash
    offset, bone = points / squash - start, end - start
    length = float(bone @ bone)
    along = np.clip(offset @ bone / length, 0.0, 1.0) if length > 0.0 else np.zeros(len(points))
    across = offset - along[:, None] * bone
    radius = blob.radius[0] + along * (blob.radius[1] - blob.radius[0])
    return (np.sqrt(np.einsum("ij,ij->i", across, across)) - radius) * float(squash.min())


def _smooth_minimum(a: Array, b: Array, width: float) -> Array:
    overlap = np.maximum(width - np.abs(a - b), 0.0) / width
    return np.minimum(a, b) - 0.25 * width * overlap * overlap


def _join(total: Array, d: Array, blob: Blob) -> Array:
    """Distance to a part with one more blob added or carved away."""
    return -_smooth_minimum(-total, d, blob.blend) if blob.carve else _smooth_minimum(total, d, blob.blend)


def distance(points: Array, part: Part, pose: BindPose) -> Array:
    """Signed distance (N,), m, of points (N, 3) of the world to a part."""
    total = np.full(len(points), FAR)
    for blob in part.blobs:
        total = _join(total, blob_distance(pose.local(points, blob.joint), blob), blob)
    return _cut(total, points, part, pose)


def _onto_surface(vertices: Array, part: Part, pose: BindPose) -> Array:
    """One Newton step to the zero of the distance: a coarse grid then still gives a smooth surface."""
    d, small = distance(vertices, part, pose), 0.1 * part.step
    gradient = np.stack([(distance(vertices + small * e, part, pose) - d) / small for e in np.eye(3)], axis=-1)
    squared = np.maximum(np.sum(gradient**2, axis=-1), 0.05)
    move = np.clip(d / squared, -0.5 * part.step, 0.5 * part.step)
    return vertices - move[:, None] * gradient


def _cut(total: Array, points: Array, part: Part, pose: BindPose) -> Array:
    """Distance to a part, (...), m, at points (..., 3), once its cuts are made."""
    for cut in part.cuts:
        normal = np.array(cut.normal) / np.linalg.norm(cut.normal)
        beyond = (pose.local(points, cut.joint) - np.array(cut.point)) @ normal
        total = -_smooth_minimum(-total, -beyond, 0.5 * part.step)
    return total


def _bounds(part: Part, pose: BindPose) -> tuple[Array, Array]:
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for blob in part.blobs:
        if not blob.carve:
            margin = max(blob.radius) * max(blob.squash) + 0.3 * blob.blend + 2.0 * part.step
            for point in (blob.start, blob.end):
                centre = pose.world(point, blob.joint)
                low, high = np.minimum(low, centre - margin), np.maximum(high, centre + margin)
    return low, high


def _sample(part: Part, pose: BindPose) -> tuple[Array, Array]:
    """Distances on a grid (X, Y, Z) and its origin; blocks of the grid far from the surface hold only a coarse value.

    A distance changes by no more than a point moves, so what is known at the middle of a block says which blobs can
    matter inside it: a tenth of all evaluations.
    """
    low, high = _bounds(part, pose)
    edge = BLOCK * part.step
    shape = np.ceil((high - low) / edge).astype(int) + 1
    middles = low + (np.indices(tuple(shape)).reshape(3, -1).T + 0.5) * edge
    to_blob = [blob_distance(pose.local(middles, blob.joint), blob) for blob in part.blobs]
    rough = np.full(len(middles), FAR)
    for blob, d in zip(part.blobs, to_blob, strict=True):
        rough = _join(rough, d, blob)
    rough_cut = _cut(rough, middles, part, pose)
    half_diagonal = 0.5 * np.sqrt(3.0) * edge
    near = np.flatnonzero(np.abs(rough_cut) < half_diagonal + part.step)
    inside_block = (np.indices((BLOCK,) * 3).reshape(3, -1).T + 0.5) * part.step - 0.5 * edge
    points = middles[near, None] + inside_block
    fine = np.full(points.shape[:2], FAR)
    for blob, d in zip(part.blobs, to_blob, strict=True):
        matters = d[near] < np.abs(rough[near]) + blob.blend + 2.0 * half_diagonal
        d_fine = blob_distance(pose.local(points[matters].reshape(-1, 3), blob.joint), blob).reshape(-1, BLOCK**3)
        fine[matters] = _join(fine[matters], d_fine, blob)
    blocks = np.repeat(rough_cut[:, None], BLOCK**3, axis=1)
    blocks[near] = _cut(fine, points, part, pose)
    grid = blocks.reshape(*shape, BLOCK, BLOCK, BLOCK).transpose(0, 3, 1, 4, 2, 5).reshape(BLOCK * shape)
    return grid, low + 0.5 * part.step


_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
_EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if np.abs(_CORNERS[a] - _CORNERS[b]).sum() == 1]


def surface_nets(grid: Array, origin: Array, step: float) -> tuple[Array, NDArray[np.int64]]:
    """Zero surface of a signed distance on a grid: vertices (V, 3), m, and faces (F, 3), as in :class:`Surface`."""
    inside = grid < 0.0
    shifted = [inside[x : x - 1 or None, y : y - 1 or None, z : z - 1 or None] for x, y, z in _CORNERS]
    count = np.sum(shifted, axis=0)
    cells = np.argwhere((count > 0) & (count < 8))
    values = np.stack([grid[tuple((cells + corner).T)] for corner in _CORNERS], axis=-1)
    total, crossings = np.zeros((len(cells), 3)), np.zeros(len(cells))
    for a, b in _EDGES:
        crosses = (values[:, a] < 0.0) != (values[:, b] < 0.0)
        fraction = values[:, a] / np.where(crosses, values[:, a] - values[:, b], 1.0)
        total += np.where(crosses[:, None], _CORNERS[a] + fraction[:, None] * (_CORNERS[b] - _CORNERS[a]), 0.0)
        crossings += crosses
    vertices = origin + (cells + total / crossings[:, None]) * step
    number = np.full(count.shape, -1)
    number[tuple(cells.T)] = np.arange(len(cells))
    return vertices, _faces(inside, number)


def _faces(inside: NDArray[np.bool_], number: NDArray[np.int64]) -> NDArray[np.int64]:
    """Two triangles for each grid edge that crosses the surface, between the four cells round that edge."""
    faces = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        ahead = np.take(inside, range(1, inside.shape[axis]), axis)
        here = np.take(inside, range(inside.shape[axis] - 1), axis)
        edges = np.argwhere(here != ahead)
        edges = edges[(edges[:, u] > 0) & (edges[:, v] > 0)]
        leaving = here[tuple(edges.T)]
        step_u, step_v = np.eye(3, dtype=int)[u], np.eye(3, dtype=int)[v]
        ring = [number[tuple((edges - s).T)] for s in (step_u + step_v, step_v, np.zeros(3, int), step_u)]
        a, b, c, d = (np.where(leaving, ring[i], ring[(4 - i) % 4]) for i in range(4))
        faces += [np.stack([a, b, c], -1), np.stack([a, c, d], -1)]
    return np.concatenate(faces)


def _weights(vertices: Array, faces: NDArray[np.int64], part: Part, pose: BindPose) -> Array:
    """Weights (V, J) that fall off with the distance to each joint's blobs, as softly as the limb is thick.

    Only joints within two steps of the nearest one in the tree take part, so that a finger does not move its neighbour,
    and of these the :data:`BONES` nearest, as programs that draw skins have it.
    """
    skeleton = pose.skeleton
    distances = np.full((len(vertices), len(skeleton)), FAR)
    thickness = np.ones(len(skeleton))
    for blob in part.blobs:
        if not blob.carve:
            joint = skeleton.index(blob.joint)
            d = blob_distance(pose.local(vertices, blob.joint), blob)
            distances[:, joint] = np.minimum(distances[:, joint], d)
            thickness[joint] = min(blob.radius[1], thickness[joint])
    nearest = distances.argmin(axis=1)
    fall_off = SOFTNESS * thickness[nearest, None]
    weights = np.exp(-(distances - distances.min(axis=1, keepdims=True)) / fall_off)
    weights *= _within_two_steps(skeleton)[nearest]
    weights = _smoothed(weights / weights.sum(axis=1, keepdims=True), faces)
    fifth = np.partition(weights, -BONES - 1, axis=1)[:, -BONES - 1 : -BONES]
    weights = np.maximum(weights - fifth, 0.0)  # cut off alone it would leave a crease where another becomes the fifth
    weights[weights < 0.02 * weights.sum(axis=1, keepdims=True)] = 0.0
    return weights / weights.sum(axis=1, keepdims=True)


def _within_two_steps(skeleton: Skeleton) -> NDArray[np.bool_]:
    step = np.eye(len(skeleton), dtype=int)
    for joint, parent in enumerate(skeleton.parents):
        if parent >= 0:
            step[joint, parent] = step[parent, joint] = 1
    return step @ step > 0


def _smoothed(weights: Array, faces: NDArray[np.int64], passes: int = 4) -> Array:
    """Weights averaged over neighbouring vertices, so that no crease shows where another joint becomes the nearest."""
    rows = np.concatenate([faces[:, i] for i in (0, 1, 2)])
    columns = np.concatenate([faces[:, i] for i in (1, 2, 0)])
    neighbours = sparse.coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(len(weights),) * 2).tocsr()
    mean = sparse.diags(1.0 / np.maximum(np.asarray(neighbours.sum(axis=1)).ravel(), 1.0)) @ neighbours
    for _ in range(passes):
        weights = 0.5 * (weights + mean @ weights)
    return weights


def sculpt(part: Part, pose: BindPose) -> Surface:
    """The surface of a part in the bind pose."""
    grid, origin = _sample(part, pose)
    vertices, faces = surface_nets(grid, origin, part.step)
    vertices = _onto_surface(vertices, part, pose)
    return Surface(vertices, faces, _weights(vertices, faces, part, pose))
