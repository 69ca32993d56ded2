"""What a full disk, or a crash on it, leaves of a recording: everything that came."""

import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from highfive.hil.commands.stream.record import Recorder, recover
from highfive.mocap_bridge.files.c3d import read_c3d
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.model.errors import HighFiveError


@contextmanager
def room_for(size: int) -> Iterator[None]:
    """No file grows beyond ``size`` bytes: a full disk that needs no disk to fill."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def frame(number: int) -> MarkerFrame:
    points = np.arange(12.0).reshape(4, 3) + 1e-3 * number
    return MarkerFrame(
        names=("a", "b", "c", "d"),
        positions=points,
        valid=np.ones(4, dtype=bool),
        number=number,
        source_time_ns=round(number * 1e9 / 120.0),
        arrival_time_ns=round(number * 1e9 / 120.0),
        unlabelled=np.zeros((0, 3)),
    )


def test_a_full_disk_ends_the_recording_and_keeps_what_came_until_there_is_room(tmp_path: Path) -> None:
    take, raw = tmp_path / "take.c3d", tmp_path / "take.c3d.part"
    with room_for(3_000):
        recorder = Recorder(take)
        for number in range(100):
            recorder([frame(number)], 120.0)
        came = recorder.frames
        assert 10 < came < 100
        assert "recording stopped" in recorder.trouble
    with room_for(1_000), pytest.raises(HighFiveError, match=r"what came is in .*take\.c3d\.part"):
        recorder.finish()
    kept = raw.read_bytes()
    for _ in range(3):  # the disk is still full: whoever tries again loses nothing
        with room_for(1_000), pytest.raises(HighFiveError, match="cannot be saved"):
            recover(take)
        assert sorted(path.name for path in tmp_path.iterdir()) == ["take.c3d.part"]
        assert raw.read_bytes() == kept
    assert f"{came} frames of it are now in" in recover(take)
    saved = read_c3d(tmp_path / "take-recovered.c3d")
    assert len(saved) == came
    np.testing.assert_allclose(saved.points[-1], frame(came - 1).positions, atol=1e-5)
    assert not raw.exists()


def test_a_disk_that_was_full_from_the_first_is_not_in_the_way(tmp_path: Path) -> None:
    take = tmp_path / "take.c3d"
    with room_for(0), pytest.raises(HighFiveError, match="cannot record to"):
        Recorder(take)
    assert recover(take) == ""
    Recorder(take).finish()
    assert not list(tmp_path.iterdir())


def test_what_is_no_recording_is_left_alone(tmp_path: Path) -> None:
    take, raw = tmp_path / "take.c3d", tmp_path / "take.c3d.part"
    raw.write_text("somebody's own notes")
    with pytest.raises(HighFiveError, match="no raw recording"):
        recover(take)
    assert raw.read_text() == "somebody's own notes"
