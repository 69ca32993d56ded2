"""From tracked markers to head, right arm and palm of the live person."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.frames import HumanArm, PalmPose, TrackedMarkers
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.tracking.filter_settings import NEVER
from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry.rotations import Array

# In the zero pose the right palm faces +y and its fingers point to -z.
_PALM_NORMAL = np.array([0.0, 1.0, 0.0])
_FINGERS = np.array([0.0, 0.0, -1.0])
_UP_AND_LEFT = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
_HAND_BY_FOREARM = 0.36  # wrist to knuckles over elbow to wrist
_HAND_ROWS, _ARM_ROWS = [2, 3], [1, 0, 4]  # of the landmarks: wrist, hand; elbow, shoulder, head
_STEP_S = 1e-4  # time step of the palm's directional derivative


class Recipe(NamedTuple):
    """A marker set's :class:`highfive.mocap_bridge.markers.marker_set.ArmRecipe`, in numbers.

    Attributes:
        landmarks: (7, M) weights that give shoulder, elbow, wrist, hand, head, and the vectors across hand and body.
        head: markers of the head.
        to_head: (16, 3 N) coefficients of Horn's matrix, of these markers or of two directions.
        head_offset: (3,) m, from their mean to the head's centre in its frame.
        from_body: the head's orientation comes from two directions.
        shoulder_below, elbow_medial: m, see the arm recipe.
        forearm_length: m on the reference body, where the forearm gives the size of the hand; else 0.
        hand_length: m on the reference body, wrist to the hand's markers.
        across: the hand has markers across; otherwise its palm faces ``towards_partner`` (3,).
        seen_from_markers: (4, 3) palm, knuckles, the palm's normal and the fingers' direction in the markers' axes.
        used, of_hand: markers that the arm, and that the hand rests on.
        on_head: markers that say where the head is: a neck that is seen does not; where nothing is on the head, all
            that stands in for it.
    """

    landmarks: Array
    head: NDArray[np.int64]
    to_head: Array
    head_offset: Array
    from_body: bool
    shoulder_below: float
    elbow_medial: float
    forearm_length: float
    hand_length: float
    across: bool
    towards_partner: Array
    seen_from_markers: Array
    used: NDArray[np.int64]
    of_hand: NDArray[np.int64]
    on_head: NDArray[np.int64]


class Known(NamedTuple):
    """How well an arm is known.

    Attributes:
        whole: each marker was seen at some time.
        valid, age_ns, head_unseen_ns, hand_unseen_ns, head_deviation, hand_deviation: as in
            :class:`highfive.mocap_bridge.frames.HumanArm`.
    """

    valid: bool
    age_ns: int
    head_unseen_ns: int
    hand_unseen_ns: int
    head_deviation: float
    hand_deviation: float
    whole: bool


class HumanArmEstimator:
    """Head pose, joint centres and palm pose of the right arm, as the marker set's recipe says.

    Where a set has no markers across the hand (the joint centres of an Acclaim skeleton: wrist and fingers only), the
    palm is taken to face the partner: its normal is ``towards_partner``, made orthogonal to the fingers. Where it has
    nothing beyond the wrist, the hand is taken to go on in the forearm's direction.
    """

    def __init__(self, marker_set: MarkerSet, towards_partner: tuple[float, float, float] = (-1.0, 0.0, 0.0)):
        """Args: ``towards_partner`` is a unit vector in the world, from the person to the avatar."""
        arm, local = marker_set.arm, marker_set.local_positions
        shoulder, elbow, wrist, hand, head = (
            _mean_of(marker_set, names) for names in (arm.shoulder, arm.elbow, arm.wrist, arm.hand, arm.head)
        )
        if not arm.hand:
            hand = wrist + _HAND_BY_FOREARM * (wrist - elbow)
        head_markers = marker_set.indices(arm.head)
        template = local[head_markers] - local[head_markers].mean(axis=0)
        hand_template = local[marker_set.indices(arm.hand)].mean(axis=0) if arm.hand else arm.knuckles_in_hand
        hand_length = float(np.linalg.norm(hand_template))
        along, normal = hand_template / hand_length, _PALM_NORMAL
        if arm.across:
            normal = np.cross(local[marker_set.index(arm.across[1])] - local[marker_set.index(arm.across[0])], along)
        # Palm, knuckles, the palm's normal and the fingers' direction as seen from the axes that the markers give.
        in_hand = np.array([arm.palm_in_hand, arm.knuckles_in_hand, _PALM_NORMAL, _FINGERS])
        self._recipe = Recipe(
            landmarks=np.stack(
                [shoulder, elbow, wrist, hand, head]
                + [_difference(marker_set, pair) for pair in (arm.across, arm.head_left)]
            ),
            head=head_markers.astype(np.int64),
            to_head=_horn(_UP_AND_LEFT if arm.head_left else template),
            head_offset=arm.centre_in_head - local[head_markers].mean(axis=0),
            from_body=bool(arm.head_left),
            shoulder_below=arm.shoulder_below,
            elbow_medial=arm.elbow_medial,
            # A point called hand or hand tip lies somewhere on the hand: the forearm then says how large the person is.
            forearm_length=marker_set.segments["right_elbow"].length if arm.scale_by_forearm else 0.0,
            hand_length=hand_length,
            across=bool(arm.across),
            towards_partner=np.array(towards_partner, dtype=float),
            seen_from_markers=np.ascontiguousarray(in_hand @ axes_of(along, normal).T),
            used=marker_set.indices(arm.markers).astype(np.int64),
            of_hand=marker_set.indices((*arm.wrist, *arm.hand, *arm.across)).astype(np.int64),
            on_head=marker_set.indices(marker_set.on_head or arm.head).astype(np.int64),
        )
        # Called once, so that nothing is left to compile when a person is there.
        places, count = np.array(local), len(marker_set)
        nothing = np.zeros((count, 3, 3)), np.zeros(count, dtype=bool), np.zeros(count, dtype=np.int64)
        arm_of(self._recipe, places, np.zeros_like(places), *nothing)

    def __call__(self, tracked: TrackedMarkers) -> HumanArm:
        """The person's arm in the world frame; ``valid`` only if every marker that it rests on is valid."""
        points, quaternion, covariance, known = arm_of(
            self._recipe, tracked.positions, tracked.velocities, tracked.covariances, tracked.valid, tracked.age_ns
        )
        head, shoulder, elbow, wrist, palm, knuckles, normal, fingers, velocity = points
        return HumanArm(
            head_position=head,
            head_orientation=quaternion,
            shoulder=shoulder,
            elbow=elbow,
            wrist=wrist,
            knuckles=knuckles,
            palm=PalmPose(palm, normal, fingers, velocity),
            hand_points=points[3:6:2],
            valid=known.valid,
            age_ns=known.age_ns,
            time_ns=tracked.time_ns,
            hand_covariance=covariance[_HAND_ROWS],
            arm_covariance=covariance[_ARM_ROWS],
            whole=known.valid and known.whole,
            head_unseen_ns=known.head_unseen_ns,
            hand_unseen_ns=known.hand_unseen_ns,
            head_deviation=known.head_deviation,
            hand_deviation=known.hand_deviation,
        )


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


