"""A session that was killed while it was to take the place of an older one: its recording lies beside that."""

from __future__ import annotations

import logging
from pathlib import Path

from highfive.model.files import leftovers

LOG = logging.getLogger(__name__)


def tell_of_newer(path: Path) -> None:
    """Says in one line where an unfinished recording that was to have the name of ``path`` is newer than that."""
    if not path.is_file():
        return
    written_ns = path.stat().st_mtime_ns
    for left in leftovers(path):
        if left.stat().st_mtime_ns > written_ns:
            LOG.warning(
                "%s is of an older session: one that did not end, or still runs, lies beside it; give %s to open that",
                path.name, left,
            )  # fmt: skip
