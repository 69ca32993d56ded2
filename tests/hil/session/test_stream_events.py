"""Whatever a stream does, it is told once, in one line, and nothing raises."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from highfive.hil.session.kinds import EVENTS, VECTORS
from highfive.hil.session.stream import StreamSettings
from highfive.hil.session.sync_events import Happened, SyncEvent
from highfive.hil.session.synchroniser import Synchroniser
from highfive.mocap_bridge.sources.ping_clock import PingClock
from highfive.mocap_bridge.sources.stamp_clock import UNKNOWN_NS, StampClock

MS, S = 1_000_000, 1_000_000_000
PERIOD = 10 * MS
BEGAN = 5000 * S  # of this computer's clock


def noise(k: int) -> int:
    """A delay, ns: most are short."""
    return (k * 7919 % 13) ** 2 * 20_000


def kinds(events: list[SyncEvent]) -> list[Happened]:
    for event in events:
        assert "\n" not in event.text
        assert event.text.startswith(event.stream)
    return [event.happened for event in events]


def heard(stamps: list[int], clock: StampClock | None = None) -> tuple[Synchroniser, list[SyncEvent]]:
    """A stream whose samples come each 10 ms with such stamps, and that is asked all the while."""
    events: list[SyncEvent] = []
    server = Synchroniser(events.append)
    stream = server.open("lab", VECTORS, clock)
    for k, stamp in enumerate(stamps):
        arrival = BEGAN + k * PERIOD + noise(k)
        stream.add(stamp, np.array([float(k)]), arrival)
        server.at(arrival)
    return server, events


def test_a_stream_as_it_should_be_has_no_events_and_is_at_its_place() -> None:
    count = 2000
    server, events = heard([k * PERIOD for k in range(count)], StampClock())
    assert events == []
    found = server.at(BEGAN + (count - 2) * PERIOD + PERIOD // 2)["lab"]
    np.testing.assert_allclose(found.value, count - 1.5, atol=0.01)
    assert found.bound_ns < MS
    assert found.valid


@pytest.mark.parametrize("moved", [-10 * MS, 10 * MS, -3600 * S, 3600 * S])
def test_a_clock_that_is_set_is_one_event(moved: int) -> None:
    server, events = heard([k * PERIOD + (moved if k > 1000 else 0) for k in range(2000)], StampClock())
    assert [kind for kind in kinds(events) if kind is not Happened.BACK] == [Happened.RESYNCHRONISED]
    about = events[-1].about()
    assert about["stream"] == "lab" and abs(about["moved_ms"] + 1e-6 * moved) < 1.0
    found = server.at(BEGAN + 1998 * PERIOD)["lab"]
    np.testing.assert_allclose(found.value, 1998, atol=0.1)


def test_a_stream_that_stops_and_resumes() -> None:
    events: list[SyncEvent] = []
    server = Synchroniser(events.append)
    stream = server.open("lab", VECTORS)
    for k in (*range(100), *range(200, 300)):
        stream.add(BEGAN + k * PERIOD, np.zeros(1), BEGAN + k * PERIOD)
        server.at(BEGAN + k * PERIOD)
        if k == 99:
            asked = [server.at(BEGAN + late * PERIOD)["lab"].valid for late in range(100, 200)]
            assert asked[0]
            assert not any(asked[3:])
    assert kinds(events) == [Happened.STOPPED, Happened.RESUMED]


def test_a_stream_that_jumps_back_goes_on_from_there() -> None:
    server, events = heard([BEGAN + k * PERIOD - (S if k > 300 else 0) for k in range(600)])
    assert kinds(events) == [Happened.BACK, Happened.RESYNCHRONISED]
    np.testing.assert_allclose(server.at(BEGAN + 580 * PERIOD - S)["lab"].value, 580)


def test_a_stream_that_changes_its_rate() -> None:
    stamps = [k * PERIOD for k in range(600)]
    events: list[SyncEvent] = []
    server = Synchroniser(events.append)
    stream = server.open("lab", VECTORS, StampClock())
    for k in range(1200):
        stamp = stamps[k] if k < 600 else 600 * PERIOD + (k - 600) * PERIOD // 2
        stream.add(stamp, np.zeros(1), BEGAN + stamp)
    assert kinds(events) == [Happened.RATE]
    assert "100 to 200 Hz" in events[0].text


def test_a_stream_that_changes_its_channels_begins_anew() -> None:
    events: list[SyncEvent] = []
    server = Synchroniser(events.append)
    stream = server.open("lab", VECTORS)
    for k in range(20):
        stream.add(k * PERIOD, np.zeros(3 if k < 10 else 4))
        assert np.shape(server.at(k * PERIOD - PERIOD // 2)["lab"].value) == ((3,) if k < 10 else (4,))
    assert kinds(events) == [Happened.LAYOUT]
    assert events[0].text == "lab changed its channels from (3,) to (4,); it begins anew"


def test_one_stamp_of_another_time_takes_no_others_with_it() -> None:
    server, events = heard([BEGAN + k * PERIOD + (3600 * S if k == 300 else 0) for k in range(600)])
    assert kinds(events) == [Happened.ASTRAY]
    found = server.at(BEGAN + 590 * PERIOD)["lab"]
    np.testing.assert_allclose(found.value, 590)
    assert found.valid


def test_what_alternates_is_told_once_a_minute_with_a_count() -> None:
    """Two programs that send under one name: three and four channels in turn, one of them an hour ahead."""
    events: list[SyncEvent] = []
    server = Synchroniser(events.append)
    stream = server.open("lab", VECTORS)
    for k in range(12_500):
        now = BEGAN + k * PERIOD
        stream.add(now + (k % 2) * 3600 * S, np.zeros(3 + k % 2), now)
    found = {kind: [event.text for event in events if event.happened is kind] for kind in set(kinds(events))}
    assert {kind: len(texts) for kind, texts in found.items()} == {Happened.LAYOUT: 3, Happened.ASTRAY: 3}
    assert "times more" not in found[Happened.LAYOUT][0]
    for texts in found.values():
        assert "(2999 times more since that was told last)" in texts[1]


@pytest.mark.parametrize("closed", [False, True])
def test_what_was_only_counted_is_told_at_the_end(closed: bool) -> None:
    """Two other layouts and one stamp an hour ahead after those that were told, and then never again."""
    events: list[SyncEvent] = []
    server = Synchroniser(events.append)
    stream = server.open("lab", VECTORS)
    for k in range(1000):
        now = BEGAN + k * PERIOD
        stream.add(now + (3600 * S if k in (100, 200) else 0), np.zeros(4 if k in (50, 90) else 3), now)
    assert kinds(events) == [Happened.LAYOUT, Happened.ASTRAY]
    if closed:
        server.close(stream)
    else:
        server.tell_counts()
    server.tell_counts()
    assert kinds(events[2:]) == [Happened.LAYOUT, Happened.ASTRAY]
    assert [event.text for event in events[2:]] == [
        "lab changed its channels: 3 times more since that was told last",
        "lab is of another time: 1 time more since that was told last",
    ]
    assert [event.time_ns for event in events[2:]] == [BEGAN + 91 * PERIOD, BEGAN + 200 * PERIOD]


def test_what_was_only_counted_and_is_over_is_told_while_the_session_goes_on() -> None:
    events: list[SyncEvent] = []
    server = Synchroniser(events.append)
    stream = server.open("lab", VECTORS)
    told: list[int] = []
    for k in range(20_000):
        now = BEGAN + k * PERIOD
        stream.add(now, np.zeros(4 if 50 <= k < 60 or k == 6500 else 3), now)
        if k % 100 == 0:
            server.states(now)
        told += [k] * (len(events) - len(told))
    changed = "lab changed its channels from (3,) to (4,); it begins anew"
    back = "lab changed its channels: 1 time more since that was told last"
    assert [event.text for event in events] == [changed, back, changed, back]
    assert told == [50, 6100, 6500, 12_600]


def test_what_is_wrong_again_and_stays_so_is_told_when_the_minute_is_over() -> None:
    stamps = [BEGAN + k * PERIOD + (3600 * S if 100 <= k < 200 or k >= 300 else 0) for k in range(7000)]
    _, events = heard(stamps)
    told = [event.time_ns for event in events if event.happened is Happened.ASTRAY]
    assert len(told) == 2 and 60 * S <= told[1] - told[0] < 61 * S


@pytest.mark.parametrize(("unit", "ns"), [("ms", 10**6), ("µs", 10**3)])
def test_stamps_in_another_unit_are_told_and_not_used(unit: str, ns: int) -> None:
    server, events = heard([round(k * PERIOD / ns) for k in range(500)], StampClock())
    assert kinds(events) == [Happened.UNIT]
    assert f"counts its stamps in {unit}, expected ns" in events[0].text
    assert "lab" not in server.at(BEGAN + 500 * PERIOD)


def test_stamps_of_this_clock_in_ms_are_told_at_once() -> None:
    server, events = heard([round((BEGAN + k * PERIOD) / MS) for k in range(50)])
    assert kinds(events) == [Happened.ASTRAY]
    assert "are they in ms?" in events[0].text
    assert len(server.at(BEGAN)) == 0


@pytest.mark.parametrize(("unit", "count"), [("ms", 10**3), ("µs", 10**6), ("ns", 10**9)])
def test_stamps_in_another_unit_than_s_are_guessed(unit: str, count: int) -> None:
    """Who takes them for s, as LSL's are, has them so many times as far ahead."""
    server, events = heard([(BEGAN + k * PERIOD) * count for k in range(300)])
    assert kinds(events) == [Happened.ASTRAY]
    assert f"its stamps are not used: are they in {unit}, not in s?" in events[0].text
    assert not server.at(BEGAN + 300 * PERIOD)


