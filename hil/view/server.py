"""The server of the page: files, and the newest pose to each who looks on, in a process of its own.

A page acknowledges each pose. Whoever has :data:`CREDIT` of them unacknowledged gets no more, and then the newest: a
tab that sleeps has no backlog when it wakes. Texts are few, ordered, and never dropped; who does not take them is let
go.
"""

from __future__ import annotations

import asyncio
import json
import multiprocessing
import os
import signal
import ssl
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field
from http import HTTPStatus
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from highfive.hil.drivers.latch import Cause, Latch
from highfive.hil.runtime.clock import MACHINE
from highfive.hil.sim.scene import build_scene
from highfive.hil.view.access import Access, address_of
from highfive.hil.view.allowance import Allowance
from highfive.hil.view.arm_cast import ArmCast
from highfive.hil.view.cast import Cast
from highfive.hil.view.commands import OF_PARTICIPANTS, parse_command
from highfive.hil.view.elsewhere import for_elsewhere, is_here
from highfive.hil.view.mailbox import Mailbox
from highfive.hil.view.page_shown import parse_shown
from highfive.hil.view.pages import POLICY, TYPES, WEBCAM_POLICY, File, page_files, refusal
from highfive.hil.view.skin_file import skin_file
from highfive.hil.view.webcam_files import net_files
from highfive.hil.view.wire import LONGEST, POSES, VERSION, encode_text, number_of, stamped
from highfive.hil.view.worn import Worn
from highfive.mocap_bridge.wire import headset
from highfive.mocap_bridge.wire.landmarks import KIND as LANDMARKS

CREDIT = 8
"""Poses that a page may owe: 120 Hz over a round trip of 66 ms."""
MOST_TEXTS = 256
"""Texts that may wait for a page before it is let go."""
MOST_A_SECOND = 1000
"""Messages that a page may send in a second before it is let go; it acknowledges some 120."""
SHOWN_A_SECOND = 8
"""Messages of what was shown that are taken of a page; it sends four. The host reads them in its ticks."""
LONGEST_ASKED = 4096
"""Characters of a command or a question; longer texts, which take time to be read, can only say what was shown."""
MOST_PAGES = 16
LONGEST_NAME = 64
NICE = 5
"""Less urgent by so much than what it shows: where cores are few, the tick goes first."""
FULL = "too many pages look on already"
CONTACTS = 12
"""High fives that a new page is told: so many bars its chart has."""
LIVE = "/live"
KEPT = ("state", "contacts", "say", "experiment", "participant", "experimenter")
"""Kinds of texts of which a new page is told the newest."""
HIDDEN = ("state", "contacts", "contact", "streams", "experimenter")
"""Kinds that a participant is not told: they say which style is shown."""


@dataclass(frozen=True)
class ServerOptions:
    """What the server is told as it starts.

    Attributes:
        host: address that it listens on.
        port: 0 takes a free one.
        key: of the page's address.
        names: further names of this machine under which the page may be asked for.
        about: text of the first message to every page: what is shown.
        tls: files with certificate and key; None serves without TLS.
    """

    host: str
    port: int
    key: str
    names: tuple[str, ...]
    about: dict[str, object]
    tls: tuple[Path, Path] | None = None


