"""The world from markers on the floor: laws of the transform, and what is no floor."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highfive.calibration.room_frame import room_from_markers
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations

NAMES = ("origin", "ahead", "left")
angle = st.floats(-np.pi, np.pi)
place = st.tuples(*[st.floats(-3.0, 3.0)] * 2, st.floats(-0.2, 0.2))


@given(angle, place, st.floats(0.15, 2.0), st.floats(0.15, 2.0), st.floats(np.radians(30), np.radians(150)), angle)
def test_markers_come_to_lie_where_they_are_in_the_world(
    turn: float, at: tuple[float, float, float], ahead: float, aside: float, corner: float, lean_way: float
) -> None:
    """Wherever the motion capture's origin is, and whichever way a floor of 2° leans in it."""
    world = np.array([[0, 0, 0.02], [ahead, 0, 0.02], [aside * np.cos(corner), aside * np.sin(corner), 0.02]])
    lean = rotations.from_rotation_vector(np.radians(2.0) * np.array([np.cos(lean_way), np.sin(lean_way), 0.0]))
    mocap = rotations.multiply(lean, rotations.from_axis_angle("z", turn))
    seen = rotations.rotate(mocap, world) + np.array(at)
    found = room_from_markers(seen, NAMES, 0.02)
    np.testing.assert_allclose(found.apply(seen), world, atol=1e-9)


@given(angle, place)
def test_a_wand_takes_the_motion_captures_vertical(turn: float, at: tuple[float, float, float]) -> None:
    mocap = rotations.from_axis_angle("z", turn)
    seen = rotations.rotate(mocap, np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.01]])) + np.array(at)
    found = room_from_markers(seen, NAMES[:2], 0.0)
    np.testing.assert_allclose(found.apply(seen), [[0.0, 0.0, 0.0], [0.4, 0.0, 0.01]], atol=1e-9)
    up = rotations.rotate(found.rotation, np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(up, [0.0, 0.0, 1.0], atol=1e-12)


@pytest.mark.parametrize(
    ("places", "says"),
    [
        ([[0, 0, 0], [0.4, 0, 0], [0, -0.3, 0]], "lies to the right"),
        ([[0, 0, 0], [0.4, 0, 0], [0.8, 0.05, 0]], "almost in a line"),
        ([[0, 0, 0], [0.04, 0, 0], [0, 0.3, 0]], "ahead is 0.04 m from origin"),
        ([[0, 0, 0], [400, 0, 0], [0, 300, 0]], "does the motion capture send metres"),
        ([[0, 0, 0], [0.4, 0, 0], [0, 0.3, 0.1]], "lean by 18.4°"),
        ([[0, 0, 0], [0, 0, 0.4], [0, 0.3, 0]], "lies? to the right|lean by 90"),
        ([[0, 0, 0], [0.3, 0, 0.3]], "lean by 45.0°"),
    ],
)
def test_what_is_no_floor_is_refused(places: list[list[float]], says: str) -> None:
    with pytest.raises(HighFiveError, match=says):
        room_from_markers(np.array(places, float), NAMES[: len(places)], 0.0)
