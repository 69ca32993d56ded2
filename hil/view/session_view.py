"""A running session on the live page: every tick's poses, how it stands, and what people before the page ask for."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from highfive.hil.arm_model.arm_folder import DEFAULT_ARM
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.runtime.console import say_aside
from highfive.hil.session.contact_time import sure_contact_s
from highfive.hil.session.session import STALLED_NS, Session, Tick, TickInput
from highfive.hil.session.stream import StreamState
from highfive.hil.sim.playout import PlayOut
from highfive.hil.sim.scene import Scene
from highfive.hil.trials.events import PalmsTogether
from highfive.hil.view.arm_cast import ArmCast
from highfive.hil.view.cast import Cast
from highfive.hil.view.commands import Command
from highfive.hil.view.ellipsoid import ellipsoid
from highfive.hil.view.interruption import Interruption
from highfive.hil.view.page_shown import PageShown
from highfive.hil.view.wire import PoseMessage
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.online.reaction import current_forecast

if TYPE_CHECKING:
    from highfive.hil.trials.trial_result import TrialResult

STATES_EVERY = 6
"""Ticks between two texts that say how it stands."""
PAUSED_NS = 50_000_000
"""So often it is looked at whether the page still says pause, ns."""


@runtime_checkable
class ShowingPage(Protocol):
    """What a session needs of the page: a :class:`~highfive.hil.view.live_page.LivePage` has it."""

    @property
    def alive(self) -> bool:
        """The server is there."""
        ...

    def show(self, message: PoseMessage) -> None:
        """Where everything is."""
        ...

    def tell(self, kind: str, **fields: Any) -> None:
        """Something that must arrive, in order."""
        ...

    def commands(self) -> list[Command]:
        """What was asked for since the last call."""
        ...

    def shown(self) -> list[PageShown]:
        """What pages have shown since the last call."""
        ...

    def said(self) -> list[str]:
        """What the server has had to say since the last call."""
        ...


def heard(page: ShowingPage, gone: bool, goes_on: str) -> bool:
    """Says what the page's server had to say, and whether it is still there; once, that it is ``gone`` and what
    ``goes_on``."""
    for line in page.said():
        say_aside(line, logging.WARNING)
    if not page.alive and not gone:
        say_aside(f"the live page is gone, for its server was ended; {goes_on}")
    return page.alive


class SessionView:
    """The page of one session.

    Attributes:
        weights: style that was asked for; None as long as none was.
        cell: where the hand is to be raised; None as long as nobody asked.
    """

    def __init__(
        self, page: ShowingPage, session: Session, playout: PlayOut, scene: Scene, *,
        arm: Callable[[], tuple[Array, Array] | None] | None = None, rig: str = DEFAULT_ARM, clock: Clock = MACHINE,
        shown: Callable[[PageShown], None] = lambda picture: None, trouble: Callable[[], str] = lambda: "",
    ) -> None:  # fmt: skip
        """Of a session that plays in ``playout``; ``shown`` is given each picture that a page says it has shown, and
        ``trouble`` says why the arm is stopped, '' while it is not.

        With an ``arm`` (``rig`` is its name or folder), of which it gives the joints (J,), rad, as measured and as
        wanted, a high five is never broken
        off for a wish.
        """
        self._page, self._session, self._playout, self._scene = page, session, playout, scene
        self._cast, self._arm, self._clock, self._shown = Cast.of(scene.model), arm, clock, shown
        self._trouble = trouble
        self._arm_cast = None if arm is None else ArmCast(rig)
        self.weights: dict[str, float] | None = None
        self.cell: str | None = None
        self.corrects = session.corrects
        self._paused, self._wish, self._stopped, self._alone = False, "", False, False
        self._trial: dict[str, Any] = {}
        self._count, self._palms, self._begins_ns, self._captured_ns = 0, PalmsTogether(), 0, 0
        self._latest: PoseMessage | None = None

    def begin(self, number: int, trials: int, cell: str, style: Mapping[str, float]) -> None:
        """A new high five; waits as long as the page says pause.

        Raises:
            Interruption: the session is to end.
        """
        self._trial = {"trial": number, "trials": trials, "cell": cell, "weights": dict(style)}
        self._count, self._palms, self._wish = 0, PalmsTogether(), ""
        self._stand_still()

    def in_time(self, frames: Iterable[MarkerFrame]) -> Iterator[MarkerFrame]:
        """The frames of a recording as they would come from a live system, but for when the page says pause; after a
        pause of the machine they go on from where they were, too.
        """
        start = self._clock.now()
        for frame in frames:
            before = self._clock.now()
            self._stand_still()
            start += self._clock.now() - before
            self._clock.wait_until(start + frame.source_time_ns)
            now = self._clock.now()
            if now - start - frame.source_time_ns > STALLED_NS:
                start = now - frame.source_time_ns
            yield replace(frame, arrival_time_ns=now)

    def inputs(self, inputs: Iterable[TickInput]) -> Iterator[TickInput]:
        """The same inputs; keeps what the page is told of their times."""
        for begins in inputs:
            self._begins_ns = begins.at_ns
            if begins.frame is not None:
                self._captured_ns = begins.at_ns - begins.ahead_ns
            yield begins

    def watch(self, tick: Tick) -> None:
        """Shows a tick that was played.

        Raises:
            Interruption: somebody wants another high five, or the end.
        """
        self._obey()
        self.hear_shown()
        self.show(tick)
        if self._wish and not self._arm:
            raise Interruption(self._wish)

    def show(self, tick: Tick) -> None:
        """Shows a tick that was played, whatever is asked for."""
        data, markers = self._playout.data, tick.markers
        self._latest = PoseMessage(
            0, self._begins_ns, self._captured_ns, 0, 1.0, 1e-9 * tick.time_ns,
            self._bodies(), markers.positions, markers.seen & markers.valid,
        )  # fmt: skip
        self._page.show(self._latest)
        palms = data.site_xpos[[self._scene.palm_site, self._scene.person_palm_site]]
        distance = float(np.linalg.norm(palms[0] - palms[1]))
        if self._palms(distance):
            self._page.tell("touch", where=palms.mean(axis=0))
        if self._count % STATES_EVERY == 0:
            self._page.tell("state", **self._state(tick, distance))
        self._count += 1

    def hear_shown(self) -> None:
        """Hands on the pictures that pages say they have shown since the last call."""
        for picture in self._page.shown():
            self._shown(picture)

    def _bodies(self) -> Array:
        bodies = self._cast.poses(self._playout.data)
        joints = None if self._arm is None else self._arm()
        return (
            bodies if self._arm_cast is None or joints is None else np.vstack([bodies, self._arm_cast.poses(*joints)])
        )

    def judged(self, result: TrialResult) -> str:
        """A high five that is over; what is to be done now: ``again``, ``end``, or '' for the next one."""
        error = result.touch_error if np.isfinite(result.touch_error) else result.error
        self._page.tell("contact", met=result.contact.met, distance_m=error, style=result.style, cell=result.cell)
        self._obey()
        return self._wish if self._wish != "next" else ""

    def streams(self, states: Sequence[StreamState]) -> None:
        """Shows how the session's streams stand."""
        self._page.tell("streams", streams=[asdict(state) for state in states])

    def ends(self, why: str, *, stopped: bool) -> None:
        """The session ends before it is through: the page says ``why``, and whether the arm was ``stopped``."""
        self._stopped = stopped
        about = {**self._trial, **self._standing(), "message": f"{why[:1].upper()}{why[1:]}"}
        self._page.tell("state", **about, time_s=0.0)

    def _obey(self) -> None:
        for command in self._page.commands():
            self._follow(command)
        if gone := not heard(self._page, self._alone, "the session goes on without it"):
            self._paused = False  # nobody could let it go on
        self._alone = self._alone or gone

    def _follow(self, command: Command) -> None:
        match command.name:
            case "style":
                self._restyle(command.value)
            case "correct":
                self.corrects = command.value
                self._session.set_correct(command.value)
            case "pause":
                self._paused = command.value
            case "cell":
                self.cell = command.value
            case "next" | "again" | "end":
                self._wish = command.name
            case _:  # what only recordings know; the emergency stop was pulled already
                pass

    def _restyle(self, weights: dict[str, float]) -> None:
        """The responder moves there smoothly; what the model does not know is passed over."""
        total = sum(weights.values())
        wanted = {name: round(weight / total, 2) for name, weight in weights.items()}
        try:
            self._session.set_style(wanted)
        except HighFiveError:
            return
        self.weights = self._trial["weights"] = wanted

    def _stand_still(self) -> None:
        """As long as it is paused."""
        self._obey()
        while self._paused and not self._wish:
            if self._latest is not None:
                self._page.show(replace(self._latest, rate=0.0, holds_ns=self._clock.now()))
            self._page.tell("state", **self._trial, **self._standing(), time_s=0.0)
            self._clock.wait_until(self._clock.now() + PAUSED_NS)
            self._obey()
        if self._wish and not self._arm:
            raise Interruption(self._wish)

    def _standing(self) -> dict[str, Any]:
        trouble = self._trouble()
        why = {"message": f"The arm was stopped: {trouble}"} if trouble else {}
        return {"paused": self._paused, "corrected": self.corrects, "stopped": self._stopped or bool(trouble), **why}

    def _state(self, tick: Tick, distance: float) -> dict[str, Any]:
        response = tick.response
        forecast, sure_s = current_forecast(response), sure_contact_s(response, tick.target.phase)
        return {
            **self._trial,
            **self._standing(),
            "time_s": 1e-9 * tick.time_ns,
            "phase": tick.target.phase.value,
            "correction": tick.target.weight,
            "time_to_contact_s": sure_s,
            "palms_m": distance if tick.person.valid else None,
            **self._plate(tick),
            "tracked": int(tick.markers.seen.sum()),
            "markers": len(tick.markers.seen),
            "forecast": None
            if forecast is None
            or sure_s is None  # only where its time is told
            or forecast.time < 0.0
            else ellipsoid(forecast.point, forecast.covariance),
        }

    def _plate(self, tick: Tick) -> dict[str, Any]:
        """How far the arm's plate is from the person's palm; nothing where there is no arm."""
        if self._arm_cast is None or self._arm is None:
            return {}
        joints = self._arm()
        if joints is None or not tick.person.valid:
            return {"plate_m": None}
        return {"plate_m": float(np.linalg.norm(self._arm_cast.plate(joints[0]) - tick.person.palm.position))}