def run_server(options: ServerOptions, mailbox: Mailbox, estop: Latch | None, tracked: Mailbox | None = None) -> None:
    """What the process does until it is told to close, or its parent is gone.

    ``tracked`` takes what the page tracks, in a headset or before its camera; None where nobody asks for that.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the host decides when the page closes
    os.nice(NICE)
    asyncio.run(_Server(options, mailbox, estop, tracked).run())


OPEN_S = 120.0
"""So long a request may take: skin and scene are made once, in several seconds, on a busy machine in many."""


@dataclass(eq=False)
class _Page:
    """One that looks on."""

    connection: ServerConnection
    number: int
    name: str  # its own, which it keeps when it is reloaded
    owed: deque[int] = field(default_factory=deque)
    last: int = -1
    texts: deque[str] = field(default_factory=deque)
    news: asyncio.Event = field(default_factory=asyncio.Event)
    messages: Allowance = field(default_factory=lambda: Allowance(MOST_A_SECOND))
    shown: Allowance = field(default_factory=lambda: Allowance(SHOWN_A_SECOND))
    blind: bool = False  # a participant's, in an experiment: it is not told what is shown
    here: bool = True  # on this machine

    def tell(self, text: str) -> None:
        """Queues a text; who has not taken so many is let go."""
        self.texts.append(text)
        if len(self.texts) > MOST_TEXTS:
            self.connection.transport.abort()
        self.news.set()


class _Server:
    """The pages, and what they are shown."""

    def __init__(self, options: ServerOptions, mailbox: Mailbox, estop: Latch | None, tracked: Mailbox | None) -> None:
        self._options, self._mailbox, self._estop, self._tracked = options, mailbox, estop, tracked
        self._worn = Worn()
        self._pages: set[_Page] = set()
        self._came = 0  # pages so far
        self._newest: bytes | None = None
        self._kept: dict[str, str] = {}  # the newest text of each kind that a new page is told
        self._contacts: deque[str] = deque(maxlen=CONTACTS)
        self._posed = False  # since the last of them something has moved
        self._done = asyncio.Event()
        self._made: asyncio.Task[dict[str, File]] | None = None
        self._files = dict(page_files())
        self._policy = POLICY
        self._camera: _Page | None = None
        if options.about.get("webcam"):
            self._files |= net_files()
            self._policy = WEBCAM_POLICY
        self._secure = options.tls is not None
        self._access = Access.to(options.port, options.key, options.names, secure=self._secure)

    async def run(self) -> None:
        loop = asyncio.get_running_loop()
        loop.add_signal_handler(signal.SIGTERM, self._done.set)
        parent = multiprocessing.parent_process()
        if parent is not None:
            loop.add_reader(parent.sentinel, self._done.set)
        loop.add_reader(self._mailbox.fileno(), self._read)
        try:
            context = None
            if self._options.tls is not None:
                context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
                context.load_cert_chain(*self._options.tls)
            server = await serve(
                self._look_on, self._options.host, self._options.port, process_request=self._request,
                ssl=context, compression=None, max_size=LONGEST, ping_interval=20, ping_timeout=60, close_timeout=1,
                open_timeout=OPEN_S,
            )  # fmt: skip
        except OSError as error:
            self._mailbox.put(encode_text("failed", reason=error.strerror or str(error)))
            return
        async with server:
            port = next(iter(server.sockets)).getsockname()[1]
            self._access = Access.to(port, self._options.key, self._options.names, secure=self._secure)
            self._mailbox.put(encode_text("ready", port=port))
            soon = asyncio.create_task(self._make("/skin.glb"))  # as long as nobody asks for it yet
            await self._done.wait()
            soon.cancel()

    def _read(self) -> None:
        """Takes what the host has put; of poses the newest."""
        newest = None
        for data in self._mailbox.take():
            if data[0] == POSES:
                newest = data
                continue
            text = data.decode()
            kind = json.loads(text)["kind"]
            if kind == "close":
                self._done.set()
                return
            if kind in KEPT:
                self._kept[kind] = text
            if kind == "contact":
                self._contacts.append(text)
                self._posed = False
            for page in self._pages:
                if not (page.blind and kind in HIDDEN):
                    page.tell(text if page.here or kind != "over" else for_elsewhere(text))
        if newest is not None:
            self._newest, self._posed = newest, True
            for page in self._pages:
                page.news.set()

    async def _request(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answers for a file; None goes on to a live connection."""
        address = address_of(request.path)
        if address is None:
            return refusal(HTTPStatus.BAD_REQUEST, "what was asked for is no address")
        path = address.path
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        reason = self._access.refusal(
            address.query,
            hosts[0] if len(hosts) == 1 else None,
            ",".join(origins) or None,
            needs_key=path in ("/", LIVE),
        )
        if reason:
            return refusal(HTTPStatus.FORBIDDEN, reason)
        if path == LIVE:
            full = len(self._pages) >= MOST_PAGES
            return refusal(HTTPStatus.SERVICE_UNAVAILABLE, FULL) if full else None
        file = self._files.get(path)
        if file is None and path in ("/skin.glb", "/scene.json"):
            file = await self._make(path)
        if file is None:
            return refusal(HTTPStatus.NOT_FOUND, "there is no such file here")
        return file.response(request.headers.get("Accept-Encoding", ""), self._policy)

    async def _make(self, path: str) -> File | None:
        """Skin and scene, made once and off the loop: it takes seconds."""
        if self._made is None:
            self._made = asyncio.create_task(asyncio.to_thread(_make_scene, str(self._options.about.get("rig") or "")))
        return (await asyncio.shield(self._made)).get(path)

    async def _look_on(self, connection: ServerConnection) -> None:
        self._came += 1
        query = "" if connection.request is None else urlsplit(connection.request.path).query
        asked = parse_qs(query)
        name = asked.get("page", [""])[0][:LONGEST_NAME]
        here = is_here(connection.remote_address, connection.local_address)
        page = _Page(connection, self._came, name, blind=asked.get("role") == ["participant"], here=here)
        about = {**self._options.about, "rig": bool(self._options.about.get("rig"))}  # not whose folder it is
        page.tell(encode_text("hello", version=VERSION, credit=CREDIT, **about))
        for kind, text in self._kept.items():
            if not (page.blind and kind in HIDDEN):
                page.tell(text)
        for number, text in enumerate(() if page.blind else self._contacts, 1):
            # Past, but for one after which nothing has moved yet: then the session is between two high fives.
            past = self._posed or number < len(self._contacts)
            page.tell(encode_text(**{**json.loads(text), "past": past}))
        self._pages.add(page)
        self._tell_count()
        sender = asyncio.create_task(self._send(page))
        try:
            async for message in connection:
                if not page.messages.takes(MACHINE.now()):
                    break
                self._worn.hears(page.number, MACHINE.now())
                self._hear(page, message)
        except ConnectionClosed:
            pass
        finally:
            self._pages.discard(page)
            self._worn.gone(page.number, MACHINE.now())
            self._camera = None if self._camera is page else self._camera
            sender.cancel()
            with suppress(asyncio.CancelledError, ConnectionClosed):
                await sender
            self._tell_count()

    def _tell_count(self) -> None:
        self._mailbox.put(encode_text("pages", count=len(self._pages)))

    async def _send(self, page: _Page) -> None:
        try:
            while True:
                await page.news.wait()
                page.news.clear()
                while page.texts:
                    await page.connection.send(page.texts[0])
                    page.texts.popleft()
                data = self._newest
                if data is not None and len(page.owed) < CREDIT and number_of(data) != page.last:
                    page.last = number_of(data)
                    page.owed.append(page.last)
                    await page.connection.send(stamped(data, MACHINE.now()))
        except ConnectionClosed:
            return

    def _hear(self, page: _Page, message: str | bytes) -> None:
        """An acknowledgement (4 bytes), what a headset or a camera tracks, what was shown, a question, or a command.

        All else is dropped.
        """
        if isinstance(message, bytes):
            if len(message) == 4:
                number = int.from_bytes(message, "little")
                if number in page.owed:
                    while page.owed.popleft() != number:
                        pass
                    page.news.set()
            elif message and self._tracked is not None:
                self._track(page, message, self._tracked)
            return
        if self._hear_shown(page, message) or self._hear_wanted(page, message):
            return
        command = parse_command(message)
        if command is not None:
            if page.blind and command.name not in OF_PARTICIPANTS:
                return
            if command.name == "estop" and self._estop is not None:
                self._estop.pull(Cause.PAGE)  # here and now: the host may be busy
            self._mailbox.put(encode_text("command", name=command.name, value=command.value))
            return
        asked = _asked(message)
        if asked is not None:
            page.tell(encode_text("time", asked=asked, now_ms=1e-6 * MACHINE.now()))

    def _hear_wanted(self, page: _Page, message: str) -> bool:
        """Whether a page says that it wants to be the one whose camera or headset counts, or no longer."""
        if _wants(message, "headset") is False:  # who wore it is out of VR and AR
            self._worn.left(page.number, MACHINE.now())
            return True
        wants = _wants(message, "camera") if self._options.about.get("webcam") else None
        if wants:
            self._camera = self._camera or page  # one at a time: two people's hands are never mixed
            page.tell(encode_text("camera", granted=self._camera is page))
        elif wants is False:  # it could not be opened
            self._camera = None if self._camera is page else self._camera
        return wants is not None

    def _hear_shown(self, page: _Page, message: str) -> bool:
        """What a page has shown: whether it was that, or is too long for anything else.

        Too many are dropped, long ones unread. A later one says more than one that did not fit: nothing waits for it.
        """
        long = len(message) > LONGEST_ASKED
        if long and not page.shown.takes(MACHINE.now()):
            return True
        shown = parse_shown(message)
        if shown is not None and (long or page.shown.takes(MACHINE.now())):
            tracks = page is self._camera or page.number == self._worn.page
            text = encode_text("shown", page=page.number, bound_ms=shown[0], pictures=shown[1], tracks=tracks)
            self._mailbox.put_newest(text.encode())
        return long or shown is not None

    def _track(self, page: _Page, message: bytes, tracked: Mailbox) -> None:
        """Hands on what one camera or headset tracks; another headset is told that it is not tracked."""
        if page is self._camera and message[0] == LANDMARKS:
            tracked.put_newest(message)
        if message[0] != headset.KIND or len(message) != headset.LENGTH:
            return
        taken, before, told = self._worn.takes(page.number, page.name, MACHINE.now())
        if taken:
            tracked.put_newest(message)
        if told:
            page.tell(encode_text("headset", message=told, refused=not taken))
        if before:
            line = f"the headset of page {page.number} is tracked now, in place of that of page {before}, which is gone"
            self._mailbox.put(encode_text("said", line=line))


def _wants(message: str, kind: str) -> bool | None:
    """Whether the page wants to be the one whose camera, or headset, counts, or no longer; None of other messages."""
    with suppress(ValueError, RecursionError, AttributeError):
        asked = json.loads(message)
        return not asked.get("over") if asked.get("kind") == kind else None
    return None


def _asked(message: str) -> float | None:
    """The page's own time in its question for ours."""
    with suppress(ValueError, RecursionError, AttributeError):
        question = json.loads(message)
        asked = question.get("asked")
        if question.get("kind") == "time" and isinstance(asked, int | float) and not isinstance(asked, bool):
            return float(asked) if abs(asked) < 1e15 else None
    return None


def _make_scene(rig: str) -> dict[str, File]:
    cast = Cast.of(build_scene(visible=True).model)
    found = cast.description()
    if rig:
        arm = ArmCast(rig)
        found["geoms"] += arm.geoms(len(cast.names))
        found["bodies"] += arm.names
    description = json.dumps(found, separators=(",", ":")).encode()
    return {
        "/skin.glb": File.of(TYPES[".glb"], skin_file(cast)),
        "/scene.json": File.of(TYPES[".json"], description),
    }
