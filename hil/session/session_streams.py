"""All streams of one session on one synchroniser, beside its ticks: who comes, who is shown it, what is recorded.

Each is added to by the thread that receives it. The tick asks nothing of them: what it computes rests on the source's
own estimate, which is the same.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from highfive.hil.session.kinds import MARKERS, SHOWN, VECTORS, Kind
from highfive.hil.session.shown import Shown, picture_rate, shown_figures
from highfive.hil.session.stream import Stream, StreamSettings, StreamState, ToldClock
from highfive.hil.session.sync_events import SyncEvent, Told
from highfive.hil.session.synchroniser import Synchroniser
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.mocap_bridge.sources.steady_time import ClockEstimate
from highfive.model.geometry.rotations import Array

PAGES = 8
"""That are followed at once; of more, the one that was there first is forgotten."""
_PICTURES = 3600
"""Of a page that its figures are of: the last minute's at 60 Hz."""
_SAYS_NS = 1_000_000_000
"""A page that has shown nothing for so long is hidden, closed or at a standstill: it says so four times a second."""
ARM, PERSON = "arm", "person"


class SessionStreams:
    """The streams of one session.

    Attributes:
        events: what has happened to them so far, in order.
        paged: clock of the person who comes through a live page: that one tells how far it may be off.
    """

    def __init__(self, told: Told = lambda event: None, known: Mapping[str, StreamSettings] | None = None) -> None:
        """``told`` is told of what happens to them; ``known`` is what is known of some beforehand, by name; all of the
        person's systems are :data:`PERSON` there."""
        self._told, self._known = told, dict(known or {})
        self._server = Synchroniser(self._tell)
        self.events: list[SyncEvent] = []
        self.paged = ToldClock()
        self._arm: Stream[Array] | None = None
        self._pages: dict[int, tuple[Stream[Shown], ToldClock, deque[Shown]]] = {}

    def open(
        self, name: str, kind: Kind[Any], clock: ClockEstimate | None = None, *, updates: bool = True, known: str = ""
    ) -> Stream[Any]:
        """A new stream, of which is known what is of ``known``, by default its name; see
        :meth:`highfive.hil.session.synchroniser.Synchroniser.open`."""
        return self._server.open(name, kind, clock, updates=updates, settings=self._known.get(known or name))

    def close(self, stream: Stream[Any]) -> None:
        """It is there no more."""
        self._server.close(stream)

    def end(self) -> None:
        """They are over: what was only counted of them is told."""
        self._server.tell_counts()

    def follow(self, source: LiveSource, *, by_page: bool = False) -> None:
        """A live system, or each of several that are merged, from its next frame on; ``by_page`` of a headset's or a
        webcam's, which come through the page."""
        for part in source.parts:
            newest = part.newest(0)
            own = newest is not None and newest.own_clock
            clock = part.stamps if not own else self.paged if by_page else ToldClock()
            part.hear(_taken(self.open(part.title, MARKERS, clock, updates=False, known=PERSON)))

    def arm(self, time_ns: int, joints: Array) -> None:
        """Joint angles (J,), rad, that servos said at a time of this computer's clock."""
        if self._arm is None:
            self._arm = self.open(ARM, VECTORS)
        self._arm.add(time_ns, joints, time_ns)

    def shown(self, page: int, shown: Shown, bound_ns: int, *, tracks: bool = False) -> None:
        """A picture that a page has shown, and how far off its clock may be; ``tracks``: of the person's page."""
        if page not in self._pages:
            if len(self._pages) >= PAGES:
                self.close(self._pages.pop(min(self._pages))[0])
            clock = ToldClock()
            self._pages[page] = self.open(f"page {page}", SHOWN, clock), clock, deque[Shown](maxlen=_PICTURES)
        stream, clock, pictures = self._pages[page]
        clock.told_ns = bound_ns
        if tracks:
            self.paged.told_ns = bound_ns
        stream.add(shown.display_ns, shown)
        pictures.append(shown)

    def states(self, time_ns: int) -> list[StreamState]:
        """How each stands, asked for one time, ns of this computer's clock.

        Of a page the rate is that of its pictures, and it is valid while it says what it shows.
        """
        pages = {stream.name: pictures for stream, _, pictures in self._pages.values()}

        def of_page(state: StreamState, pictures: Sequence[Shown]) -> StreamState:
            says = state.valid and state.age_ms <= 1e-6 * _SAYS_NS
            return replace(state, rate_hz=picture_rate(pictures), valid=says)

        found = self._server.states(time_ns)
        return [of_page(state, pages[state.stream]) if state.stream in pages else state for state in found]

    def pages(self) -> dict[str, dict[str, Any]]:
        """What each page has shown in its last minute: :func:`highfive.hil.session.shown.shown_figures`, by stream."""
        return {stream.name: shown_figures(pictures) for stream, _, pictures in self._pages.values()}

    def _tell(self, event: SyncEvent) -> None:
        self.events.append(event)
        self._told(event)


def _taken(stream: Stream[MarkerFrame]) -> Callable[[MarkerFrame], None]:
    return lambda frame: stream.add(frame.source_time_ns, frame, frame.arrival_time_ns, frame.latency_ns)
