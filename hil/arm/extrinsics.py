"""Takes the postures of an extrinsic calibration: which way each joint turns, then the plate from everywhere."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from highfive.calibration.arm_kinematics import ArmShape
from highfive.calibration.joint_directions import reversed_joints, turned_by
from highfive.calibration.pose_file import TakenPose
from highfive.calibration.rigid_fit import rigid_fit
from highfive.hil.arm.plate_watch import PlateWatch, StillMoves
from highfive.hil.arm.posture_drive import PostureDrive
from highfive.hil.arm_model.servo_arm import ServoArm
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

TURN = np.radians(5.0)
"""rad, by which each joint is turned, both ways."""
HOLD_S = 0.75
"""A posture is looked at for so long, s."""
SAME = 0.002
"""m, root mean square: markers that fit a plate's template so well are not mirrored."""
MIRRORED = "the plate is seen as in a mirror: the motion capture's axes are left-handed; set its up axis"
TRIES = 3
"""Times that a posture is looked at while the plate still moves."""
SIZE = 0.02
"""Share by which a plate may be seen larger or smaller than its template: a millimetre of 80."""
LEANS = np.radians(30.0)
"""Most by which the arm may seem to lean: beyond it the stream has another axis up."""
SIDES = 0.02
"""rad: a joint that came from nearer than this has no side of approach."""


def check_directions(drive: PostureDrive, watch: PlateWatch, shape: ArmShape, arm: ServoArm) -> None:
    """Turns one joint at a time, about where the ``arm`` waits; ``shape`` is it as drawn, with the plate.

    Raises:
        HighFiveError: the stream is mirrored, mis-scaled or not z up, joints are reversed, all of them by name, or the
            plate is not seen.
    """
    ready, joints = arm.ready, arm.joints
    lower, upper = np.empty(joints), np.empty(joints)
    seen = np.empty((joints, 2, len(shape.markers), 3))
    middle = np.zeros(joints)
    for joint in range(joints):
        for side, turn in enumerate((-TURN, TURN)):
            target = ready.copy()
            target[joint] += turn
            pose = taken(drive, watch, target, drive.go(target))
            check_plate(shape.markers[pose.seen], pose.markers[pose.seen])
            (lower if side == 0 else upper)[joint] = pose.encoders[joint]
            seen[joint, side] = np.where(pose.seen[:, None], pose.markers, np.nan)
            middle += pose.encoders / (2 * joints)
        drive.go(ready)
    turns = shape, middle, lower, upper, seen
    if wrong := drive.while_standing(lambda: reversed_joints(*turns)):
        if drive.while_standing(lambda: _as_in_a_mirror(*turns)):  # of a flat plate, which looks the same there
            raise HighFiveError(f"{MIRRORED}; or else these are reversed: {', '.join(wrong)}")
        raise HighFiveError(
            f"{', '.join(wrong)}: turned the other way than the servos say; correct `reversed` in the rig's file, then "
            f"{drive.command('configure')}"
        )
    up = turned_by(*turns) @ rotations.to_matrix(arm.mount.quaternion)[2]
    if (leans := float(np.arccos(np.clip(up[2], -1.0, 1.0)))) > LEANS:
        raise HighFiveError(
            f"the arm seems to lean by {np.degrees(leans):.0f}° against its drawing: set the motion capture's axes "
            "to z up, or the arm's mount as it is"
        )


def check_plate(markers: Array, places: Array) -> None:
    """Refuses a stream in which a plate with markers (M, 3), m, is at ``places`` (M, 3), m, mirrored (where they are
    off one plane), or of another size.

    Raises:
        HighFiveError: it is.
    """
    fit = rigid_fit(markers, places)
    if fit.rms > SAME and fit.mirrored:
        raise HighFiveError(f"{MIRRORED} ({1e3 * fit.mirrored_rms:.1f} against {1e3 * fit.rms:.1f} mm)")
    if abs(fit.scale - 1.0) > SIZE:
        raise HighFiveError(
            f"the plate is seen {100.0 * fit.scale:.1f} % as large as its template says: calibrate the motion "
            "capture's scale (its wand), or measure the template again"
        )


def _as_in_a_mirror(shape: ArmShape, middle: Array, lower: Array, upper: Array, seen: Array) -> bool:
    try:
        return not reversed_joints(shape, middle, lower, upper, seen * [1.0, -1.0, 1.0])
    except HighFiveError:
        return False


def take_poses(
    drive: PostureDrive,
    watch: PlateWatch,
    ready: Array,
    stages: Sequence[Array],
    before: Sequence[TakenPose] = (),
    kept: Callable[[list[TakenPose]], object] = lambda poses: None,
) -> list[TakenPose]:
    """Visits postures, and looks at the plate in each.

    Args:
        drive, watch: arm and plate.
        ready: (J,) rad, where the arm waits; there it is not looked at.
        stages: :func:`highfive.hil.arm.posture_route.route`.
        before: poses that were taken already.
        kept: gets all poses after each.

    Raises:
        HighFiveError: the arm was stopped, somebody stayed in the way, or the plate is not seen.
    """
    poses = list(before)
    for target in stages:
        sides = _sides(drive, target)
        if not np.array_equal(target, ready):
            poses.append(taken(drive, watch, target, sides))
            kept(poses)
    return poses


def _sides(drive: PostureDrive, target: Array) -> Array:
    start = drive.positions
    return drive.go(target) * (np.abs(target - start) > SIDES)


def taken(drive: PostureDrive, watch: PlateWatch, asked: Array, sides: Array) -> TakenPose:
    """Looks at the plate where the arm stands, having come from ``sides`` (J,).

    Raises:
        HighFiveError: the plate is not seen, or still moves.
    """
    for attempt in range(TRIES):
        encoders: list[Array] = []
        watch.begin()
        drive.hold(HOLD_S, encoders, watch.look)
        try:
            return TakenPose(asked, np.mean(encoders, axis=0), sides, *watch.pose())
        except StillMoves:
            if attempt + 1 == TRIES:
                raise
    raise AssertionError
