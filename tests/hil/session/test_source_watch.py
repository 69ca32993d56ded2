"""A live source whose clock is set while it is followed, in virtual time."""

from contextlib import closing

import numpy as np
import pytest

from highfive.hil.bench.frame_link import FrameLink, SentFrames
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.runtime.virtual_scheduler import VirtualScheduler
from highfive.hil.session.source_watch import SourceWatch
from highfive.hil.session.sync_events import Happened, SyncEvent
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.live import LiveSource

MS, S = 1_000_000, 1_000_000_000


@pytest.mark.parametrize("moved_ms", [0, 10, -10, -5000])
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
            watch, frame, before, back, off = SourceWatch(source, told.append), None, 0, 0, []
            while clock.now() < begins + round(11.9 * S):
                frame = source.wait(frame, 0.1) or frame
                assert frame is not None
                captured, count = source.captured(frame), len(told)
                watch.look(clock.now())
                if captured < before:
                    assert len(told) > count  # no earlier than it is told
                    back += 1
                before = captured
                if clock.now() > begins + 9 * S or 3 * S < clock.now() - begins < 6 * S:
                    off.append(abs(captured - begins - frame.number * 10 * MS) / MS)
    assert max(off) < 0.5
    assert [event.happened for event in told] == ([Happened.RESYNCHRONISED] if moved_ms else [])
    assert back <= len(told)
    if moved_ms:
        assert abs(told[0].moved_ns + moved_ms * MS) < 3 * MS
        assert told[0].text.startswith("lab was synchronised anew")