@compiled_entry
def arm_of(
    recipe: Recipe, positions: Array, velocities: Array, covariances: Array, valid: NDArray[np.bool_],
    age_ns: NDArray[np.int64],
) -> tuple[Array, Array, Array, Known]:  # fmt: skip
    """Head, shoulder, elbow, wrist, palm, knuckles, normal, fingers and the palm's velocity (9, 3), and the rest.

    That is the head's quaternion (4,), the covariance (5, 3, 3), m², of the first five landmarks, and how well all of
    it is known. Positions (M, 3) are in m, velocities (M, 3) in m/s, covariances (M, 3, 3) in m².
    """
    landmarks, moving = _landmarks(recipe, positions), _landmarks(recipe, velocities)
    shoulder, elbow, wrist = landmarks[0].copy(), landmarks[1].copy(), landmarks[2]
    shoulder[2] -= recipe.shoulder_below
    if recipe.elbow_medial != 0.0:
        # The axis of flexion is across upper arm and forearm; a straight arm has none, and nothing is moved.
        axis = _cross(_unit(wrist - elbow), _unit(elbow - shoulder))
        elbow += recipe.elbow_medial / (math.sqrt(axis @ axis) + 0.1) * axis
    if recipe.forearm_length > 0.0:
        scale = _length(wrist - elbow) / recipe.forearm_length
    else:
        scale = _length(landmarks[3] - wrist) / recipe.hand_length
    hand = _hand(recipe, landmarks, scale)
    # The palm is a function of the markers: its velocity is the derivative along the markers' velocities.
    moved = _hand(recipe, landmarks + _STEP_S * moving, scale)
    quaternion = _head_orientation(recipe, positions, landmarks)
    points = np.empty((9, 3))
    points[0] = landmarks[4] + _rotated(quaternion, recipe.head_offset)
    points[1], points[2], points[3] = shoulder, elbow, wrist
    points[4:8] = hand
    points[8] = (moved[0] - hand[0]) / _STEP_S
    covariance = np.zeros((5, 3, 3))
    for row in range(5):
        for i in range(3):
            for m in range(len(positions)):
                covariance[row, i, i] += abs(recipe.landmarks[row, m]) * math.sqrt(covariances[m, i, i])
            covariance[row, i, i] *= covariance[row, i, i]
    return points, quaternion, covariance, _known(recipe, covariances, valid, age_ns, covariance)