def test_stamps_in_the_future_are_told_once_and_not_used() -> None:
    server, events = heard([BEGAN + k * PERIOD + 3600 * S for k in range(50)])
    assert kinds(events) == [Happened.ASTRAY]
    assert "3600 s in the future" in events[0].text
    assert len(server.at(BEGAN)) == 0


def test_an_outage_that_ends_in_a_burst_is_a_stop_and_no_more() -> None:
    events: list[SyncEvent] = []
    server = Synchroniser(events.append)
    stream = server.open("lab", VECTORS, StampClock())
    for k in range(3000):
        arrival = BEGAN + (1500 if 1000 <= k < 1500 else k) * PERIOD + noise(k)
        stream.add(k * PERIOD, np.zeros(1), arrival)
    assert kinds(events) == []


def test_what_is_known_of_latency_is_taken_off_and_its_bound_added() -> None:
    server = Synchroniser()
    settings = StreamSettings(latency_ns=4 * MS, latency_bound_ns=MS)
    stream = server.open("camera", VECTORS, settings=settings)
    for k in range(10):
        stream.add(BEGAN + k * PERIOD, np.array([float(k)]), BEGAN + k * PERIOD + MS, latency_ns=6 * MS)
    found = server.at(BEGAN + 4 * PERIOD)["camera"]
    np.testing.assert_allclose(found.value, 5.0)
    assert found.bound_ns == MS


