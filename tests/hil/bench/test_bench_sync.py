"""The benchmark of synchronisation: the same twice, within its targets, and it can fail."""

import numpy as np
import pytest

from highfive.hil.bench.sync import SyncOptions, _one_way, bench_sync, print_sync, unmatched
from highfive.hil.bench.sync_hosts import BEGAN_NS, EPOCH_NS, MS, WIRED, WIRELESS, Host, Network, heard
from highfive.hil.runtime.console import Bar
from highfive.model.errors import HighFiveError


def silent() -> Bar:
    return lambda label, total: lambda *args, **kwargs: None


@pytest.mark.slow
def test_targets_hold_in_a_short_run(capsys: pytest.CaptureFixture[str]) -> None:
    found = bench_sync(SyncOptions(seconds=60.0, long_s=120.0), silent())
    for name in ("wired", "wireless", "long"):
        assert found[name]["error_ms"]["p95"] <= 0.2  # the first seconds count more than in a long run
        assert found[name]["wrong_resets"] == 0
    assert found["steps"]["resets"] == 9
    assert 0.0 < found["steps"]["found_step_s"] <= 2.0
    assert found["steps"]["error_ms"]["max"] > 5.0
    assert found["three_streams"]["wrist_error_mm"]["now"]["p95"] <= 1.5
    assert all(0.95 < row["within_bound"] <= 1.0 for row in found.values() if "within_bound" in row)
    both, one = found["two_systems"]["merged"], found["two_systems"]["one_system"]
    assert both["marker_error_mm"]["p95"] < 2.0 * one["marker_error_mm"]["p95"]
    assert both["palm_error_mm"]["p95"] < one["palm_error_mm"]["p95"] + 2.0
    for row in found.values():
        assert row["error_ms"].keys() == {"p50", "p95", "max"} and row["resets"] >= 0 and "found_step_s" in row
    assert found["three_streams"]["error_ms"]["p95"] < 0.5 and found["two_systems"]["error_ms"]["p95"] < 2.0
    assert found["three_streams"]["resets"] == found["two_systems"]["resets"] == 0
    assert found["steps"]["wrong_resets"] == found["steps"]["missed_steps"] == 0
    print_sync(found)
    assert "three streams" in capsys.readouterr().out


def test_what_is_sent_is_what_was_asked_for() -> None:
    rng = np.random.default_rng(3)
    came = heard(Host(100.0, 1000.0, 0.0, ((5.0, 10.0),)), WIRELESS, 60.0, rng)
    assert np.all(np.diff(came.arrivals) >= 0)
    assert np.all(came.arrivals - came.true >= round(WIRELESS.least_ms * MS))
    ran = (came.stamps - EPOCH_NS) - (came.true - BEGAN_NS)
    np.testing.assert_allclose(ran[1:500] / (came.true - BEGAN_NS)[1:500], 1e-3, atol=1e-6)
    np.testing.assert_allclose(ran[500] - ran[499], 10 * MS + 10_000, atol=2)
    longest = (came.arrivals - came.true).max() / MS
    assert longest > 20.0
    again = heard(Host(100.0, 1000.0, 0.0, ((5.0, 10.0),)), WIRELESS, 60.0, np.random.default_rng(3))
    assert np.array_equal(again.arrivals, came.arrivals)
    assert (heard(Host(), Network(1.0, 0.0), 2.0, rng).arrivals - BEGAN_NS)[0] == MS


def test_a_missed_step_and_a_wrong_reset_do_not_make_up_for_each_other() -> None:
    assert unmatched([10.0, 20.0], [10.5, 21.0]) == (0, 0)
    assert unmatched([10.0, 20.0], [10.5, 17.0]) == (1, 1)
    assert unmatched([10.0], [9.9, 10.1, 10.2]) == (2, 0)


@pytest.mark.parametrize("network", [WIRED, WIRELESS])
@pytest.mark.parametrize("ppm", [50.0, 1000.0])
def test_the_bound_of_the_first_half_minute_holds(network: Network, ppm: float) -> None:
    within = []
    for seed in range(3):
        rng = np.random.default_rng([seed, 77])
        host = Host(120.0, ppm)
        within.append(_one_way(host, network, heard(host, network, 30.0, rng))["first_half_minute"]["within_bound"])
    assert min(within) >= 0.97


def test_too_short_a_run_is_refused() -> None:
    with pytest.raises(HighFiveError, match="too short"):
        bench_sync(SyncOptions(seconds=5.0), silent())