@compiled
def _known(
    recipe: Recipe, covariances: Array, valid: NDArray[np.bool_], age_ns: NDArray[np.int64], of_landmarks: Array
) -> Known:
    """How well the arm is known whose landmarks have the covariance ``of_landmarks`` (5, 3, 3), m²."""
    usable, whole, oldest, ever_seen = True, True, 0, False
    for m in recipe.used:
        usable, whole = usable and bool(valid[m]), whole and age_ns[m] != NEVER
    hand_unseen = head_unseen = NEVER
    for m in recipe.of_hand:
        hand_unseen = min(hand_unseen, int(age_ns[m]))
        if age_ns[m] != NEVER:  # a marker that this person does not wear is put where the set has it
            oldest, ever_seen = max(oldest, int(age_ns[m])), True
    deviation = 0.0
    for m in recipe.on_head:
        head_unseen = min(head_unseen, int(age_ns[m]))
        deviation += math.sqrt(covariances[m, 0, 0] + covariances[m, 1, 1] + covariances[m, 2, 2])
    largest = 0.0
    for row in (2, 3):
        largest = max(largest, of_landmarks[row, 0, 0] + of_landmarks[row, 1, 1] + of_landmarks[row, 2, 2])
    return Known(
        usable, oldest if ever_seen else NEVER, head_unseen, hand_unseen, deviation / len(recipe.on_head),
        math.sqrt(largest), whole,
    )  # fmt: skip


@compiled
def _landmarks(recipe: Recipe, points: Array) -> Array:
    result = np.zeros((7, 3))
    for row in range(7):
        for m in range(len(points)):
            weight = recipe.landmarks[row, m]
            if weight != 0.0:
                for i in range(3):
                    result[row, i] += weight * points[m, i]
    return result


@compiled
def _hand(recipe: Recipe, landmarks: Array, scale: float) -> Array:
    """Centre of the palm, knuckles, normal of the palm and direction of the fingers (4, 3) in the world."""
    along = _unit(landmarks[3] - landmarks[2])
    normal = _cross(landmarks[5], along) if recipe.across else recipe.towards_partner
    axes = axes_of(along, normal)
    hand = np.zeros((4, 3))
    for row in range(4):
        for k in range(3):
            for i in range(3):
                hand[row, i] += recipe.seen_from_markers[row, k] * axes[k, i]
    for row in range(2):
        for i in range(3):
            hand[row, i] = landmarks[2, i] + scale * hand[row, i]
    return hand


