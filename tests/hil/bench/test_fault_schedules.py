"""Schedules of faults: what a seed draws, that a run is the same twice, and that the laws hold and can be broken."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.lifecycle import emulator_options
from highfive.hil.bench.black_box import BlackBox
from highfive.hil.bench.fault_laws import ESTOP_MS, Laws, judge_body, judge_times
from highfive.hil.bench.fault_run import LASTS_S, FaultJob, run_schedule
from highfive.hil.bench.fault_schedule import BUS, KINDS, MOST, FaultSchedule, Happening, drawn
from highfive.hil.bench.faults import FaultsOptions, bench_faults
from highfive.hil.bench.long_session import LongSessionOptions, bench_long_session
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.emulator.emulator_process import make_bus
from highfive.hil.safety.limits_file import load_limits
from highfive.hil.trials.partners import Partner, simulated_partners
from highfive.model import DEFAULT_MODEL
from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.store import load_model

MS = 1_000_000


def quiet(_: str, __: int):
    return lambda *_, **__: None


def test_a_seed_draws_the_same_schedule_and_many_draw_everything() -> None:
    schedules = [drawn(seed, 16, LASTS_S) for seed in range(400)]
    assert schedules == [drawn(seed, 16, LASTS_S) for seed in range(400)]
    drawn_kinds = Counter(it.kind for schedule in schedules for it in schedule.happenings)
    assert set(drawn_kinds) == set(KINDS)
    assert {len(schedule.happenings) for schedule in schedules} == set(range(1, MOST + 1))
    for schedule in schedules:
        assert str(schedule.seed) in str(schedule)
        assert all(0.0 <= it.at_s < LASTS_S and it.kind in str(it) for it in schedule.happenings)
        for it in schedule.of(*BUS):
            assert it.bus_fault().kind == it.kind


@pytest.fixture(scope="module")
def partner() -> Partner:
    return simulated_partners(1, ["happy"], ["B2"], 3)[0]


def schedule(*happenings: Happening) -> FaultSchedule:
    return FaultSchedule(1, 0, happenings)


def test_a_run_is_the_same_twice(partner: Partner) -> None:
    job = FaultJob(schedule(Happening("half", 0.5, 0.05, 0.5), Happening("emergency stop", 1.2)), partner)
    first, second = run_schedule(job), run_schedule(job)
    assert first == second
    laws, said = first
    assert not laws.broken
    assert any("emergency stop" in line for line in said)
    assert 0.0 <= laws.worst["emergency stop to the last goal, ms"] <= ESTOP_MS


@pytest.mark.parametrize(
    ("happening", "said"),
    [
        (Happening("dead", 1.0, 0.5, servo=4), "elbow has not answered for"),
        (Happening("overload", 1.0, servo=2), "the servo of shoulder reports overload"),
        (Happening("machine stall", 1.2, 0.3), "the loop paused for"),
        (Happening("full disk", 1.0), "cannot write the recording"),
    ],
)
def test_what_happened_is_said(happening: Happening, said: str, partner: Partner) -> None:
    laws, lines = run_schedule(FaultJob(schedule(happening), partner))
    assert not laws.broken
    assert any(said in line for line in lines), lines


def boxed() -> BlackBox:
    """An arm that stood for a second, looked at every ms."""
    box = BlackBox(make_bus(emulator_options(ArmOptions())), load_rig())
    for ms in range(1, 1001):
        box.look(ms * MS)
    box.powered = [[True] * 6 for _ in box.powered]
    return box


def test_a_goal_that_comes_after_an_emergency_stop_breaks_a_law() -> None:
    box, laws = boxed(), Laws()
    for late in (10, 60):
        box.goals = [list(row) for row in box.goals]
        for row in box.goals[500 + late :]:
            row[0] += 0.1
        judge_times(laws, schedule(Happening("emergency stop", 0.5)), box, 0, 500 * MS)
        assert [law for law, _ in laws.broken] == ["emergency stop to the last goal, ms"] * (late > ESTOP_MS)


def test_a_body_that_leaves_its_limits_breaks_laws() -> None:
    limits, laws = load_limits(), Laws()
    judge_body(laws, boxed(), limits)
    assert not laws.broken
    for change, law in (
        (lambda box: box.positions[300].__iadd__(4.0), "body: position beyond its stop, rad"),
        (lambda box: box.velocities[300].__iadd__(9.0), "body: speed, of what is allowed"),
        (lambda box: box.velocities[-1].__iadd__(0.2), "body: speed in the end, rad/s"),
        (lambda box: box.allowed.__setitem__(300, [9.0] * 6), "goal current, of what is allowed"),
    ):
        box, laws = boxed(), Laws()
        change(box)
        judge_body(laws, box, limits)
        assert law in [name for name, _ in laws.broken]


def test_no_number_keeps_no_law() -> None:
    laws = Laws()
    laws.judge("a law", float("nan"), 1.0)
    assert [law for law, _ in laws.broken] == ["a law"]


def test_none_is_refused() -> None:
    with pytest.raises(HighFiveError, match="ask for at least one"):
        bench_faults(replace(FaultsOptions(), seeds=0), quiet)


@pytest.mark.slow(400)
def test_two_hundred_schedules_break_no_law() -> None:
    result = bench_faults(FaultsOptions(200), quiet)
    assert result["schedules"] == 200
    assert not result["broken"], result["broken"]
    assert result["estop_ms"] <= ESTOP_MS and result["watchdog_ms"] <= 100.0 and result["hold_ms"] <= 100.0
    assert np.isfinite(list(result["worst"].values())).all()


@pytest.mark.slow
def test_a_session_goes_on_and_on_without_a_missed_cycle() -> None:
    result = bench_long_session(LongSessionOptions(0.5), load_model(DEFAULT_MODEL), quiet)
    assert result["minutes"] >= 0.5 and result["trials"] >= 4 and result["stopped"] == ""
    assert result["missed_cycles"] == result["unanswered"] == 0 < result["cycles"]
    assert not result["broken"]
    with pytest.raises(HighFiveError, match=r"ask for 0\.1 at least"):
        bench_long_session(LongSessionOptions(float("nan")), load_model(DEFAULT_MODEL), quiet)
