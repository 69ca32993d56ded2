"""What the servers share: a port, a thread, being switched off and on; and, over TCP, taking clients and sending on."""

from __future__ import annotations

import contextlib
import selectors
import socket
import threading
from abc import ABC, abstractmethod
from typing import Generic, TypeVar

from highfive.mocap_bridge.sources.scheduler import THREADS, Now
from highfive.mocap_bridge.wire.errors import LinkError
from highfive.model.errors import HighFiveError

_MOST_UNSENT = 1 << 20  # bytes of answers; who reads none of them is let go
_SEND_BUFFER = 1 << 16  # bytes that the system keeps for a slow client: no more than some frames


class LiveServer(ABC):
    """A socket at a port, and a thread that obeys clients; see :class:`highfive.mocap_bridge.servers.serving.Server`.

    What both touch is touched under ``self._lock``. A subclass has all its own before it calls ``__init__``, which
    starts the thread.
    """

    def __init__(self, host: str, port: int, name: str, now: Now = THREADS.now) -> None:
        """Listens.

        Args:
            host: address to listen at; '' or '0.0.0.0' lets in the whole network.
            port: 0 takes any that is free.
            name: of the protocol.
            now: monotonic clock, ns.

        Raises:
            LinkError: the port is taken or not allowed.
        """
        self._host, self._now = host, now
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._sent_ns = 0
        self._sock = self._bound(port)
        self._port = self._sock.getsockname()[1]
        self._listen()
        self._up = True
        self._thread = threading.Thread(target=self._run, name=f"{name} server {self._port}", daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """The port that it listens at."""
        return self._port

    @property
    def sent_ns(self) -> int:
        """When the last frame went out; see :class:`highfive.mocap_bridge.servers.serving.Server`."""
        return self._sent_ns

    def hang_up(self) -> None:
        """Drops every client, and is not there until :meth:`answer`."""
        with self._lock:
            self._up = False
            self._drop_all()
            self._sock.close()
            self._hold_port()
        self._wake()

    def answer(self) -> None:
        """Is there again, at the same port."""
        with self._lock:
            if self._up or self._closing.is_set():
                return
            if self._sock.fileno() < 0:
                self._sock = self._bound(self._port)
            self._listen()
            self._up = True
        self._wake()

    def close(self) -> None:
        """Ends everything; a second call does nothing."""
        self._closing.set()
        self._wake()
        self._thread.join(timeout=5.0)
        with self._lock:
            self._drop_all()
            self._sock.close()

    def _bound(self, port: int) -> socket.socket:
        sock = self._socket()
        try:
            sock.bind((self._host, port))
            sock.setblocking(False)
        except (OSError, OverflowError) as error:
            sock.close()
            reason = getattr(error, "strerror", None) or error
            where = f"{self._host or '0.0.0.0'}:{port}"
            other = 8802 if port == 8801 else 8801
            raise LinkError(f"cannot listen at {where}: {reason}; name another port, such as --port {other}") from None
        return sock

    @abstractmethod
    def _socket(self) -> socket.socket:
        """A socket that is bound to no port yet."""

    def _listen(self) -> None:  # noqa: B027 (datagrams need none)
        """Begins to take clients."""

    def _hold_port(self) -> None:  # noqa: B027 (datagrams need none)
        """Keeps the port while nobody is answered."""

    def _wake(self) -> None:  # noqa: B027 (datagrams need none)
        """Something has changed that the thread does not see by itself."""

    @abstractmethod
    def _drop_all(self) -> None:
        """Lets every client go."""

    @abstractmethod
    def _run(self) -> None:
        """The thread, until it is closing."""


class Client:
    """One connection over TCP, and what has not been sent yet.

    Attributes:
        sock: it.
        unsent: bytes that the socket has not taken.
        open: False once it is to be let go.
    """

    def __init__(self, sock: socket.socket) -> None:
        """Nothing has been sent to it."""
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        self.sock = sock
        self.unsent = bytearray()
        self.open = True

    def push(self, message: bytes = b"") -> None:
        """Sends what can be sent now."""
        self.unsent += message
        try:
            while self.unsent:
                del self.unsent[: self.sock.send(self.unsent)]
        except BlockingIOError:
            self.open &= len(self.unsent) <= _MOST_UNSENT
        except OSError:
            self.open = False


AnyClient = TypeVar("AnyClient", bound=Client)


class TcpServer(LiveServer, Generic[AnyClient]):
    """Any number of clients over TCP.

    ``send`` writes to the sockets itself and never waits: whoever has not taken the last frame yet misses this one. The
    thread takes connections and requests, and goes on where a socket was full.
    """

    def __init__(self, host: str, port: int, name: str, now: Now = THREADS.now) -> None:
        """Listens; as :class:`LiveServer`."""
        self._clients: list[AnyClient] = []
        self._awake, self._alarm = socket.socketpair()
        for end in (self._awake, self._alarm):
            end.setblocking(False)
        try:
            super().__init__(host, port, name, now)
        except LinkError:
            self._awake.close()
            self._alarm.close()
            raise

    @abstractmethod
    def _welcomed(self, sock: socket.socket) -> AnyClient:
        """A new client, greeted."""

    @abstractmethod
    def _take(self, client: AnyClient, chunk: bytes) -> None:
        """Does what a client asks for; :class:`HighFiveError` for what is not of the protocol."""

    def _go_on(self, client: AnyClient) -> None:
        """A client's socket takes more again."""
        client.push()

    def _send_to_all(self) -> None:
        """Has the thread send on what sockets were too full for; ends a :meth:`send`, under the lock."""
        self._let_go()
        if any(client.unsent for client in self._clients):
            self._wake()

    def _socket(self) -> socket.socket:
        sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        return sock

    def _listen(self) -> None:
        self._sock.listen()

    def _hold_port(self) -> None:
        with contextlib.suppress(LinkError):  # bound, but not listening; answer() tries again
            self._sock = self._bound(self._port)

    def _drop_all(self) -> None:
        for client in self._clients:
            client.sock.close()
        self._clients = []

    def _let_go(self) -> None:
        for client in self._clients:
            if not client.open:
                client.sock.close()
        self._clients = [client for client in self._clients if client.open]

    def _wake(self) -> None:
        with contextlib.suppress(OSError):  # full: it wakes anyway; closed: it has ended
            self._alarm.send(b"!")

    def _run(self) -> None:
        with self._awake, self._alarm:
            while not self._closing.is_set():
                self._turn()

    def _turn(self) -> None:
        """Waits until there is something to do, and does it."""
        with selectors.DefaultSelector() as selector:
            with self._lock:
                selector.register(self._awake, selectors.EVENT_READ)
                if self._up:
                    selector.register(self._sock, selectors.EVENT_READ)
                for client in self._clients:
                    full = selectors.EVENT_WRITE if client.unsent else 0
                    selector.register(client.sock, selectors.EVENT_READ | full, client)
            ready = selector.select()
        with self._lock:
            for key, events in ready:
                if key.fileobj is self._awake:
                    self._awake.recv(4096)
                elif key.fileobj is self._sock:
                    self._accept()
                elif key.data in self._clients:
                    if events & selectors.EVENT_WRITE:
                        self._go_on(key.data)
                    if events & selectors.EVENT_READ and key.data.open:
                        self._read(key.data)
            self._let_go()

    def _accept(self) -> None:
        if self._up:
            with contextlib.suppress(OSError):
                self._clients.append(self._welcomed(self._sock.accept()[0]))

    def _read(self, client: AnyClient) -> None:
        try:
            chunk = client.sock.recv(1 << 16)
            client.open &= bool(chunk)
            self._take(client, chunk)
        except BlockingIOError:
            pass
        except (OSError, HighFiveError):
            client.open = False
