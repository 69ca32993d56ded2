"""The avatar's skeleton in numbers: the one place where body measures are written down.

All lengths are given for a standing height of 1.75 m and scale with height. In the zero pose the body stands upright,
the arms hang with the palms at the thighs, and every joint frame is parallel to the world: x forward, y to the left, z
up.

Sources
    Segment lengths as fractions of standing height: Drillis & Contini 1966, as printed in Winter, "Biomechanics and
    Motor Control of Human Movement" (4th ed. 2009), fig. 4.1.
    Segment masses as fractions of body mass: de Leva 1996, J. Biomech. 29(9), table 4 (male).
    Finger bones: Buryanov & Kotiuk 2010, Int. J. Morphol. 28(3), tables 1 and 2 (means of adults).
    Ranges of motion: American Academy of Orthopaedic Surgeons, "Joint Motion: Method of Measuring and Recording"
    (1965), rounded; trunk ranges are split evenly over the four trunk joints.
"""

from __future__ import annotations

HEIGHT = 1.75
"""Standing height of the avatar, m."""

MASS = 73.0
"""Body mass of the avatar, kg (de Leva's male sample)."""

_H = HEIGHT

# (name, parent, joint centre in the zero pose in m relative to the floor point under the pelvis: x, y, z)
_TRUNK = [
    ("pelvis", None, (0.0, 0.0, 0.530 * _H)),
    ("lumbar_5", "pelvis", (-0.015, 0.0, 0.572 * _H)),
    ("lumbar_3", "lumbar_5", (-0.015, 0.0, 0.612 * _H)),
    ("thoracic_12", "lumbar_3", (-0.020, 0.0, 0.660 * _H)),
    ("thoracic_8", "thoracic_12", (-0.025, 0.0, 0.720 * _H)),
    ("neck", "thoracic_8", (-0.012, 0.0, 0.840 * _H)),
    ("head", "neck", (0.008, 0.0, 0.905 * _H)),
]

_SHOULDER = (-0.010, 0.107 * _H, 0.815 * _H)
_ELBOW_Z = _SHOULDER[2] - 0.186 * _H
_WRIST_Z = _ELBOW_Z - 0.146 * _H

# The left side; the right side is its mirror image.
_LEFT_LIMBS = [
    ("clavicle", "thoracic_8", (0.010, 0.030, 0.812 * _H)),
    ("shoulder", "clavicle", _SHOULDER),
    ("elbow", "shoulder", (-0.010, _SHOULDER[1], _ELBOW_Z)),
    ("wrist", "elbow", (-0.010, _SHOULDER[1], _WRIST_Z)),
    ("hip", "pelvis", (0.0, 0.052 * _H, 0.530 * _H)),
    ("knee", "hip", (0.0, 0.052 * _H, 0.285 * _H)),
    ("ankle", "knee", (-0.005, 0.052 * _H, 0.039 * _H)),
    ("toe", "ankle", (0.130, 0.056 * _H, 0.012 * _H)),
]

PALM_LENGTH = 0.098
"""Wrist centre to the centre of the third knuckle, m: carpus 0.033 + third metacarpal 0.065."""

PALM_THICKNESS = 0.028
"""Dorsal to palmar surface of the hand at the metacarpals, m."""

PALM_CENTRE = 0.068
"""Wrist centre to palm centre along the hand, m."""

# (finger, x of the knuckle across the hand with the thumb side forward, distance of the knuckle from the wrist, bones)
FINGERS = [
    ("index", 0.026, 0.098, (0.040, 0.022, 0.018)),
    ("middle", 0.004, 0.098, (0.045, 0.026, 0.019)),
    ("ring", -0.017, 0.092, (0.041, 0.026, 0.019)),
    ("little", -0.036, 0.084, (0.033, 0.018, 0.017)),
]
# The thumb: base at the wrist's thumb side; its bones point forward and down in the zero pose.
THUMB_BASE = (0.026, 0.028)
THUMB_DIRECTION = (0.60, -0.80)
THUMB_BONES = (0.046, 0.032, 0.024)

FINGER_NAMES = ("thumb", "index", "middle", "ring", "little")


def _hand(wrist: tuple[float, float, float]) -> list[tuple[str, str, tuple[float, float, float]]]:
    x, y, z = wrist
    # The left palm faces the thigh, so its normal points to -y: the thumb's base lies a little towards the palm.
    joints = []
    bx, bz = x + THUMB_BASE[0], z - THUMB_BASE[1]
    joints.append(("thumb_1", "wrist", (bx, y - 0.008, bz)))
    for number, bone in ((2, THUMB_BONES[0]), (3, THUMB_BONES[1])):
        bx, bz = bx + bone * THUMB_DIRECTION[0], bz + bone * THUMB_DIRECTION[1]
        joints.append((f"thumb_{number}", f"thumb_{number - 1}", (bx, y - 0.008, bz)))
    for finger, across, along, bones in FINGERS:
        fz = z - along
        joints.append((f"{finger}_1", "wrist", (x + across, y, fz)))
        joints.append((f"{finger}_2", f"{finger}_1", (x + across, y, fz - bones[0])))
        joints.append((f"{finger}_3", f"{finger}_2", (x + across, y, fz - bones[0] - bones[1])))
    return joints


FINGER_TIP_LENGTH = {"thumb": THUMB_BONES[2], **{finger: bones[2] for finger, _, _, bones in FINGERS}}
"""Length of the last bone of each finger, m."""


