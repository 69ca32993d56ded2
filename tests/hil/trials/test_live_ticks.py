"""Ticks of a live person follow the frames, whatever their rate; in virtual time, at the wire's place."""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from virtual_system import VirtualSystem

from highfive.calibration.placement import Placement
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.safety.envelope import LATE_TICK
from highfive.hil.session.session import TickInput
from highfive.hil.trials.live_partner import TICK_NS, LivePerson, LiveTrial, live_source
from highfive.hil.trials.live_settings import LIVE
from highfive.hil.trials.partners import simulated_partners
from highfive.mocap_bridge.files.recording import Recording, resample
from highfive.mocap_bridge.frames import MarkerFrame

ADDRESS = "vicon://lab"
HERE = Placement(np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), ("the room is registered",))


@pytest.fixture(scope="module")
def greeting() -> Recording:
    return simulated_partners(1, ("neutral",), ("B2",), 3)[0].recording


@pytest.fixture
def clock() -> Iterator[VirtualClock]:
    with VirtualClock() as clock:
        yield clock


def ticked(
    clock: VirtualClock, recording: Recording, count: int, *faults: str, latency_ns: int = 0
) -> tuple[list[tuple[int, TickInput]], dict[str, int]]:
    """When each of the first ticks began, ns, what with, and the trial's counts."""
    system = VirtualSystem(clock, recording, *faults)
    with closing(live_source(ADDRESS, None, system.wiring)) as source:
        source.first()
        clock.wait_until(clock.now() + 1_500_000_000)  # the source has found its clock
        trial = LiveTrial(source, HERE, clock, latency_ns)
        begun = [(clock.now(), begins) for begins in islice(trial, count)]
    return begun, {"late": trial.late, "predicted": trial.predicted, "stale": trial.stale}


@pytest.mark.slow
@pytest.mark.parametrize("rate", [30, 50, 60, 75, 78, 82, 90, 100, 120, 200, 240, 500])
def test_at_any_rate_ticks_are_for_now_and_never_further_apart_than_a_frame_or_a_tick(
    rate: int, greeting: Recording, clock: VirtualClock
) -> None:
    begun, counts = ticked(clock, resample(greeting, rate), 240)
    times = np.array([(at, begins.time_ns) for at, begins in begun[1:]])
    local, stamps = np.diff(times, axis=0).T
    np.testing.assert_allclose(stamps, local, atol=50_000)  # the stamps' own step, not a nominal one
    assert local.max() < LATE_TICK * TICK_NS - 500_000 and local.min() >= 0.5 * TICK_NS  # none is late for an arm
    assert counts["late"] == counts["stale"] == 0
    frames = [begins for _, begins in begun if begins.frame is not None]
    seconds = 1e-9 * (times[-1, 0] - times[0, 0])
    assert len(frames) >= min(rate, 1e9 / TICK_NS) * seconds * 0.95 - 2
    assert (counts["predicted"] == 0) == (rate >= 90)


def test_each_tick_is_ahead_of_its_frame_by_what_the_system_and_the_screen_take(
    greeting: Recording, clock: VirtualClock
) -> None:
    begun, _ = ticked(clock, greeting, 60, latency_ns=30_000_000)
    assert [begins.ahead_ns for _, begins in begun] == pytest.approx([30_000_000] * 60, abs=50_000)
    assert [begins.at_ns - at for at, begins in begun] == pytest.approx([30_000_000] * 60, abs=50_000)


@pytest.mark.parametrize(("says_ms", "ahead_ms"), [(0, 0), (30, 30), (3_200, 0), (-20, 0)])
def test_a_latency_that_a_system_cannot_mean_is_not_made_up_for_and_said(
    says_ms: int, ahead_ms: int, greeting: Recording, clock: VirtualClock, caplog: pytest.LogCaptureFixture
) -> None:
    class Says(VirtualSystem):
        def send(self, frame: MarkerFrame) -> None:
            super().send(replace(frame, latency_ns=1_000_000 * says_ms))

    caplog.set_level("INFO")
    with closing(live_source(ADDRESS, None, Says(clock, greeting).wiring)) as source:
        source.first()
        clock.wait_until(clock.now() + 1_500_000_000)
        ahead = [begins.ahead_ns for begins in islice(LiveTrial(source, HERE, clock), 61)][1:]
        LivePerson(source, ADDRESS, registered=HERE, clock=clock)
    assert ahead == pytest.approx([1_000_000 * ahead_ms] * 60, abs=100_000)
    said = caplog.text
    assert ("as it says: made up for" in said) == (says_ms == 30)
    assert (f"are {says_ms} ms old as it sends them; expected 0 to 250 ms" in said) == (says_ms in (3_200, -20))


