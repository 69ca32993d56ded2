"""By what one arm differs from its drawing, put into the numbers that the compiled functions work on.

Frames of the drawing are parallel to the base where all joints are zero, and an arm's tilts turn all that follows: with
Cⱼ the tilts up to joint j, one after the other, its frame is G Cⱼ, where G are frames whose axes are Cⱼ times the drawn
ones, and nothing but those turns. So axes, offsets, masses and plate are the drawing's, turned by their Cⱼ; no
function that works on them knows of tilts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from highfive.hil.arm_model.from_mujoco import ArmBody
from highfive.model.geometry.rotations import Array, from_rotation_vector, to_matrix


@dataclass(frozen=True, eq=False)
class Corrections:
    """Of an arm with J joints. Zeros are not among them: what its servos say is put right where it is read.

    Attributes:
        lengths: (J, 3) m, added to the offsets, in the frame before each joint.
        tilts: (J, 3) rad, rotation vectors there, of the joints' axes and all that follows.
        compliance: (J,) rad/(N·m), by which joints give way that their encoders do not see.
        plate, normal: (3,) m and a unit vector, of the plate's surface in the last joint's frame.
    """

    lengths: Array
    tilts: Array
    compliance: Array
    plate: Array
    normal: Array

    @property
    def turns(self) -> Array:
        """(J, 3, 3): the tilts up to each joint."""
        found, turn = [], np.eye(3)
        for tilt in to_matrix(from_rotation_vector(self.tilts)):
            turn = turn @ tilt
            found.append(turn)
        return np.array(found)


def corrected(body: ArmBody, by: Corrections) -> ArmBody:
    """The arm as it is; its limits are those of its stops."""
    turns = by.turns
    before = np.concatenate([np.eye(3)[None], turns[:-1]])
    normal = turns[-1] @ by.normal
    fingers = turns[-1] @ body.fingers
    fingers = fingers - (fingers @ normal) * normal
    return replace(
        body,
        axes=np.einsum("jrc,jc->jr", turns, body.axes),
        offsets=np.einsum("jrc,jc->jr", before, body.offsets + by.lengths),
        centres=np.einsum("jrc,jc->jr", turns, body.centres),
        inertias=turns @ body.inertias @ np.swapaxes(turns, 1, 2),
        plate=turns[-1] @ by.plate,
        normal=normal,
        fingers=fingers / np.linalg.norm(fingers),
    )
