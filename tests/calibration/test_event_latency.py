"""Events that two streams see: the delay that made them is found, or it is said why not."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highfive.calibration.event_latency import event_latency
from highfive.model.errors import HighFiveError

MS, S = 1_000_000, 1_000_000_000


def events(count: int, rng: np.random.Generator) -> np.ndarray:
    return np.cumsum(rng.uniform(0.8, 2.0, count) * S).astype(np.int64)


@given(st.integers(0, 10_000), st.integers(-200, 200))
def test_the_delay_is_found_although_some_events_are_missed_or_made_up(seed: int, delay_ms: int) -> None:
    rng = np.random.default_rng(seed)
    true = events(30, rng)
    seen = true + delay_ms * MS + rng.normal(0.0, 3.0 * MS, 30).astype(np.int64)
    kept = np.concatenate([seen[rng.random(30) > 0.2], [true[3] + 500 * MS]])
    found = event_latency(true[rng.random(30) > 0.2].tolist(), kept.tolist())
    assert abs(found.latency_ns - delay_ms * MS) < 4 * MS
    assert 0 < found.bound_ns < 5 * MS


def test_the_bound_holds_as_often_as_it_says() -> None:
    within = []
    for seed in range(300):
        rng = np.random.default_rng(seed)
        true = events(20, rng)
        found = event_latency(true.tolist(), (true + 8 * MS + rng.normal(0.0, 3.0 * MS, 20).astype(np.int64)).tolist())
        within.append(abs(found.latency_ns - 8 * MS) <= found.bound_ns)
    assert 0.85 < np.mean(within) <= 1.0


def test_too_few_or_unlike_events_are_refused() -> None:
    rng = np.random.default_rng(0)
    true = events(20, rng)
    with pytest.raises(HighFiveError, match="4 events are seen by both"):
        event_latency(true[:4].tolist(), true[:4].tolist())
    with pytest.raises(HighFiveError, match="0 events"):
        event_latency([], [])
    with pytest.raises(HighFiveError, match="scatter"):
        event_latency(true.tolist(), (true + rng.uniform(-200, 200, 20) * MS).astype(np.int64).tolist())
