"""The server of the page, over its real sockets: who is let in, what they get, and what a slow one gets."""

import json
import socket
import time
from collections.abc import Iterator
from http.client import HTTPConnection
from urllib.parse import urlsplit

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from highfive.hil.drivers.latch import Cause, Latch
from highfive.hil.session.shown import Shown, shown_figures
from highfive.hil.view.allowance import Allowance
from highfive.hil.view.live_page import LivePage
from highfive.hil.view.page_shown import MOST
from highfive.hil.view.pages import page_files
from highfive.hil.view.server import CREDIT, MOST_A_SECOND, SHOWN_A_SECOND
from highfive.hil.view.wire import VERSION, PoseMessage, decode_poses
from highfive.model.errors import HighFiveError

ABOUT = {"mode": "session", "title": "tested"}


def poses(time_s: float = 0.0) -> PoseMessage:
    return PoseMessage(0, 1, 2, 0, 1.0, time_s, np.ones((59, 7)), np.zeros((16, 3)), np.ones(16, dtype=bool))


@pytest.fixture(scope="module")
def estop() -> Latch:
    return Latch()


@pytest.fixture(scope="module")
def page(estop: Latch) -> Iterator[LivePage]:
    with LivePage(ABOUT, port=0, estop=estop) as opened:
        yield opened


def live(page: LivePage, **more: object) -> ClientConnection:
    return connect(page.address.replace("http", "ws", 1).replace("/?", "/live?"), compression=None, **more)  # pyright: ignore


def get(page: LivePage, path: str, **headers: str) -> tuple[int, dict[str, str], bytes]:
    link = HTTPConnection("127.0.0.1", page.port, timeout=30)
    link.request("GET", path, headers=headers)
    answer = link.getresponse()
    return answer.status, dict(answer.getheaders()), answer.read()


def texts_until(link: ClientConnection, kind: str) -> dict[str, object]:
    while True:
        message = link.recv(10.0)
        if isinstance(message, str) and (text := json.loads(message))["kind"] == kind:
            return text


def test_who_has_the_address_gets_the_page_and_everything_it_names(page: LivePage) -> None:
    parts = urlsplit(page.address)
    status, headers, body = get(page, f"{parts.path}?{parts.query}")
    assert status == 200 and b"<title>High Five</title>" in body
    assert headers["Content-Security-Policy"].startswith("default-src 'self'")
    assert headers["X-Content-Type-Options"] == "nosniff" and headers["Referrer-Policy"] == "no-referrer"
    for path in {*page_files(), "/skin.glb", "/scene.json"} - {"/"}:
        status, headers, body = get(page, path)
        assert status == 200 and len(body) == int(headers["Content-Length"]), path
    assert b"://" not in b"".join(file.plain for path, file in page_files().items() if path in ("/", "/style.css"))


@pytest.mark.parametrize(
    ("path", "headers", "status"),
    [
        ("/", {}, 403),
        ("/?key=wrong", {}, 403),
        ("/?key=KEY&key=KEY", {}, 403),
        ("/?key=KEY", {"Host": "evil.example:80"}, 403),
        ("/?key=KEY", {"Origin": "http://evil.example"}, 403),
        ("/style.css", {"Host": "evil.example:80"}, 403),
        ("/../wire.py", {}, 404),
        ("/%2e%2e/wire.py", {}, 404),
        ("/etc/passwd", {}, 404),
        ("/?a0=1&a1=1&a2=1&a3=1&a4=1&a5=1&a6=1&a7=1&a8=1&key=KEY", {}, 403),
        ("//[::1/", {}, 400),
    ],
)
def test_nobody_else_is_let_in(page: LivePage, path: str, headers: dict[str, str], status: int) -> None:
    key = urlsplit(page.address).query.removeprefix("key=")
    found, _, body = get(page, path.replace("KEY", key), **headers)
    assert found == status and body.count(b"\n") == 1


def request_targets(key: str) -> Iterator[bytes]:
    """What programs may ask for: pieces of addresses, of ours too, and bytes, thrown together."""
    rng = np.random.default_rng(6)
    pieces = [
        b"/", b"//", b"..", b"?", b"&", b"=", b"#", b"%", b"%00", b"%ff", b"%zz", b"[", b"]", b"[::1", b"http://", b":",
        b"@", b";", b"key=", b"key=" + key.encode(), b"\xff", "é".encode(), b"\x00", b"\t", b"live", b"style.css",
        b"a" * 3000, b"&a=1" * 12,
    ]  # fmt: skip
    for _ in range(300):
        yield b"".join(pieces[i] for i in rng.integers(len(pieces), size=rng.integers(1, 9)))
        yield b"/?key=" + rng.bytes(8)