def test_a_peer_that_answers_has_its_clock() -> None:
    server, clock = Synchroniser(), PingClock()
    stream = server.open("headset", VECTORS, clock)
    assert stream.bound_ns == UNKNOWN_NS
    for k in range(100):
        clock.update(k * 100 * MS, k * 100 * MS + 2 * MS - 50 * S, k * 100 * MS + 4 * MS)
        stream.add(k * 100 * MS - 50 * S, np.array([float(k)]), k * 100 * MS + 3 * MS)
    found = server.at(95 * 100 * MS)["headset"]
    np.testing.assert_allclose(found.value, 95, atol=0.01)
    assert abs(found.bound_ns - 2 * MS) < MS


@settings(max_examples=200)
@given(
    st.lists(st.tuples(st.integers(-(2**62), 2**62), st.integers(0, 3), st.integers(-(10**10), 10**10)), max_size=60),
    st.booleans(),
)
def test_nothing_raises_whatever_comes(samples: list[tuple[int, int, int]], own: bool) -> None:
    events: list[SyncEvent] = []
    server = Synchroniser(events.append)
    stream = server.open("any", VECTORS, None if own else StampClock())
    marks = server.open("marks", EVENTS)
    now = BEGAN
    for stamp, channels, passed in samples:
        now += passed
        stream.add(stamp, np.zeros(channels), now)
        marks.add(stamp, "mark", now)
        for name in server.at(now):
            assert server.at(now)[name].age_ns >= 0


@given(st.lists(st.tuples(st.integers(1, 30 * MS), st.integers(0, 40 * MS)), min_size=2, max_size=200))
def test_the_time_of_a_stream_goes_forward_unless_it_is_synchronised_anew(steps: list[tuple[int, int]]) -> None:
    events: list[SyncEvent] = []
    server = Synchroniser(events.append)
    stream = server.open("lab", VECTORS, StampClock())
    stamp, arrival, before = 0, BEGAN, -1
    for number, (period, delay) in enumerate(steps):
        stamp += period
        arrival = max(arrival, BEGAN + stamp + delay)
        resets = len(events)
        stream.add(stamp, np.array([float(number)]), arrival)
        newest = server.at(arrival + S)["lab"]
        time = arrival + S - newest.age_ns
        assert time >= before or len(events) > resets
        assert time <= arrival
        before = time
