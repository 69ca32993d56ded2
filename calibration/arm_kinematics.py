"""An arm that is not quite as its drawing says: where markers on its plate are, and how that goes with every error.

Errors of a joint, in the order in which they act: its place in the frame before it (length), the direction of its axis
(tilt), and its angle: θ = q + zero − compliance · τ + ½ play · side + ripple, where q is what the encoder says, τ the
torque that gravity asks of it, and side ± 1 from which side it was approached. Columns of the Jacobian: a joint turns a
point p by axis × (p − centre); a length moves it along the axes of the frame before; a tilt turns it about those.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from highfive.model.geometry.rotations import Array, from_rotation_vector, to_matrix

GRAVITY = 9.81
"""m/s²"""

KINDS = ("base_turn", "base_place", "zero", "compliance", "length", "tilt", "marker", "play", "ripple")
"""Groups of parameters, in their order."""

_SMALL = 1e-8


@dataclass(frozen=True)
class ArmShape:
    """An arm as drawn, with J joints and M markers on its plate.

    Attributes:
        names: (J,) of the joints.
        axes: (J, 3) unit vectors, each in its own frame.
        offsets: (J, 3) m, each joint's centre in the frame before it (the first: of the base).
        masses, centres: (J,) kg and (J, 3) m, of the links in their frames.
        markers: (M, 3) m, in the last joint's frame.
    """

    names: tuple[str, ...]
    axes: Array
    offsets: Array
    masses: Array
    centres: Array
    markers: Array


@dataclass(frozen=True)
class ArmErrors:
    """By what an arm differs from its drawing, and where its base stands; all zeros for the drawing.

    Attributes:
        rotation, translation: (3, 3) and (3,) m, from the base's frame to that of the motion capture.
        base_turn: (3,) rad, a rotation vector that turns the base further, after ``rotation``.
        base_place: (3,) m, added to ``translation``.
        zero: (J,) rad, added to the encoder's angle.
        compliance: (J,) rad/(N·m).
        length: (J, 3) m, added to the offsets.
        tilt: (J, 3) rad, rotation vectors in the frame before the joint.
        marker: (M, 3) m, added to the markers' places.
        play: (J,) rad, between the two sides of approach.
        ripple: (J, 2) rad, of the sine and cosine of the encoder's angle.
    """

    rotation: Array
    translation: Array
    base_turn: Array
    base_place: Array
    zero: Array
    compliance: Array
    length: Array
    tilt: Array
    marker: Array
    play: Array
    ripple: Array

    @property
    def base_axes(self) -> Array:
        """(3, 3), of the base in the motion capture's frame, in columns."""
        return to_matrix(from_rotation_vector(self.base_turn)) @ self.rotation

    @property
    def base(self) -> Array:
        """(3,) m, where the base stands in the motion capture's frame."""
        return self.translation + self.base_place

    def packed(self) -> Array:
        """(P,) all of :data:`KINDS`, one after the other."""
        return np.concatenate([getattr(self, kind).ravel() for kind in KINDS])

    def unpacked(self, values: Array) -> ArmErrors:
        """These with the values (P,) of :meth:`packed`."""
        found, at = {}, 0
        for kind in KINDS:
            own = getattr(self, kind)
            found[kind] = values[at : at + own.size].reshape(own.shape)
            at += own.size
        return ArmErrors(self.rotation, self.translation, **found)


def as_drawn(shape: ArmShape, rotation: Array | None = None, translation: Array | None = None) -> ArmErrors:
    """No errors, with the base there; without a place in the origin."""
    joints, markers = len(shape.axes), len(shape.markers)
    return ArmErrors(
        rotation=np.eye(3) if rotation is None else rotation,
        translation=np.zeros(3) if translation is None else translation,
        base_turn=np.zeros(3),
        base_place=np.zeros(3),
        zero=np.zeros(joints),
        compliance=np.zeros(joints),
        length=np.zeros((joints, 3)),
        tilt=np.zeros((joints, 3)),
        marker=np.zeros((markers, 3)),
        play=np.zeros(joints),
        ripple=np.zeros((joints, 2)),
    )


@dataclass(frozen=True)
class Frames:
    """Frames of N postures in the motion capture's frame.

    Attributes:
        before: (N, J, 3, 3) axes, in columns, of the frame before each joint.
        axes: (N, J, 3) unit vectors, of the joints.
        centres: (N, J, 3) m, of the joints.
        last, links: (N, 3, 3) axes of the last frame; (N, J, 3, 3) of all of them.
    """

    before: Array
    axes: Array
    centres: Array
    links: Array

    @property
    def last(self) -> Array:
        """(N, 3, 3) axes of the frame that carries the plate."""
        return self.links[:, -1]


