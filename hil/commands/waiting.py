"""Waiting for a person before there is a high five: what is waited for is said, and the page is heard."""

from __future__ import annotations

from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.runtime.console import say_aside
from highfive.hil.view.live_page import LivePage
from highfive.model.errors import HighFiveError

SAID_EVERY_S = 20.0
"""So often the terminal says what is waited for."""


class Waiting:
    """A wait before the live page; call :meth:`look` some times a second.

    Attributes:
        paused: the page said pause: nothing may begin, and no time passes.
    """

    def __init__(self, page: LivePage, patience_s: float, clock: Clock = MACHINE) -> None:
        """Begins, for ``patience_s`` at most."""
        self._page, self._clock, self._patience_s = page, clock, patience_s
        self.paused = False
        self._looked_ns, self._waited_ns, self._said = clock.now(), 0, 0

    def look(self, what: str) -> bool:
        """Whether there is patience left; says on the terminal now and then ``what`` is waited for.

        Raises:
            HighFiveError: the page's end button was pressed, or its server is gone.
        """
        now = self._clock.now()
        self._waited_ns += 0 if self.paused else now - self._looked_ns
        self._looked_ns = now
        for command in self._page.take("pause", "end"):
            if command.name == "end":
                raise HighFiveError("ended on the page before the first high five: nothing was played")
            self.paused = command.value
            self._page.tell("state", paused=self.paused, corrected=True, stopped=False, cell="", time_s=0.0)
        if not self._page.alive:
            raise HighFiveError("the live page is gone: its server was ended from outside; start again")
        waited_s = 1e-9 * self._waited_ns
        if waited_s >= (self._said + 1) * SAID_EVERY_S:
            self._said = int(waited_s // SAID_EVERY_S)
            say_aside(f"{what} ({waited_s:.0f} of {self._patience_s:g} s)")
        return waited_s < self._patience_s
