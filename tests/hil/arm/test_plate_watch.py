"""What is seen of the plate while the arm stands, who is in the way, and what is said where it cannot be used."""

from dataclasses import replace

import numpy as np
import pytest

from highfive.hil.arm.hidden_arm import TEMPLATE
from highfive.hil.arm.plate_watch import PlateWatch, StillMoves
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

PERIOD_NS = 8_333_333
PLACE = np.array([1.0, -2.0, 1.3])


class Stream:
    """The newest of what was put in."""

    def __init__(self, clock: VirtualClock) -> None:
        self.clock, self.frame = clock, None
        self._rng, self._number = np.random.default_rng(0), 0

    def newest(self, now_ns: int) -> MarkerFrame | None:
        return self.frame

    def put(self, places: Array, names: tuple[str, ...] = TEMPLATE.names, lost: tuple[str, ...] = ()) -> None:
        self.clock.wait_until(self.clock.now() + PERIOD_NS)
        now, self._number = self.clock.now(), self._number + 1
        valid = np.array([name not in lost for name in names])
        noisy = places + self._rng.normal(0.0, 0.0005, places.shape)
        self.frame = MarkerFrame(names, noisy, valid, self._number, now, now, np.zeros((0, 3)))


def watched(places: list[Array], **how: tuple[str, ...]) -> PlateWatch:
    clock = VirtualClock()
    stream = Stream(clock)
    watch = PlateWatch(stream, TEMPLATE, clock)
    for one in places:
        stream.put(one, **how)
        watch.look()
        watch.look()  # the same frame counts once
    return watch


STILL = [TEMPLATE.places + PLACE] * 60


def test_a_plate_that_stands_is_where_it_is_seen() -> None:
    watch = watched(STILL)
    places, seen = watch.pose()
    assert watch.full and seen.all()
    np.testing.assert_allclose(places, TEMPLATE.places + PLACE, atol=3e-4)


def test_labels_swapped_now_and_then_move_nothing() -> None:
    swapped = (TEMPLATE.places + PLACE)[[1, 0, 2, 3, 4]]
    places, _ = watched([swapped if n % 6 == 0 else STILL[0] for n in range(60)]).pose()
    np.testing.assert_allclose(places, TEMPLATE.places + PLACE, atol=4e-4)


def test_labels_that_are_always_swapped_are_named() -> None:
    with pytest.raises(HighFiveError, match="plate1 and plate4 are swapped"):
        watched([(TEMPLATE.places + PLACE)[[3, 1, 2, 0, 4]]] * 60).pose()


def test_a_marker_that_is_not_seen_is_left_out_and_three_are_needed() -> None:
    _, seen = watched(STILL, lost=("plate2", "stalk")).pose()
    assert seen.tolist() == [True, False, True, True, False]
    with pytest.raises(HighFiveError, match="plate2, plate3, stalk were hardly seen"):
        watched(STILL, lost=("plate2", "plate3", "stalk")).pose()


def test_a_label_that_never_comes_is_named() -> None:
    with pytest.raises(HighFiveError, match=r"plate1 are missing; the system sends .*other"):
        watched(STILL, names=("other", *TEMPLATE.names[1:])).pose()


def test_a_plate_that_moves_is_no_pose() -> None:
    with pytest.raises(StillMoves, match="still moves"):
        watched([TEMPLATE.places + PLACE + np.array([0.0, 2e-5 * n, 0.0]) for n in range(60)]).pose()


def test_whoever_is_near_is_in_the_way_and_silence_is_no_answer() -> None:
    clock = VirtualClock()
    stream = Stream(clock)
    watch = PlateWatch(stream, TEMPLATE, clock)
    assert "no frames come" in watch.in_the_way()
    stream.put(STILL[0])
    assert watch.in_the_way() == ""
    stream.put(np.vstack([STILL[0], PLACE + np.array([0.0, 0.9, 0.0])]), names=(*TEMPLATE.names, "RFIN"))
    assert watch.in_the_way() == "somebody is in the arm's way (RFIN)"  # and not who stands afar
    stream.put(np.vstack([STILL[0], PLACE + np.array([0.0, 1.5, 0.0])]), names=(*TEMPLATE.names, "RFIN"))
    assert watch.in_the_way() == ""
    stream.put(STILL[0])
    assert stream.frame is not None
    ghost = stream.frame
    stream.frame = replace(ghost, unlabelled=(PLACE + np.array([0.0, 0.5, 0.0]))[None])
    assert "without a label" in watch.in_the_way()
    stream.frame = replace(ghost, unlabelled=(PLACE + np.array([0.0, 0.03, 0.0]))[None])
    assert watch.in_the_way() == ""
    clock.wait_until(clock.now() + 200_000_000)
    assert "no frames come" in watch.in_the_way()


def test_a_plate_that_nobody_sees_is_nowhere() -> None:
    """What hides it may be a person; and while it is hidden it moves."""
    clock = VirtualClock()
    stream, hand = Stream(clock), PLACE + np.array([0.0, 1.15, 0.0])
    watch = PlateWatch(stream, TEMPLATE, clock)
    places, names = np.vstack([STILL[0], hand]), (*TEMPLATE.names, "RFIN")
    stream.put(places, names=names)
    assert watch.in_the_way() == ""
    for _ in range(50):
        stream.put(places, names=names, lost=TEMPLATE.names)
    assert watch.in_the_way() == ""
    for _ in range(50):  # 0.8 s: it may have come 0.2 m nearer
        stream.put(places, names=names, lost=TEMPLATE.names)
    assert watch.in_the_way() == "somebody is in the arm's way (RFIN)"
    for _ in range(30):
        stream.put(STILL[0], lost=TEMPLATE.names)
    assert "no marker of the plate has been seen for 1 s" in watch.in_the_way()
    stream.put(STILL[0])
    assert watch.in_the_way() == ""
