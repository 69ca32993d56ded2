"""Any LSL stream over the real library on this machine, on the line of all streams."""

import time
from collections.abc import Callable
from contextlib import closing

import numpy as np
import pylsl
import pytest

from highfive.hil.session.kinds import EVENTS, VECTORS
from highfive.hil.session.sync_events import SyncEvent
from highfive.hil.session.synchroniser import Synchroniser
from highfive.mocap_bridge.sources.lsl import configure
from highfive.mocap_bridge.sources.lsl_stream import LslStream
from highfive.mocap_bridge.sources.ping_clock import PingClock
from highfive.mocap_bridge.sources.stamp_clock import UNKNOWN_NS
from highfive.model.errors import HighFiveError

MS = 1_000_000


@pytest.fixture(scope="module", autouse=True)
def this_machine_alone() -> None:
    configure(local_only=True)


def outlet(name: str, kind: str, channels: int, rate: float, form: int) -> pylsl.StreamOutlet:
    return pylsl.StreamOutlet(pylsl.StreamInfo(name, kind, channels, rate, form, f"test-{name}"))


def until(holds: Callable[[], bool], meanwhile: Callable[[], None] = lambda: None, seconds: float = 15.0) -> None:
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end
        meanwhile()
        time.sleep(0.01)


def test_gaze_and_events_are_on_one_line_with_their_bounds() -> None:
    told: list[SyncEvent] = []
    server = Synchroniser(told.append)
    gaze_out = outlet("Gaze test", "Gaze", 2, 100.0, pylsl.cf_double64)
    events_out = outlet("Events test", "Markers", 1, 0.0, pylsl.cf_string)
    clocks = PingClock(), PingClock()
    gaze, events = server.open("gaze", VECTORS, clocks[0]), server.open("PsychoPy", EVENTS, clocks[1])
    with (
        closing(LslStream("Gaze test", gaze.add, clocks[0])) as followed,
        closing(LslStream("Events test", events.add, clocks[1])),
    ):
        until(lambda: gaze_out.have_consumers() and events_out.have_consumers())

        def look() -> None:
            gaze_out.push_sample([1e-9 * time.monotonic_ns(), 0.5])

        until(lambda: gaze.newest_ns is not None and max(gaze.bound_ns, events.bound_ns) < UNKNOWN_NS, look)
        events_out.push_sample(['{"event": "hand_raised"}'])
        raised_ns = time.monotonic_ns()
        until(lambda: events.newest_ns is not None, look)
        for _ in range(30):
            look()
            time.sleep(0.01)
        assert followed.trouble == ""
        newest = gaze.newest_ns
        assert newest is not None
        assert events.newest_ns is not None
        moment = server.at(newest - 5 * MS)
        assert abs(events.newest_ns - raised_ns) < 5 * MS
    assert told == []
    np.testing.assert_allclose(moment.of(gaze).value, [1e-9 * (newest - 5 * MS), 0.5], atol=2e-3)
    assert 0 < moment.of(gaze).bound_ns < 5 * MS
    assert server.at(raised_ns + 50 * MS).of(events).value == '{"event": "hand_raised"}'


def test_a_stream_that_is_not_there_is_said() -> None:
    with closing(LslStream("No such stream", lambda *_: None, PingClock())) as follower:
        until(lambda: "no stream called 'No such stream'" in follower.trouble)
    with pytest.raises(HighFiveError, match="without quotation marks"):
        LslStream("it's", lambda *_: None, PingClock())
