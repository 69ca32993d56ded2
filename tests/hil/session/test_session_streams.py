"""The streams of a session: a live source whose clock is set while it is followed, in virtual time; pages; an arm."""

from contextlib import closing

import numpy as np
import pytest

from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.runtime.virtual_scheduler import VirtualScheduler
from highfive.hil.session.session_streams import PAGES, SessionStreams
from highfive.hil.session.shown import Shown
from highfive.hil.session.sync_events import Happened, SyncEvent
from highfive.hil.trials.frame_link import FrameLink, SentFrames
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.mocap_bridge.sources.stamp_clock import UNKNOWN_NS

MS, S = 1_000_000, 1_000_000_000


@pytest.mark.parametrize("moved_ms", [0, 10, -10, -5000])
@pytest.mark.slow
def test_a_clock_that_is_set_is_told_once_and_time_goes_forward_but_for_that(moved_ms: int) -> None:
    told: list[SyncEvent] = []
    with VirtualClock(1) as clock:
        begins, rng = clock.now() + 10 * MS, np.random.default_rng(1)
        frames = [
            MarkerFrame(
                ("RFIN",), np.ones((1, 3)), np.ones(1, dtype=bool), k,
                k * 10 * MS + (moved_ms * MS if k >= 600 else 0),
                begins + k * 10 * MS + round(rng.exponential(0.5) * MS), np.zeros((0, 3)),
            )
            for k in range(1200)
        ]  # fmt: skip
        link = FrameLink(clock, 100.0, SentFrames(frames))
        with closing(LiveSource("lab", lambda: link, None, 100.0, VirtualScheduler(clock))) as source:
            streams, frame, before, back, off = SessionStreams(told.append), None, 0, 0, []
            streams.follow(source)
            while clock.now() < begins + round(11.9 * S):
                frame = source.wait(frame, 0.1) or frame
                assert frame is not None
                captured, count = source.captured(frame), len(told)
                if captured < before:
                    assert count > back  # no earlier than it is told
                    back += 1
                before = captured
                if clock.now() > begins + 9 * S or 3 * S < clock.now() - begins < 6 * S:
                    off.append(abs(captured - begins - frame.number * 10 * MS) / MS)
                (state,) = streams.states(captured)
                # The stream's time of a frame is the source's own.
                assert state.age_ms < 0.01, (frame.number, state)
    assert max(off) < 0.5
    assert state.stream == "lab" and state.resets == len(told) and state.valid
    assert state.rate_hz == pytest.approx(100.0, rel=0.1) and state.bound_ms is not None and state.bound_ms < 2.0
    assert streams.events == told
    assert [event.happened for event in told] == ([Happened.RESYNCHRONISED] if moved_ms else [])
    assert back <= len(told)
    if moved_ms:
        assert abs(told[0].moved_ns + moved_ms * MS) < 3 * MS
        assert told[0].text.startswith("lab was synchronised anew")


def test_an_arm_and_pages_are_asked_for_one_time_and_pages_say_what_they_have_shown() -> None:
    streams = SessionStreams()
    for k in range(101):
        streams.arm(k * 10 * MS, np.full(6, 0.01 * k))
    for page in range(1, PAGES + 3):
        streams.shown(page, Shown(7, 900 * MS, 930 * MS), 3 * MS)
        streams.shown(page, Shown(9, 916 * MS, 946 * MS, 1), 2 * MS)
    assert streams.paged.bound_ns(0) == UNKNOWN_NS  # none of them tracks her
    found = {state.stream: state for state in streams.states(1 * S)}
    assert found.pop("arm").age_ms == 0.0
    assert list(found) == [f"page {page}" for page in range(3, PAGES + 3)]  # the newest of too many
    assert all((page.bound_ms, page.age_ms, page.rate_hz) == (2.0, 54.0, 62.5) for page in found.values())
    assert streams.pages()["page 4"] == {"pictures": 2, "dropped": 1, "late_ms": {"p50": 30.0, "p95": 30.0}}
    streams.shown(PAGES, Shown(11, 916 * MS, 946 * MS, 1), 5 * MS, tracks=True)
    streams.shown(PAGES + 2, Shown(11, 916 * MS, 946 * MS, 1), 1 * MS)
    assert streams.paged.bound_ns(0) == 5 * MS  # as far off as her page, whichever was the last to say something


def test_a_page_has_the_rate_of_its_pictures_and_is_valid_while_it_says_what_it_shows() -> None:
    streams = SessionStreams()

    def looked(time_ns: int) -> tuple[float | None, bool]:
        (page,) = streams.states(time_ns)
        return page.rate_hz, page.valid

    for k in range(300):
        at = 4 * S + (round(k * S / 90) if k < 100 else round(100 * S / 90) + (k - 100) * 20 * MS)
        streams.shown(1, Shown(k, at - 20 * MS, at), MS)
        if k == 0:
            assert looked(at) == (None, True)
        if k == 99:
            assert looked(at + 250 * MS) == (pytest.approx(90.0, abs=0.01), True)
    assert looked(at + 250 * MS) == (pytest.approx(50.0, abs=0.01), True)
    assert looked(at + 5 * S) == (pytest.approx(50.0, abs=0.01), False)
    streams.shown(1, Shown(300, at + 5 * S, at + 5 * S), MS)
    assert looked(at + 5 * S) == (None, True)  # it was hidden in between
