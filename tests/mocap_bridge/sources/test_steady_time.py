"""Time that never goes back: laws, over estimates that move as they like."""

from dataclasses import dataclass

from hypothesis import given
from hypothesis import strategies as st

from highfive.mocap_bridge.sources.steady_time import SteadySettings, SteadyTime

MS = 1_000_000
SLEW = SteadySettings().slew


@dataclass
class Told:
    """An estimate that is whatever it is told to be."""

    offset_ns: int = 0
    resets: int = 0
    drift: float = 0.0
    settled: bool = True

    def local(self, stamp_ns: int) -> int:
        return stamp_ns + self.offset_ns

    def bound_ns(self, stamp_ns: int) -> int:
        return 0


@given(st.lists(st.tuples(st.integers(1, 50 * MS), st.integers(-5 * MS, 5 * MS), st.booleans()), min_size=2))
def test_time_never_goes_back_and_runs_off_by_the_slew_at_the_most(moves: list[tuple[int, int, bool]]) -> None:
    clock, stamp = Told(), 0
    steady = SteadyTime(clock)
    before = steady.local(stamp)
    for elapsed, clock.offset_ns, clock.settled in moves:
        stamp += elapsed
        now = steady.local(stamp)
        assert now >= before
        if clock.settled:
            assert abs((now - before) - elapsed) <= SLEW * elapsed + 1
        before = now


def test_an_estimate_that_moved_is_met() -> None:
    clock = Told()
    steady = SteadyTime(clock)
    steady.local(0)
    clock.offset_ns = 100_000
    times = [steady.local(k * 8 * MS) - k * 8 * MS for k in range(60)]
    assert times[-1] == 100_000
    assert times[1] < 5_000
    assert steady.behind_ns == 0


def test_a_clock_that_was_set_is_followed_at_once_and_back() -> None:
    clock = Told()
    steady = SteadyTime(clock)
    assert steady.local(100 * MS) == 100 * MS
    clock.offset_ns, clock.resets = -10 * MS, 1
    assert steady.local(108 * MS) == 98 * MS


def test_drift_is_no_correction() -> None:
    clock = Told(drift=1e-3)
    steady = SteadyTime(clock)
    steady.local(0)
    for k in range(1, 200):
        clock.offset_ns = k * 8_000
        assert abs(steady.local(k * 8 * MS) - k * 8_008_000) <= 1
