"""A live source in virtual time: a frame is handed over at once, and whoever reads slowly reads the newest."""

from collections.abc import Iterator
from contextlib import closing

import numpy as np
import pytest
from virtual_system import VirtualSystem

from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.sources.address import open_source
from highfive.mocap_bridge.sources.live import BACK_OFF_S, SILENT_S, STALLED_S, LiveSource
from highfive.mocap_bridge.sources.source import Connection

NAMES = ("human:RFIN", "human:RMC5", "human:RWRA")
PERIOD_NS = 1e9 / 120.0
AT_ONCE_NS = 50_000


def following(clock: VirtualClock, *faults: str) -> tuple[VirtualSystem, LiveSource]:
    points = np.random.default_rng(0).uniform(0.2, 1.6, size=(1, len(NAMES), 3)) + np.zeros((120, 1, 1))
    recording = make_recording(120.0, NAMES, points, np.ones((120, len(NAMES)), dtype=bool))
    system = VirtualSystem(clock, recording, *faults)
    wiring = system.wiring
    source = open_source("vicon://lab", "human", scheduler=wiring.scheduler, connects=wiring.connects)
    assert isinstance(source, LiveSource)
    return system, source


@pytest.fixture
def clock() -> Iterator[VirtualClock]:
    with VirtualClock() as clock:
        yield clock


def test_who_waits_has_every_frame_at_once(clock: VirtualClock) -> None:
    system, source = following(clock)
    with closing(source):
        seen, delays = source.first(), []
        for _ in range(240):
            seen = source.wait(seen, 1.0)
            assert seen is not None
            delays.append(clock.now() - dict(system.sent)[seen.number])
        health = source.health(clock.now())
    assert seen.number == health.received - 1 == 240 and health.lost == 0
    assert max(delays) < AT_ONCE_NS


@pytest.mark.parametrize("busy_s", [0.03, 0.1, 1.0])
def test_a_slow_reader_reads_the_newest(clock: VirtualClock, busy_s: float) -> None:
    system, source = following(clock)
    with closing(source):
        source.first()
        for _ in range(20):
            clock.wait_until(clock.now() + round(1e9 * busy_s))
            frame = source.newest(clock.now())
            assert frame is not None
            assert clock.now() - dict(system.sent)[frame.number] < PERIOD_NS + AT_ONCE_NS


def test_silence_is_seen_in_its_time_and_ends_the_connection(clock: VirtualClock) -> None:
    begun = clock.now()

    def health_at(seconds: float) -> tuple[Connection, str]:
        clock.wait_until(begun + round(1e9 * seconds))
        found = source.health(clock.now())
        return found.connection, found.trouble

    _, source = following(clock, "stall@1-4")
    with closing(source):
        assert health_at(0.99 + STALLED_S) == (Connection.LIVE, "")
        assert health_at(1.01 + STALLED_S) == (Connection.STALLED, "")
        assert health_at(0.95 + SILENT_S) == (Connection.STALLED, "")
        assert health_at(1.15 + SILENT_S)[1].startswith("connected, but nothing has come")
        assert health_at(4.05 + BACK_OFF_S[1]) == (Connection.LIVE, "")
