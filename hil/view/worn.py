"""Which headset is tracked: one at a time, for as long as it is there."""

from __future__ import annotations

from dataclasses import dataclass, field

HELD_BACK_NS = 1_500_000_000
"""From one headset to another nothing is handed on for so long: who follows them takes that for a person who is gone,
and two people's hands are never one movement."""
SILENT_NS = 4_000_000_000
"""A page asks for the time each second: one of which nothing has come for so long is gone, whatever its connection
says; a network that went away keeps that open for more than a minute."""
TAKEN = "Another headset is tracked already: this one only shows."
YOURS = "This headset is tracked now, in place of another one."


@dataclass
class Worn:
    """The headset of one page.

    Attributes:
        page: number of the page whose headset is tracked; 0 for none.
        refused: pages that were told that another one is.
    """

    page: int = 0
    refused: set[int] = field(default_factory=set)
    _last: int = 0
    _free_ns: int = 0
    _heard_ns: int = 0

    def hears(self, page: int, now_ns: int) -> None:
        """Anything has come from a page."""
        if self.page == page:
            self._heard_ns = now_ns

    def takes(self, page: int, now_ns: int) -> tuple[bool, int, str]:
        """Something of a page's headset has come: whether it is tracked, whose place it has taken now (0 for nobody's),
        and what the page is to be told, '' for nothing.
        """
        if self.page == page:
            self._heard_ns = now_ns
            return True, 0, ""
        if self.page and now_ns - self._heard_ns > SILENT_NS:
            self.gone(self.page, self._heard_ns)
        if self.page:
            told = "" if page in self.refused else TAKEN
            self.refused.add(page)
            return False, 0, told
        if self._last not in (0, page) and now_ns - self._free_ns < HELD_BACK_NS:
            return False, 0, ""
        before, self.page = self._last, page
        self.refused.discard(page)
        self._last, self._heard_ns = page, now_ns
        return (True, before, YOURS) if before not in (0, page) else (True, 0, "")

    def gone(self, page: int, now_ns: int) -> None:
        """A page is gone, or nobody wears its headset any more."""
        self.refused.discard(page)
        if self.page == page:
            self.page, self._free_ns = 0, now_ns
