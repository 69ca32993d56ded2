"""Simple shapes that stand for the bodies in contact and inertia; what the eye sees is in ``appearance``.

A shape lies in the frame of the joint that carries it, for the left side and the trunk; the right side is its mirror
image in the x–z plane. Sizes are half axes or radii in m, chosen to lie just inside the visible surface, so that a
contact never shows as two surfaces that do not yet touch.
"""

from __future__ import annotations

from highfive.scenes.anthropometry import PALM_CENTRE, PALM_THICKNESS

# joint: (centre, half axes)
ELLIPSOIDS: dict[str, tuple[tuple[float, float, float], tuple[float, float, float]]] = {
    "pelvis": ((0.0, 0.0, -0.01), (0.095, 0.140, 0.085)),
    "lumbar_5": ((0.015, 0.0, 0.035), (0.085, 0.130, 0.060)),
    "lumbar_3": ((0.015, 0.0, 0.040), (0.085, 0.122, 0.060)),
    "thoracic_12": ((0.018, 0.0, 0.050), (0.092, 0.128, 0.070)),
    "thoracic_8": ((0.015, 0.0, 0.090), (0.100, 0.138, 0.105)),
    "head": ((0.022, 0.0, 0.062), (0.094, 0.074, 0.108)),
    # Domed like a palm: two palms touch at their centres even when they are a few degrees out of parallel.
    "wrist": ((0.0, 0.0, -PALM_CENTRE), (0.042, 0.5 * PALM_THICKNESS, 0.050)),
}

# joint: radius of the capsule along the bone
CAPSULE_RADIUS = {
    "neck": 0.050, "clavicle": 0.040, "shoulder": 0.040, "elbow": 0.029,
    "hip": 0.064, "knee": 0.045, "ankle": 0.034, "toe": 0.020,
    "thumb_1": 0.0120, "thumb_2": 0.0105, "thumb_3": 0.0090,
    "index_1": 0.0090, "index_2": 0.0080, "index_3": 0.0070,
    "middle_1": 0.0092, "middle_2": 0.0082, "middle_3": 0.0072,
    "ring_1": 0.0088, "ring_2": 0.0078, "ring_3": 0.0068,
    "little_1": 0.0078, "little_2": 0.0068, "little_3": 0.0060,
}  # fmt: skip

TOE_LENGTH = 0.055
"""Toe joint to the tip of the toes, m."""

TISSUE_DENSITY = 1100.0
"""kg/m³ of a finger (de Leva 1996 after Clauser et al. 1969: hand 1.16, soft tissue about 1.05)."""

PERSON_HAND_MASS = 0.8
"""kg that a person's palm brings into a contact: the hand (0.45 kg) and a part of the forearm."""

PERSON_FINGER_BEND_DEGREES = 6.0
"""Bend of each finger joint of the person's open hand."""

HEAD_CENTRE = (0.022, 0.0, 0.062)
"""Centre of the head in the frame of the joint ``head``, m."""
