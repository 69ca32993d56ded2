"""The host's hold on the page: starts its server, hands it poses and texts, and takes what people ask for."""

from __future__ import annotations

import json
import multiprocessing
import secrets
import select
from collections import deque
from pathlib import Path
from types import TracebackType
from typing import Any

from highfive.hil.drivers.latch import Latch
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.view.access import new_key
from highfive.hil.view.commands import Command
from highfive.hil.view.mailbox import mailboxes
from highfive.hil.view.page_shown import PageShown, page_shown
from highfive.hil.view.server import ServerOptions, run_server
from highfive.hil.view.wire import PoseMessage, encode_poses, encode_text
from highfive.model.errors import HighFiveError

PORT = 8150
"""Where the page is, unless something else is there."""
_START_S, _CLOSE_S = 30.0, 3.0
_MOST_SHOWN = 4096  # pictures that are kept: half a minute of a headset


class LivePage:
    """A page that can be opened at :attr:`address`; close it, or use it in ``with``."""

    def __init__(
        self,
        about: dict[str, Any],
        *,
        port: int | None = None,
        host: str = "127.0.0.1",
        names: tuple[str, ...] = (),
        tls: tuple[Path, Path] | None = None,
        estop: Latch | None = None,
        key: str | None = None,
        tracks: bool = False,
        clock: Clock = MACHINE,
    ) -> None:
        """Starts the server and waits until it answers.

        Args:
            about: what every page is told first, for JSON.
            port: None takes :data:`PORT`, or a free one where that is in use.
            host: address to listen on; beyond this machine only where somebody says so.
            names: further names of this machine under which the page may be asked for.
            tls: files with certificate and key; None serves without TLS.
            estop: is pulled by the page's button at once.
            key: of the address; None makes a new one.
            tracks: what the page tracks, in a headset or before its camera, comes through :attr:`tracked`.
            clock: what waiting for the server and for people goes by.

        Raises:
            HighFiveError: the port is in use, or the server does not start.
        """
        self._key, self._clock = key or new_key(), clock
        self._experiment = about.get("mode") == "experiment"
        self._box, others = mailboxes()
        self.tracked, tracker = mailboxes() if tracks else (None, None)
        """What the page tracks, a message after the other; None where it does not."""
        self.pages = 0
        """How many look on."""
        self._commands: list[Command] = []
        self._said: list[str] = []
        self._shown: deque[PageShown] = deque(maxlen=_MOST_SHOWN)
        self._count, self._over = 0, False
        run = secrets.token_hex(8)
        for chosen in (PORT, 0) if port is None else (port,):
            options = ServerOptions(host, chosen, self._key, names, {**about, "run": run}, tls)
            self._process = multiprocessing.get_context("spawn").Process(
                target=run_server, args=(options, others, estop, tracker), name="highfive-page", daemon=True
            )
            self._process.start()
            answer = self._wait_for(("ready", "failed"))
            if answer["kind"] == "ready":
                break
            self._process.join(_CLOSE_S)
        else:
            self._close_boxes()
            raise HighFiveError(f"cannot show the page on port {port or PORT}: {answer['reason']}; choose another")
        others.close()
        if tracker is not None:
            tracker.close()
        self.port = int(answer["port"])
        self._name = names[0] if names else "localhost"
        self._scheme = "http" if tls is None else "https"

    @property
    def address(self) -> str:
        """What to open in a browser."""
        return f"{self._scheme}://{self._name}:{self.port}/?key={self._key}"

    @property
    def participant_address(self) -> str:
        """What to open for who takes part: of an experiment her own page, which is told no style."""
        return f"{self.address}&role=participant" if self._experiment else self.address

    def show(self, message: PoseMessage) -> None:
        """Where everything is. Its number is given here. Never waits (docs/performance.md)."""
        self._count += 1
        self._box.put_newest(encode_poses(message.numbered(self._count)))

    def tell(self, kind: str, **fields: Any) -> None:
        """Something that must arrive, in order. ``over`` is the last: pages look on no more."""
        self._over = self._over or kind == "over"
        self._box.put(encode_text(kind, **fields))

    def commands(self) -> list[Command]:
        """What was asked for since the last call."""
        self._note_all()
        asked, self._commands = self._commands, []
        return asked

    def take(self, *names: str) -> list[Command]:
        """Those of what was asked for that have one of these names; the others stay for :meth:`commands`."""
        self._note_all()
        taken = [command for command in self._commands if command.name in names]
        self._commands = [command for command in self._commands if command.name not in names]
        return taken

    def shown(self) -> list[PageShown]:
        """What pages have shown since the last call, as they say: each picture, for when its pose was, and when it was
        seen. The oldest are dropped where nobody asks.
        """
        self._note_all()
        told = list(self._shown)
        self._shown.clear()
        return told

    def said(self) -> list[str]:
        """Lines that the server has had for who runs the session since the last call: another headset is tracked."""
        self._note_all()
        told, self._said = self._said, []
        return told

    def wait_for_page(self, seconds: float) -> bool:
        """Waits until somebody looks on; False if nobody does within ``seconds``."""
        end = self._clock.now() + round(1e9 * seconds)
        while not self.pages and (left := 1e-9 * (end - self._clock.now())) > 0.0:
            select.select([self._box], [], [], left)
            self._note_all()
        return self.pages > 0

    @property
    def alive(self) -> bool:
        """The server is there."""
        return self._process.is_alive()

    def close(self) -> None:
        """Ends the server."""
        self._box.put(encode_text("close"))
        self._process.join(_CLOSE_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._close_boxes()

    def __enter__(self) -> LivePage:
        """Self."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Closes; whoever looks on, or wears a headset, is told that it is over, and of what went wrong."""
        if error is not None and not self._over:
            why = f": {error}" if isinstance(error, HighFiveError) else ""
            self.tell("over", message=f"It ended early{why}.")
        self.close()

    def _close_boxes(self) -> None:
        self._box.close()
        if self.tracked is not None:
            self.tracked.close()

    def _note(self, message: dict[str, Any]) -> None:
        if message["kind"] == "pages":
            self.pages = int(message["count"])
        elif message["kind"] == "command":
            self._commands.append(Command(message["name"], message["value"]))
        elif message["kind"] == "said":
            self._said.append(message["line"])
        elif message["kind"] == "shown":
            told = (message[name] for name in ("page", "bound_ms", "pictures", "tracks"))
            self._shown.extend(page_shown(*told))

    def _note_all(self) -> None:
        for message in self._take():
            self._note(message)

    def _take(self) -> list[dict[str, Any]]:
        return [json.loads(data) for data in self._box.take()]

    def _wait_for(self, kinds: tuple[str, ...]) -> dict[str, Any]:
        end = self._clock.now() + round(1e9 * _START_S)
        while (left := 1e-9 * (end - self._clock.now())) > 0.0 and (self._process.is_alive() or self._ready()):
            select.select([self._box], [], [], min(left, 0.2))
            for message in self._take():
                if message["kind"] in kinds:
                    return message
                self._note(message)
        raise HighFiveError("the server of the page does not start")

    def _ready(self) -> bool:
        return bool(select.select([self._box], [], [], 0.0)[0])
