"""A peer that answers: its clock against a truth that is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highfive.mocap_bridge.sources.ping_clock import PingClock
from highfive.mocap_bridge.sources.stamp_clock import UNKNOWN_NS

MS, S = 1_000_000, 1_000_000_000


def probes(
    seconds: float, ppm: float, ways_ms: tuple[float, float], seed: int, step_ns: int = 0, step_at: float = np.inf
) -> list[tuple[int, int, int, int]]:
    """Sent, stamp, came, and when the stamp was made by the local clock, ns: eight probes each two seconds."""
    rng, found = np.random.default_rng(seed), []
    for at in (2.0 * turn + 0.064 * k for turn in range(int(seconds / 2)) for k in range(8)):
        there, back = (way + rng.gamma(2.0, 0.7) + (rng.random() < 0.03) * rng.exponential(50.0) for way in ways_ms)
        true = at + 1e-3 * there
        stamp = round(S * true * (1.0 + 1e-6 * ppm)) + 777 * S + (step_ns if true > step_at else 0)
        found.append((round(S * at), stamp, round(S * true + MS * back), round(S * true)))
    return found


@pytest.mark.parametrize("ppm", [0.0, 50.0, -100.0])
@pytest.mark.parametrize("ways", [(0.2, 0.2), (1.0, 4.0)])
def test_the_bound_is_half_the_least_round_trip_and_holds(ppm: float, ways: tuple[float, float]) -> None:
    clock = PingClock()
    assert clock.bound_ns(0) == UNKNOWN_NS
    for sent, stamp, came, true in probes(120.0, ppm, ways, 3):
        clock.update(sent, stamp, came)
        if sent > 10 * S:
            error, bound = abs(clock.local(stamp) - true) / MS, clock.bound_ns(stamp) / MS
            assert error <= bound
            assert bound <= 0.5 * sum(ways) + 1.2
            assert error <= 0.5 * abs(ways[0] - ways[1]) + 0.7
    assert clock.resets == 0


def test_the_truth_is_within_the_bound() -> None:
    within = []
    for seed in range(60):
        clock = PingClock()
        for sent, stamp, came, true in probes(40.0, 50.0, (0.0, 0.0), seed):
            clock.update(sent, stamp, came)
            within.append(abs(clock.local(stamp) - true) <= clock.bound_ns(stamp))
    assert np.mean(within) >= 0.98


@given(st.floats(0.0, 20.0), st.floats(0.0, 20.0), st.integers(0, 1000))
def test_it_is_off_by_half_of_what_the_ways_differ_by(there: float, back: float, seed: int) -> None:
    clock = PingClock()
    for sent, stamp, came, true in probes(30.0, 50.0, (there, back), seed):
        clock.update(sent, stamp, came)
        if sent > 20 * S:
            assert abs(clock.local(stamp) - true - 0.5 * MS * (back - there)) <= 1.5 * MS


@pytest.mark.parametrize("step_ms", [10, -10])
def test_a_peer_whose_clock_is_set_is_followed(step_ms: int) -> None:
    clock = PingClock()
    for sent, stamp, came, true in probes(90.0, 50.0, (0.3, 0.3), 5, step_ms * MS, 41.0):
        clock.update(sent, stamp, came)
        if sent > 47 * S:
            assert abs(clock.local(stamp) - true) < 2 * MS
    assert clock.resets == 1


def test_an_answer_before_its_question_is_none() -> None:
    clock = PingClock()
    clock.update(10 * S, 5 * S, 9 * S)
    assert clock.bound_ns(5 * S) == UNKNOWN_NS
