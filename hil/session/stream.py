"""One stream on this computer's clock: its newest samples, and what they are at a time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from highfive.hil.session.kinds import Kind
from highfive.hil.session.stream_watch import StreamWatch, WatchSettings
from highfive.hil.session.sync_events import Happened, SyncEvent, Told
from highfive.mocap_bridge.sources.stamp_clock import UNKNOWN_NS, StampClock
from highfive.mocap_bridge.sources.steady_time import ClockEstimate, SteadyTime
from highfive.mocap_bridge.sources.timeline import AHEAD_NS, Timeline
from highfive.model.settings import Settings, setting

Sample = TypeVar("Sample")


class HostClock:
    """Of stamps that are of this computer's monotonic clock already: the arm, the renderer here, the tick."""

    resets, drift, settled = 0, 0.0, True

    def local(self, stamp_ns: int) -> int:
        """The stamp."""
        return stamp_ns

    def bound_ns(self, stamp_ns: int) -> int:
        """It is not off."""
        return 0


class ToldClock(HostClock):
    """Of a peer that puts its stamps on this computer's clock itself, and tells how far off they may be."""

    told_ns = UNKNOWN_NS

    def bound_ns(self, stamp_ns: int) -> int:
        """What it told last, ns."""
        return self.told_ns


@dataclass(frozen=True)
class StreamSettings(Settings):
    """What is known of a stream beforehand."""

    latency_ns: int = setting(0, "ns", least=0, most=2_000_000_000)
    """From what a sample is of until its stamp, or its least delay where the stamp's clock is known by arrivals alone:
    as an event shows that this stream and another both see (:mod:`highfive.calibration.event_latency`)."""
    latency_bound_ns: int = setting(0, "ns", least=0)
    """How far off that may be; it adds to the bound that is shown."""


@dataclass(frozen=True)
class Aligned(Generic[Sample]):
    """A stream at one time.

    Attributes:
        value: what it is then: between samples, or beyond the newest one for 25 ms at the most.
        age_ns: from the nearest sample to the time requested; of events since when they hold.
        valid: there is a sample so near that the value may be used, and it says so itself.
        bound_ns: how far its time may be off, ns: the clock's own bound, what is still to be corrected, and the
            latency's.
    """

    value: Sample
    age_ns: int
    valid: bool
    bound_ns: int


@dataclass(frozen=True)
class StreamState:
    """How a stream stands at a time: for people and for a recording.

    Attributes:
        stream: its name.
        rate_hz: of its samples, or of a page's pictures; None where that is not known, or what comes holds until the
            next one.
        offset_s: this computer's clock minus the stream's.
        drift_ppm: by how much this computer's clock is faster.
        bound_ms: how far the stream's time may be off; None where nothing is known of it.
        age_ms: from the nearest sample to the time requested.
        valid: there is a sample so near that it may be used.
        resets: how often it was synchronised anew.
    """

    stream: str
    rate_hz: float | None
    offset_s: float
    drift_ppm: float
    bound_ms: float | None
    age_ms: float
    valid: bool
    resets: int


