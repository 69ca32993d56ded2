"""Several motion capture systems that see one person, as one: each with its own clock and place, for one time.

A frame is made whenever the quickest system has one, for the time of that; the others are asked for it, between their
samples or up to 25 ms beyond. Where a system stops the others go on.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import chain

import numpy as np

from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.live import Link, LiveSource
from highfive.mocap_bridge.sources.marker_merge import MergeSettings, Placed, Seen, merge, seen_at
from highfive.mocap_bridge.sources.scheduler import THREADS, Scheduler
from highfive.mocap_bridge.sources.source import Connection
from highfive.mocap_bridge.sources.tap import Tap, tapped
from highfive.mocap_bridge.sources.timeline import Timeline
from highfive.mocap_bridge.wire.errors import LinkError

ALL_S = 2.0
"""For so long all systems are waited for; then those that are there begin, s."""

SILENT_S = 0.8
"""Without a frame of any system for so long it is said what stands in their way, s."""

APART_FRAMES = 12
"""A marker that systems see at two places in so many frames in a row is told of."""

LOG = logging.getLogger(__name__)


@dataclass
class _System:
    """One of the systems.

    ``there`` is whether it was live at the last frame.
    """

    source: LiveSource
    placed: Placed
    newest: MarkerFrame | None = None
    resets: int = 0
    there: bool = False
    frames: Timeline[MarkerFrame] = field(default_factory=Timeline[MarkerFrame])

    def take(self) -> None:
        """Its newest frame, if that is another than before."""
        frame = self.source.newest(0)
        if frame is None or frame is self.newest:
            return
        if self.newest is not None and frame.names != self.newest.names:
            self.frames.clear()
        time_ns = self.source.captured(frame)
        if self.source.stamps.resets != self.resets:
            self.resets = self.source.stamps.resets
            self.frames.forget_from(time_ns)
        self.newest = frame
        self.frames.add(time_ns, frame)

    def seen(self, time_ns: int, settings: MergeSettings) -> Seen | None:
        """What it says for a time; None where it has nothing to say."""
        found = self.frames.around(time_ns)
        if found is None or self.newest is None:
            return None
        own = self.newest.own_clock
        bound = 0 if own else self.source.stamps.bound_ns(self.newest.source_time_ns)
        return seen_at(found, time_ns, min(bound, _UNSURE_NS), self.placed, settings)


_UNSURE_NS = 10_000_000  # of a clock that nothing is known of yet


class MergedLink:
    """The systems' frames as those of one (see :class:`highfive.mocap_bridge.sources.live.Link`)."""

    def __init__(
        self, systems: Sequence[tuple[LiveSource, Placed]], now: Callable[[], int],
        settings: MergeSettings | None = None,
    ) -> None:  # fmt: skip
        """Args: ``systems``: source and place of each; ``now``: this process's monotonic clock, ns."""
        self._systems = [_System(*one) for one in systems]
        self._now, self._settings = now, settings or MergeSettings()
        self._began_ns: int | None = now()
        self._heard_ns = now()
        self._leader = self._systems[0]
        self._last_ns, self._number, self._lost = 0, 0, 0
        self._names: tuple[str, ...] = ()
        self._apart: dict[str, int] = {}  # markers at two places, and in how many frames in a row

    @property
    def rate_hz(self) -> float:
        """Of the system that is followed."""
        return self._leader.source.rate_hz

    def receive(self, timeout_s: float) -> Sequence[MarkerFrame]:
        """The frame of the next time, if there is one soon.

        Raises:
            LinkError: no system has sent anything for a while; or waiting does not help one of them: it has several
                persons, and nobody said which.
        """
        before, self._leader = self._leader, self._quickest()
        last = self._leader.newest
        frame = self._leader.source.wait(last, timeout_s)
        for system in self._systems:
            health = system.source.health(self._now())
            if health.hopeless:
                raise LinkError(health.trouble)
            system.take()
        if frame is None:
            self._look_for_silence()
            return ()
        self._heard_ns = self._now()
        if not self._may_begin():
            return ()
        time_ns = self._leader.frames.newest_ns
        if time_ns is None or time_ns <= self._last_ns:
            return ()
        lost, self._lost = self._lost, self._leader.source.health(self._heard_ns).lost
        same = before is self._leader and last is not None
        self._number += 1 + (max(0, self._lost - lost) if same else 0)  # one that was newer so soon is not lost
        self._last_ns = time_ns
        return (self._merged(time_ns),)

    def close(self) -> None:
        """The systems go on."""

    def _quickest(self) -> _System:
        """Of those that are there; the first where none is."""
        now = self._now()
        live = [one for one in self._systems if one.source.health(now).connection is Connection.LIVE]
        return max(live or self._systems[:1], key=lambda one: one.source.rate_hz)

    def _look_for_silence(self) -> None:
        now = self._now()
        health = [system.source.health(now) for system in self._systems]
        if now - self._heard_ns > 1e9 * SILENT_S and all(one.connection is not Connection.LIVE for one in health):
            self._heard_ns = now
            both = zip(health, self._systems, strict=True)
            raise LinkError("; ".join(one.trouble or f"{system.source.title} is silent" for one, system in both))

    def _may_begin(self) -> bool:
        if self._began_ns is None:
            return True
        all_there = all(system.newest is not None for system in self._systems)
        if all_there or self._now() - self._began_ns > 1e9 * ALL_S:
            self._began_ns = None
        return self._began_ns is None

    def _merged(self, time_ns: int) -> MarkerFrame:
        seen = list[Seen]()
        for system in self._systems:
            one = system.seen(time_ns, self._settings)
            health = system.source.health(self._now())
            if system.there and health.connection is not Connection.LIVE:
                reason = health.trouble or "no frame comes"
                LOG.warning("%s sees nothing any more (%s); the other systems go on", system.source.title, reason)
            system.there = health.connection is Connection.LIVE
            if one is not None:
                seen.append(one)
        known = dict.fromkeys(chain(self._names, *(one.names for one in seen)))
        if len(known) > len(self._names):  # the same object as long as nothing new comes
            self._names = tuple(known)
        positions, valid, covariance, apart = merge(seen, self._names, self._settings)
        self._tell(apart)
        return MarkerFrame(
            self._names, positions, valid, self._number, time_ns, 0,
            np.concatenate([one.unlabelled for one in seen]), covariance=covariance, own_clock=True,
        )  # fmt: skip

    def _tell(self, apart: tuple[str, ...]) -> None:
        """Says once which markers are not where both systems have them."""
        self._apart = {name: self._apart.get(name, 0) + 1 for name in apart}
        new = [name for name, frames in self._apart.items() if frames == APART_FRAMES]
        if new:
            titles = " and ".join(system.source.title for system in self._systems if system.there)
            LOG.warning(
                "%s see %s more than %.0f mm apart; the surer counts: is a label swapped, or a placement (at=) wrong?",
                titles, ", ".join(new), 1e3 * self._settings.apart,
            )  # fmt: skip


class MergedSource(LiveSource):
    """Several live systems that see one person, followed as one."""

    def __init__(
        self, title: str, systems: Sequence[tuple[LiveSource, Placed]], tap: Tap | None = None,
        scheduler: Scheduler = THREADS, settings: MergeSettings | None = None,
    ) -> None:  # fmt: skip
        """Follows them until it is closed, and closes them.

        Args:
            title: for messages.
            systems: each source, and where it stands in the frame of all.
            tap: gets every merged frame.
            scheduler: as of :class:`LiveSource`.
            settings: of the merging.
        """
        self._sources = [source for source, _ in systems]

        link = MergedLink(systems, scheduler.now, settings)

        def connect() -> Link:
            return link  # it connects to nothing itself: its frames' numbers go on

        rate = max(source.rate_hz for source in self._sources)
        super().__init__(title, connect if tap is None else tapped(connect, tap, scheduler.now), None, rate, scheduler)

    @property
    def parts(self) -> Sequence[LiveSource]:
        """The systems."""
        return self._sources

    def close(self) -> None:
        """Ends all of them."""
        super().close()
        for source in self._sources:
            source.close()
