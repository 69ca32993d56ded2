"""Messages of pages, headsets and cameras, and what the page's server and the host make of them."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from highfive.hil.bench.fuzz_mutations import damaged_json, damaged_text
from highfive.hil.bench.fuzz_reader import Seed
from highfive.hil.view.access import Access, address_of
from highfive.hil.view.commands import Command, parse_command
from highfive.hil.view.mailbox import Mailbox, mailboxes
from highfive.hil.view.page_shown import page_shown
from highfive.hil.view.server import ServerOptions, _Page, _Server
from highfive.mocap_bridge.wire.headset import HeadsetPose, decode_headset, encode_headset
from highfive.mocap_bridge.wire.landmarks import HandLandmarks, Landmarks, decode_landmarks, encode_landmarks


def page_seeds() -> list[Seed]:
    """What a page sends: commands, what it has shown, questions, acknowledgements; and what it asks for."""
    values: dict[str, Any] = {
        "style": {"angry": 0.5, "happy": 0.5}, "cell": "B2", "correct": True, "trial": 1, "seek": 0.5, "step": -1,
        "answer": {"key": "a", "at_ms": 12.5}, "rate": {"name": "valence", "value": 0.5}, "note": "a note", "end": None,
    }  # fmt: skip
    texts: list[dict[str, Any]] = [{"kind": "command", "name": name, "value": value} for name, value in values.items()]
    texts += [{"kind": "time", "asked": 12.5}, {"kind": "headset", "over": True}, {"kind": "camera"}]
    texts += [{"kind": "shown", "bound_ms": 1.5, "pictures": [[n, 12.5, 13.5, 0] for n in range(3)]}]
    seeds = [Seed(json.dumps(text).encode(), _text, damaged_json) for text in texts]
    target = b"/live?key=abcdefgh&page=p1&role=participant"
    return [*seeds, Seed(b"\x05\0\0\0", _binary), Seed(target, _asked_for, damaged_text)]


@cache
def _server() -> tuple[_Server, Mailbox, Mailbox]:
    """The page's own, with nobody connected, and the host's ends of its mailboxes."""
    host, server = mailboxes()
    tracked, tracker = mailboxes()
    options = ServerOptions("127.0.0.1", 0, "abcdefgh", (), {"mode": "session"})
    return _Server(options, server, None, tracker), host, tracked


def _text(content: bytes, folder: Path) -> Any:
    return _heard(content.decode("utf-8", "replace"))


def _binary(content: bytes, folder: Path) -> Any:
    return _heard(content)


def _heard(message: str | bytes) -> Any:
    """What the server and then the host make of a message."""
    server, host, tracked = _server()
    connection = SimpleNamespace(transport=SimpleNamespace(abort=lambda: None))
    page = _Page(cast("Any", connection), 1, "p1")
    page.owed.extend((4, 5, 6))
    server._hear(page, message)
    found: list[Any] = [*page.texts]
    for data in host.take():
        told = json.loads(data)
        if told["kind"] == "command":
            found.append(Command(told["name"], told["value"]))
            json.dumps(told, ensure_ascii=False, allow_nan=False).encode()  # as logs and files hold it
        elif told["kind"] == "shown":
            found += page_shown(*(told[name] for name in ("page", "bound_ms", "pictures", "tracks")))
    if isinstance(message, str):
        found.append(parse_command(message))
    return found, [_tracked(data) for data in tracked.take()]


def _tracked(data: bytes) -> Any:
    """What the host makes of what is handed on to it."""
    return decode_headset(data) if data[0] == 2 else decode_landmarks(data)


def _asked_for(content: bytes, folder: Path) -> Any:
    target = content.decode("latin-1")
    address = address_of(target)
    if address is None:
        return None
    access = Access.to(8150, "abcdefgh")
    return access.refusal(address.query, "localhost:8150", target, needs_key=True)


def headset_seeds() -> list[Seed]:
    """A headset's pose with everything seen, and with nothing; landmarks of a picture with a person, and without."""
    hands = np.zeros((2, 25, 3)) + np.linspace(0.0, 0.1, 25)[:, None]
    viewer = np.array([0.1, 0.0, 0.2, 1.0, 0.0, 0.0, 0.0])
    full = HeadsetPose(1, 0, 12.5, viewer, True, hands, np.ones((2, 25), bool), np.full((4, 3), 0.1), np.ones(4, bool))
    empty = HeadsetPose(2, 0, 12.5, viewer, False, hands, np.zeros((2, 25), bool), np.zeros((4, 3)), np.zeros(4, bool))
    hand = HandLandmarks(0.9, np.full((21, 2), 0.5), np.full((21, 3), 0.01))
    person = Landmarks(
        1, 12.5, 60.0, (640, 480), 1, np.full((25, 2), 0.5), np.full(25, 0.9), np.full((25, 3), 0.1), (hand,)
    )
    nobody = Landmarks(2, 12.5, 60.0, (640, 480), 0, None, None, None)
    seeds = [Seed(encode_headset(pose), lambda data, _: decode_headset(data)) for pose in (full, empty)]
    seeds += [Seed(encode_landmarks(found), lambda data, _: decode_landmarks(data)) for found in (person, nobody)]
    return [*seeds, Seed(encode_headset(full), _binary), Seed(encode_landmarks(person), _binary)]
