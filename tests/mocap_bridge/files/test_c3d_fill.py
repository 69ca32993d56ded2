"""A file with its gaps filled is the same file but for the points that were missing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from highfive.mocap_bridge.files.c3d import BLOCK, MAX_BYTES, layout_of, read_bytes, read_c3d, write_c3d
from highfive.mocap_bridge.files.c3d_fill import _put_back, _words, write_filled
from highfive.mocap_bridge.files.recording import make_recording
from highfive.model.errors import HighFiveError

NAMES = ("A:RFIN", "A:RWRA", "B:RFIN")


@pytest.fixture
def gappy(tmp_path: Path) -> Path:
    rng = np.random.default_rng(0)
    points = np.cumsum(rng.normal(scale=0.01, size=(30, 3, 3)), axis=0) + 1.0
    recording = make_recording(120.0, NAMES, points, rng.random((30, 3)) > 0.3)
    ghosts = np.full((30, 2, 3), 0.7)
    write_c3d(tmp_path / "gappy.c3d", replace(recording, unlabelled=ghosts, unlabelled_valid=ghosts[..., 0] > 0))
    return tmp_path / "gappy.c3d"


def test_only_missing_points_that_may_be_filled_are(gappy: Path, tmp_path: Path):
    before = read_c3d(gappy)
    usable = np.arange(30) % 2 == 0
    count = write_filled(gappy, tmp_path / "out.c3d", {"A:RFIN": (np.full((30, 3), 0.25), usable), "A:none": ()})
    after = read_c3d(tmp_path / "out.c3d")
    put_in = ~before.valid[:, 0] & usable
    assert count == put_in.sum() > 0
    np.testing.assert_array_equal(after.valid[:, 0], before.valid[:, 0] | usable)
    np.testing.assert_array_equal(after.points[put_in, 0], np.full((count, 3), 0.25))
    np.testing.assert_array_equal(after.points[before.valid], before.points[before.valid])
    np.testing.assert_array_equal(after.valid[:, 1:], before.valid[:, 1:])
    np.testing.assert_array_equal(after.unlabelled, before.unlabelled)


def test_nothing_to_fill_gives_the_same_bytes(gappy: Path, tmp_path: Path):
    nothing = {"A:RFIN": (np.zeros((30, 3)), np.zeros(30, dtype=bool))}
    assert write_filled(gappy, tmp_path / "out.c3d", nothing) == 0
    assert (tmp_path / "out.c3d").read_bytes() == gappy.read_bytes()


@pytest.mark.parametrize("processor", [84, 85, 86])
@pytest.mark.parametrize("scale", [-0.1, 0.05])
def test_every_byte_order_and_number_format_goes_there_and_back(gappy: Path, processor: int, scale: float):
    layout = replace(layout_of(read_bytes(gappy, MAX_BYTES), "x"), processor=processor, scale=scale)
    rng = np.random.default_rng(1)
    words = rng.integers(-30_000, 30_000, size=(layout.frames, layout.words_a_frame))
    size = layout.start + words.size * 4
    data = bytearray(rng.integers(0, 256, size=size + BLOCK, dtype=np.uint8).tobytes())
    around = bytes(data[: layout.start]), bytes(data[size:])
    _put_back(data, layout, words.astype(np.float32 if scale < 0 else np.int16))
    np.testing.assert_array_equal(_words(data, layout), words)
    assert (bytes(data[: layout.start]), bytes(data[size:])) == around
    once = bytes(data)
    _put_back(data, layout, _words(data, layout))
    assert bytes(data) == once


def test_what_cannot_be_written_or_read_is_said_in_a_line(gappy: Path, tmp_path: Path):
    with pytest.raises(HighFiveError, match="cannot write"):
        write_filled(gappy, tmp_path / "no" / "out.c3d", {})
    with pytest.raises(HighFiveError, match="no file"):
        write_filled(tmp_path / "none.c3d", tmp_path / "out.c3d", {})
    assert [path.name for path in tmp_path.iterdir()] == ["gappy.c3d"]
