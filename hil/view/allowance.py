"""How many messages of a kind are taken in a second."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Allowance:
    """Of ``a_second`` in each whole second of a clock."""

    a_second: int
    _second: int = -1
    _taken: int = 0

    def takes(self, now_ns: int) -> bool:
        """Counts one at ``now_ns``; False where there have been so many in this second."""
        second = now_ns // 1_000_000_000
        if second != self._second:
            self._second, self._taken = second, 0
        self._taken += 1
        return self._taken <= self.a_second
