"""A kept placement: what was written is read, and what is none is refused in one line."""

import re
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highfive.calibration.placement import Placement
from highfive.calibration.placement_file import load_placement, save_placement
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations

NOW = datetime(2026, 11, 24, 8, 30, tzinfo=UTC)


@given(
    turn=st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3),
    shift=st.lists(st.floats(-20.0, 20.0), min_size=3, max_size=3),
)
def test_what_is_kept_is_read(turn: list[float], shift: list[float], tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("place") / "place.toml"
    kept = Placement(rotations.from_rotation_vector(np.array(turn)), np.array(shift), ("the floor is at +0.1 m",))
    save_placement(path, kept, "vicon", NOW)
    found = load_placement(path, "VICON")
    point = np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(found.apply(point), kept.apply(point), atol=1e-9)
    assert found.notes == ("placed as in place.toml, of 2026-11-24 08:30 UTC",) and not found.guesses


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("format = 1", "format = 2"), "meta.format is 2, this program reads 1"),
        (('"vicon"', '"qtm"'), "is of a qtm system, the person comes from vicon"),
        (("rotation = [1.0", "rotation = [2.0"), "no unit quaternion"),
        (("translation_m = [0.5", "translation_m = [500.5"), "in millimetres?"),
        (("translation_m = [0.500000000000", "translation_m = [nan"), "not all numbers"),
        (("translation_m", "translation"), "world.translation_m"),
        (("[world]", "[world"), "no TOML file"),
        (("2026-11-24T08:30:00Z", "2026-11-24"), "a date without a time"),
        (("2026-11-24T08:30:00Z", "0001-01-01T00:00:00+10:00"), "expected a date of our time"),
        (("2026-11-24T08:30:00Z", "9999-12-31T23:59:59-10:00"), "expected a date of our time"),
        (("translation_m = [0.500000000000", "translation_m = [1" + 400 * "0"), "more than 64 bits"),
        (("translation_m = [0.500000000000", "translation_m = [1" + 5000 * "0"), "no TOML file"),
        (("translation_m = [0.500000000000", "translation_m = [1e308"), "in millimetres?"),
        (("[meta]", "deep = " + 100_000 * "["), "no TOML file"),
    ],
)
def test_what_is_no_placement_is_refused_in_one_line(change: tuple[str, str], message: str, tmp_path: Path) -> None:
    path = tmp_path / "place.toml"
    save_placement(path, Placement(np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.5, 0.0, 0.0]), ()), "vicon", NOW)
    text = path.read_text(encoding="utf-8")
    assert change[0] in text
    path.write_text(text.replace(*change), encoding="utf-8")
    with pytest.raises(HighFiveError, match=re.escape(message)) as error:
        load_placement(path, "vicon")
    assert "\n" not in str(error.value)


def test_a_file_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    here = Placement(np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), ())
    with pytest.raises(HighFiveError, match="cannot write the placement"):
        save_placement(tmp_path / "missing" / "place.toml", here, "vicon", NOW)


def test_a_file_that_is_there_is_left_alone(tmp_path: Path) -> None:
    path, here = tmp_path / "place.toml", Placement(np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), ())
    path.write_text("mine", encoding="utf-8")
    with pytest.raises(HighFiveError, match="cannot write the placement"):
        save_placement(path, here, "vicon", NOW)
    assert path.read_text(encoding="utf-8") == "mine" and list(tmp_path.iterdir()) == [path]