@pytest.mark.slow
def test_no_request_line_brings_the_server_into_trouble(capfd: pytest.CaptureFixture[str]) -> None:
    with LivePage(ABOUT, port=0) as page:  # of this test's own: what it prints is caught
        parts = urlsplit(page.address)
        for target in request_targets(parts.query.removeprefix("key=")):
            with socket.create_connection(("127.0.0.1", page.port), timeout=10.0) as link:
                link.sendall(b"GET " + target + b" HTTP/1.1\r\nHost: localhost:%d\r\n\r\n" % page.port)
                with link.makefile("rb") as answer:
                    line = answer.readline()
            assert not line.startswith(b"HTTP/1.1 5"), target
        assert get(page, f"{parts.path}?{parts.query}")[0] == 200
    assert capfd.readouterr() == ("", "")


def test_a_live_connection_needs_the_key_and_a_page_of_ours(page: LivePage) -> None:
    address = f"ws://localhost:{page.port}/live?key=wrong"
    with pytest.raises(InvalidStatus, match="403"):
        connect(address)
    with pytest.raises(InvalidStatus, match="403"):
        live(page, origin="http://evil.example")
    with live(page, origin=f"http://localhost:{page.port}") as link:
        assert json.loads(link.recv(5.0))["kind"] == "hello"


def test_texts_come_in_order_and_the_newest_state_to_who_comes_late(page: LivePage) -> None:
    with live(page) as link:
        hello = texts_until(link, "hello")
        assert hello["title"] == "tested" and hello["version"] == VERSION
        for count in range(50):
            page.tell("note", count=count)
        assert [texts_until(link, "note")["count"] for _ in range(50)] == list(range(50))
        page.tell("state", time_s=1.5)
        assert texts_until(link, "state")["time_s"] == 1.5
    with live(page) as link:
        assert texts_until(link, "state")["time_s"] == 1.5


def test_who_does_not_acknowledge_gets_the_credit_and_then_the_newest(page: LivePage) -> None:
    with live(page) as link:
        texts_until(link, "hello")
        for count in range(200):
            page.show(poses(count))
            time.sleep(0.002)
        got: list[PoseMessage] = []
        while len(got) < CREDIT:
            message = link.recv(5.0)
            if isinstance(message, bytes):
                got.append(decode_poses(message))
        with pytest.raises(TimeoutError):
            while True:
                assert isinstance(link.recv(0.3), str)
        link.send(got[-1].number.to_bytes(4, "little"))
        message = link.recv(5.0)
        assert isinstance(message, bytes)
        newest = decode_poses(message)
        assert newest.time_s == 199.0 and newest.sent_ns > 0
        assert len({one.number for one in [*got, newest]}) == CREDIT + 1


def test_commands_reach_the_host_and_nothing_else_does(page: LivePage) -> None:
    page.commands()
    with live(page) as link:
        texts_until(link, "hello")
        for message in ('{"kind": "command", "name": "reboot"}', "nonsense", "[]", b"\0" * 9, b"\xff\xff\xff\xff"):
            link.send(message)
        link.send('{"kind": "command", "name": "style", "value": {"angry": 1}}')
        link.send('{"kind": "time", "asked": 12.5}')
        assert texts_until(link, "time")["asked"] == 12.5
        asked = page.commands()
        assert [(one.name, one.value) for one in asked] == [("style", {"angry": 1.0})]


def test_what_pages_have_shown_reaches_the_host_by_page_and_nothing_like_it_does(page: LivePage) -> None:
    wrong = (
        [], [[1, 2.0, 3.0]], [[1, 2.0, 3.0, -1]], [[1, None, 3.0, 0]], [[1.5, 2.0, 3.0, 0]], [[True, 2.0, 3.0, 0]],
        [[1, 1e300, 3.0, 0]], [[1, 2.0, 3.0, 0]] * 1000, "no", {"a": 1}, [["1", 2.0, 3.0, 0]],
    )  # fmt: skip
    with live(page) as one, live(page) as other:
        for pictures in wrong:
            one.send(json.dumps({"kind": "shown", "bound_ms": 0.5, "pictures": pictures}))
        one.send(json.dumps({"kind": "shown", "bound_ms": -1.0, "pictures": [[1, 2.0, 3.0, 0]]}))
        one.send(json.dumps({"kind": "shown", "pictures": [[1, 2.0, 3.0, 0]]}))
        one.send(
            json.dumps({"kind": "shown", "bound_ms": 0.25, "pictures": [[7, 1000.5, 1008.25, 0], [8, 1016, 1024.5, 2]]})
        )
        other.send(json.dumps({"kind": "shown", "bound_ms": 1, "pictures": [[0, 1000.0, 1010.0, 0]]}))
        told, end = [], time.monotonic() + 10.0
        while len(told) < 3 and time.monotonic() < end:
            told += page.shown()
    by_page = {number: [one for one in told if one.page == number] for number in {one.page for one in told}}
    assert sorted(map(len, by_page.values())) == [1, 2]
    both = next(found for found in by_page.values() if len(found) == 2)
    assert [one.shown for one in both] == [
        Shown(7, 1_000_500_000, 1_008_250_000, 0), Shown(8, 1_016_000_000, 1_024_500_000, 2)
    ]  # fmt: skip
    assert both[0].bound_ns == 250_000
    assert shown_figures([one.shown for one in both]) == {
        "pictures": 2, "dropped": 2, "late_ms": {"p50": 8.125, "p95": pytest.approx(8.4625)},
    }  # fmt: skip
    assert page.shown() == []


