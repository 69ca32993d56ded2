"""Any number of streams, each with a clock of its own, on one time line (the paper's synchronisation server).

Poses come when the model has answered, the person's arm as the markers come in, and a headset, an arm, an eye tracker
or an experiment's events as they like. Whoever shows or records them (MuJoCo, a viewer, the servo rig) asks all of them
for one time and gets each as it was then, with how old that is and how far its time may be off.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

from highfive.hil.session.kinds import Kind
from highfive.hil.session.stream import Aligned, Stream, StreamSettings, StreamState
from highfive.hil.session.stream_watch import WatchSettings
from highfive.hil.session.sync_events import SyncEvent, Told
from highfive.mocap_bridge.sources.steady_time import ClockEstimate
from highfive.model.errors import HighFiveError

Sample = TypeVar("Sample")


class Moment(Mapping[str, Aligned[Any]]):
    """All streams that have begun, at one time, by their names.

    Attributes:
        time_ns: the time requested, ns.
    """

    def __init__(self, time_ns: int, found: Mapping[str, Aligned[Any]]) -> None:
        """Of what was ``found``."""
        self.time_ns, self._found = time_ns, found

    def __getitem__(self, name: str) -> Aligned[Any]:
        """A stream by its name; ``KeyError`` where there is none that has begun."""
        return self._found[name]

    def __iter__(self) -> Iterator[str]:
        """Names of the streams that have begun."""
        return iter(self._found)

    def __len__(self) -> int:
        """How many have begun."""
        return len(self._found)

    def of(self, stream: Stream[Sample]) -> Aligned[Sample]:
        """A stream that has to have begun.

        Raises:
            HighFiveError: it has not.
        """
        found = self._found.get(stream.name)
        if found is None:
            raise HighFiveError(
                f"there are no {stream.kind.name} yet; all streams have to run before they can be shown together"
            )
        return found


class Synchroniser:
    """The streams. They may be opened and closed while others run; each is added to by a thread of its own."""

    def __init__(self, told: Told | None = None) -> None:
        """Knows no stream; ``told`` is told of what happens to them."""
        self._streams: Mapping[str, Stream[Any]] = {}  # replaced as a whole
        self._told = told

    def open(
        self, name: str, kind: Kind[Sample], clock: ClockEstimate | None = None, *, updates: bool = True,
        settings: StreamSettings | None = None, watch: WatchSettings | None = None,
    ) -> Stream[Sample]:  # fmt: skip
        """A new stream; see :class:`highfive.hil.session.stream.Stream`.

        Raises:
            HighFiveError: there is one of that name, or the name is empty.
        """
        if not name:
            raise HighFiveError("a stream has no name; give each one of its own")
        if name in self._streams:
            raise HighFiveError(f"there are two streams called {name!r}; rename one of them where it is sent")
        stream = Stream(name, kind, self._tell, clock, updates=updates, settings=settings, watch=watch)
        self._streams = {**self._streams, name: stream}
        return stream

    def close(self, stream: Stream[Any]) -> None:
        """Forgets a stream; its name is free again. What of it was only counted is told."""
        stream.tell_counts()
        self._streams = {name: one for name, one in self._streams.items() if one is not stream}

    def reset(self) -> None:
        """Forgets all samples, not the streams nor what is known of their clocks."""
        for stream in self._streams.values():
            stream.reset()

    def at(self, time_ns: int) -> Moment:
        """All streams at ``time_ns``: between samples by interpolation, before the oldest the oldest. Never waits."""
        found = ((name, stream.at(time_ns)) for name, stream in self._streams.items())
        return Moment(time_ns, {name: aligned for name, aligned in found if aligned is not None})

    def states(self, time_ns: int) -> list[StreamState]:
        """How each stream that has begun stands at ``time_ns``, in the order in which they were opened.

        What was only counted of a stream, and is over since a minute, is told.
        """
        moment, streams = self.at(time_ns), self._streams
        self.tell_counts(time_ns)
        return [streams[name].state(aligned) for name, aligned in moment.items() if name in streams]

    def tell_counts(self, now_ns: int | None = None) -> None:
        """See :meth:`highfive.hil.session.stream_watch.StreamWatch.tell_counts`; of every stream."""
        for stream in self._streams.values():
            stream.tell_counts(now_ns)

    def _tell(self, event: SyncEvent) -> None:
        if self._told is not None:
            self._told(event)
