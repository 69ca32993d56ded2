"""A skeleton of ball-like joints: names, tree, bone offsets, limits and forward kinematics."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from highfive.model.geometry import rotations
from highfive.model.geometry.hinges import hinges_between, hinges_within
from highfive.model.geometry.names import index_of
from highfive.model.geometry.rotations import Array

Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Skeleton:
    """A tree of J joints of three rotation coordinates each; joint 0 is the root and parents come before children.

    In the zero pose all joint frames are parallel to the world.

    Attributes:
        names: J joint names.
        parents: index of each joint's parent, -1 for the root.
        offsets: (J, 3) m, a joint's centre relative to its parent's in the zero pose; the root's is its height above
            the floor.
        hinge_orders: for each joint the axes of its three hinges from parent to child, such as ``'yxz'``.
        hinge_limits: (J, 3, 2) rad, lower and upper limit in the order of the hinges.
        rest: (J, 4) quaternions of the pose to which the model's rotation vectors are relative.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: Array
    hinge_orders: tuple[str, ...]
    hinge_limits: Array
    rest: Array

    def __len__(self) -> int:
        """Number of joints, J."""
        return len(self.names)

    def index(self, name: str) -> int:
        """Index of the joint called ``name``."""
        return index_of(name, self.names, "the skeleton", "joint")

    @cached_property
    def hash(self) -> str:
        """Hex digest of names, tree, hinges, limits and rest pose; not of bone lengths: scaled bodies share a model."""
        digest = hashlib.sha256()
        digest.update(repr((self.names, self.parents, self.hinge_orders)).encode())
        digest.update(np.round(self.hinge_limits, 6).tobytes() + np.round(self.rest, 6).tobytes())
        return digest.hexdigest()[:16]

    def scaled(self, factors: float | Mapping[str, float]) -> Skeleton:
        """The same skeleton with the offset of each joint scaled, by one factor or by a factor a joint (default 1)."""
        if isinstance(factors, Mapping):
            scale = np.array([factors.get(name, 1.0) for name in self.names])[:, None]
        else:
            scale = np.full((len(self), 1), float(factors))
        return replace(self, offsets=self.offsets * scale)

    @cached_property
    def _levels(self) -> tuple[tuple[Indices, Indices], ...]:
        """Joints and their parents, depth by depth, so that kinematics is one batched product a level."""
        depth = [0] * len(self)
        for joint, parent in enumerate(self.parents):
            depth[joint] = 0 if parent < 0 else depth[parent] + 1
        levels: list[tuple[Indices, Indices]] = []
        for level in range(1, max(depth) + 1):
            joints = [j for j, d in enumerate(depth) if d == level]
            levels.append((np.array(joints), np.array([self.parents[j] for j in joints])))
        return tuple(levels)

    @cached_property
    def _hinges(self) -> tuple[Indices, Indices, Array, Array]:
        """Where in quaternions (J, 4) the components along each joint's hinges are, rows (J, 1) and columns (J, 3); the
        sign (J,) of the permutation that the hinges are of x, y, z; the middle (J, 3), rad, of their limits.
        """
        axes = np.array([["xyz".index(axis) for axis in order] for order in self.hinge_orders])
        sign = np.where((axes[:, 1] - axes[:, 0]) % 3 == 1, 1.0, -1.0)
        return np.arange(len(self))[:, None], axes + 1, sign, self.hinge_limits.mean(axis=-1)

    def to_hinges(self, quaternions: Array) -> Array:
        """Hinge angles (..., J, 3), rad, of joint rotations (..., J, 4).

        The same as :func:`highfive.model.geometry.rotations.to_euler` joint by joint, in one pass, but each angle in
        the turn nearest the middle of its limits: near ±pi rounding would decide.
        """
        joints, axes, sign, middle = self._hinges
        w = sign * quaternions[..., 0]
        v = quaternions[..., joints, axes]
        i, j, k = v[..., 0], v[..., 1], v[..., 2]
        angles = np.empty(v.shape)
        angles[..., 0] = np.arctan2(2.0 * (w * i - j * k) * sign, 1.0 - 2.0 * (i * i + j * j))
        angles[..., 1] = np.arcsin(np.clip(2.0 * (i * k + w * j) * sign, -1.0, 1.0))
        angles[..., 2] = np.arctan2(2.0 * (w * k - i * j) * sign, 1.0 - 2.0 * (j * j + k * k))
        return angles - 2.0 * np.pi * np.round((angles - middle) / (2.0 * np.pi))

    def from_hinges(self, angles: Array) -> Array:
        """Joint rotations (..., J, 4) of hinge angles (..., J, 3), rad: the product of three half-angle quaternions."""
        joints, axes, sign, _ = self._hinges
        cosine, sine = np.cos(0.5 * angles), np.sin(0.5 * angles)
        ci, cj, ck = cosine[..., 0], cosine[..., 1], cosine[..., 2]
        si, sj, sk = sine[..., 0], sine[..., 1], sine[..., 2]
        vector = np.stack(
            [
                si * cj * ck + sign * ci * sj * sk,
                ci * sj * ck - sign * si * cj * sk,
                ci * cj * sk + sign * si * sj * ck,
            ],
            axis=-1,
        )
        quaternions = np.empty((*angles.shape[:-1], 4))
        quaternions[..., 0] = ci * cj * ck - sign * si * sj * sk
        quaternions[..., joints, axes] = vector
        return quaternions

    def clamp(self, angles: Array) -> Array:
        """Hinge angles (..., J, 3) moved into the limits."""
        return np.clip(angles, self.hinge_limits[..., 0], self.hinge_limits[..., 1])

    def to_rotation_vectors(self, quaternions: Array) -> Array:
        """Joint rotations (..., J, 4) as rotation vectors (..., 3 J), rad, relative to the rest pose."""
        relative = rotations.multiply(rotations.conjugate(self.rest), quaternions)
        return rotations.to_rotation_vector(relative).reshape(*quaternions.shape[:-2], 3 * len(self))

    def from_rotation_vectors(self, vectors: Array) -> Array:
        """Inverse of :meth:`to_rotation_vectors`: (..., 3 J) to (..., J, 4)."""
        relative = rotations.from_rotation_vector(vectors.reshape(*vectors.shape[:-1], len(self), 3))
        return rotations.multiply(self.rest, relative)

    def hinges_within(self, vectors: Array) -> Array:
        """Hinge angles (J, 3), rad, inside the limits, of one pose's rotation vectors (3 J,): what
        :meth:`from_rotation_vectors`, :meth:`to_hinges` and :meth:`clamp` make of them.
        """
        _, axes, sign, middle = self._hinges
        turned = np.array(vectors, dtype=float).reshape(len(self), 3)
        return hinges_within(turned, self.rest, axes - 1, sign, middle, self.hinge_limits)

    def hinges_between(self, one: Array, other: Array, share: float) -> Array:
        """``share`` of the way from hinge angles (J, 3), rad, to others, or beyond, inside the limits."""
        return hinges_between(np.ascontiguousarray(one), np.ascontiguousarray(other), share, self.hinge_limits)

    def chain_to(self, name: str) -> tuple[list[int], Skeleton]:
        """The joints from the root to one of a name: their indices, and the skeleton that they make by themselves."""
        if name in self._chains:
            return self._chains[name]
        joint = self.index(name)
        chain: list[int] = []
        while joint >= 0:
            chain.insert(0, joint)
            joint = self.parents[joint]
        alone = Skeleton(
            tuple(self.names[j] for j in chain),
            tuple(range(-1, len(chain) - 1)),
            self.offsets[chain],
            tuple(self.hinge_orders[j] for j in chain),
            self.hinge_limits[chain],
            self.rest[chain],
        )
        self._chains[name] = chain, alone
        return chain, alone

    @cached_property
    def _chains(self) -> dict[str, tuple[list[int], Skeleton]]:
        """What :meth:`chain_to` was called with before: a chain works out its levels once."""
        return {}

    def forward_kinematics(self, root_in_world: Array, quaternions: Array) -> tuple[Array, Array]:
        """Positions (..., J, 3), m, and orientations (..., J, 4) of all joints in the world.

        Args:
            root_in_world: (..., 3) m, position of the root joint.
            quaternions: (..., J, 4) rotation of each joint relative to its parent; the root's is relative to the world.
        """
        positions = np.empty((*quaternions.shape[:-1], 3))
        orientations = np.empty_like(quaternions)
        positions[..., 0, :], orientations[..., 0, :] = root_in_world, quaternions[..., 0, :]
        for joints, parents in self._levels:
            orientations[..., joints, :] = rotations.multiply(
                orientations[..., parents, :], quaternions[..., joints, :]
            )
            bones = rotations.rotate(orientations[..., parents, :], self.offsets[joints])
            positions[..., joints, :] = positions[..., parents, :] + bones
        return positions, orientations


def skeleton_from_table(
    table: Sequence[tuple[str, str | None, tuple[float, float, float]]],
    hinges: Mapping[str, tuple[str, Sequence[tuple[float, float]]]],
    rest_degrees: Mapping[str, tuple[float, float, float]],
) -> Skeleton:
    """Builds a skeleton from joint centres in the zero pose (m), hinge orders and limits (degrees) and a rest pose."""
    names = tuple(name for name, _, _ in table)
    centres = np.array([centre for _, _, centre in table])
    parents = tuple(-1 if parent is None else names.index(parent) for _, parent, _ in table)
    offsets = np.array([c - (centres[p] if p >= 0 else 0.0) for c, p in zip(centres, parents, strict=True)])
    orders = tuple(hinges[name][0] for name in names)
    limits = np.radians([hinges[name][1] for name in names])
    rest = [rotations.from_euler(hinges[n][0], np.radians(rest_degrees.get(n, (0.0, 0.0, 0.0)))) for n in names]
    return Skeleton(names, parents, offsets, orders, limits, np.array(rest))
