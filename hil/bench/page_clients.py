"""Clients of the live page, each in a process of its own: one that looks on, and one that floods it."""

from __future__ import annotations

import itertools
import json
import multiprocessing
import os
import time
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

from highfive.hil.view.player import AHEAD_S
from highfive.hil.view.wire import decode_poses

NICE = 19
"""A flood comes from elsewhere: here it gets what the session's own processes leave."""
_FLOOD: tuple[str | bytes, ...] = (
    *(
        json.dumps({"kind": "command", "name": name, "value": value})
        for name, value in (("style", {"angry": 0.5, "sad": 0.5}), ("correct", True), ("cell", "B2"), ("seek", 1.0))
    ),
    json.dumps({"kind": "time", "asked": 1.0}),
    json.dumps({"kind": "shown", "bound_ms": 1.0, "pictures": [[1, 1.0, 2.0, 0]] * 100}),
    json.dumps({"kind": "command", "name": "style", "value": {"x" * 60: 1.0}}),
    b"\0\0\0\0",
    b"\1" * 40_000,
    "[" * 20_000,
)
"""What a page may send, and what none does."""


@dataclass(frozen=True)
class Seen:
    """What a page of a recording got: numbers of the poses, and ms until they came, from being sent and from being due.

    ``before`` is the number of the last pose before it slept; 0 where it did not.
    """

    numbers: tuple[int, ...]
    sent_ms: tuple[float, ...]
    age_ms: tuple[float, ...]
    before: int = 0

    @property
    def dropped(self) -> int:
        """Poses that it was not sent, from the last one before it slept on, or else from the first."""
        first = self.before + 1 if self.before else self.numbers[0]
        return self.numbers[-1] - first + 1 - len(self.numbers)


def look_on(address: str, seconds: float, blocked_s: float, said: Connection) -> None:
    """A page without a picture, in a process of its own.

    Args:
        address: of the page.
        seconds: for so long.
        blocked_s: it first sleeps so long with the connection open, and counts only what comes then.
        said: takes ``ready``, then what was :class:`Seen`.
    """
    numbers: list[int] = []
    sent_ms: list[float] = []
    age_ms: list[float] = []
    before = [0]
    with connect(address.replace("http", "ws", 1).replace("/?", "/live?", 1), max_queue=None, compression=None) as link:
        said.send("ready")
        if blocked_s:
            _take(link, 1.0, lambda now, poses: before.append(poses.number))
            time.sleep(blocked_s)

        def note(now: int, poses: Any) -> None:
            numbers.append(poses.number)
            sent_ms.append(1e-6 * (now - poses.sent_ns))
            age_ms.append(1e-6 * (now - poses.holds_ns) + (1e3 * AHEAD_S if poses.rate else 0.0))

        _take(link, seconds, note)
    said.send(Seen(tuple(numbers), tuple(sent_ms), tuple(age_ms), before[-1]))


def _take(link: Any, seconds: float, note: Any) -> None:
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0.0:
        try:
            message = link.recv(left)
        except TimeoutError:
            return
        if isinstance(message, bytes):
            link.send(message[4:8])
            note(time.monotonic_ns(), decode_poses(message))


class Page:
    """Somebody who looks on."""

    def __init__(self, address: str, seconds: float, blocked_s: float = 0.0) -> None:
        """Begins; see :func:`look_on`."""
        context = multiprocessing.get_context("spawn")
        self._heard, said = context.Pipe(duplex=False)
        self._process = context.Process(target=look_on, args=(address, seconds, blocked_s, said), daemon=True)
        self._process.start()
        said.close()
        self._heard.recv()

    def seen(self) -> Seen:
        """What it got, once its time is over."""
        found = self._heard.recv()
        self._process.join()
        return found


@dataclass(frozen=True)
class Sent:
    """What a flood came to: messages sent, in so many s, and how often its connection was ended."""

    messages: int
    seconds: float
    let_go: int


def flood(address: str, said: Connection) -> None:
    """Sends as much as it can, and connects again whenever it is let go, until it hears something.

    Args:
        address: of the page.
        said: takes ``ready``, then what was :class:`Sent`; hears when to end.
    """
    os.nice(NICE)
    messages, let_go, start = 0, -1, time.monotonic()
    said.send("ready")
    while not said.poll():
        let_go += 1
        with (
            suppress(OSError, WebSocketException),
            connect(address.replace("http", "ws", 1).replace("/?", "/live?", 1), compression=None) as link,
        ):
            for message in itertools.cycle(_FLOOD):
                if messages % 50 == 0 and said.poll():
                    break
                link.send(message)
                messages += 1
    said.recv()
    said.send(Sent(messages, time.monotonic() - start, let_go))


class Flood:
    """Somebody who floods the page."""

    def __init__(self, address: str) -> None:
        """Begins."""
        context = multiprocessing.get_context("spawn")
        self._heard, said = context.Pipe()
        self._process = context.Process(target=flood, args=(address, said), daemon=True)
        self._process.start()
        said.close()
        self._heard.recv()

    def end(self) -> Sent:
        """Ends it; what it came to."""
        self._heard.send("end")
        sent = self._heard.recv()
        self._process.join()
        return sent