def test_after_a_stall_there_is_one_tick_for_now_and_no_burst(greeting: Recording, clock: VirtualClock) -> None:
    begun, counts = ticked(clock, greeting, 300, "stall@2.5-2.9")
    local, stamps = np.diff([(at, begins.time_ns) for at, begins in begun], axis=0)[1:].T
    assert local.min() >= 0.5 * TICK_NS and local.max() < LATE_TICK * TICK_NS
    np.testing.assert_allclose(stamps, local, atol=2_000_000)
    assert counts["stale"] == pytest.approx((0.4 - LIVE.stale) * 120, abs=4)


def test_a_trial_does_not_begin_with_a_frame_of_long_ago(greeting: Recording, clock: VirtualClock) -> None:
    """The system stalls as the trial begins: it begins with what comes after that, for now."""
    system = VirtualSystem(clock, greeting, "stall@2-4")
    with closing(live_source(ADDRESS, None, system.wiring)) as source:
        source.first()
        clock.wait_until(clock.now() + 2_500_000_000)
        before = clock.now()
        trial = LiveTrial(source, HERE, clock)
        assert trial.begins()
        ticks = list(islice(trial, 5))
    assert not trial.trouble and len(ticks) == 5
    assert 1e-9 * (clock.now() - before) == pytest.approx(1.5, abs=0.6)
    assert max(begins.ahead_ns for begins in ticks) < 20_000_000


@pytest.mark.parametrize("step_ms", [-700, -400, -150, 10, 150, 400])
@pytest.mark.slow
def test_a_clock_of_the_system_that_is_set_costs_nobody_the_person(
    step_ms: int, greeting: Recording, clock: VirtualClock
) -> None:
    """Two seconds into the trial: the frames go on, and so does her time."""

    class Set(VirtualSystem):
        def send(self, frame: MarkerFrame) -> None:
            moved = 1_000_000 * step_ms if self.clock.now() > set_at else 0
            super().send(replace(frame, source_time_ns=frame.source_time_ns + moved))

    set_at = clock.now() + 4_000_000_000
    with closing(live_source(ADDRESS, None, Set(clock, greeting).wiring)) as source:
        source.first()
        clock.wait_until(set_at - 2_000_000_000)
        trial = LiveTrial(source, HERE, clock)
        ticks = [(clock.now(), begins) for begins in islice(trial, 360)]
        assert source.stamps.resets == 1
    local, stamps = np.diff([(at, begins.time_ns) for at, begins in ticks], axis=0)[1:].T
    np.testing.assert_allclose(stamps, local, atol=5_000_000)
    assert trial.stale == 0 and not trial.trouble
    assert max(begins.ahead_ns for _, begins in ticks) < 20_000_000


def test_a_host_that_stood_still_goes_on_with_now(greeting: Recording, clock: VirtualClock) -> None:
    system = VirtualSystem(clock, greeting)
    with closing(live_source(ADDRESS, None, system.wiring)) as source:
        source.first()
        trial = LiveTrial(source, HERE, clock)
        ticks = iter(trial)
        before = [next(ticks) for _ in range(30)][-1]
        clock.wait_until(clock.now() + 400_000_000)
        after = [(clock.now(), next(ticks)) for _ in range(10)]
    assert after[0][1].time_ns - before.time_ns == pytest.approx(400_000_000, abs=TICK_NS)
    assert np.diff([at for at, _ in after]).min() >= 0 and trial.count == 40
    assert after[-1][0] - after[0][0] >= 8 * TICK_NS - 2_000_000
