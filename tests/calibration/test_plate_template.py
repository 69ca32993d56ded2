"""A plate's template: what is read, what no plate is like, and which markers are swapped."""

from pathlib import Path

import numpy as np
import pytest

from highfive.calibration.plate_template import load_template, swapped_markers
from highfive.hil.arm.hidden_arm import TEMPLATE
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations

TEXT = """
[plate]
centre_m = [0.18, 0.0, 0.0]
normal = [1.0, 0.0, 0.0]

[markers]
a = [0.0, 0.0, 0.062]
b = [0.0, 0.058, -0.022]
c = [0.0, -0.05, -0.037]
d = [-0.05, 0.02, 0.04]
"""


def test_a_template_is_read(tmp_path: Path) -> None:
    file = tmp_path / "plate.toml"
    file.write_text(TEXT)
    found = load_template(file)
    assert found.names == ("a", "b", "c", "d")
    np.testing.assert_allclose(found.markers[1], [0.18, 0.058, -0.022])


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("[1.0, 0.0, 0.0]", "[1.0, 1.0, 0.0]", "no unit vector"),
        ("[1.0, 0.0, 0.0]", "[1e200, 0.0, 0.0]", "no unit vector"),
        ("0.062", "62.0", "millimetres"),
        ("0.062]", "nan]", "not all numbers"),
        ("centre_m", "center_m", "centre_m missing"),
        ("[markers]", "[marks]", "markers missing"),
        ("[-0.05, 0.02, 0.04]", "[0.001, 0.0, 0.062]", "apart"),
    ],
)
def test_what_is_no_template_is_refused(tmp_path: Path, old: str, new: str, says: str) -> None:
    file = tmp_path / "plate.toml"
    file.write_text(TEXT.replace(old, new))
    with pytest.raises(HighFiveError, match=says):
        load_template(file)


@pytest.mark.parametrize("count", [1, 2])
def test_too_few_markers_are_refused(tmp_path: Path, count: int) -> None:
    file = tmp_path / "plate.toml"
    file.write_text("\n".join(TEXT.splitlines()[: 6 + count]))
    with pytest.raises(HighFiveError, match=f"it has {count} markers"):
        load_template(file)


def test_markers_that_nobody_tells_apart_are_refused(tmp_path: Path) -> None:
    """An isosceles triangle is its own mirror image: turned round, two of its corners are swapped."""
    file = tmp_path / "plate.toml"
    rows = "m1 = [0.0, 0.05, 0.0]\nm2 = [0.0, -0.05, 0.0]\nm3 = [0.0, 0.0, 0.06]"
    file.write_text(TEXT.partition("[markers]")[0] + "[markers]\n" + rows)
    with pytest.raises(HighFiveError, match="m1 and m2 swapped look the same"):
        load_template(file)


def test_swapped_markers_are_named_whatever_way_the_plate_is_turned() -> None:
    rng = np.random.default_rng(0)
    for a in range(5):
        for b in range(a):
            order = np.arange(5)
            order[[a, b]] = b, a
            turn = rotations.normalize(rng.normal(size=4))
            seen = rotations.rotate(turn, TEMPLATE.places) + rng.normal(0.0, 0.0005, (5, 3))
            assert swapped_markers(TEMPLATE, seen) is None
            assert swapped_markers(TEMPLATE, seen[order]) == (TEMPLATE.names[b], TEMPLATE.names[a])
