"""What avatar and person look like: the blobs that bodies, clothes and faces are sculpted from, and their colours.

Blobs are given in the frame of the joint that carries them (x forward, y to the left, z up in the zero pose), for the
left side; ``mirrored`` adds the right. Lengths in m, for a standing height of 1.75 m.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from highfive.scenes import anthropometry, body_shapes

Vector = tuple[float, float, float]
Colour = tuple[float, float, float]


class Blob(NamedTuple):
    """A tapered capsule.

    Attributes:
        joint: whose frame it lies in, and which it moves with.
        start, end: ends of its axis, m.
        radius: at start and end, m.
        squash: factors by which it is stretched along x, y and z.
        blend: width over which it melts into the blobs before it, m.
        carve: takes away instead of adding.
    """

    joint: str
    start: Vector
    end: Vector
    radius: tuple[float, float]
    squash: Vector = (1.0, 1.0, 1.0)
    blend: float = 0.03
    carve: bool = False


class Cut(NamedTuple):
    """A plane in the frame of ``joint``; what lies on the side of its normal is removed."""

    joint: str
    point: Vector
    normal: Vector


class Part(NamedTuple):
    """A surface of one colour.

    Attributes:
        name: what it is.
        material: key into :class:`Look` ``.colours``.
        blobs, cuts: its shape.
        step: edge of the grid it is sculpted on, m.
    """

    name: str
    material: str
    blobs: tuple[Blob, ...]
    cuts: tuple[Cut, ...] = ()
    step: float = 0.020


class Look(NamedTuple):
    """A person's colours and hair.

    Attributes:
        colours: red, green and blue of each material.
        hair: the head's hair.
        iris: colour of the eyes.
    """

    colours: dict[str, Colour]
    hair: tuple[Blob, ...]
    hair_cuts: tuple[Cut, ...]
    iris: Colour


def ball(joint: str, centre: Vector, radius: float, squash: Vector = (1.0, 1.0, 1.0), **kwargs: object) -> Blob:
    """A blob without length; ``squash`` keeps its centre."""
    return Blob(joint, centre, centre, (radius, radius), squash, **kwargs)  # pyright: ignore[reportArgumentType]


def _flip(point: Vector) -> Vector:
    return (point[0], -point[1], point[2])


def _other_side(joint: str) -> str:
    return joint.replace("left_", "right_")


def mirrored(items: Iterable[Blob | Cut]) -> tuple:
    """The items and their mirror images in the x–z plane."""
    both: list[Blob | Cut] = []
    for item in items:
        if isinstance(item, Blob):
            image = item._replace(joint=_other_side(item.joint), start=_flip(item.start), end=_flip(item.end))
        else:
            image = Cut(_other_side(item.joint), _flip(item.point), _flip(item.normal))
        both += [item, image]
    return tuple(both)


_TRUNK_SHIRT = (
    Blob("pelvis", (-0.004, 0, -0.05), (0.006, 0, 0.07), (0.119, 0.104), (1, 1.58, 1)),
    ball("pelvis", (-0.036, 0, -0.045), 0.103, (1, 1.62, 1)),
    # The hem goes with the thighs that it lies on, else they come through it where hips bend.
    *mirrored([Blob("left_hip", (0.010, -0.006, -0.01), (0.010, -0.004, -0.06), (0.092, 0.090), blend=0.03)]),
    Blob("lumbar_5", (0.013, 0, 0.0), (0.015, 0, 0.07), (0.102, 0.100), (1, 1.34, 1)),
    Blob("lumbar_3", (0.015, 0, 0.0), (0.016, 0, 0.08), (0.100, 0.101), (1, 1.30, 1)),
    Blob("thoracic_12", (0.018, 0, 0.0), (0.018, 0, 0.10), (0.102, 0.108), (1, 1.32, 1)),
    Blob("thoracic_8", (0.018, 0, 0.01), (0.004, 0, 0.120), (0.109, 0.094), (1, 1.42, 1)),
    *mirrored([
        Blob("thoracic_8", (-0.012, 0.03, 0.205), (-0.014, 0.14, 0.172), (0.034, 0.036), blend=0.05),
        ball("thoracic_8", (0.060, 0.065, 0.085), 0.055, (0.8, 1.15, 1), blend=0.05),
    ]),
    Blob("thoracic_8", (-0.006, 0, 0.17), (-0.002, 0, 0.24), (0.066, 0.058), blend=0.04),
)  # fmt: skip

_SLEEVE = (
    Blob("left_clavicle", (-0.01, 0.04, -0.01), (-0.02, 0.145, 0.004), (0.048, 0.052), blend=0.05),
    Blob("left_shoulder", (0, -0.004, -0.004), (0, 0, -0.16), (0.060, 0.051), blend=0.05),
    Blob("left_shoulder", (0, 0, -0.16), (0, 0, -0.32), (0.051, 0.045), blend=0.005),
    Blob("left_elbow", (0, 0, 0), (0, 0, -0.10), (0.045, 0.045), blend=0.008),
    Blob("left_elbow", (0, 0, -0.10), (0, 0, -0.26), (0.045, 0.0335), blend=0.005),
)

_CUFF = (Blob("left_elbow", (0, 0, -0.218), (0, 0, -0.243), (0.0385, 0.0375), blend=0.004),)
_CUFF_CUTS = (Cut("left_elbow", (0, 0, -0.247), (0, 0, -1)), Cut("left_elbow", (0, 0, -0.212), (0, 0, 1)))

_LEG = (
    ball("pelvis", (-0.030, 0.060, -0.050), 0.084, blend=0.04),
    Blob("left_hip", (0.004, -0.006, -0.02), (0.004, 0, -0.22), (0.084, 0.077), blend=0.03),
    Blob("left_hip", (0.004, 0, -0.22), (0.004, 0, -0.42), (0.077, 0.062), blend=0.005),
    Blob("left_knee", (0.002, 0, 0), (-0.008, 0, -0.14), (0.061, 0.060), blend=0.008),
    Blob("left_knee", (-0.008, 0, -0.14), (-0.004, 0, -0.42), (0.060, 0.052), blend=0.005),
)

_SHOE = (
    Blob("left_ankle", (-0.004, 0, 0.045), (-0.012, 0, -0.02), (0.042, 0.043), blend=0.02),
    Blob("left_ankle", (-0.035, 0, -0.032), (0.085, 0.004, -0.038), (0.037, 0.036), blend=0.03),
    Blob("left_ankle", (0.05, 0.002, -0.025), (0.12, 0.005, -0.045), (0.036, 0.030), blend=0.03),
    Blob("left_toe", (-0.015, 0, 0.006), (0.045, -0.004, 0.004), (0.036, 0.031), (1, 1.22, 0.85), blend=0.03),
)
_SOLE = tuple(b._replace(radius=(b.radius[0] + 0.004, b.radius[1] + 0.004)) for b in _SHOE[1:])

_FINGER_KNUCKLES = {name: (across, along) for name, across, along, _ in anthropometry.FINGERS}
_METACARPAL = {"index": 0.0125, "middle": 0.0128, "ring": 0.0120, "little": 0.0110}


def _hand() -> tuple[Blob, ...]:
    """The left hand: forearm end, metacarpals, pads of the palm, fingers with their knuckles."""
    blobs = [
        Blob("left_elbow", (0, 0, -0.18), (0, 0, -0.25), (0.030, 0.0265), (1.08, 0.88, 1), blend=0.02),
        Blob("left_wrist", (0, 0, 0.0), (0.001, 0, -0.03), (0.0255, 0.0255), (1.08, 0.74, 1), blend=0.02),
    ]
    for name, (across, along) in _FINGER_KNUCKLES.items():
        base = (0.45 * across + 0.001, 0.0015, -0.022)
        radius = _METACARPAL[name]
        blobs.append(Blob("left_wrist", base, (across, 0.0005, -along + 0.004), (0.0145, radius), blend=0.010))
    blobs += [
        Blob("left_wrist", (0.014, -0.003, -0.026), (0.030, -0.004, -0.064), (0.0150, 0.0110), blend=0.010),
        Blob("left_wrist", (-0.018, -0.003, -0.030), (-0.030, -0.002, -0.070), (0.0140, 0.0110), blend=0.010),
    ]
    for finger in anthropometry.FINGER_NAMES:
        for number in (1, 2, 3):
            start = body_shapes.CAPSULE_RADIUS[f"{finger}_{number}"]
            end = body_shapes.CAPSULE_RADIUS.get(f"{finger}_{number + 1}", 0.88 * start)
            bone = finger_bone(finger, number)
            # The tip is round, so its last centimetre lies within the bone's length.
            reach = 1.0 if number < 3 else 1.0 - 0.75 * end / sum(c * c for c in bone) ** 0.5
            tip = tuple(reach * c for c in bone)
            blend = 0.012 if number == 1 else 0.004
            blobs.append(Blob(f"left_{finger}_{number}", (0, 0, 0), tip, (start, end), blend=blend))  # pyright: ignore
    return tuple(blobs)


def finger_bone(finger: str, number: int) -> Vector:
    """Bone of a left finger in the frame of its joint, m."""
    if finger == "thumb":
        x, z = anthropometry.THUMB_DIRECTION
        length = anthropometry.THUMB_BONES[number - 1]
        return (x * length, 0.0, z * length)
    bones = {name: lengths for name, _, _, lengths in anthropometry.FINGERS}[finger]
    return (0.0, 0.0, -bones[number - 1])


_FACE = (
    ball("head", (-0.004, 0, 0.086), 0.0765, (1.18, 0.97, 1.03)),
    Blob("head", (0.030, 0, 0.050), (0.044, 0, -0.012), (0.060, 0.042), (1, 0.97, 1), blend=0.04),
    ball("head", (0.044, 0, 0.098), 0.052, (1, 1.05, 1), blend=0.04),
    *mirrored([
        Blob("head", (0.008, 0.047, 0.008), (0.058, 0.018, -0.030), (0.020, 0.017), blend=0.03),
        ball("head", (0.064, 0.040, 0.028), 0.021, blend=0.03),
        ball("head", (0.051, 0.034, -0.002), 0.031, blend=0.03),
        Blob("head", (0.083, 0.010, 0.074), (0.068, 0.045, 0.075), (0.011, 0.010), blend=0.02),
    ]),
    ball("head", (0.074, 0, -0.034), 0.0175, blend=0.025),
    ball("head", (0.079, 0, -0.004), 0.021, (0.9, 1.15, 0.9), blend=0.025),
    *mirrored([ball("head", (0.106, 0.031, 0.050), 0.0185, (1, 1.1, 0.85), blend=0.014, carve=True)]),
    Blob("head", (0.090, 0, 0.062), (0.1075, 0, 0.026), (0.0075, 0.0105), blend=0.014),
    *mirrored([
        ball("head", (0.0995, 0.0115, 0.0225), 0.0075, blend=0.008),
        ball("head", (-0.004, 0.075, 0.044), 0.030, (0.60, 0.30, 1.05), blend=0.008),
        ball("head", (0.002, 0.086, 0.048), 0.018, (0.60, 0.30, 1.0), blend=0.006, carve=True),
    ]),
    Blob("neck", (-0.004, 0, -0.06), (0.006, 0, 0.03), (0.055, 0.052), blend=0.03),
    Blob("neck", (0.006, 0, 0.03), (0.010, 0, 0.11), (0.052, 0.050), blend=0.03),
)  # fmt: skip

_LIDS = mirrored([
    ball("head", (0.0795, 0.031, 0.0510), 0.0148, (1.0, 1.12, 1.0)),
    ball("head", (0.0980, 0.031, 0.0500), 0.0150, (1.0, 0.98, 0.42), blend=0.003, carve=True),
])  # fmt: skip

_LIPS = mirrored([
    Blob("head", (0.0990, 0.004, -0.0040), (0.0942, 0.0255, -0.0030), (0.0046, 0.0022), (1, 1, 0.8), blend=0.003),
    Blob("head", (0.0985, 0.000, -0.0120), (0.0942, 0.0245, -0.0042), (0.0056, 0.0022), (1, 1, 0.9), blend=0.001),
])  # fmt: skip

_BROWS = mirrored([
    Blob("head", (0.1035, 0.013, 0.0765), (0.0975, 0.032, 0.0785), (0.0038, 0.0042), (1, 1, 0.75), blend=0.003),
    Blob("head", (0.0975, 0.032, 0.0785), (0.0850, 0.050, 0.0715), (0.0042, 0.0028), (1, 1, 0.75), blend=0.003),
])  # fmt: skip

EYE_CENTRE, EYE_RADIUS = (0.0800, 0.0310, 0.0510), 0.0130
"""Left eyeball in the frame of the head."""

_SHORT_HAIR = (
    ball("head", (-0.008, 0, 0.091), 0.083, (1.16, 0.99, 1.02)),
    Blob("head", (-0.055, 0, 0.05), (-0.050, 0, 0.005), (0.052, 0.040), (1, 1.25, 1), blend=0.03),
    Blob("head", (0.060, 0.035, 0.150), (0.070, -0.03, 0.143), (0.022, 0.020), blend=0.03),
    ball("head", (0.020, 0, 0.155), 0.045, (1.2, 1.2, 0.7), blend=0.03),
    Blob("head", (0.140, 0, 0.090), (0.130, 0, -0.02), (0.080, 0.095), (1, 1, 1), blend=0.012, carve=True),
    *mirrored([ball("head", (0.005, 0.085, 0.030), 0.034, (0.8, 1, 1.25), blend=0.012, carve=True)]),
)
_LONG_HAIR = (
    ball("head", (-0.010, 0, 0.092), 0.085, (1.17, 1.0, 1.02)),
    Blob("head", (-0.055, 0, 0.05), (-0.062, 0, -0.085), (0.062, 0.050), (0.9, 1.35, 1), blend=0.04),
    *mirrored([
        Blob("head", (0.005, 0.062, 0.080), (-0.012, 0.072, -0.075), (0.030, 0.026), (1.1, 0.8, 1), blend=0.03),
    ]),
    Blob("head", (0.058, -0.035, 0.142), (0.066, 0.045, 0.120), (0.020, 0.020), blend=0.04),
    Blob("head", (0.150, 0, 0.070), (0.125, 0, -0.05), (0.082, 0.095), (1, 0.86, 1), blend=0.014, carve=True),
)  # fmt: skip

AVATAR = Look(
    colours={
        "skin": (0.80, 0.58, 0.46), "lips": (0.70, 0.40, 0.36), "hair": (0.26, 0.16, 0.10),
        "shirt": (0.16, 0.42, 0.50), "cuff": (0.13, 0.35, 0.42), "trousers": (0.20, 0.22, 0.28),
        "shoes": (0.86, 0.84, 0.80), "sole": (0.96, 0.95, 0.93),
    },
    hair=_SHORT_HAIR, hair_cuts=(), iris=(0.25, 0.38, 0.30),
)  # fmt: skip
PERSON = Look(
    colours={
        "skin": (0.55, 0.36, 0.26), "lips": (0.52, 0.27, 0.25), "hair": (0.12, 0.085, 0.07),
        "shirt": (0.88, 0.62, 0.26), "cuff": (0.78, 0.52, 0.20), "trousers": (0.30, 0.36, 0.50),
        "shoes": (0.35, 0.20, 0.16), "sole": (0.90, 0.87, 0.80),
    },
    hair=_LONG_HAIR, hair_cuts=(Cut("head", (0, 0, -0.105), (0, 0, -1)),), iris=(0.22, 0.13, 0.08),
)  # fmt: skip


def parts(look: Look) -> list[Part]:
    """All surfaces of a whole body."""
    neckline = Cut("thoracic_8", (0.0, 0, 0.222), (0.28, 0, 1))
    hem = Cut("pelvis", (0, 0, -0.062), (0, 0, -1))
    # Trousers end a little under the shirt, which follows a bending trunk, as they do not.
    waist = Cut("pelvis", (0, 0, -0.022), (0, 0, 1))
    sleeve_ends = mirrored([Cut("left_elbow", (0, 0, -0.236), (0, 0, -1))])
    return [
        Part("shirt", "shirt", (*_TRUNK_SHIRT, *mirrored(_SLEEVE)), (neckline, hem, *sleeve_ends)),
        Part("left_cuff", "cuff", _CUFF, _CUFF_CUTS, step=0.005),
        Part("trousers", "trousers",
             (Blob("pelvis", (0, 0, -0.03), (0.004, 0, 0.05), (0.100, 0.096), (1, 1.38, 1)), *mirrored(_LEG)),
             (*mirrored([Cut("left_knee", (0, 0, -0.405), (0, 0, -1))]), waist)),
        Part("left_shoe", "shoes", _SHOE, (Cut("left_ankle", (0, 0, -0.056), (0, 0, -1)),), step=0.012),
        Part("left_sole", "sole", _SOLE,
             (Cut("left_ankle", (0, 0, -0.067), (0, 0, -1)), Cut("left_ankle", (0, 0, -0.051), (0, 0, 1))), step=0.010),
        Part("left_hand", "skin", _hand(), step=0.0048),
        Part("head", "skin", _FACE, step=0.0075),
        Part("lids", "skin", _LIDS, step=0.0028),
        Part("lips", "lips", _LIPS, step=0.0025),
        Part("brows", "hair", _BROWS, step=0.0028),
        Part("hair", "hair", look.hair, look.hair_cuts, step=0.0095),
    ]  # fmt: skip


def mirror_image(part: Part) -> Part:
    """The right-hand part of a left-hand one."""
    items = mirrored([*part.blobs, *part.cuts])[1::2]
    blobs = tuple(i for i in items if isinstance(i, Blob))
    return part._replace(name=_other_side(part.name), blobs=blobs, cuts=tuple(i for i in items if isinstance(i, Cut)))
