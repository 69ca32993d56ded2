"""Looks whether a stream goes on as it did, and tells once where it does not."""

from __future__ import annotations

from dataclasses import dataclass

from highfive.hil.runtime.console import counted
from highfive.hil.session.sync_events import Happened, SyncEvent, Told
from highfive.model.settings import Settings, setting

UNITS = {"s": 10**9, "ms": 10**6, "µs": 10**3}
"""What others count in where ns are expected, ns."""
FINER = {"ms": 10**3, "µs": 10**6, "ns": 10**9}
"""What others count in where s are expected, as LSL does, a second."""
_REPEATED = {Happened.BACK, Happened.RATE, Happened.LAYOUT, Happened.UNIT, Happened.ASTRAY}
"""What may alternate from sample to sample."""


@dataclass(frozen=True)
class WatchSettings(Settings):
    """When a stream is said to be wrong. Set by hand."""

    stopped_ns: int = setting(250_000_000, "ns", above=0)
    """Without a sample for so long it has stopped; as a live source counts as stalled."""
    window_ns: int = setting(1_000_000_000, "ns", above=0)
    """Rate and unit are looked at over so long."""
    rate: float = setting(0.2, above=0.0, below=1.0)
    """A rate that differs by this share in two windows is another one, and no lost frames."""
    back_ns: int = setting(500_000_000, "ns", above=0)
    """A stream that is behind itself for so long will not catch up: it goes on from there."""
    ahead_ns: int = setting(1_000_000_000, "ns", above=0)
    """A stamp so far in the future is of another clock: a pose is for some tens of ms ahead at the most."""
    old_ns: int = setting(10_000_000_000, "ns", above=0)
    """The same of the past."""
    quiet_ns: int = setting(60_000_000_000, "ns", above=0)
    """What happens again and again, as where two programs send under one name, is told once in so long, and counted."""


