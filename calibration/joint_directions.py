"""Which way each joint really turns, from small turns of one joint at a time, before anything else is fitted."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from highfive.calibration.arm_kinematics import ArmShape, as_drawn, frames_of, marker_places
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

MOVED_M = 0.002
"""m that markers have to move at least for a joint's turn to be seen: 0.5 mm are noise."""
MISFIT = 0.5
"""Share of what moved that may be left unexplained by the best set of directions."""


def reversed_joints(shape: ArmShape, middle: Array, lower: Array, upper: Array, seen: Array) -> tuple[str, ...]:
    """Joints that turn the other way than their encoders say; all sets of directions are tried.

    Args:
        shape: the arm as drawn, J joints and M markers.
        middle: (J,) rad, the posture about which joints were turned.
        lower, upper: (J,) rad, where each joint stood by its encoder, the others in the middle.
        seen: (J, 2, M, 3) m, markers then, in the motion capture's frame; NaN where unseen.

    Raises:
        HighFiveError: a joint did not move the markers, or no set of directions explains what they did.
    """
    moves = seen[:, 1] - seen[:, 0]
    shown: NDArray[np.bool_] = np.all(np.isfinite(moves), axis=-1)
    for j, name in enumerate(shape.names):
        if not shown[j].any():
            raise HighFiveError(f"{name} was turned and no marker was seen on both sides; clear the cameras' view")
        length = float(np.linalg.norm(moves[j][shown[j]], axis=1).max())
        if length < MOVED_M:
            raise HighFiveError(
                f"{name} was turned by {np.degrees(upper[j] - lower[j]):.1f}°, the plate moved {1e3 * length:.1f} mm: "
                "does its servo drive it, and are the markers on this arm's plate?"
            )
    moves = np.where(shown[..., None], moves, 0.0)
    sizes = np.sqrt(np.sum(moves**2, axis=(1, 2), keepdims=True))
    found = [(_unexplained(shape, middle, lower, upper, signs, moves / sizes, shown, sizes), signs)
             for signs in product((1.0, -1.0), repeat=len(middle))]  # fmt: skip
    found.sort(key=lambda one: (round(one[0], 6), one[1].count(-1.0)))
    least, signs = found[0]
    if least > MISFIT:
        raise HighFiveError(
            "the plate's moves fit no set of directions of the joints; is this the arm of the rig file, and was only "
            "one joint turned at a time?"
        )
    return tuple(name for name, sign in zip(shape.names, signs, strict=True) if sign < 0.0)


def turned_by(shape: ArmShape, middle: Array, lower: Array, upper: Array, seen: Array) -> Array:
    """The rotation (3, 3) from the arm as drawn to the motion capture's frame, by the same small turns."""
    shown: NDArray[np.bool_] = np.all(np.isfinite(seen), axis=(1, 3))
    moves = np.where(shown[..., None], seen[:, 1] - seen[:, 0], 0.0)
    expected = np.where(shown[..., None], _expected(shape, middle, lower, upper, np.ones(len(middle))), 0.0)
    return rotations.nearest_rotation(np.einsum("jmr,jmc->rc", moves, expected))


def _expected(shape: ArmShape, middle: Array, lower: Array, upper: Array, signs: Array) -> Array:
    """(J, M, 3) m, by which markers move as each joint is turned, in the frame of the arm as drawn."""
    joints = len(middle)
    postures = np.repeat(middle[None], 2 * joints, axis=0)
    postures[np.arange(joints), np.arange(joints)] = lower
    postures[joints + np.arange(joints), np.arange(joints)] = upper
    errors = as_drawn(shape)
    places = marker_places(shape, errors, frames_of(shape, errors, postures * signs))
    return places[joints:] - places[:joints]


def _unexplained(
    shape: ArmShape, middle: Array, lower: Array, upper: Array, signs: tuple[float, ...], moves: Array,
    shown: NDArray[np.bool_], sizes: Array,
) -> float:  # fmt: skip
    """Share of the joints' moves (J, M, 3), each of length 1, that no rotation of the arm with these signs explains."""
    expected = np.where(shown[..., None], _expected(shape, middle, lower, upper, np.array(signs)), 0.0) / sizes
    rotation = rotations.nearest_rotation(np.einsum("jmr,jmc->rc", moves, expected))
    return float(np.sum((moves - expected @ rotation.T) ** 2) / len(middle))
