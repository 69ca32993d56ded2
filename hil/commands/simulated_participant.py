"""Brings a simulated participant to a run: over the page's own connection, or in one process and virtual time.

Both carry the texts that pages hear and the commands that pages send, as they are on the wire.
"""

from __future__ import annotations

import heapq
import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count
from typing import Any
from urllib.parse import urlsplit, urlunsplit

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from highfive.hil.experiments.observer import Reply, SimulatedParticipant
from highfive.hil.experiments.question import ANSWER
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.view.commands import Command, parse_command
from highfive.hil.view.server import LIVE
from highfive.hil.view.wire import encode_text

S = 1_000_000_000


class PageInProcess:
    """What a run takes for its page: what is told goes to a simulated participant, whose replies come at their time."""

    def __init__(self, participant: SimulatedParticipant, clock: Clock) -> None:
        """By the run's clock."""
        self._participant, self._clock, self._numbers = participant, clock, count()
        self._due: list[tuple[int, int, str]] = []

    def tell(self, kind: str, **fields: Any) -> None:
        """See :meth:`highfive.hil.view.live_page.LivePage.tell`."""
        _hear(self._participant, encode_text(kind, **fields), self._clock.now(), self._due, self._numbers)

    def take(self, *names: str) -> list[Command]:
        """See :meth:`highfive.hil.view.live_page.LivePage.take`."""
        found: list[Command] = []
        while self._due and self._due[0][0] <= self._clock.now():
            command = parse_command(heapq.heappop(self._due)[2])
            if command is not None and command.name in names:
                found.append(command)
        return found


@contextmanager
def participant_on_page(participant: SimulatedParticipant, address: str) -> Iterator[None]:
    """A simulated participant who takes part through the page at ``address``, from a thread of its own."""
    parts = urlsplit(address)
    live = urlunsplit(("ws", parts.netloc, LIVE, parts.query, ""))
    over = threading.Event()
    with connect(live, compression=None, max_size=None) as connection:

        def take_part() -> None:
            due: list[tuple[int, int, str]] = []
            numbers = count()
            with suppress(ConnectionClosed):
                while not over.is_set():
                    left = 0.05 if not due else max(0.0, min(0.05, (due[0][0] - MACHINE.now()) / S))
                    message = b""
                    with suppress(TimeoutError):
                        message = connection.recv(timeout=left)
                    if isinstance(message, str):
                        _hear(participant, message, MACHINE.now(), due, numbers)
                    elif message:
                        connection.send(message[4:8])  # a picture, acknowledged
                    while due and due[0][0] <= MACHINE.now():
                        connection.send(heapq.heappop(due)[2])

        thread = threading.Thread(target=take_part, name="participant", daemon=True)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()


def _hear(
    participant: SimulatedParticipant, text: str, now_ns: int, due: list[tuple[int, int, str]], numbers: Iterator[int]
) -> None:
    """Adds to ``due``, a heap of times, ns, numbers and texts, what is replied to a text: each after the one before.

    What was not said by then is not said any more once she is told something else: a late answer is none to what is
    asked next.
    """
    fields = json.loads(text)
    if fields["kind"] == "participant":
        due.clear()
    for reply in participant.hear(fields["kind"], fields):
        now_ns += round(S * reply.after_s)
        heapq.heappush(due, (now_ns, next(numbers), _command(reply, now_ns)))


def _command(reply: Reply, at_ns: int) -> str:
    value = {**reply.value, "at_ms": 1e-6 * at_ns} if reply.name == ANSWER else reply.value
    return json.dumps({"kind": "command", "name": reply.name, "value": value})
