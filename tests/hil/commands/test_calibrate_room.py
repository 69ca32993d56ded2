"""``highfive calibrate room`` against a system's frames, in virtual time."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from highfive.calibration.placement_file import load_placement
from highfive.hil.commands.calibrate_room import RoomOptions, calibrate_room
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.runtime.virtual_scheduler import VirtualScheduler
from highfive.hil.trials.frame_link import FrameLink, SentFrames
from highfive.hil.trials.live_wiring import LiveWiring
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.model.errors import HighFiveError

NAMES = ("L1", "L2", "L3", "RFIN")
FLOOR = np.array([[1.0, 2.0, 0.012], [1.0, 2.5, 0.012], [0.7, 2.0, 0.012], [1.3, 2.4, 1.1]])
"""The avatar faces +y; somebody's finger is there as well."""


def looked(
    options: RoomOptions, change: Callable[[int, np.ndarray, np.ndarray], object] = lambda *_: None
) -> dict[str, Any]:
    rng, frames = np.random.default_rng(0), []
    for number in range(400):
        places, valid = FLOOR + rng.normal(0.0, 0.0005, FLOOR.shape), rng.random(4) > 0.03
        change(number, places, valid)
        arrival = 1_000_000_000 + round(number * 1e9 / 100.0)
        frames.append(MarkerFrame(NAMES, places, valid, number, arrival, arrival, np.zeros((0, 3))))
    with VirtualClock(1) as clock:
        link = lambda _: lambda: FrameLink(clock, 100.0, SentFrames(frames))  # noqa: E731
        return calibrate_room(options, LiveWiring(clock, VirtualScheduler(clock), link))


def test_the_world_is_where_the_markers_say(tmp_path: Path) -> None:
    file = tmp_path / "place.toml"
    options = RoomOptions("vicon://cameras", NAMES[:3], 0.012, file)
    found = looked(options)
    assert found["facing_deg"] == pytest.approx(90.0, abs=0.3)
    placement = load_placement(file, "vicon")
    world = placement.apply(np.array([[1.0, 2.0, 0.0], [1.0, 4.0, 0.0]]))
    np.testing.assert_allclose(world, [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]], atol=0.005)
    with pytest.raises(HighFiveError, match="is there already"):
        looked(options)
    assert looked(RoomOptions("vicon://cameras", NAMES[:2], 0.012, file, overwrite=True))["out"] == str(file)


def test_markers_that_are_hidden_or_moved_are_said(tmp_path: Path) -> None:
    options = RoomOptions("vicon://cameras", NAMES[:3], 0.0, tmp_path / "place.toml")

    def hides(number: int, places: np.ndarray, valid: np.ndarray) -> None:
        valid[1] = number % 2 == 0

    def moves(number: int, places: np.ndarray, valid: np.ndarray) -> None:
        places[2] += [0.0, 0.0, 0.0002 * number]

    with pytest.raises(HighFiveError, match=r"L2 is seen in \d\d% of the frames"):
        looked(options, hides)
    with pytest.raises(HighFiveError, match="L3 moves by"):
        looked(options, moves)
    with pytest.raises(HighFiveError, match="corner are not seen; the system sends L1, L2, L3, RFIN"):
        looked(RoomOptions("vicon://cameras", ("corner", "L2", "L3"), 0.0, tmp_path / "place.toml"))
    assert not (tmp_path / "place.toml").exists()


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"source": "people.c3d"}, "expected a motion capture system"),
        ({"markers": ("L1",)}, "two or three labels"),
        ({"markers": ("L1", "L1", "L2")}, "two or three labels"),
        ({"height": 14.0}, "--height 14000"),
        ({"out": Path("place.json")}, "write it as place.toml"),
    ],
)
def test_bad_input_is_one_line(changes: dict[str, Any], says: str) -> None:
    given = {"source": "vicon://cameras", "markers": NAMES[:3], "out": Path("nowhere.toml")} | changes
    with pytest.raises(HighFiveError, match=says):
        calibrate_room(RoomOptions(**given))
