"""What a seed draws, and what of it a camera sends."""

import numpy as np
import pytest

from highfive.hil.bench.fault_schedule import (
    BUS,
    DEATHS,
    ENDLESS_S,
    FOLLOWING,
    GROUPS,
    KINDS,
    MOST,
    PHASES,
    STALLS,
    SWITCHING_ON,
    FaultSchedule,
    Happening,
    drawn,
)  # fmt: skip
from highfive.hil.bench.faulty_camera import BEFORE_S, FaultyCamera
from highfive.hil.session.session import RATE_HZ
from highfive.hil.trials.partners import Partner
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.source import C3DSource

MS = 1_000_000


def test_a_seed_draws_the_same_schedule_and_many_draw_everything() -> None:
    schedules = [drawn(seed, 16) for seed in range(600)]
    assert schedules == [drawn(seed, 16) for seed in range(600)]
    happenings = [it for schedule in schedules for it in schedule.happenings]
    assert {it.kind for it in happenings} == set(KINDS)
    assert {it.phase for it in happenings} == set(PHASES)
    assert {len(schedule.happenings) for schedule in schedules} == set(range(1, MOST + 1))
    lengths = [it.lasts_s for it in happenings if it.kind in STALLS]
    assert min(lengths) < 0.05 and max(lengths) == ENDLESS_S and sum(0.5 < one < 5.0 for one in lengths) > 20
    assert {bool(it.looks) for it in happenings if it.kind in DEATHS} == {True, False}
    for schedule in schedules:
        assert str(schedule.seed) in str(schedule)
        assert all(0.0 <= it.at_s < PHASES[it.phase] and it.kind in str(it) for it in schedule.happenings)
        for it in schedule.of(*BUS):
            assert it.bus_fault().kind == it.kind


def test_each_group_is_met_in_any_few_schedules() -> None:
    for first in range(0, 120, 7):
        few = [drawn(seed, 16) for seed in range(first, first + len(GROUPS))]
        assert all(any(schedule.of(*group) for schedule in few) for group in GROUPS)


def schedule(*happenings: Happening) -> FaultSchedule:
    return FaultSchedule(1, 0, happenings)


def frames(partner: Partner, *happenings: Happening) -> list[tuple[int, MarkerFrame]]:
    """What a camera sends in a second and a half, with when; the arm follows after half a second."""
    found: list[tuple[int, MarkerFrame]] = []
    begun = {SWITCHING_ON: 0, FOLLOWING: 500 * MS}
    now = 0
    camera = FaultyCamera(partner, schedule(*happenings), lambda it: begun[it] if now >= begun[it] else None, 0)
    while now < 1500 * MS:
        found += [(now, frame) for frame in camera.arrived(now)]
        now = camera.next_ns
    return found


def test_a_camera_sends_the_person_who_stands_until_the_arm_follows(partner: Partner) -> None:
    sent = frames(partner)
    assert [frame.number for _, frame in sent] == list(range(180))
    assert all(frame.arrival_time_ns == at for at, frame in sent)
    first = max(0, partner.contact_frame - round(BEFORE_S * RATE_HZ))
    for number, row in ((0, first), (60, first), (61, first + 1), (160, first + 100)):
        expected = C3DSource(partner.recording, RATE_HZ).frame(row)
        assert np.array_equal(sent[number][1].positions, expected.positions)


@pytest.mark.parametrize("phase", [SWITCHING_ON, FOLLOWING])
def test_what_goes_wrong_with_frames_is_sent(phase: str, partner: Partner) -> None:
    begun = 500 * MS if phase == FOLLOWING else 0
    whole = frames(partner)

    def during(sent: list[tuple[int, MarkerFrame]]) -> list[MarkerFrame]:
        return [frame for _, frame in sent if 200 <= (frame.number * 1e3 / RATE_HZ) - begun / MS < 400]

    def one(kind: str, amount: float = 0.0) -> list[tuple[int, MarkerFrame]]:
        return frames(partner, Happening(kind, 0.2, 0.2, amount, phase=phase))

    assert not during(one("stall")) and len(one("stall")) == len(whole) - 24
    assert {frame.arrival_time_ns for frame in during(one("burst"))} == {begun + 400 * MS}
    assert not any(frame.valid.any() for frame in during(one("occlusion")))
    assert 0 < len(during(one("drop", 0.5))) < 24
    for kind, amount, markers in (("swap", 0.0, 2), ("ghost", 0.3, 1)):
        changed = [
            (a.positions != b.positions).any(axis=1).sum()
            for a, b in zip(during(one(kind, amount)), during(whole), strict=True)
        ]
        assert set(changed) == {markers}
    jumped = frames(partner, Happening("clock jump", 0.2, 0.0, -3.0, phase=phase))
    steps = np.diff([frame.source_time_ns for _, frame in jumped])
    assert (steps < 0).sum() == 1 and np.isclose(steps.min(), -3e9 + 1e9 / RATE_HZ, atol=2)
