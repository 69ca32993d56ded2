"""The high fives of a session in their order, and what people before the page make of it."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from highfive.hil.commands.simulate_options import SimulateOptions
from highfive.hil.sim.people.grid import CELLS
from highfive.hil.trials.partners import Partner, simulated_partners
from highfive.hil.trials.trial_result import TrialResult

if TYPE_CHECKING:
    from highfive.hil.view.session_view import SessionView


class Programme:
    """What is still to be played; false once there is nothing.

    Attributes:
        number: of the next high five, counted from 0; one that was broken off has none.
        ended: somebody before the page ended the session.
    """

    def __init__(
        self,
        options: SimulateOptions,
        partners: Sequence[Partner],
        view: SessionView | None,
        styles: Sequence[Mapping[str, float]] = (),
    ) -> None:
        """All of ``partners``; ``view`` is the page, where there is one; ``styles`` of each, where they are given."""
        self._options, self._queue, self._view, self._styles = options, deque(partners), view, styles
        self.number, self.ended = 0, False

    def __bool__(self) -> bool:
        """There is a high five to play."""
        return bool(self._queue) and not self.ended

    def take(self) -> tuple[Partner, Mapping[str, float]]:
        """The next partner, and the style to answer in."""
        partner, view = self._queue.popleft(), self._view
        cell = None if view is None or self._options.source is not None else view.cell
        if cell is not None and cell != partner.cell and cell in CELLS:
            partner = simulated_partners(1, (partner.emotion,), (cell,), self._options.seed + self.number)[0]
        asked = None if view is None else view.weights
        usual = self._styles[self.number] if self._styles else {partner.emotion: 1.0}
        return partner, asked or self._options.style or usual

    def begin(self, partner: Partner, style: Mapping[str, float]) -> None:
        """Tells the page; waits as long as it says pause.

        Raises:
            Interruption: somebody wants another one, or the end.
        """
        if self._view is not None:
            self._view.begin(self.number, self.number + 1 + len(self._queue), partner.cell, style)

    def follow(self, wish: str, partner: Partner) -> None:
        """Does as the page asked: ``again``, ``end``, or goes on."""
        self.ended = self.ended or wish == "end"
        if wish == "again":
            self._queue.appendleft(partner)

    def judged(self, result: TrialResult, partner: Partner) -> None:
        """A high five is over."""
        self.number += 1
        if self._view is not None:
            self.follow(self._view.judged(result), partner)