def test_so_many_are_taken_in_a_second_and_in_the_next_again() -> None:
    allowance = Allowance(3)
    assert [allowance.takes(now) for now in (0, 1, 2, 3, 999_999_999)] == [True, True, True, False, False]
    assert [allowance.takes(1_000_000_000 + now) for now in range(4)] == [True, True, True, False]
    assert allowance.takes(7_000_000_000)


@pytest.mark.parametrize("pictures", [1, MOST])
def test_a_flood_of_what_was_shown_reaches_the_host_as_a_trickle_and_holds_up_no_acknowledgement(
    page: LivePage, pictures: int
) -> None:
    """Long ones and short ones: of 600 some 8 for each second that they take to be sent come to the host's tick."""
    page.shown()
    told = json.dumps({"kind": "shown", "bound_ms": 0.5, "pictures": [[7, 1000.123456, 1008.123456, 0]] * pictures})
    with live(page) as link:
        texts_until(link, "hello")
        page.show(poses(1.0))
        first = next(message for message in iter(link.recv, None) if isinstance(message, bytes))
        start = time.monotonic()
        for count in range(1000, 1600):
            link.send(told)
            if count % 100 == 50:  # what is owed is acknowledged between them, and the next pose comes
                link.send(first[4:8])
                page.show(poses(float(count)))
                poses_sent = (message for message in iter(lambda: link.recv(20.0), None) if isinstance(message, bytes))
                # Who comes is given the newest pose of before, and may have that one still to take.
                first = next(message for message in poses_sent if decode_poses(message).time_s == float(count))
        link.send('{"kind": "command", "name": "next"}')
        link.send('{"kind": "time", "asked": 77}')
        while texts_until(link, "time")["asked"] != 77:
            pass
        seconds = int(time.monotonic() - start) + 2
        shown = page.shown()
        assert [one.name for one in page.commands()] == ["next"]
    assert pictures <= len(shown) <= SHOWN_A_SECOND * seconds * pictures
    assert SHOWN_A_SECOND * seconds < 300  # else nothing was judged


def test_the_emergency_stop_is_pulled_by_the_server_itself(page: LivePage, estop: Latch) -> None:
    with live(page) as link:
        texts_until(link, "hello")
        assert estop.pulled_ns is None
        link.send('{"kind": "command", "name": "estop"}')
        link.send('{"kind": "time", "asked": 1}')
        texts_until(link, "time")
    assert estop.pulled_ns is not None and estop.cause is Cause.PAGE
    estop.let_go()


def test_who_floods_is_let_go_and_the_others_stay(page: LivePage) -> None:
    with live(page) as quiet:
        texts_until(quiet, "hello")
        with live(page) as loud, pytest.raises(ConnectionClosed):
            for _ in range(20 * MOST_A_SECOND):
                loud.send("x" * 100)
            while True:
                loud.recv(5.0)
        with live(page) as long, pytest.raises(ConnectionClosed):
            long.send("x" * 100_000)
            while True:
                long.recv(5.0)
        page.tell("still", there=True)
        assert texts_until(quiet, "still")["there"]
    assert page.alive


def test_pages_are_counted(page: LivePage) -> None:
    with live(page) as link:
        texts_until(link, "hello")
        assert page.wait_for_page(60.0)
    end = time.monotonic() + 60.0
    while page.pages and time.monotonic() < end:
        page.commands()
        time.sleep(0.01)
    assert page.pages == 0 and not page.wait_for_page(0.01)


@pytest.mark.slow
def test_a_port_in_use_is_one_line() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(HighFiveError, match=f"cannot show the page on port {port}: .*choose another$"):
            LivePage(ABOUT, port=port)


@pytest.mark.slow
def test_a_host_whose_server_is_gone_goes_on() -> None:
    with LivePage(ABOUT, port=0) as page:
        page._process.kill()
        page._process.join()
        for _ in range(500):
            page.show(poses())
            page.tell("note", long="x" * 1000)
        assert not page.alive and page.commands() == []
