"""``highfive bench bus``: its figures are possible ones; how good they are is measured on a machine that is at rest."""

import pytest

from highfive.hil.bench.bus import BusBenchOptions, bench_bus, limit_hz


def test_the_limit_is_what_was_calculated() -> None:
    assert limit_hz(list(range(1, 8)), 1_000_000) == pytest.approx(552.5, abs=0.1)
    assert limit_hz(list(range(1, 8)), 4_000_000) == pytest.approx(2033.0, abs=10.0)


@pytest.mark.slow
@pytest.mark.realtime
def test_no_cycle_is_faster_than_the_line() -> None:
    result = bench_bus(BusBenchOptions(seconds=1.0, trials=1), lambda label, total: lambda note="", done=None: None)
    assert 20.0 < result["cycle_hz"] <= result["limit_hz"] * 1.01
    assert result["cycle_ms"]["p50"] >= 1e3 / result["limit_hz"] * 0.99
    assert result["failed"] == 0
    assert 0.0 < result["dead_servo_hz"] < result["limit_hz"]
    assert 0.0 <= result["estop_ms"] < 1000.0
    assert result["watchdog_ms"] >= 60.0
