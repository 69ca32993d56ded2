"""Messages of the page: what goes in comes out, and whatever else comes is refused in one line."""

import json
import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from highfive.hil.view.commands import COMMANDS, Command, parse_command
from highfive.hil.view.wire import HEAD, PoseMessage, decode_poses, encode_poses, encode_text, number_of, stamped
from highfive.model.errors import HighFiveError

FLOATS = st.floats(-100.0, 100.0, width=32)
TIMES = st.integers(-(2**62), 2**62)


@st.composite
def messages(draw: st.DrawFn) -> PoseMessage:
    bodies, markers = draw(st.integers(0, 70)), draw(st.integers(0, 40))
    return PoseMessage(
        draw(st.integers(0, 2**32 - 1)), draw(TIMES), draw(TIMES), draw(TIMES), draw(FLOATS), draw(FLOATS),
        draw(arrays(np.float32, (bodies, 7), elements=FLOATS)).astype(float),
        draw(arrays(np.float32, (markers, 3), elements=FLOATS)).astype(float), draw(arrays(bool, markers)),
    )  # fmt: skip


@given(messages(), TIMES)
def test_what_is_encoded_is_decoded(message: PoseMessage, sent: int) -> None:
    data = encode_poses(message)
    found = decode_poses(stamped(data, sent))
    assert number_of(data) == found.number == message.number
    assert (found.holds_ns, found.captured_ns, found.sent_ns) == (message.holds_ns, message.captured_ns, sent)
    assert (found.rate, found.time_s) == (message.rate, message.time_s)
    assert np.array_equal(found.bodies, message.bodies) and np.array_equal(found.markers, message.markers)
    assert np.array_equal(found.seen, message.seen)


def test_ten_thousand_mutated_messages_are_decoded_or_refused() -> None:
    chance = random.Random(1)
    whole = encode_poses(PoseMessage(1, 2, 3, 4, 1.0, 0.5, np.ones((59, 7)), np.ones((16, 3)), np.ones(16, dtype=bool)))
    assert len(whole) == HEAD.size + 59 * 28 + 16 * 13
    texts = [
        json.dumps({"kind": "command", "name": name, "value": value})
        for name in COMMANDS
        for value in (None, True, 1, 0.5, "B2", {"angry": 0.5, "sad": 0.5})
    ]
    decoded = 0
    for _ in range(10_000):
        data = bytearray(whole if chance.random() < 0.5 else chance.choice(texts).encode())
        for _ in range(chance.randint(1, 4)):
            data[chance.randrange(len(data))] = chance.randrange(256)
        del data[chance.choice((len(data), chance.randrange(1, len(data)))) :]
        try:
            decode_poses(bytes(data))
            decoded += 1
        except HighFiveError as error:
            assert "\n" not in str(error)
        command = parse_command(data.decode("latin-1"))
        assert command is None or command.name in COMMANDS
    assert 1000 < decoded < 9000


@pytest.mark.parametrize(
    ("name", "value", "right"),
    [
        ("style", {"angry": 0.25, "sad": 0.75}, True),
        ("style", {"angry": 0.0}, False),
        ("style", {"angry": -0.5, "sad": 1.0}, False),
        ("style", {"angry": float("nan")}, False),
        ("style", {}, False),
        ("style", [1.0], False),
        ("style", {f"e{i}": 0.1 for i in range(40)}, False),
        ("pause", True, True),
        ("pause", 1, False),
        ("seek", 1.5, True),
        ("seek", True, False),
        ("seek", 10**400, False),
        ("speed", 0.25, True),
        ("speed", 0.0, False),
        ("step", -1, True),
        ("step", 1.0, False),
        ("cell", "B2", True),
        ("cell", "", False),
        ("next", None, True),
        ("estop", "whatever", True),
        ("reboot", None, False),
    ],
)
def test_a_command_is_one_of_the_list_with_a_value_of_its_kind(name: str, value: object, right: bool) -> None:
    found = parse_command(json.dumps({"kind": "command", "name": name, "value": value}))
    assert (found is not None) is right
    if found is not None and COMMANDS[name] is not None:
        assert found == Command(name, value)


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '{"kind": "time"}', "[" * 100_000, '{"kind": "command"}'])
def test_what_is_no_command_is_none(text: str) -> None:
    assert parse_command(text) is None


def test_texts_hold_no_number_that_json_does_not_know() -> None:
    text = encode_text("state", a=np.nan, b=np.array([1.0, np.inf]), c={"d": np.float64(0.1234567891)}, e=np.int64(3))
    assert json.loads(text) == {"kind": "state", "a": None, "b": [1.0, None], "c": {"d": 0.123457}, "e": 3}
