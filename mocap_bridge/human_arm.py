"""From tracked markers to head, right arm and palm of the live person."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.linalg import get_lapack_funcs

from mocap_bridge.frames import HumanArm, PalmPose, TrackedMarkers
from mocap_bridge.marker_sets import MarkerSet
from model.rotations import Array

Vector = Sequence[float]

# In the zero pose the right palm faces +y and its fingers point to -z.
_PALM_NORMAL = np.array([0.0, 1.0, 0.0])
_FINGERS = np.array([0.0, 0.0, -1.0])
_UP_AND_LEFT = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
_HAND_BY_FOREARM = 0.36  # wrist to knuckles over elbow to wrist
_STEP_S = 1e-4  # time step of the palm's directional derivative

(_syev,) = get_lapack_funcs(("syev",), (np.zeros((1, 1)),))


class HumanArmEstimator:
    """Head pose, joint centres and palm pose of the right arm, as the marker set's recipe says.

    Where a set has no markers across the hand (the joint centres of an Acclaim skeleton: wrist and fingers only), the
    palm is taken to face the partner: its normal is ``towards_partner``, made orthogonal to the fingers. Where it has
    nothing beyond the wrist, the hand is taken to go on in the forearm's direction.
    """

    def __init__(self, marker_set: MarkerSet, towards_partner: tuple[float, float, float] = (-1.0, 0.0, 0.0)):
        """Args: ``towards_partner`` is a unit vector in the world, from the person to the avatar."""
        arm, local = marker_set.arm, marker_set.local_positions
        self._arm = arm
        self._partner = towards_partner
        self._head = marker_set.indices(arm.head)
        self._used = marker_set.indices(arm.markers)
        self._hand_used = marker_set.indices((*arm.wrist, *arm.hand, *arm.across))
        shoulder, elbow, wrist, hand, head = (
            _mean_of(marker_set, names) for names in (arm.shoulder, arm.elbow, arm.wrist, arm.hand, arm.head)
        )
        if not arm.hand:
            hand = wrist + _HAND_BY_FOREARM * (wrist - elbow)
        self._landmarks = np.stack(
            [shoulder, elbow, wrist, hand, head]
            + [_difference(marker_set, pair) for pair in (arm.across, arm.head_left)]
        )
        head_template = local[self._head]
        self._head_offset = arm.centre_in_head - head_template.mean(axis=0)
        self._to_head = _horn(_UP_AND_LEFT if arm.head_left else head_template - head_template.mean(axis=0))
        hand_template = local[marker_set.indices(arm.hand)].mean(axis=0) if arm.hand else arm.knuckles_in_hand
        self._hand_length = float(np.linalg.norm(hand_template))
        along = (hand_template / self._hand_length).tolist()
        # A point called hand or hand tip lies somewhere on the hand: the forearm then says how large the person is.
        self._forearm_length = marker_set.segments["right_elbow"].length if arm.scale_by_forearm else 0.0
        across = local[marker_set.index(arm.across[1])] - local[marker_set.index(arm.across[0])] if arm.across else None
        normal = _PALM_NORMAL.tolist() if across is None else _cross(across.tolist(), along)
        # Palm, knuckles, the palm's normal and the fingers' direction as seen from the axes that the markers give.
        in_hand = np.array([arm.palm_in_hand, arm.knuckles_in_hand, _PALM_NORMAL, _FINGERS])
        self._seen_from_markers = in_hand @ np.array(_axes(along, normal)).T

    def __call__(self, tracked: TrackedMarkers) -> HumanArm:
        """The person's arm in the world frame; ``valid`` only if every marker that it rests on is valid."""
        arm = self._arm
        landmarks = self._landmarks @ tracked.positions
        shoulder, elbow, wrist = landmarks[:3]
        shoulder[2] -= arm.shoulder_below
        if arm.elbow_medial:
            # The axis of flexion is across upper arm and forearm; a straight arm has none, and nothing is moved.
            axis = np.array(_cross(_unit((wrist - elbow).tolist()), _unit((elbow - shoulder).tolist())))
            elbow = elbow + arm.elbow_medial / (math.sqrt(axis @ axis) + 0.1) * axis
        if self._forearm_length:
            scale = _direction((wrist - elbow).tolist(), 1e-6)[1] / self._forearm_length
        else:
            scale = _direction((landmarks[3] - wrist).tolist(), 1e-6)[1] / self._hand_length
        palm, knuckles, normal, fingers = self._hand(landmarks, scale)
        # The palm is a function of the markers: its velocity is the derivative along the markers' velocities.
        moved = self._hand(landmarks + _STEP_S * (self._landmarks @ tracked.velocities), scale)[0]
        head_orientation = self._head_orientation(tracked.positions, landmarks)
        return HumanArm(
            head_position=landmarks[4] + _rotate(head_orientation, self._head_offset),
            head_orientation=head_orientation,
            shoulder=shoulder,
            elbow=elbow,
            wrist=wrist,
            knuckles=knuckles,
            palm=PalmPose(palm, normal, fingers, (moved - palm) / _STEP_S),
            hand_points=np.array([wrist, knuckles]),
            valid=bool(tracked.valid.take(self._used).all()),
            age_ns=int(tracked.age_ns.take(self._hand_used).max()),
            time_ns=tracked.time_ns,
        )

    def _hand(self, landmarks: Array, scale: float) -> Array:
        """Centre of the palm, knuckles, normal of the palm and direction of the fingers (4, 3) in the world."""
        along, _ = _direction((landmarks[3] - landmarks[2]).tolist(), 1e-6)
        normal = _cross(landmarks[5].tolist(), along) if self._arm.across else self._partner
        hand = self._seen_from_markers @ np.array(_axes(along, normal))
        hand[:2] *= scale
        hand[:2] += landmarks[2]
        return hand

    def _head_orientation(self, positions: Array, landmarks: Array) -> Array:
        """Quaternion (4,) of the head."""
        points = positions.take(self._head, axis=0)
        if self._arm.head_left:
            points = np.array([_unit((points[-1] - points[0]).tolist()), _unit(landmarks[6].tolist())])
        # Horn 1987, J. Opt. Soc. Am. A 4(4): the eigenvector of the largest eigenvalue of a symmetric 4 by 4 matrix.
        matrix = (self._to_head @ points.reshape(-1)).reshape(4, 4)
        quaternion = _syev(matrix, lower=1)[1][:, -1]
        return quaternion if quaternion[0] >= 0 else -quaternion