class StreamWatch:
    """Of one stream.

    Attributes:
        period_ns: from sample to sample, over the last second; 0 where that is not known.
    """

    def __init__(self, name: str, told: Told, settings: WatchSettings, *, held: bool) -> None:
        """Args: ``held``: what comes holds until the next one, so that no rate is expected."""
        self._name, self._told, self._settings, self._regular = name, told, settings, not held
        # When it was told last, how often it was not since, and when it was last.
        self._repeated: dict[Happened, tuple[int, int, int]] = {}
        self.reset()

    def reset(self) -> None:
        """Knows of no sample."""
        self.period_ns = 0
        self._said = set[Happened]()  # and not over yet
        self._window: tuple[int, int] | None = None  # stamp and arrival at which it began
        self._count = 0
        self._unit = ""  # that the stamps are in
        self._suspected: str = ""  # that those of the window before were in
        self._rate_hz, self._other = 0.0, 0  # and in how many windows in a row it was another
        self._behind_since: int | None = None
        self._arrived_ns, self._stamp_ns = 0, 0  # the newest sample with another stamp than before, whatever it is

    def _say(self, happened: Happened, time_ns: int, text: str) -> None:
        """Once, until it is over."""
        if happened not in self._said and self._tell(happened, time_ns, text):
            self._said.add(happened)

    def _tell(self, happened: Happened, time_ns: int, text: str) -> bool:
        """Whether it is told now. Of what came again too soon the number is told with the next, or by itself."""
        told_ns, again, _ = self._repeated.get(happened, (None, 0, 0))
        if told_ns is not None and 0 <= time_ns - told_ns < self._settings.quiet_ns and happened in _REPEATED:
            self._repeated[happened] = told_ns, again + 1, time_ns
            return False
        self._repeated[happened] = time_ns, 0, time_ns
        count = f" ({counted(again, 'time')} more since that was told last)" if again else ""
        self._told(SyncEvent(happened, self._name, time_ns, f"{self._name} {text}{count}"))
        return True

    def tell_counts(self, now_ns: int | None = None) -> None:
        """Tells how often it was of what came again too soon to be told, and has not come for a minute since; of all
        of that where ``now_ns`` is None, for the stream is over. The event is of when it came last."""
        for happened, (told_ns, again, last_ns) in list(self._repeated.items()):
            if again and (now_ns is None or now_ns - last_ns >= self._settings.quiet_ns):
                self._repeated[happened] = told_ns, 0, last_ns
                text = f"{self._name} {happened.value}: {counted(again, 'time')} more since that was told last"
                self._told(SyncEvent(happened, self._name, last_ns, text))

    def changes(self, text: str, time_ns: int) -> None:
        """It has other channels from now on; ``text`` says which."""
        self._tell(Happened.LAYOUT, time_ns, text)

    def runs_astray(self, stamp_ns: int, arrival_ns: int) -> bool:
        """Whether the stamps count in another unit: such samples are of no use. Looks at the rate, too."""
        if stamp_ns != self._stamp_ns:
            self._arrived_ns, self._stamp_ns = arrival_ns, stamp_ns
        if not self._regular:
            return False
        if self._window is None:
            self._window, self._count = (stamp_ns, arrival_ns), 0
            return bool(self._unit)
        self._count += 1
        elapsed, passed = stamp_ns - self._window[0], arrival_ns - self._window[1]
        if passed >= self._settings.window_ns:
            self._look_at_unit(elapsed, passed, arrival_ns)
            if not self._unit and 0.5 * passed < elapsed < 2.0 * passed:  # else stamps leapt: that is no rate
                self._look_at_rate(1e9 * self._count / elapsed, arrival_ns)
            self._window, self._count = (stamp_ns, arrival_ns), 0
        return bool(self._unit)

    def _look_at_unit(self, elapsed: int, passed: int, now_ns: int) -> None:
        found: str = next((unit for unit, ns in UNITS.items() if 0.5 < elapsed * ns / passed < 2.0), "")
        if found and found == self._suspected:  # twice: what an outage held back comes all at once
            self._unit = found
            self._say(Happened.UNIT, now_ns, f"counts its stamps in {found}, expected ns; its samples are not used")
        elif not found:
            self._unit = ""
            self._said.discard(Happened.UNIT)
        self._suspected = found

    def _look_at_rate(self, rate_hz: float, now_ns: int) -> None:
        if not self._rate_hz:
            self._rate_hz = rate_hz
        if abs(rate_hz - self._rate_hz) > self._settings.rate * self._rate_hz:
            self._other += 1
        else:
            self._other = 0
            self.period_ns = round(1e9 / rate_hz)
        if self._other >= 2:
            text = f"changed its rate from {self._rate_hz:.3g} to {rate_hz:.3g} Hz"
            self._tell(Happened.RATE, now_ns, text)
            self._rate_hz, self._other, self.period_ns = rate_hz, 0, round(1e9 / rate_hz)

    def stays_back(self, stamp_ns: int, newest_ns: int, arrival_ns: int) -> bool:
        """Whether stamps have been behind the newest one for so long that this is where it goes on."""
        if stamp_ns >= newest_ns:
            self._behind_since = None
            self._said.discard(Happened.BACK)
            return False
        text = f"went back by {1e-6 * (newest_ns - stamp_ns):.1f} ms; older samples are not used"
        self._say(Happened.BACK, arrival_ns, text)
        self._behind_since = arrival_ns if self._behind_since is None else self._behind_since
        if arrival_ns - self._behind_since < self._settings.back_ns:
            return False
        self._behind_since = None
        return True

    def is_astray(self, time_ns: int, arrival_ns: int) -> bool:
        """Whether a sample's time is so far off that it is of another clock."""
        ahead_ns = time_ns - arrival_ns
        if -self._settings.old_ns <= ahead_ns <= self._settings.ahead_ns:
            self._said.discard(Happened.ASTRAY)
            return False
        meant = [(unit, time_ns * ns) for unit, ns in UNITS.items()]
        meant += [(f"{unit}, not in s", time_ns // count) for unit, count in FINER.items()]
        near = next((unit for unit, time in meant if abs(time - arrival_ns) <= self._settings.old_ns), "")
        how = f"{1e-9 * abs(ahead_ns):.4g} s {'in the future' if ahead_ns > 0 else 'ago'}"
        guess = f"are they in {near}?" if near else "are they of this computer's monotonic clock?"
        self._say(Happened.ASTRAY, arrival_ns, f"has stamps of {how}; its stamps are not used: {guess}")
        return True

    def asked(self, time_ns: int, newest_ns: int) -> None:
        """It was asked for a time, and this is the newest that it knows of."""
        silent_ns = time_ns - max(newest_ns, self._arrived_ns)
        if silent_ns > max(self._settings.stopped_ns, 4 * self.period_ns):
            self._say(Happened.STOPPED, time_ns, f"has stopped: nothing for {1e-6 * silent_ns:.0f} ms")
        elif Happened.STOPPED in self._said:
            self._said.discard(Happened.STOPPED)
            self._tell(Happened.RESUMED, time_ns, "has resumed")
