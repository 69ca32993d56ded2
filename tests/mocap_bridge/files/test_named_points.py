import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highfive.mocap_bridge.files.named_points import NamedPoints, frames_of, in_world, read_text, unit_by_size
from highfive.model.errors import HighFiveError

BODY = np.array([[0.0, 0.0, 1.7], [0.2, 0.0, 1.4], [0.2, 0.1, 0.8]])


def points(values, names=("a", "b", "c"), unit=None):
    return NamedPoints("a.csv", 100.0, tuple(names), np.asarray(values, dtype=float), unit)


@given(st.floats(0.4, 1.6), st.sampled_from(["mm", "cm", "m"]))
def test_a_person_of_any_size_tells_the_unit(size, unit):
    body = size * BODY / {"mm": 1e-3, "cm": 1e-2, "m": 1.0}[unit]
    found = unit_by_size(points(np.tile(body, (4, 1, 1))))
    assert found == (unit if (0.9 if unit == "cm" else 0.5) <= size * 0.9 <= 3.0 else None)


@given(st.floats(1.3, 2.1))
def test_a_person_in_inches_is_not_taken_for_a_small_one_in_centimetres(height):
    assert unit_by_size(points(np.tile(height / 0.9 * BODY / 0.0254, (4, 1, 1)))) is None


@pytest.mark.parametrize("size", [10.0, 30.0, 0.2, 5000.0, 0.0])
def test_what_no_person_is_as_large_as_is_in_doubt(size):
    assert unit_by_size(points(np.tile(size * BODY / 0.9, (4, 1, 1)))) is None


def test_two_people_are_measured_each_and_have_to_agree():
    far = np.concatenate([BODY, BODY + np.array([3.0, 0.0, 0.0])])
    names = [f"{who}:{part}" for who in ("human", "avatar") for part in "abc"]
    assert unit_by_size(points(np.tile(far, (4, 1, 1)), names)) == "m"
    far[3:] *= 1000.0
    assert unit_by_size(points(np.tile(far, (4, 1, 1)), names)) is None


@given(st.lists(st.tuples(*[st.floats(-3, 3)] * 3), min_size=3, max_size=3))
def test_y_up_is_a_turn_that_keeps_distances_and_right_hands(rows):
    here = np.array(rows)
    found = in_world(points([here, here]), 1.0, "y").points[0]
    np.testing.assert_allclose(found[:, 2], here[:, 1])
    np.testing.assert_allclose(found @ found.T, here @ here.T, atol=1e-9)
    volumes = [np.dot(np.cross(rows[0], rows[1]), rows[2]) for rows in (found, here)]
    assert volumes[0] == pytest.approx(volumes[1], abs=1e-9)


def test_units_and_what_is_missing():
    values = np.tile(BODY, (2, 1, 1)) * 1000.0
    values[1, 2] = np.nan
    found = in_world(points(values), 1e-3, "z")
    np.testing.assert_array_equal(found.valid, [[True] * 3, [True, True, False]])
    np.testing.assert_allclose(found.points[0], BODY)
    np.testing.assert_array_equal(found.points[1, 2], 0.0)
    with pytest.raises(HighFiveError, match=r"a\.csv has labels, but not one measured point"):
        in_world(points(np.full((4, 3, 3), np.nan)), 1.0, "z")


@given(st.integers(0, 1000), st.sampled_from([25.0, 100.0, 120.0, 240.0]))
def test_stamps_that_jitter_and_lose_frames_still_count_them(seed, rate):
    rng = np.random.default_rng(seed)
    frames = np.sort(rng.choice(np.arange(1, 199), 150, replace=False))
    frames = np.concatenate([[0], frames, [199]])
    times = frames / rate + rng.uniform(-0.1, 0.1, len(frames)) / rate
    found_rate, found = frames_of(times, "a")
    np.testing.assert_array_equal(found, frames)
    assert found_rate == pytest.approx(rate, rel=2e-3)


def test_files_that_are_no_text(tmp_path):
    path = tmp_path / "a.bvh"
    for content, says in ((b"", "is empty"), (b" \n\n", "is empty"), (b"\x00\x01\x02" * 99, "no text")):
        path.write_bytes(content)
        with pytest.raises(HighFiveError, match=says):
            read_text(path)
    with pytest.raises(HighFiveError, match="No such file"):
        read_text(tmp_path / "none.bvh")
    with pytest.raises(HighFiveError, match="is a folder"):
        read_text(tmp_path)
    path.write_bytes(b"\xef\xbb\xbfH\xc3\xa4nde")
    assert read_text(path) == "Hände"
    path.write_bytes("Hände".encode("latin-1"))
    assert read_text(path) == "Hände"
