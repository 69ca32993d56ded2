"""Names of joints and markers: where one stands, and what a message says of many."""

from __future__ import annotations

from collections.abc import Sequence

from highfive.model.errors import HighFiveError


def index_of(name: str, names: Sequence[str], owner: str, kind: str) -> int:
    """Index of ``name`` among the names of the ``owner``'s joints, markers, or what ``kind`` says.

    Raises:
        HighFiveError: it is not among them.
    """
    try:
        return names.index(name)
    except ValueError:
        raise HighFiveError(f"{owner} has no {kind} {name!r}; it has {listed(names)}") from None


def listed(names: Sequence[str], most: int = 12) -> str:
    """The names, or the first of them and how many more there are, for a message."""
    shown = ", ".join(str(name) for name in names[:most])
    return shown + (f" and {len(names) - most} more" if len(names) > most else "")
