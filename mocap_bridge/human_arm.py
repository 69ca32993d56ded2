"""From tracked markers to head, right arm and palm of the live person."""

from __future__ import annotations

import numpy as np

from mocap_bridge.frames import HumanArm, PalmPose, TrackedMarkers
from mocap_bridge.marker_sets import MarkerSet
from model.rotations import Array

# In the zero pose the right palm faces +y and its fingers point to -z.
_PALM_NORMAL = np.array([0.0, 1.0, 0.0])
_FINGERS = np.array([0.0, 0.0, -1.0])
_UP_AND_LEFT = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
_STEP_S = 1e-4  # time step of the palm's directional derivative


class HumanArmEstimator:
    """Head pose, joint centres and palm pose of the right arm, as the marker set's recipe says.

    Where a set has no markers across the hand (the joint centres of an Acclaim skeleton: wrist and fingers only), the
    palm is taken to face the partner: its normal is ``towards_partner``, made orthogonal to the fingers.
    """

    def __init__(self, marker_set: MarkerSet, towards_partner: tuple[float, float, float] = (-1.0, 0.0, 0.0)):
        """Args: ``towards_partner`` is a unit vector in the world, from the person to the avatar."""
        arm, local = marker_set.arm, marker_set.local_positions
        self._arm = arm
        self._partner = np.array(towards_partner)
        self._head = marker_set.indices(arm.head)
        self._used = marker_set.indices(arm.markers)
        self._hand_used = marker_set.indices((*arm.wrist, *arm.hand, *arm.across))
        self._landmarks = np.stack(
            [_mean_of(marker_set, names) for names in (arm.shoulder, arm.elbow, arm.wrist, arm.hand, arm.head)]
            + [_difference(marker_set, pair) for pair in (arm.across, arm.head_left)]
        )
        head_template = local[self._head]
        self._head_template = head_template - head_template.mean(axis=0)
        self._head_offset = arm.centre_in_head - head_template.mean(axis=0)
        hand_template = local[marker_set.indices(arm.hand)].mean(axis=0)
        self._hand_length = float(np.linalg.norm(hand_template))
        along = hand_template / self._hand_length
        across = local[marker_set.index(arm.across[1])] - local[marker_set.index(arm.across[0])] if arm.across else None
        normal = _PALM_NORMAL if across is None else _cross(across, along)
        self._from_template = _axes(along, normal).T

    def __call__(self, tracked: TrackedMarkers) -> HumanArm:
        """The person's arm in the world frame; ``valid`` only if every marker that it rests on is valid."""
        arm = self._arm
        landmarks = self._landmarks @ tracked.positions
        shoulder, elbow, wrist = landmarks[0] - [0.0, 0.0, arm.shoulder_below], landmarks[1], landmarks[2]
        if arm.elbow_medial:
            # The axis of flexion is across upper arm and forearm; a straight arm has none, and nothing is moved.
            axis = _cross(_unit(wrist - elbow), _unit(elbow - shoulder))
            elbow = elbow + arm.elbow_medial * axis / (float(np.linalg.norm(axis)) + 0.1)
        hand, scale = self._hand_frame(landmarks)
        palm_position = wrist + hand @ (scale * arm.palm_in_hand)
        # The palm is a function of the markers: its velocity is the derivative along the markers' velocities.
        moved = landmarks + _STEP_S * (self._landmarks @ tracked.velocities)
        velocity = (moved[2] + self._hand_frame(moved)[0] @ (scale * arm.palm_in_hand) - palm_position) / _STEP_S
        knuckles = wrist + hand @ (scale * arm.knuckles_in_hand)
        head_orientation = self._head_orientation(tracked.positions, landmarks)
        return HumanArm(
            head_position=landmarks[4] + _rotate(head_orientation, self._head_offset),
            head_orientation=head_orientation,
            shoulder=shoulder,
            elbow=elbow,
            wrist=wrist,
            knuckles=knuckles,
            palm=PalmPose(palm_position, hand @ _PALM_NORMAL, hand @ _FINGERS, velocity),
            hand_points=np.array([wrist, knuckles]),
            valid=bool(tracked.valid[self._used].all()),
            age_ns=int(tracked.age_ns[self._hand_used].max()),
            time_ns=tracked.time_ns,
        )

    def _hand_frame(self, landmarks: Array) -> tuple[Array, float]:
        """Rotation of the hand in the world (3, 3) and size of the hand relative to the set's."""
        along = landmarks[3] - landmarks[2]
        length = max(float(np.linalg.norm(along)), 1e-6)
        along = along / length
        normal = _cross(landmarks[5], along) if self._arm.across else self._partner
        return _axes(along, normal) @ self._from_template, length / self._hand_length

    def _head_orientation(self, positions: Array, landmarks: Array) -> Array:
        """Quaternion (4,) of the head."""
        points = positions[self._head]
        if self._arm.head_left:
            measured = np.stack([_unit(points[-1] - points[0]), _unit(landmarks[6])])
            return _rigid_fit(_UP_AND_LEFT, measured)
        return _rigid_fit(self._head_template, points - landmarks[4])


def _mean_of(marker_set: MarkerSet, names: tuple[str, ...]) -> Array:
    """Weights (M,) that give the mean of some markers."""
    weights = np.zeros(len(marker_set))
    weights[marker_set.indices(names)] = 1.0 / len(names)
    return weights


def _difference(marker_set: MarkerSet, pair: tuple[str, ...]) -> Array:
    """Weights (M,) that give the vector from the first to the second of two markers; zero for no pair."""
    weights = np.zeros(len(marker_set))
    if pair:
        weights[marker_set.indices(pair)] = -1.0, 1.0
    return weights


def _rigid_fit(template: Array, measured: Array) -> Array:
    """Quaternion (4,) that turns ``template`` (N, 3) best into ``measured`` (N, 3), both about the origin.

    Horn 1987, J. Opt. Soc. Am. A 4(4): the eigenvector of the largest eigenvalue of a symmetric 4 by 4 matrix.
    """
    s = template.T @ measured
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = s.tolist()
    n = np.array(
        [
            [xx + yy + zz, yz - zy, zx - xz, xy - yx],
            [yz - zy, xx - yy - zz, xy + yx, zx + xz],
            [zx - xz, xy + yx, yy - xx - zz, yz + zy],
            [xy - yx, zx + xz, yz + zy, zz - xx - yy],
        ]
    )
    quaternion = np.linalg.eigh(n).eigenvectors[:, -1]
    return quaternion if quaternion[0] >= 0 else -quaternion


def _axes(along: Array, normal: Array) -> Array:
    """Right-handed axes (3, 3) in columns: ``along``, across, and ``normal`` made orthogonal to ``along``."""
    normal = normal - float(normal @ along) * along
    norm = float(np.linalg.norm(normal))
    if norm < 1e-6:  # no direction is marked: any one across the fingers will do, the same one every time
        least = int(np.argmin(np.abs(along)))
        normal = np.eye(3)[least] - along[least] * along
        norm = float(np.linalg.norm(normal))
    normal = normal / norm
    return np.array([along, _cross(normal, along), normal]).T


def _cross(a: Array, b: Array) -> Array:
    # numpy.cross takes 20 µs for one pair of vectors, this 2.
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def _unit(vector: Array) -> Array:
    return vector / max(float(np.linalg.norm(vector)), 1e-9)


def _rotate(quaternion: Array, vector: Array) -> Array:
    u = 2.0 * _cross(quaternion[1:], vector)
    return vector + quaternion[0] * u + _cross(quaternion[1:], u)
