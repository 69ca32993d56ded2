"""Contact timing on reaches that are known in closed form."""

import numpy as np
import pytest

from highfive.hil.experiments.analysis.contact_timing import contact_time, contact_timing, onset_time
from highfive.model.errors import HighFiveError

RATE = 120.0
PLACE = np.array([0.4, 0.1, 1.2])


def reach(start: float, duration: float, length: float = 0.5, seconds: float = 2.0, side: float = 1.0) -> np.ndarray:
    """A palm that moves by least jerk to the place of contact, along x, and stays there: (T, 3)."""
    share = np.clip((np.arange(round(seconds * RATE)) / RATE - start) / duration, 0.0, 1.0)
    track = np.tile(PLACE, (len(share), 1))
    track[:, 0] += side * length * (1.0 - (10 * share**3 - 15 * share**4 + 6 * share**5))
    return track


def test_a_reach_of_least_jerk() -> None:
    person, avatar = reach(0.5, 0.8), reach(0.7, 0.7, side=-1.0)
    found = contact_timing(person, avatar, RATE, 1.4, PLACE)
    # Its speed is 30 s²(1 − s)² length / duration: the peak 1.875, and 5 % of it at s(1 − s) = ¼ √.05.
    share = 0.5 * (1.0 - np.sqrt(1.0 - np.sqrt(0.05)))
    assert found.person.onset == pytest.approx(0.5 + share * 0.8, abs=0.005)
    assert found.avatar.onset == pytest.approx(0.7 + share * 0.7, abs=0.005)
    assert found.person.time_to_contact == pytest.approx(1.4 - found.person.onset)
    assert found.person.peak_speed == pytest.approx(1.875 * 0.5 / 0.8, rel=0.01)
    assert found.person.peak_at == pytest.approx((0.9 - found.person.onset) / found.person.time_to_contact, abs=0.01)
    assert found.person.peaks == found.avatar.peaks == 1
    assert found.person.arrival == pytest.approx(1.3, abs=0.02) and found.avatar.arrival == pytest.approx(1.4, abs=0.02)
    assert found.asynchrony == pytest.approx(-0.1, abs=0.02)
    assert found.miss == pytest.approx(0.0, abs=1e-6)


def test_who_is_there_first_waits_and_a_stop_on_the_way_is_another_peak() -> None:
    early, late = reach(0.2, 0.6), reach(0.9, 0.8, side=-1.0)
    found = contact_timing(early, late, RATE, 1.7, PLACE)
    slow = np.flatnonzero(np.linalg.norm(early - PLACE, axis=1) < 0.02)[0] / RATE
    assert 0.85 < found.person.waiting < 1.7 - slow + 0.01
    assert found.avatar.waiting < 0.15
    half = 0.5 * (reach(0.2, 0.5) - PLACE) + 0.5 * (reach(1.0, 0.5) - PLACE) + PLACE
    assert contact_timing(half, late, RATE, 1.7, PLACE).person.peaks == 2


def test_closing_speed_and_miss_of_palms_that_pass() -> None:
    frames = np.arange(240) / RATE
    person = PLACE + np.stack([1.0 - frames, 0.0 * frames, 0.0 * frames], axis=1)
    avatar = PLACE + np.stack([frames - 1.0, 0.03 + 0.0 * frames, 0.0 * frames], axis=1)
    found = contact_timing(person, avatar, RATE, 0.9, PLACE)
    assert found.closing_speed == pytest.approx(2.0, rel=0.03)
    assert found.miss == pytest.approx(0.03)
    assert found.person.arrival == pytest.approx(1.0, abs=1e-9)


def test_arrivals_are_told_between_frames() -> None:
    frames = np.arange(200) / RATE
    track = PLACE + np.stack([0.8123 - frames, 0.01 + 0.0 * frames, 0.0 * frames], axis=1)
    assert contact_timing(track, track, RATE, 0.8, PLACE).person.arrival == pytest.approx(0.8123, abs=1e-9)


def test_all_moved_in_time_moves_times_alone() -> None:
    one = contact_timing(reach(0.4, 0.6), reach(0.5, 0.6, side=-1.0), RATE, 1.1, PLACE)
    later = contact_timing(reach(0.65, 0.6), reach(0.75, 0.6, side=-1.0), RATE, 1.35, PLACE)
    assert later.person.onset == pytest.approx(one.person.onset + 0.25)
    assert later.asynchrony == pytest.approx(one.asynchrony, abs=1e-9)
    assert later.person.time_to_contact == pytest.approx(one.person.time_to_contact)


@pytest.mark.parametrize(("speed", "within"), [(3.0, 0.0006), (1.5, 0.001), (0.3, 0.006)])
def test_contact_from_a_noisy_gap(speed: float, within: float) -> None:
    rng = np.random.default_rng(3)
    errors = []
    for contact in 0.5 + rng.uniform(0.0, 0.1, 60):
        gap = speed * (contact - np.arange(90) / RATE)
        gap = np.where(gap < 0.0, -0.0005, gap) + 0.0007 * rng.standard_normal(90) * (gap > -1.0)
        found = contact_time(gap, RATE)
        assert found is not None
        errors.append(found - contact)
    assert np.sqrt(np.mean(np.square(errors))) < within


def test_palms_that_do_not_meet_have_no_contact_time() -> None:
    assert contact_time(np.full(30, 0.01), RATE) is None
    assert contact_time(np.full(30, -0.01), RATE) is None
    assert onset_time(np.array([1.0, 1.0, 2.0]), RATE, 0.05) == 0.0


def test_what_is_no_track_is_refused() -> None:
    track = reach(0.5, 0.8)
    with pytest.raises(HighFiveError, match="expected \\(T, 3\\) twice"):
        contact_timing(track, track[1:], RATE, 1.0, PLACE)
    with pytest.raises(HighFiveError, match="expected 3 frames before it"):
        contact_timing(track, track, RATE, 0.01, PLACE)
    with pytest.raises(HighFiveError, match="expected 3 frames before it"):
        contact_timing(track, track, RATE, 9.0, PLACE)
    gone = track.copy()
    gone[5] = np.nan
    with pytest.raises(HighFiveError, match="has gaps"):
        contact_timing(track, gone, RATE, 1.0, PLACE)
    with pytest.raises(HighFiveError, match="expected \\(T,\\) finite"):
        contact_time(np.array([1.0, np.nan]), RATE)
