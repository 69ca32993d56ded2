"""How two calibrations of one arm differ: at its plate, which is what a session relies on, and in the room."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from highfive.calibration.arm_file import ArmCalibration
from highfive.calibration.arm_kinematics import ArmShape, frames_of, gravity_torques, true_angles
from highfive.calibration.pose_check import calibrated
from highfive.calibration.registration import REGISTRATION
from highfive.calibration.rigid_fit import rigid_fit
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class ArmDifference:
    """Of one calibration from another, for the same encoders.

    Attributes:
        plate: (N,) m, of the plate's middle in the motion capture's frame; empty for two systems, whose frames have
            nothing to do with each other.
        moved: m, and ...
        turned: ... rad, of the arm as a whole in that frame: a base that was bumped, or cameras calibrated anew.
        bent: (N,) m, of the plate's middle once that is taken off: horns, links, or the plate.
        worst: m, most that 95 of 100 may be off.
    """

    plate: Array
    moved: float
    turned: float
    bent: Array
    worst: float = REGISTRATION.worst

    @property
    def trouble(self) -> str:
        """Why the two do not say the same; '' where they do."""
        plate = self.plate if self.plate.size else self.bent
        if (off := float(np.percentile(plate, 95))) <= self.worst:
            return ""
        bent = float(np.percentile(self.bent, 95))
        why = "a horn, a servo or the plate" if bent > self.worst else "the base was bumped, or the cameras"
        return (
            f"they disagree: the plate is {1e3 * off:.1f} mm apart (95 % of {len(plate)} postures), at most "
            f"{1e3 * self.worst:g} are the same; {1e3 * bent:.1f} are left once the arm is moved as a whole: "
            f"{why} changed in between"
        )


def plate_places(shape: ArmShape, found: ArmCalibration, encoders: Array) -> Array:
    """(N, 3) m, the plate's middle where a calibration has it in the world, with encoders (N, J), rad."""
    errors, none = calibrated(shape, found), np.zeros_like(encoders)
    torques = gravity_torques(shape, frames_of(shape, errors, true_angles(errors, encoders, none, none)), _UP)
    frames = frames_of(shape, errors, true_angles(errors, encoders, torques, none))
    return frames.centres[:, -1] + frames.last @ found.plate


def in_mocap(found: ArmCalibration, places: Array) -> Array:
    """Places (N, 3), m, of the world in the motion capture's frame."""
    room = found.registration
    return rotations.rotate(rotations.conjugate(room.world_from_mocap), places - room.translation)


def arm_difference(
    shapes: tuple[ArmShape, ArmShape], one: ArmCalibration, two: ArmCalibration, encoders: Array
) -> ArmDifference:
    """How the second differs from the first.

    Args:
        shapes: the arm as drawn, with the markers of each.
        one, two: of the same arm.
        encoders: (N, J) rad, postures from all over its room; 4 or more.
    """
    places = [
        in_mocap(found, plate_places(shape, found, encoders)) for shape, found in zip(shapes, (one, two), strict=True)
    ]
    as_a_whole = rigid_fit(places[0], places[1])
    base = in_mocap(one, one.mount[None])
    same_room = one.registration.system == two.registration.system
    return ArmDifference(
        plate=np.linalg.norm(places[1] - places[0], axis=1) if same_room else np.zeros(0),
        moved=float(np.linalg.norm(as_a_whole.apply(base) - base)),
        turned=float(np.linalg.norm(rotations.to_rotation_vector(rotations.from_matrix(as_a_whole.rotation)))),
        bent=np.linalg.norm(places[1] - as_a_whole.apply(places[0]), axis=1),
    )