class Stream(Generic[Sample]):
    """One thread adds; any may ask. Neither raises, whatever comes: what is wrong is an event.

    Attributes:
        name: of the stream; there is one of that name.
        kind: what it is of.
        synchronised_anew: how often that was told of.
    """

    def __init__(
        self, name: str, kind: Kind[Sample], told: Told, clock: ClockEstimate | None = None, *, updates: bool = True,
        settings: StreamSettings | None = None, watch: WatchSettings | None = None,
    ) -> None:  # fmt: skip
        """Starts empty.

        Args:
            name: for messages.
            kind: what it is of.
            told: of what happens to it.
            clock: of its stamps; None where that is this computer's.
            updates: a :class:`StampClock` learns from what is added here; False where it does elsewhere.
            settings: what is known of it.
            watch: when it is said to be wrong.
        """
        self.name, self.kind, self._told = name, kind, told
        self.synchronised_anew = 0
        self._clock = clock or HostClock()
        self._heard = self._clock if updates and isinstance(self._clock, StampClock) else None
        self._settings = settings or StreamSettings()
        self._watch = StreamWatch(name, told, watch or WatchSettings(), held=kind.mix is None)
        self.reset()

    def reset(self) -> None:
        """Forgets the samples, not the clock."""
        self._line = Timeline[Sample]()
        self._steady, self._resets = SteadyTime(self._clock), self._clock.resets
        self._layout: object = None
        self._stamp_ns = 0
        self._watch.reset()

    def add(self, stamp_ns: int, value: Sample, arrival_ns: int | None = None, latency_ns: int = 0) -> None:
        """A sample; one that is not newer than the last is dropped.

        Args:
            stamp_ns: by the stream's own clock.
            value: what it says.
            arrival_ns: when it came, by this computer's clock; None where that is of no matter: nothing is then
                learned of the stamps, nor found to be wrong with them.
            latency_ns: what the system itself says that it took until the stamp.
        """
        layout = self.kind.layout(value)
        if self._line.newest_ns is not None and layout != self._layout:
            found = stamp_ns if arrival_ns is None else arrival_ns
            self._watch.changes(self._changed(layout), found)
            self._line.clear()
        self._layout = layout
        if arrival_ns is not None:
            if self._watch.runs_astray(stamp_ns, arrival_ns):
                self._line.clear()
                return
            if self._heard is not None:
                self._heard.update(stamp_ns, arrival_ns)
            # Before time goes on to there: it never goes back, and one such stamp would take all later ones with it.
            if self._watch.is_astray(self._clock.local(stamp_ns) - latency_ns - self._settings.latency_ns, arrival_ns):
                return
            self._follow(stamp_ns, arrival_ns)
        time_ns = self._steady.local(stamp_ns) - latency_ns - self._settings.latency_ns
        if self._line.add(time_ns, value):
            self._stamp_ns = stamp_ns

    def _follow(self, stamp_ns: int, arrival_ns: int) -> None:
        """Where a clock was set, or the stream goes on from an earlier stamp, nothing later is left behind."""
        newest, time_ns = self._line.newest_ns, self._clock.local(stamp_ns)
        if self._clock.resets != self._resets:
            self._resets, why = self._clock.resets, "its clock, or this computer's, was set"
            moved_ns = time_ns - self._steady.foreseen(stamp_ns)
        elif newest is not None and self._watch.stays_back(stamp_ns, self._stamp_ns, arrival_ns):
            self._steady, why = SteadyTime(self._clock), "it goes on from an earlier time"
            moved_ns = stamp_ns - self._stamp_ns
        else:
            return
        text = f"{self.name} was synchronised anew: {why}; its time moved by {1e-6 * moved_ns:+.1f} ms"
        self.synchronised_anew += 1
        self._told(SyncEvent(Happened.RESYNCHRONISED, self.name, arrival_ns, text, moved_ns))
        self._line.forget_from(time_ns)

    def _changed(self, layout: object) -> str:
        def short(one: Any) -> str:  # names, or a shape
            return f"{len(one)} ({one!r:.40})" if one and isinstance(one[0], str) else repr(one)

        return f"changed its channels from {short(self._layout)} to {short(layout)}; it begins anew"

    @property
    def newest_ns(self) -> int | None:
        """Time of the newest sample; None before the first."""
        return self._line.newest_ns

    def time_of(self, stamp_ns: int) -> int:
        """When a sample with that stamp was, ns of this computer's clock, as the stream's clock is known by now."""
        return self._clock.local(stamp_ns) - self._settings.latency_ns

    def tell_counts(self, now_ns: int | None = None) -> None:
        """See :meth:`highfive.hil.session.stream_watch.StreamWatch.tell_counts`."""
        self._watch.tell_counts(now_ns)

    def state(self, aligned: Aligned[Sample]) -> StreamState:
        """How it stands, where it was asked for a time and this is what it was then."""
        period_ns, bound_ns, stamp_ns = self._watch.period_ns, aligned.bound_ns, self._stamp_ns
        return StreamState(
            self.name,
            round(1e9 / period_ns, 3) if period_ns else None,
            round(1e-9 * (self._clock.local(stamp_ns) - stamp_ns), 9),
            round(1e6 * self._clock.drift, 3),
            None if bound_ns >= UNKNOWN_NS else round(1e-6 * bound_ns, 6),
            round(1e-6 * aligned.age_ns, 6),
            aligned.valid,
            self.synchronised_anew,
        )

    def at(self, time_ns: int) -> Aligned[Sample] | None:
        """What it is at a time; None before the first sample."""
        if self.kind.mix is None:
            return self._held(time_ns)
        found = self._line.around(time_ns)
        if found is None:
            return None
        newest = self._line.newest_ns or 0
        self._watch.asked(time_ns, newest)
        value = found.first
        if found.share != 0.0:
            value = self.kind.mix(found.first, found.second, found.share, time_ns)
        near = found.age_ns <= max(AHEAD_NS, self._watch.period_ns if time_ns < newest else 0)
        return Aligned(value, found.age_ns, near and self.kind.usable(value), self.bound_ns)

    def _held(self, time_ns: int) -> Aligned[Sample] | None:
        found = self._line.before(time_ns)
        if found is None:
            return None
        return Aligned(found[1], time_ns - found[0], self.kind.usable(found[1]), self.bound_ns)

    @property
    def bound_ns(self) -> int:
        """How far its time may be off, ns; see :class:`Aligned`."""
        bound = self._clock.bound_ns(self._stamp_ns)
        if bound == UNKNOWN_NS:
            return bound
        return bound + self._steady.behind_ns + self._settings.latency_bound_ns