def _mean_of(marker_set: MarkerSet, names: tuple[str, ...]) -> Array:
    """Weights (M,) that give the mean of some markers; zero for none."""
    weights = np.zeros(len(marker_set))
    if names:
        weights[marker_set.indices(names)] = 1.0 / len(names)
    return weights


def _difference(marker_set: MarkerSet, pair: tuple[str, ...]) -> Array:
    """Weights (M,) that give the vector from the first to the second of two markers; zero for no pair."""
    weights = np.zeros(len(marker_set))
    if pair:
        weights[marker_set.indices(pair)] = -1.0, 1.0
    return weights


def _horn(template: Array) -> Array:
    """Coefficients (16, 3 N) that make of measured points (N, 3) Horn's matrix (4, 4) of the rigid fit to ``template``.

    The matrix is linear in the points. The template is taken about its centre or is of directions, so that it does not
    matter where the points' origin lies.
    """
    coefficients = []
    for unit in np.eye(template.size):
        (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = template.T @ unit.reshape(-1, 3)
        matrix = [
            [xx + yy + zz, yz - zy, zx - xz, xy - yx],
            [yz - zy, xx - yy - zz, xy + yx, zx + xz],
            [zx - xz, xy + yx, yy - xx - zz, yz + zy],
            [xy - yx, zx + xz, yz + zy, zz - xx - yy],
        ]
        coefficients.append(np.ravel(matrix))
    return np.array(coefficients).T


# Plain floats: for single vectors NumPy, and with it model.rotations, takes five to ten times as long.


def _axes(along: Vector, normal: Vector) -> tuple[Vector, Vector, Vector]:
    """Right-handed axes: ``along`` (a unit vector), across, and ``normal`` made orthogonal to ``along``."""
    (ax, ay, az), (nx, ny, nz) = along, normal
    dot = nx * ax + ny * ay + nz * az
    normal, norm = _direction((nx - dot * ax, ny - dot * ay, nz - dot * az), 1e-300)
    if norm < 1e-6:  # no direction is marked: any one across the fingers will do, the same one every time
        least = min(range(3), key=lambda i: abs(along[i]))
        other = [float(i == least) - along[least] * along[i] for i in range(3)]
        normal, _ = _direction(other, 1e-300)
    return along, _cross(normal, along), normal


def _direction(vector: Vector, shortest: float) -> tuple[Vector, float]:
    """Unit vector and length, which counts as ``shortest`` if it is less."""
    x, y, z = vector
    length = max(math.sqrt(x * x + y * y + z * z), shortest)
    return (x / length, y / length, z / length), length


def _unit(vector: Vector) -> Vector:
    return _direction(vector, 1e-9)[0]


def _cross(a: Vector, b: Vector) -> Vector:
    (ax, ay, az), (bx, by, bz) = a, b
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


def _rotate(quaternion: Array, vector: Array) -> Array:
    w, *axis = quaternion.tolist()
    x, y, z = vector.tolist()
    ux, uy, uz = _cross(axis, (2.0 * x, 2.0 * y, 2.0 * z))
    vx, vy, vz = _cross(axis, (ux, uy, uz))
    return np.array([x + w * ux + vx, y + w * uy + vy, z + w * uz + vz])
