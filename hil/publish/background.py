"""A publisher in a thread of its own: the session hands over, and never waits."""

from __future__ import annotations

import logging
import threading
from queue import SimpleQueue

from highfive.hil.publish.publisher import ArmPosture, News, Publisher, SessionEvent, ShownPicture
from highfive.hil.recording.recorded_tick import RecordedTick
from highfive.hil.runtime.console import say_aside

CLOSE_S = 3.0
"""So long a publisher may take for what is waiting when the session ends."""
MOST = 2000
"""Ticks that are kept at all, where a publisher hangs."""


class BackgroundPublisher:
    """Gives a publisher what the session hands over, in order. One that fails is told of once, and given no more.

    Attributes:
        dropped: ticks that were left out because newer ones had come before they were sent.
        trouble: why it publishes no more, in one line; '' as long as it does.
    """

    def __init__(self, publisher: Publisher) -> None:
        """Begins; nobody else uses ``publisher`` from now on."""
        self._publisher = publisher
        self.dropped, self.trouble = 0, ""
        # Without a lock: handing over takes a few microseconds of the tick, a tenth of what a condition takes.
        self._given: SimpleQueue[News | None] = SimpleQueue()
        self._in = self._out = 0  # ticks; each is counted by one thread alone
        self._closing = False
        self._thread = threading.Thread(target=self._run, name=f"publish-{publisher.name}", daemon=True)
        self._thread.start()

    @property
    def name(self) -> str:
        """Of the publisher."""
        return self._publisher.name

    def give(self, news: News) -> None:
        """Hands over a tick or the arm, from one thread, or an event or a shown picture, from any; these are never left
        out."""
        if self.trouble or self._closing:
            return
        if isinstance(news, RecordedTick):
            if self._in - self._out >= MOST:
                self.dropped += 1
                return
            self._in += 1
        if isinstance(news, ArmPosture) and self._in - self._out >= MOST:
            return
        self._given.put(news)

    def close(self) -> None:
        """Returns once all was sent that was handed over; at the latest after :data:`CLOSE_S`."""
        if self._closing:
            return
        self._closing = True
        self._given.put(None)
        self._thread.join(CLOSE_S)
        if self._thread.is_alive():
            say_aside(f"{self.name} does not end; it is left behind", logging.WARNING)
        elif self.dropped:
            # Where only the newest one counts, that is as it should be.
            level = logging.WARNING if self._publisher.waiting > 1 else logging.INFO
            say_aside(f"{self.name}: {self.dropped} ticks were left out, newer ones had come", level)

    def _run(self) -> None:
        try:
            while (news := self._given.get()) is not None:
                if isinstance(news, SessionEvent):
                    self._publisher.event(news)
                    continue
                if isinstance(news, ShownPicture):
                    self._publisher.shown(news)
                    continue
                if isinstance(news, ArmPosture):
                    self._publisher.arm(news)
                    continue
                self._out += 1
                if self._in - self._out >= self._publisher.waiting:
                    self.dropped += 1
                else:
                    self._publisher.tick(news)
            self._publisher.close()
        except Exception as error:  # whatever it is: the session goes on
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        reason = " ".join(str(error).split()) or type(error).__name__
        self.trouble = f"{self.name} is published no more: {reason}"
        self._given = SimpleQueue()
        say_aside(f"{self.trouble}; the session goes on", logging.WARNING)
        try:
            self._publisher.close()
        except Exception:  # it has failed already, and that was said
            return
