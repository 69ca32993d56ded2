"""What a connection's end, or bytes that are not of its protocol, are reported by."""

from __future__ import annotations

from highfive.model.errors import HighFiveError


class LinkError(HighFiveError):
    """A connection could not be made, broke, or brought what is not of its protocol."""
