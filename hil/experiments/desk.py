"""The experimenter's and the participant's side of a run: what they are told, and what they want."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, runtime_checkable
from typing import Protocol as Interface

from highfive.hil.experiments.question import ANSWER, DONE, RATE, Sheet, heard, timed_out
from highfive.hil.experiments.stage import RunStoppedError
from highfive.hil.runtime.clock import Clock

READY, NOTE, BREAK_OFF, STOP, PAUSE = "ready", "note", "break_off", "stop", "pause"
LOOK_NS = 10_000_000
"""So often it is looked at what the page says while nothing is played, ns: what an answer says of its time counts."""


@runtime_checkable
class Said(Interface):
    """What somebody before a page, or at the terminal, asks for."""

    @property
    def name(self) -> str:
        """Which of the commands."""
        ...

    @property
    def value(self) -> Any:
        """As its name says."""
        ...


@runtime_checkable
class Page(Interface):
    """What a run needs of the page: ``highfive.hil.view.live_page.LivePage`` has it."""

    def tell(self, kind: str, **fields: Any) -> None:
        """Something that must arrive, in order."""
        ...

    def take(self, *names: str) -> Sequence[Said]:
        """What was asked for since the last call under one of these names."""
        ...


class Desk:
    """One run's; the experimenter is told all, the participant what concerns her.

    Attributes:
        paused: the experimenter wants it to wait before the next trial.
        stopping: the run is to end.
    """

    def __init__(
        self, page: Page, clock: Clock, typed: Callable[[], Sequence[Said]] = lambda: (), look_ns: int = LOOK_NS
    ) -> None:
        """``typed`` gives what the experimenter typed since the last call; the page is looked at each ``look_ns``."""
        self._page, self._clock, self._typed, self._look_ns = page, clock, typed, look_ns
        self.paused = self.stopping = False
        self._breaks_off = self._ready = False
        self._notes: list[str] = []
        self._told: dict[str, Any] = {}
        self._phase: dict[str, Any] = {}
        self._words: dict[str, str] = {}

    def open(self, **about: Any) -> None:
        """What both need to know once: question, instructions, plan, and the page's words."""
        self._words = about["words"]
        self._page.tell("experiment", **about)

    def tell(self, **fields: Any) -> None:
        """The experimenter: what changed."""
        self._told |= fields
        self._page.tell("experimenter", **self._told, paused=self.paused)

    def show(self, phase: str, **fields: Any) -> None:
        """The participant: what is now."""
        self._phase = {"phase": phase, **fields}
        self._page.tell("participant", **self._phase)

    def close(self, *, finished: bool) -> None:
        """The last that both are told: pages, and a headset that is worn, are let go."""
        self.show("over", finished=finished)
        self._page.tell("over", message=self._words["finished" if finished else "ends"])

    def look(self) -> list[Said]:
        """Does as the experimenter asked; gives back what answers a question, in order."""
        answers: list[Said] = []
        for said in (*self._page.take(READY, NOTE, BREAK_OFF, STOP, PAUSE, ANSWER, RATE, DONE), *self._typed()):
            if said.name in (ANSWER, RATE, DONE):
                answers.append(said)
            else:
                self._follow(said)
        return answers

    def _follow(self, said: Said) -> None:
        if said.name == READY:
            self._ready = True
        elif said.name == NOTE:
            self._notes.append(str(said.value))
            self.tell(message=f"noted: {said.value}")
        elif said.name == BREAK_OFF:
            self._breaks_off = True
        elif said.name == STOP:
            self.stopping = True
        elif said.name == PAUSE:
            self.paused = bool(said.value)
            self.tell(message="it waits before the next trial" if self.paused else "")

    def begin_trial(self) -> None:
        """From now on breaking off means this trial."""
        self._breaks_off = False

    @property
    def breaks_off(self) -> bool:
        """The trial is to be broken off."""
        return self._breaks_off or self.stopping

    def notes(self) -> str:
        """What the experimenter noted since the last call."""
        noted, self._notes = "; ".join(self._notes), []
        return noted

    def wait_ready(self) -> None:
        """Until the participant, or the experimenter, says that it may go on.

        Raises:
            RunStoppedError: the run is to end.
        """
        self._ready = False
        while not self._ready:
            self._pass(self._clock.now() + self._look_ns)

    def wait(self, seconds: float) -> None:
        """So long, and as long as it is paused.

        Raises:
            RunStoppedError: the run is to end.
        """
        end = self._clock.now() + round(1e9 * seconds)
        shown = self._phase
        while (left := end - self._clock.now()) > 0 or self.paused:
            if self.paused and self._phase.get("phase") != "pause":
                self.show("pause")
            self._pass(self._clock.now() + (min(left, self._look_ns) if left > 0 else self._look_ns))
        self._check()
        if self._phase.get("phase") == "pause":
            self._phase = shown
            self._page.tell("participant", **shown)

    def ask(self, sheet: Sheet) -> Sheet:
        """Asks until all is answered, or the time is over; what is not right is told.

        Raises:
            RunStoppedError: the run is to end.
        """
        self.look()  # what was pressed before the question is no answer
        self._ask_for(sheet)
        while not sheet.done:
            self._clock.wait_until(min(self._clock.now() + self._look_ns, sheet.until_ns + 1))
            before = sheet.open
            for said in self.look():
                sheet, wrong = heard(sheet, said.name, said.value, self._clock.now())
                if wrong is not None:
                    self._page.tell("say", message=self._words[wrong.word])
                    self.tell(message=wrong.detail)
            sheet = timed_out(sheet, self._clock.now())
            if sheet.open not in (before, ""):
                self._page.tell("say", message="")
                self._ask_for(sheet)
            if self.breaks_off:
                break
        self._page.tell("say", message="")
        self._check()
        return sheet

    def _ask_for(self, sheet: Sheet) -> None:
        self.show("question", asks=sheet.open, answer=sheet.answer, until_ms=1e-6 * sheet.until_ns)
        self.tell(asks=sheet.open, answer=sheet.answer)

    def _pass(self, until_ns: int) -> None:
        self._clock.wait_until(until_ns)
        self.look()
        self._check()

    def _check(self) -> None:
        if self.stopping:
            raise RunStoppedError("stopped by the experimenter")
