"""People before live systems of any rate and latency: what is measured, and that bad options are refused."""

import json

import numpy as np
import pytest

from highfive.hil.bench.clocked_twin import clocked_loop
from highfive.hil.bench.latency import LatencyOptions, bench_latency, print_latency
from highfive.hil.bench.live_people import LiveFelt, LiveJob, System, figures, frames_of, people, play, shown_pair
from highfive.hil.bench.rates import RatesOptions, bench_rates, print_rates
from highfive.hil.bench.virtual_play import default_planner
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.trials.partners import Partner
from highfive.model.errors import HighFiveError


def quiet(_: str, __: int):
    return lambda *_, **__: None


@pytest.fixture(scope="module")
def person() -> Partner:
    return people(("neutral",), ("B2",), 0, quiet)[0]


def test_frames_are_of_the_truth_late_lost_and_by_a_clock_of_their_own(person: Partner) -> None:
    system = System(60.0, latency_ms=10.0, reported_ms=7.0, delay_ms=1.0, drop=0.1, drift_ppm=200.0)
    frames = frames_of(person, system, 5_000_000_000, np.random.default_rng(2))
    stamps, arrivals = np.array([(frame.source_time_ns, frame.arrival_time_ns) for frame in frames]).T
    true = stamps / (1.0 + 200e-6)
    delays = arrivals - 5e9 - true
    assert delays.min() >= 10e6 - 2 and np.median(delays) == pytest.approx(10.7e6, abs=0.3e6)
    numbers = np.array([frame.number for frame in frames])
    assert 0.8 * numbers[-1] < len(numbers) < 0.97 * numbers[-1]
    assert {frame.latency_ns for frame in frames} == {7_000_000}
    still = np.array([frame.positions for frame in frames[:50]])
    np.testing.assert_allclose(still.std(axis=0).mean(), 0.0005, rtol=0.1)


@pytest.mark.slow
def test_latency_costs_less_where_it_is_made_up_for() -> None:
    """Of a hand that is quick: a slow one is hardly elsewhere after 40 ms."""
    (person,) = people(("happy",), ("C3",), 0, quiet)
    told, untold = (play(LiveJob(person, System(latency_ms=40.0, reported_ms=ms), 3)) for ms in (40.0, 0.0))
    assert told.touched and untold.touched
    assert told.error < 0.5 * untold.error
    again = play(LiveJob(person, System(latency_ms=40.0, reported_ms=40.0), 3))
    assert again == told


def test_people_whom_nobody_touched_have_no_figures() -> None:
    """As before a system of one frame a second: JSON has no NaN, and a table shows that there is nothing."""
    missed = LiveFelt("sad", "B2", False, np.nan, np.nan, np.nan, np.nan)
    row = figures([missed, missed])
    assert json.loads(json.dumps(row, allow_nan=False)) == {
        "trials": 2,
        "touched": 0,
        "contact_error_mm": {"median": None, "max": None},
        "time_error_ms": {"median": None, "max": None},
        "palm_speed_error": None,
        "palm_speed_rms": None,
    }
    assert shown_pair(row["contact_error_mm"], "mm", 2).split() == ["-", "/", "-", "mm"]
    print_rates({"1": row})
    print_latency({"500": {"with": row, "without": row}})
    touched = LiveFelt("sad", "B2", True, 0.002, -0.01, 0.99, 0.05)
    assert figures([missed, touched]) == {
        "trials": 2,
        "touched": 1,
        "contact_error_mm": {"median": 2.0, "max": 2.0},
        "time_error_ms": {"median": 10.0, "max": 10.0},
        "palm_speed_error": 0.01,
        "palm_speed_rms": 0.05,
    }


@pytest.mark.slow(85)
def test_palms_meet_at_any_rate_as_they_do_at_120_hz(capsys: pytest.CaptureFixture[str]) -> None:
    """The same people at each rate: a median of so few differs by a quarter from that of others like them."""
    found = bench_rates(RatesOptions((30.0, 60.0, 120.0, 500.0), ("A1", "A3", "B2", "C1", "C3")), quiet)
    print_rates(found)
    assert capsys.readouterr().out.count("20 of 20") == 4
    usual = found["120"]
    for rate, row in found.items():
        assert row["touched"] == 20, (rate, row)
        if float(rate) < 60.0:
            assert row["palm_speed_error"] <= 0.03, (rate, row)
            continue
        assert row["palm_speed_error"] <= 0.02, (rate, row)
        for figure in ("contact_error_mm", "time_error_ms"):
            assert row["paired"][figure] <= 0.2 * usual[figure]["median"], (rate, figure, row)


@pytest.mark.slow
def test_the_twin_follows_a_live_system_at_the_pace_of_its_frames(person: Partner) -> None:
    """78 Hz is where ticks are furthest apart before a tick without a frame comes between."""
    felt = play(LiveJob(person, System(78.0), 3, twin=True))
    assert felt.arm is not None
    met, stopped = felt.arm
    assert stopped == "" and met.touched
    assert met.error < 0.006


def test_the_twin_of_a_live_session_goes_on_with_the_clock() -> None:
    with VirtualClock(1) as clock:
        clock.wait_until(clock.now() + 123_456_789)
        begun = clock.now()
        loop = clocked_loop(default_planner(), clock)
        loop.begin()
        clock.wait_until(begun + 1_000_000_000)
        cycles = loop.cycles()
    times = np.array([cycle.state.time_ns for cycle in cycles])
    assert len(cycles) == 120 and 0 < times[0] - begun < 8_400_000
    assert set(np.diff(times)) == {8_333_000}  # the limits' own period


@pytest.mark.slow
def test_the_latency_bench_tells_with_and_without(capsys: pytest.CaptureFixture[str]) -> None:
    found = bench_latency(LatencyOptions((0.0, 20.0), ("B2",)), quiet)
    print_latency(found)
    assert capsys.readouterr().out.count(" of 4") == 4
    assert list(found) == ["0", "20"] and found["0"]["with"] == found["0"]["without"]
    assert found["20"]["with"]["contact_error_mm"]["median"] < found["20"]["without"]["contact_error_mm"]["median"]


@pytest.mark.parametrize(
    ("bench", "message"),
    [
        (lambda: bench_rates(RatesOptions((0.0,)), quiet), "a rate of 0 Hz"),
        (lambda: bench_rates(RatesOptions(cells=("Z9",)), quiet), "unknown cell 'Z9'"),
        (lambda: bench_latency(LatencyOptions((-1.0,)), quiet), "a latency of -1 ms"),
    ],
)
def test_what_cannot_be_measured_is_refused(bench, message: str) -> None:
    with pytest.raises(HighFiveError, match=message):
        bench()
