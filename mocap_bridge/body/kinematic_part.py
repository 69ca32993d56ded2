"""A part of the skeleton as hinges, with the derivative of its markers by every hinge: what the body solver solves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.model.compiled import exactly_compiled_entry
from highfive.model.geometry.rotations import Array
from highfive.model.geometry.skeleton import Skeleton


@dataclass(frozen=True)
class Part:
    """n joints (a parent before its children) that hang from a base, and N markers on them; H = 3 n hinges.

    Attributes:
        joints: (n,) index of each joint in the skeleton.
        parents: (n,) index of each joint's parent within the part, -1 for the base.
        offsets: (n, 3) m, from parent to joint in the zero pose; zero for the joint that is the root of the skeleton.
        axes: (n, 3) coordinate axis of each hinge, in the order of the hinges.
        limits: (H, 2) rad; infinite for the root of the skeleton, whose turn has no limit.
        rest: (H,) rad.
        markers: (N,) index of each marker in its set.
        carriers: (N,) the joint of the part that carries it.
        local: (N, 3) m, in the frame of that joint.
        free: the base may move: its position is solved for too.
        pairs: (marker, hinge) of all hinges that move a marker.
    """

    joints: NDArray[np.intp]
    parents: tuple[int, ...]
    offsets: Array
    axes: NDArray[np.intp]
    limits: Array
    rest: Array
    markers: NDArray[np.intp]
    carriers: NDArray[np.intp]
    local: Array
    free: bool
    pairs: tuple[NDArray[np.intp], NDArray[np.intp]]

    @property
    def parameters(self) -> int:
        """Number of unknowns of one frame: hinges, then the base's position if it is free."""
        return 3 * len(self.joints) + (3 if self.free else 0)


@dataclass(frozen=True)
class Kinematics:
    """Where a part is in T frames.

    Attributes:
        positions: (T, n, 3) m, joint centres.
        rotations: (T, n, 3, 3), of the joints' frames.
        axes: (T, H, 3), unit vectors along the hinges.
        markers: (T, N, 3) m.
    """

    positions: Array
    rotations: Array
    axes: Array
    markers: Array


def make_part(skeleton: Skeleton, marker_set: MarkerSet, joints: Sequence[int]) -> Part:
    """The part of ``skeleton`` that consists of ``joints``, with the markers of the set that these carry."""
    position = {joint: i for i, joint in enumerate(joints)}
    parents = tuple(position.get(skeleton.parents[joint], -1) for joint in joints)
    carried = [skeleton.index(name) for name in marker_set.joints]
    markers = np.array([m for m, joint in enumerate(carried) if joint in position], dtype=np.intp)
    carriers = np.array([position[carried[m]] for m in markers], dtype=np.intp)
    free = 0 in position
    offsets, limits = skeleton.offsets[list(joints)].copy(), skeleton.hinge_limits[list(joints)].copy()
    if free:
        offsets[0], limits[0] = 0.0, [-np.inf, np.inf]
    pairs = [(n, hinge) for n, joint in enumerate(carriers) for hinge in _hinges_above(int(joint), parents)]
    pair_array = np.array(pairs, dtype=np.intp).reshape(-1, 2)
    return Part(
        joints=np.array(joints, dtype=np.intp),
        parents=parents,
        offsets=offsets,
        axes=np.array(
            [["xyz".index(axis) for axis in skeleton.hinge_orders[joint]] for joint in joints], dtype=np.intp
        ),
        limits=limits.reshape(-1, 2),
        rest=skeleton.to_hinges(skeleton.rest)[list(joints)].reshape(-1),
        markers=markers,
        carriers=carriers,
        local=marker_set.positions_on(skeleton)[markers],
        free=free,
        pairs=(pair_array[:, 0], pair_array[:, 1]),
    )


def _hinges_above(joint: int, parents: Sequence[int]) -> list[int]:
    hinges: list[int] = []
    while joint >= 0:
        hinges += [3 * joint, 3 * joint + 1, 3 * joint + 2]
        joint = parents[joint]
    return hinges


def forward(part: Part, angles: Array, base_position: Array, base_rotation: Array) -> Kinematics:
    """Kinematics of hinge angles (T, H), rad, on a base at (T, 3), m, turned by (T, 3, 3)."""
    frames, n = len(angles), len(part.joints)
    positions, turned = np.empty((frames, n, 3)), np.empty((frames, n, 3, 3))
    axes = np.empty((frames, 3 * n, 3))
    _turn(np.array(part.parents), part.axes, np.cos(angles), np.sin(angles), base_rotation, turned, axes)
    for joint, parent in enumerate(part.parents):
        rotation = base_rotation if parent < 0 else turned[:, parent]
        origin = base_position if parent < 0 else positions[:, parent]
        positions[:, joint] = origin + rotation @ part.offsets[joint]
    carriers = part.carriers
    markers = positions[:, carriers] + np.einsum("tnij,nj->tni", turned[:, carriers], part.local)
    return Kinematics(positions, turned, axes, markers)


def jacobian(part: Part, kinematics: Kinematics) -> Array:
    """Derivative (T, 3, N, P) of the marker positions by hinge angles and, if it is free, the base's position.

    A hinge with axis a through the joint's centre c moves a marker x at the rate a × (x − c).
    """
    out = np.zeros((len(kinematics.markers), 3, len(part.markers), part.parameters))
    _cross(*part.pairs, kinematics.positions, kinematics.axes, np.ascontiguousarray(kinematics.markers), out)
    if part.free:
        for i in range(3):
            out[:, i, :, part.parameters - 3 + i] = 1.0
    return out


# Rounded as NumPy does: what is solved, and the models that learn from it, are the same to the bit.


@exactly_compiled_entry
def _turn(
    parents: NDArray[np.intp],
    orders: NDArray[np.intp],
    cosine: Array,
    sine: Array,
    base: Array,
    turned: Array,
    axes: Array,
) -> None:
    """Fills in the joints' rotations (T, n, 3, 3) and the hinges' axes (T, H, 3)."""
    for t in range(len(turned)):
        for joint in range(len(parents)):
            own, parent = turned[t, joint], parents[joint]
            own[:] = base[t] if parent < 0 else turned[t, parent]
            for order in range(3):
                hinge, axis = 3 * joint + order, orders[joint, order]
                c, s = cosine[t, hinge], sine[t, hinge]
                # Turning about a coordinate axis mixes the two other columns: cheaper than a product of matrices.
                j, k = (axis + 1) % 3, (axis + 2) % 3
                for i in range(3):
                    axes[t, hinge, i] = own[i, axis]
                    at_j, at_k = own[i, j], own[i, k]
                    own[i, j] = c * at_j + s * at_k
                    own[i, k] = c * at_k - s * at_j


@exactly_compiled_entry
def _cross(
    marker: NDArray[np.intp], hinge: NDArray[np.intp], positions: Array, axes: Array, markers: Array, out: Array
) -> None:
    """Fills in the derivative (T, 3, N, P) of each marker by each hinge that moves it."""
    for t in range(len(markers)):
        for pair in range(len(marker)):
            m, h = marker[pair], hinge[pair]
            x = markers[t, m, 0] - positions[t, h // 3, 0]
            y = markers[t, m, 1] - positions[t, h // 3, 1]
            z = markers[t, m, 2] - positions[t, h // 3, 2]
            out[t, 0, m, h] = axes[t, h, 1] * z - axes[t, h, 2] * y
            out[t, 1, m, h] = axes[t, h, 2] * x - axes[t, h, 0] * z
            out[t, 2, m, h] = axes[t, h, 0] * y - axes[t, h, 1] * x