@compiled
def _head_orientation(recipe: Recipe, positions: Array, landmarks: Array) -> Array:
    """Quaternion (4,) of the head."""
    count = 2 if recipe.from_body else len(recipe.head)
    points = np.empty((count, 3))
    if recipe.from_body:
        points[0] = _unit(positions[recipe.head[-1]] - positions[recipe.head[0]])
        points[1] = _unit(landmarks[6])
    else:
        for n in range(count):
            points[n] = positions[recipe.head[n]]
    # Horn 1987, J. Opt. Soc. Am. A 4(4): the eigenvector of the largest eigenvalue of a symmetric 4 by 4 matrix.
    matrix = np.zeros((4, 4))
    for entry in range(16):
        for n in range(count):
            for i in range(3):
                matrix[entry // 4, entry % 4] += recipe.to_head[entry, 3 * n + i] * points[n, i]
    quaternion = _dominant(matrix)
    return quaternion if quaternion[0] >= 0.0 else -quaternion


@compiled
def _dominant(matrix: Array) -> Array:
    """Unit eigenvector of the largest eigenvalue of a symmetric matrix (4, 4), by Jacobi's rotations."""
    a, vectors = matrix.copy(), np.eye(4)
    for _ in range(12):
        off = 0.0
        for p in range(3):
            for q in range(p + 1, 4):
                off += a[p, q] * a[p, q]
                if abs(a[p, q]) < 1e-300:
                    continue
                theta = 0.5 * (a[q, q] - a[p, p]) / a[p, q]
                t = (1.0 if theta >= 0.0 else -1.0) / (abs(theta) + math.sqrt(theta * theta + 1.0))
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                for k in range(4):
                    x, y = a[k, p], a[k, q]
                    a[k, p], a[k, q] = c * x - s * y, s * x + c * y
                for k in range(4):
                    x, y = a[p, k], a[q, k]
                    a[p, k], a[q, k] = c * x - s * y, s * x + c * y
                for k in range(4):
                    x, y = vectors[k, p], vectors[k, q]
                    vectors[k, p], vectors[k, q] = c * x - s * y, s * x + c * y
        if off < 1e-26 * (a[0, 0] ** 2 + a[1, 1] ** 2 + a[2, 2] ** 2 + a[3, 3] ** 2):
            break
    best = 0
    for k in range(1, 4):
        best = k if a[k, k] > a[best, best] else best
    return vectors[:, best].copy()


@compiled_entry
def axes_of(along: Array, normal: Array) -> Array:
    """Right-handed axes (3, 3), in rows: ``along`` (a unit vector), across, and ``normal`` made orthogonal to it."""
    normal = normal - (normal @ along) * along
    length = math.sqrt(normal @ normal)
    if length < 1e-6:  # no direction is marked: any one across the fingers will do, the same one every time
        least = np.argmin(np.abs(along))
        normal = -along[least] * along
        normal[least] += 1.0
        length = math.sqrt(normal @ normal)
    axes = np.empty((3, 3))
    axes[0], axes[2] = along, normal / length
    axes[1] = _cross(axes[2], along)
    return axes


@compiled
def _length(vector: Array) -> float:
    return max(math.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]), 1e-6)


@compiled
def _unit(vector: Array) -> Array:
    return vector / _length(vector)


@compiled
def _cross(a: Array, b: Array) -> Array:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@compiled
def _rotated(quaternion: Array, vector: Array) -> Array:
    axis = quaternion[1:]
    turn = _cross(axis, 2.0 * vector)
    return vector + quaternion[0] * turn + _cross(axis, turn)