def true_angles(errors: ArmErrors, encoders: Array, torques: Array, sides: Array) -> Array:
    """Angles (N, J), rad, at which joints stand whose encoders say (N, J), rad, under torques (N, J), N·m."""
    ripple = errors.ripple[:, 0] * np.sin(encoders) + errors.ripple[:, 1] * np.cos(encoders)
    return encoders + errors.zero - errors.compliance * torques + 0.5 * errors.play * sides + ripple


def frames_of(shape: ArmShape, errors: ArmErrors, angles: Array) -> Frames:
    """Frames of joints that stand at angles (N, J), rad."""
    count, joints = angles.shape
    before, axes = np.empty((count, joints, 3, 3)), np.empty((count, joints, 3))
    centres, links = np.empty((count, joints, 3)), np.empty((count, joints, 3, 3))
    turned = np.broadcast_to(errors.base_axes, (count, 3, 3))
    place = np.broadcast_to(errors.base, (count, 3))
    tilts = to_matrix(from_rotation_vector(errors.tilt))
    for j in range(joints):
        before[:, j] = turned
        place = place + turned @ (shape.offsets[j] + errors.length[j])
        tilted = turned @ tilts[j]
        turned = tilted @ to_matrix(from_rotation_vector(angles[:, j, None] * shape.axes[j]))
        axes[:, j], centres[:, j], links[:, j] = tilted @ shape.axes[j], place, turned
    return Frames(before, axes, centres, links)


def marker_places(shape: ArmShape, errors: ArmErrors, frames: Frames) -> Array:
    """Places (N, M, 3), m, of the markers in the motion capture's frame."""
    return frames.centres[:, -1, None] + np.einsum("nrc,mc->nmr", frames.last, shape.markers + errors.marker)


def gravity_torques(shape: ArmShape, frames: Frames, up: Array) -> Array:
    """Torques (N, J), N·m, that hold the links against gravity; ``up`` (3,) in the motion capture's frame."""
    middles = frames.centres + np.einsum("njrc,jc->njr", frames.links, shape.centres)
    carried = np.cumsum(shape.masses[::-1])[::-1]
    moments = np.cumsum((shape.masses[:, None] * middles)[:, ::-1], axis=1)[:, ::-1]
    levers = moments - carried[:, None] * frames.centres
    return GRAVITY * np.einsum("njr,njr->nj", frames.axes, np.cross(levers, up))


def joint_columns(frames: Frames, places: Array) -> Array:
    """(N, M, 3, J) m/rad: how each joint moves points (N, M, 3)."""
    levers = places[:, :, None] - frames.centres[:, None]
    return np.swapaxes(np.cross(frames.axes[:, None], levers), -1, -2)


def jacobian(errors: ArmErrors, frames: Frames, places: Array, encoders: Array, torques: Array, sides: Array) -> Array:
    """(N, M, 3, P): how the markers' places go with :meth:`ArmErrors.packed`; the torques (N, J) are held."""
    count, markers, _ = places.shape
    joints = len(errors.zero)
    turns = joint_columns(frames, places)
    base = np.cross(_left(errors.base_turn).T[None, None], (places - errors.base)[:, :, None])
    lengths = np.broadcast_to(frames.before[:, None], (count, markers, joints, 3, 3))
    about = np.einsum("njrc,jck->njkr", frames.before, np.array([_left(one) for one in errors.tilt]))
    tilts = np.cross(about[:, None], (places[:, :, None] - frames.centres[:, None])[:, :, :, None])
    own = np.zeros((count, markers, 3, markers, 3))
    for m in range(markers):
        own[:, m, :, m] = frames.last
    waves = np.stack([np.sin(encoders), np.cos(encoders)], axis=-1)
    ripple = turns[..., None] * waves[:, None, None]
    whole = (count, markers, 3, -1)
    return np.concatenate(
        [
            np.swapaxes(base, -1, -2),
            np.broadcast_to(np.eye(3), (count, markers, 3, 3)),
            turns,
            -torques[:, None, None] * turns,
            np.moveaxis(lengths, 3, 2).reshape(whole),
            np.moveaxis(tilts, -1, 2).reshape(whole),
            own.reshape(whole),
            0.5 * sides[:, None, None] * turns,
            ripple.reshape(whole),
        ],
        axis=-1,
    )


def _left(turn: Array) -> Array:
    """Left Jacobian (3, 3) of the rotation group at a rotation vector (3,): exp(w + dw) = exp(J dw) exp(w)."""
    angle = float(np.linalg.norm(turn))
    x, y, z = turn
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < _SMALL:
        return np.eye(3) + 0.5 * cross
    return np.eye(3) + (1.0 - np.cos(angle)) / angle**2 * cross + (angle - np.sin(angle)) / angle**3 * cross @ cross
