"""What breaks a high five off because somebody before the page asked for it."""

from __future__ import annotations


class Interruption(Exception):
    """Somebody before the page does not want this high five to go on: ``wish`` is next, again or end."""

    def __init__(self, wish: str) -> None:
        """``wish`` as the page named it."""
        super().__init__(wish)
        self.wish = wish
