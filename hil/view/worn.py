"""Which headset is tracked: one at a time, for as long as it is there."""

from __future__ import annotations

from dataclasses import dataclass, field

HELD_BACK_NS = 1_500_000_000
"""From one headset to another nothing is handed on for so long: who follows them takes that for a person who is gone,
and two people's hands are never one movement."""
SILENT_NS = 4_000_000_000
"""A page asks for the time each second: one of which nothing has come for so long is gone, whatever its connection
says; a network that went away keeps that open for more than a minute."""
KEPT_NS = 15_000_000_000
"""A place whose page is gone without a word is kept for it: who reloads it has to enter again by hand."""
TAKEN = "Another headset is tracked already: this one only shows."
YOURS = "This headset is tracked now, in place of another one."


@dataclass
class Worn:
    """The headset of one page.

    A page has a name of its own, which it keeps when it is reloaded, and a number for each of its connections.

    Attributes:
        page: number of the page whose headset is tracked; 0 for none.
        refused: pages that were told that another one is.
    """

    page: int = 0
    refused: set[int] = field(default_factory=set)
    _last: int = 0
    _name: str = ""
    _free_ns: int = 0
    _heard_ns: int = 0

    def hears(self, page: int, now_ns: int) -> None:
        """Anything has come from a page."""
        if self.page == page:
            self._heard_ns = now_ns

    def takes(self, page: int, name: str, now_ns: int) -> tuple[bool, int, str]:
        """Something of a page's headset has come: whether it is tracked, whose place it has taken now (0 for nobody's),
        and what the page is to be told, '' for nothing.

        Args:
            page: number of the page.
            name: of the page; '' for one that has none, which is nobody's who was there before.
            now_ns: of the clock.
        """
        if self.page == page:
            self._heard_ns = now_ns
            return True, 0, ""
        hers = bool(name) and name == self._name
        if self.page and not (hers and page > self.page) and now_ns - self._heard_ns > SILENT_NS:
            self.gone(self.page, self._heard_ns)
        if self.page and not (hers and page > self.page):
            return self._refuse(page)
        if not self.page and self._last not in (0, page) and not hers and now_ns < self._free_ns:
            # She whose page is gone is waited for; who has left says so, and only the held-back time passes.
            return (False, 0, "") if self._free_ns - now_ns <= HELD_BACK_NS else self._refuse(page)
        before, self.page = self._last, page
        self.refused.discard(page)
        self._last, self._heard_ns, self._name = page, now_ns, name
        return (True, 0, "") if hers or before in (0, page) else (True, before, YOURS)

    def _refuse(self, page: int) -> tuple[bool, int, str]:
        told = "" if page in self.refused else TAKEN
        self.refused.add(page)
        return False, 0, told

    def left(self, page: int, now_ns: int) -> None:
        """Nobody wears a page's headset any more: she said so."""
        self._frees(page, now_ns + HELD_BACK_NS)

    def gone(self, page: int, now_ns: int) -> None:
        """A page is gone without a word: its place is kept for a while."""
        self.refused.discard(page)
        self._frees(page, now_ns + (KEPT_NS if self._name else HELD_BACK_NS))

    def _frees(self, page: int, free_ns: int) -> None:
        if self.page == page:
            self.page, self._free_ns = 0, free_ns
