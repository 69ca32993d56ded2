"""Between the host, whose tick must never wait, and the server of the page: two sockets of datagrams.

A pose that does not fit is dropped, for a newer one follows. A text that does not fit is kept and goes with the next.
"""

from __future__ import annotations

import select
import socket
from collections import deque

from highfive.hil.view.wire import LONGEST

_BUFFER, _MOST_WAITING = 1 << 20, 256


def mailboxes() -> tuple[Mailbox, Mailbox]:
    """The host's end and the server's, which is passed as an argument of its ``Process``."""
    host, server = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    for end in (host, server):
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER)
        end.setblocking(False)
    return Mailbox(host), Mailbox(server)


class Mailbox:
    """One end. No call waits."""

    def __init__(self, end: socket.socket) -> None:
        """Owns ``end``."""
        self._socket = end
        self._waiting: deque[bytes] = deque()
        self.dropped = 0
        """Poses that did not fit."""

    def fileno(self) -> int:
        """Readable when something has come."""
        return self._socket.fileno()

    def put_newest(self, data: bytes) -> None:
        """Sends what is worth nothing later."""
        self._send_waiting()
        if not self._send(data):
            self.dropped += 1

    def put(self, text: str) -> bool:
        """Sends what must arrive, in order; False where so much is waiting that nobody reads any more."""
        self._waiting.append(text.encode())
        self._send_waiting()
        if len(self._waiting) > _MOST_WAITING:
            self._waiting.popleft()
            return False
        return True

    def take(self) -> list[bytes]:
        """All that has come since."""
        found: list[bytes] = []
        while True:
            try:
                found.append(self._socket.recv(LONGEST))
            except (BlockingIOError, InterruptedError):
                return found
            except OSError:  # the other end is gone
                return found

    def wait(self, seconds: float) -> list[bytes]:
        """All that has come since; waits so long at most for something to come."""
        try:
            select.select([self._socket], [], [], max(seconds, 0.0))
        except (OSError, ValueError):  # it was closed meanwhile
            return []
        return self.take()

    def close(self) -> None:
        """Closes this end."""
        self._socket.close()

    def _send_waiting(self) -> None:
        while self._waiting and self._send(self._waiting[0]):
            self._waiting.popleft()

    def _send(self, data: bytes) -> bool:
        try:
            self._socket.send(data)
        except (BlockingIOError, InterruptedError):
            return False
        except OSError:  # the other end is gone: nothing waits for what it no longer reads
            return True
        return True