def joint_table() -> list[tuple[str, str | None, tuple[float, float, float]]]:
    """The 53 joints as (name, parent, joint centre in the zero pose in m); a parent comes before its children."""
    limbs = _LEFT_LIMBS + _hand((_SHOULDER[0], _SHOULDER[1], _WRIST_Z))
    # Body joints first, then fingers, so that the first 23 joints are the body.
    body = [joint for joint in limbs if "_" not in joint[0]]
    fingers = [joint for joint in limbs if "_" in joint[0]]
    table: list[tuple[str, str | None, tuple[float, float, float]]] = list(_TRUNK)
    trunk = {name for name, _, _ in _TRUNK}
    for group in (body, fingers):
        for side, sign in (("right", -1.0), ("left", 1.0)):
            for name, parent, (x, y, z) in group:
                table.append((f"{side}_{name}", parent if parent in trunk else f"{side}_{parent}", (x, sign * y, z)))
    return table


# Hinge order from parent to child and limits in degrees for the LEFT side and the trunk: order, then (low, high) about
# x, y and z. Flexion of shoulder, elbow and hip is a negative rotation about y. The order keeps the singularity of the
# three hinges (second angle at ±90°) outside the range of motion.
_RANGES: dict[str, tuple[str, tuple[float, float], tuple[float, float], tuple[float, float]]] = {
    "pelvis": ("zyx", (-60, 60), (-80, 80), (-180, 180)),
    "lumbar_5": ("yxz", (-12, 12), (-10, 22), (-8, 8)),
    "lumbar_3": ("yxz", (-12, 12), (-10, 22), (-8, 8)),
    "thoracic_12": ("yxz", (-12, 12), (-10, 22), (-15, 15)),
    "thoracic_8": ("yxz", (-12, 12), (-10, 22), (-15, 15)),
    "neck": ("yxz", (-25, 25), (-30, 30), (-40, 40)),
    "head": ("yxz", (-25, 25), (-30, 35), (-45, 45)),
    "clavicle": ("zxy", (-12, 40), (-30, 30), (-30, 30)),
    "shoulder": ("yxz", (-40, 85), (-180, 60), (-90, 90)),
    "elbow": ("yxz", (-10, 10), (-150, 3), (-90, 90)),
    "wrist": ("xyz", (-75, 80), (-35, 25), (-8, 8)),
    "hip": ("yxz", (-30, 45), (-120, 30), (-45, 45)),
    "knee": ("yxz", (-8, 8), (-3, 140), (-25, 25)),
    "ankle": ("yxz", (-30, 30), (-30, 50), (-30, 30)),
    "toe": ("yxz", (-10, 10), (-60, 35), (-10, 10)),
    "thumb_1": ("xyz", (-45, 45), (-50, 45), (-60, 60)),
    "thumb_2": ("xyz", (-60, 60), (-60, 60), (-20, 20)),
    "thumb_3": ("xyz", (-80, 80), (-80, 80), (-20, 20)),
    "finger_1": ("xyz", (-90, 35), (-25, 25), (-15, 15)),
    "finger_2": ("xyz", (-105, 8), (-8, 8), (-8, 8)),
    "finger_3": ("xyz", (-85, 10), (-8, 8), (-8, 8)),
}


def hinge_range(joint: str) -> tuple[str, list[tuple[float, float]]]:
    """Hinge order and limits of a joint: ``('yxz', [(low, high)] * 3)`` in degrees, in the order of the hinges."""
    side, _, rest = joint.partition("_")
    mirrored = side == "right"
    name = rest if side in ("left", "right") else joint
    finger, _, number = name.partition("_")
    if finger in FINGER_NAMES and finger != "thumb":
        name = f"finger_{number}"
    order, x, y, z = _RANGES[name]
    if mirrored:  # a mirror image in the x–z plane turns round the sense of rotations about x and z
        x, z = (-x[1], -x[0]), (-z[1], -z[0])
    ranges = {"x": x, "y": y, "z": z}
    return order, [ranges[axis] for axis in order]


REST_DEGREES = {
    "right_shoulder": (-60.0, 0.0, 0.0),
    "right_elbow": (-60.0, 0.0, 0.0),
}
"""Hinge angles, degrees, of the rest pose that the model's rotation vectors are relative to (all other joints: zero).

Half way between hanging and raised, so that no right-arm joint comes near the singularity of the rotation vector at pi.
"""

SEGMENT_MASS_FRACTION = {
    # de Leva 1996, table 4 (male): trunk 43.46 % in upper 15.96, middle 16.33, lower 11.17.
    "pelvis": 0.1117, "lumbar_5": 0.0500, "lumbar_3": 0.0560, "thoracic_12": 0.0573, "thoracic_8": 0.1356,
    "neck": 0.0140, "head": 0.0554,
    "clavicle": 0.0120, "shoulder": 0.0271, "elbow": 0.0162, "wrist": 0.0061,
    "hip": 0.1416, "knee": 0.0433, "ankle": 0.0107, "toe": 0.0030,
}  # fmt: skip
"""Mass of the segment that a joint carries, as a fraction of body mass; a hand's mass includes its fingers.

The upper trunk's 15.96 % is split over thoracic_8 and the two clavicles, the middle trunk over three joints, the
head's 6.94 % over neck and head, the foot's 1.37 % over ankle and toe.
"""
