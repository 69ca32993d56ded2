"""``highfive bench bus``: its figures are possible ones; how good they are is measured on a machine that is at rest."""

import pytest

from highfive.hil.bench.arm_faults import dead_servo
from highfive.hil.bench.benched_bus import virtual_bus
from highfive.hil.bench.bus import BusBenchOptions, bench_bus, client_figures, limit_hz
from highfive.hil.drivers.bus.rig import load_rig

SERVOS = list(range(1, 8))


def test_the_limit_is_what_was_calculated() -> None:
    assert limit_hz(SERVOS, 1_000_000) == pytest.approx(552.5, abs=0.1)
    assert limit_hz(SERVOS, 4_000_000) == pytest.approx(2033.0, abs=10.0)


def test_where_only_the_line_takes_time_a_cycle_takes_what_was_calculated() -> None:
    rig, done = load_rig(), list[str]()
    with virtual_bus() as bus:
        found = client_figures(bus, rig.baud_rate, SERVOS, 0.5, done.append)
    limit = limit_hz(SERVOS, rig.baud_rate)
    cycle = found["cycle_ms"]
    assert 0.98 * limit < found["cycle_hz"] <= limit
    assert 1e3 / limit - 1e-3 <= cycle["p50"] <= cycle["p99"] <= cycle["max"] < 1.02e3 / limit
    assert found["failed"] == found["sdk_failed"] == 0
    assert 0.98 * limit < found["sdk_hz"] <= limit
    assert done == ["bytes", "SDK"]


def test_a_dead_servo_costs_a_cycle_its_patience() -> None:
    with virtual_bus() as bus:
        found = dead_servo(bus, load_rig(), 0.5)
    whole_ms = 1e3 / limit_hz(SERVOS, load_rig().baud_rate)
    assert 1.0 < 1e3 / found["dead_servo_hz"] / whole_ms < 1.5  # after a while it is not asked any more
    assert whole_ms < found["dead_servo_longest_ms"] < 10.0


@pytest.mark.slow
@pytest.mark.realtime
def test_no_cycle_is_faster_than_the_line() -> None:
    """On the machine: processes, pseudo-terminals, a stop, kills."""
    result = bench_bus(BusBenchOptions(seconds=1.0, trials=1), lambda label, total: lambda note="", done=None: None)
    assert 0.0 < result["cycle_hz"] <= result["limit_hz"] * 1.01
    assert result["cycle_ms"]["p50"] >= 1e3 / result["limit_hz"] * 0.99
    assert 0.0 < result["dead_servo_hz"] < result["limit_hz"]
    assert 0.0 <= result["estop_ms"] < 100.0  # for so long it is driven on: motion ended before that did
    assert result["watchdog_ms"] >= 60.0
    wakes = result["sleeper_late_ms"]
    assert 0.0 <= wakes["p50"] <= wakes["p99"] <= wakes["max"]
