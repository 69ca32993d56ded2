"""Whether the clock of a live source was set while nobody but the source itself looked at its stamps."""

from __future__ import annotations

from highfive.hil.session.sync_events import Happened, SyncEvent, Told
from highfive.mocap_bridge.sources.live import LiveSource


class SourceWatch:
    """Of one source; tells of each time that it was synchronised anew since this began."""

    def __init__(self, source: LiveSource, told: Told) -> None:
        """What was before is of no matter."""
        self._source, self._told = source, told
        self._count = source.resynchronised[0]

    def look(self, now_ns: int) -> None:
        """Tells what has happened since the last look; never waits."""
        count, moved_ns = self._source.resynchronised
        if count == self._count:
            return
        self._count = count
        text = (
            f"{self._source.title} was synchronised anew: its clock, or this computer's, was set; "
            f"its time moved by {1e-6 * moved_ns:+.1f} ms"
        )
        self._told(SyncEvent(Happened.RESYNCHRONISED, self._source.title, now_ns, text, moved_ns))
