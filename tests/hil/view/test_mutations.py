"""Ten thousand wrong messages to the real server: dropped, or their sender let go; nobody else notices."""

import json
import random
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from highfive.hil.view.commands import COMMANDS, parse_command
from highfive.hil.view.live_page import LivePage
from highfive.hil.view.server import MOST_A_SECOND
from highfive.hil.view.wire import PoseMessage, decode_poses, encode_poses

MUTATIONS, SEED = 10_000, 20
AT_ONCE = MOST_A_SECOND // 2
"""Of one connection: below what counts as a flood, so that every message is read."""
VALUES = {
    "style": {"angry": 0.5, "happy": 0.5}, "cell": "B2", "correct": True, "pause": False,
    "trial": 1, "seek": 0.5, "speed": 0.5, "step": -1,
}  # fmt: skip
ODD = (None, True, -1, 1e400, "", [], {}, {"a": {}}, "\0", "\ud800", 10**400, [[[[]]]], -0.0, "é" * 80)


def poses(number: int) -> PoseMessage:
    return PoseMessage(number, 1, 2, 0, 1.0, 0.0, np.ones((59, 7)), np.zeros((16, 3)), np.ones(16, dtype=bool))


def valid(chance: random.Random) -> str | bytes:
    """What a page may send, and what it is sent."""
    match chance.randrange(4):
        case 0:
            return chance.randrange(1 << 32).to_bytes(4, "little")
        case 1:
            return encode_poses(poses(chance.randrange(1 << 20)))
        case 2:
            return json.dumps({"kind": "time", "asked": chance.uniform(0.0, 1e6)})
        case _:
            name = chance.choice([name for name in COMMANDS if name != "estop"])
            return json.dumps({"kind": "command", "name": name, "value": VALUES.get(name)})


def mutated(chance: random.Random) -> str | bytes:
    """One of them with bytes, fields or its length changed; text may be sent as bytes and the other way round."""
    message = valid(chance)
    if isinstance(message, str) and chance.random() < 0.4:
        fields = json.loads(message)
        fields[chance.choice([*fields, "more"])] = chance.choice(ODD)
        return json.dumps(fields)
    data = bytearray(message.encode() if isinstance(message, str) else message)
    for _ in range(chance.randint(1, 6)):
        at = chance.randrange(len(data) + 1)
        match chance.randrange(4):
            case 0 if at < len(data):
                data[at] = chance.randrange(256)
            case 1:
                data[at:at] = bytes(chance.randrange(256) for _ in range(chance.randint(1, 20)))
            case 2:
                del data[at : at + chance.randint(1, 20)]
            case _:
                data[at:at] = data[: chance.randint(1, 40)]
    if isinstance(message, str) != (chance.random() < 0.1):
        return bytes(data).decode("utf-8", "replace")
    return bytes(data)


@pytest.fixture
def page() -> Iterator[LivePage]:
    with LivePage({"mode": "session"}, port=0) as opened:
        yield opened


def live(page: LivePage) -> ClientConnection:
    return connect(page.address.replace("http", "ws", 1).replace("/?", "/live?"), compression=None, max_queue=None)


@pytest.mark.slow
def test_ten_thousand_mutated_messages_are_dropped_and_nobody_else_notices(
    page: LivePage, capfd: pytest.CaptureFixture[str]
) -> None:
    chance, got, told = random.Random(SEED), [], []
    done, steps = threading.Event(), threading.Semaphore(0)

    def look_on() -> None:
        with live(page) as link:
            while not done.is_set():
                try:
                    message = link.recv(0.2)
                except TimeoutError:
                    continue
                if isinstance(message, bytes):
                    link.send(message[4:8])
                    got.append(decode_poses(message).number)
                    steps.release()
                else:
                    told.append(json.loads(message)["kind"])

    quiet = threading.Thread(target=look_on)
    quiet.start()
    assert page.wait_for_page(10.0)
    sent, shown, right = 0, 0, []
    while sent < MUTATIONS:
        with live(page) as link:
            try:
                for _ in range(min(AT_ONCE, MUTATIONS - sent)):
                    message = mutated(chance)
                    right += [parse_command(message)] if isinstance(message, str) else []
                    link.send(message)
                    sent += 1
                link.send('{"kind": "time", "asked": 4321}')
                while not (isinstance(text := link.recv(10.0), str) and json.loads(text).get("asked") == 4321):
                    pass
            except ConnectionClosed:
                pass
        # Whoever looks on gets each pose that is shown, between any two crowds.
        page.show(poses(0))
        shown += 1
        assert steps.acquire(timeout=60.0)
    done.set()
    quiet.join()
    assert len(got) == len(set(got)) == shown and got == sorted(got)
    asked = [command for command in right if command is not None]
    end = time.monotonic() + 60.0
    heard = page.commands()
    while len(heard) < len(asked) and time.monotonic() < end:
        heard += page.commands()
    assert heard == asked and 0 < len(asked) < MUTATIONS
    assert page.alive and told[0] == "hello"
    said = capfd.readouterr()
    assert not said.out and not said.err
