"""Lost samples are distinguished from late ones by stamps alone: exactly afterwards, soon while they come."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stamped_senders import Sent, send

from highfive.mocap_bridge.wire.lost_samples import PATIENCE_S, LostSamples, lost_before

RATES = (30.0, 60.0, 100.0, 120.0, 240.0, 500.0)
CASES = {
    "on time": {},
    "late bursts": {"late": 1 / 30},
    "losses": {"lost": 0.02},
    "both": {"late": 1 / 30, "lost": 0.02},
    "drift": {"wander_s": 0.003},
    "drift, late bursts and losses": {"wander_s": 0.003, "late": 1 / 30, "lost": 0.01},
    "an outage between late bursts": {"late": 1 / 30, "outage": (3.0, 5.0)},
    "held up for long": {"late": 1 / 600, "late_s": 0.2, "lost": 0.01},
}
DELAY_S = 0.01


def found(sent: Sent, nominal_hz: float) -> tuple[np.ndarray, float]:
    return lost_before(sent.stamps, sent.stamps + DELAY_S, nominal_hz)


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", RATES)
@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("even", [True, False], ids=["nominal rate", "irregular"])
def test_every_loss_is_counted_and_nothing_else(rate_hz: float, case: str, even: bool) -> None:
    for seed in range(2):
        sent = send(seed, rate_hz, **CASES[case])
        lost, period_s = found(sent, rate_hz if even else 0.0)
        assert lost.sum() == sent.lost.sum()
        # A gap lies where it is, or among the samples that came all at once with the one before or after it.
        held_up = 1.0 + rate_hz * CASES[case].get("late_s", 0.025) * ("late" in CASES[case])
        assert np.abs(np.cumsum(lost) - np.cumsum(sent.lost)).max() <= held_up
        if "late" not in CASES[case]:
            assert np.array_equal(lost, sent.lost)
        assert period_s * rate_hz == pytest.approx(1.0, abs=1e-3 if "wander_s" in CASES[case] else 5e-5)


@pytest.mark.parametrize("true_hz", [60.0, 90.0, 100.0, 113.4, 119.88, 126.0])
def test_the_nominal_rate_is_only_a_first_guess(true_hz: float) -> None:
    """A sender that sleeps between samples is slower than it says; nothing of it is lost."""
    for seed in range(2):
        sent = send(seed, true_hz, late=1 / 30, lost=0.01)
        lost, period_s = found(sent, 120.0)
        assert lost.sum() == sent.lost.sum()
        assert period_s * true_hz == pytest.approx(1.0, abs=1e-4)


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 2**32),
    st.floats(30.0, 500.0),
    st.floats(0.0, 0.03),
    st.floats(0.0, 0.03),
    st.floats(0.0, 0.03),
    st.floats(-0.05, 0.05),
)
def test_no_phantom_losses_at_any_rate(
    seed: int, rate_hz: float, late: float, late_s: float, lost: float, off: float
) -> None:
    sent = send(seed, rate_hz, late=late, late_s=late_s, lost=lost, noise_s=0.03 / rate_hz)
    assert found(sent, rate_hz * (1.0 + off))[0].sum() == sent.lost.sum()


@pytest.mark.parametrize("rate_hz", [30.0, 120.0, 500.0])
def test_while_they_come_losses_are_known_soon(rate_hz: float) -> None:
    sent = send(1, rate_hz, late=1 / 30, lost=0.02)
    samples, known = LostSamples(rate_hz), []
    for stamp in sent.stamps:
        samples.add(stamp, stamp)
        known.append(samples.total)
    true = np.cumsum(sent.lost)
    assert all(now <= truly for now, truly in zip(known, true, strict=True))
    start, delay = round(2.5 * rate_hz), max(round(1.5 * PATIENCE_S * rate_hz), 48)
    assert all(known[k] >= true[k - delay] - 2 for k in range(start, len(known)))


def test_a_sender_held_up_for_longer_than_one_waits_has_lost_nothing() -> None:
    sent = send(0, 120.0, 20.0)
    due = sent.stamps.copy()
    held = (due > 1006.0) & (due < 1007.5)
    due[held] = 1007.5 + 2e-5 * np.arange(held.sum())
    samples, most = LostSamples(120.0), 0
    for stamp in due:
        samples.add(stamp, stamp)
        most = max(most, samples.total)
    assert most > 50  # for the time being
    assert samples.total == 0


@pytest.mark.parametrize("noise", [0.1, 0.2, 0.36])
@pytest.mark.slow
def test_samples_that_are_all_stamped_late_are_not_lost(noise: float) -> None:
    for seed in range(5):
        assert found(send(seed, 120.0, 60.0, noise_s=noise / 120.0), 120.0)[0].sum() == 0
        sent = send(seed, 120.0, 60.0, noise_s=0.3 * noise / 120.0, lost=0.01)
        assert found(sent, 120.0)[0].sum() == sent.lost.sum()


@pytest.mark.parametrize("seed", range(3))
def test_events_at_random_times_are_no_stream_that_loses(seed: int) -> None:
    times = np.cumsum(np.random.default_rng(seed).exponential(0.01, size=3000))
    lost, period_s = lost_before(times, times, 0.0)
    assert lost.sum() == 0
    assert period_s == 0.0


@pytest.mark.parametrize("pause_s", [0.0, 2.0])
@pytest.mark.parametrize("start_s", [0.0, 5e3])
def test_a_sender_that_starts_anew_with_another_clock_loses_the_time_in_between(pause_s: float, start_s: float) -> None:
    first, second = send(0, 120.0, 5.0, lost=0.01), send(1, 120.0, 5.0, lost=0.01)
    stamps = np.concatenate([first.stamps, second.stamps - second.stamps[0] + start_s])
    begins = first.stamps[-1] + 1 / 120.0 + pause_s
    arrivals = np.concatenate([first.stamps, second.stamps - second.stamps[0] + begins])
    lost, _ = lost_before(stamps, arrivals, 120.0)
    assert lost[len(first.stamps)] == round(120.0 * pause_s)
    assert lost.sum() == first.lost.sum() + second.lost.sum() + round(120.0 * pause_s)


@pytest.mark.parametrize("off_s", [-1e6, -10.0, -0.3, -0.03, 0.03, 0.3, 3.0, 10.0, 1e6])
def test_one_stamp_that_is_far_off_is_no_loss(off_s: float) -> None:
    sent = send(0, 120.0)
    stamps = sent.stamps.copy()
    stamps[600] += off_s
    assert lost_before(stamps, sent.stamps, 120.0)[0].sum() == 0


def test_stamps_that_run_ahead_of_the_clock_make_no_endless_recording() -> None:
    stamps = np.cumsum(np.where(np.arange(2000) % 10 == 0, 4.9, 1 / 120.0))
    assert lost_before(stamps, np.arange(2000) / 120.0, 120.0)[0].sum() < 120.0 * 6.0


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.floats(-1e9, 1e9), st.floats(0.0, 10.0)), max_size=80), st.sampled_from([0.0, 1.0, 120.0]))
def test_any_stamps_give_losses_that_are_bounded_by_the_time_that_passed(
    came: list[tuple[float, float]], rate_hz: float
) -> None:
    arrivals = np.cumsum([gap for _, gap in came])
    lost, period_s = lost_before([stamp for stamp, _ in came], arrivals, rate_hz)
    assert (lost >= 0).all()
    assert 0.0 <= period_s < np.inf
