"""Landmarks as bytes: there and back, and nothing that is wrong gets in."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highfive.mocap_bridge.wire.errors import LinkError
from highfive.mocap_bridge.wire.landmarks import (
    HAND,
    HEAD,
    MOST_HANDS,
    POSE,
    HandLandmarks,
    Landmarks,
    decode_landmarks,
    encode_landmarks,
)


def some(rng: np.random.Generator, hands: int = 2, person: bool = True) -> Landmarks:
    def single(*shape: int) -> np.ndarray:
        return rng.uniform(0.0, 1.0, shape).astype(np.float32).astype(float)

    body = (single(POSE, 2), single(POSE), single(POSE, 3)) if person else (None, None, None)
    found = tuple(HandLandmarks(float(single(1)[0]), single(HAND, 2), single(HAND, 3)) for _ in range(hands))
    return Landmarks(7, 1234.5678, 81.25, (1280, 720), int(person), *body, found)


@pytest.mark.parametrize("hands", range(MOST_HANDS + 1))
@pytest.mark.parametrize("person", [True, False])
def test_there_and_back(hands: int, person: bool) -> None:
    found = some(np.random.default_rng(hands), hands, person)
    back = decode_landmarks(encode_landmarks(found))
    assert (back.number, back.captured_ms, back.took_ms, back.size, back.persons) == (
        7,
        1234.5678,
        81.25,
        (1280, 720),
        person,
    )
    for name in ("picture", "visibility", "world"):
        np.testing.assert_array_equal(getattr(back, name), getattr(found, name))
    assert len(back.hands) == hands
    for one, other in zip(back.hands, found.hands, strict=True):
        assert one.score == other.score
        np.testing.assert_array_equal(one.picture, other.picture)
        np.testing.assert_array_equal(one.world, other.world)


def test_numbers_that_are_none_are_refused_without_a_warning() -> None:
    """Also one that signals, which NumPy warns of where it is converted."""
    good = bytearray(encode_landmarks(some(np.random.default_rng(0))))
    for bits in (b"\x01\x00\x80\x7f", b"\x00\x00\xc0\x7f", b"\x00\x00\x80\xff"):
        good[-4:] = bits
        with pytest.raises(LinkError, match="no numbers"):
            decode_landmarks(bytes(good))


@given(st.data())
def test_no_other_bytes_are_taken_or_do_harm(data: st.DataObject) -> None:
    good = bytearray(encode_landmarks(some(np.random.default_rng(0))))
    for _ in range(data.draw(st.integers(1, 6))):
        good[data.draw(st.integers(0, len(good) - 1))] = data.draw(st.integers(0, 255))
    cut = bytes(good)[: data.draw(st.integers(0, len(good)))]
    for text in (bytes(good), cut):
        try:
            found = decode_landmarks(text)
        except LinkError:
            continue
        assert found.picture is not None
        assert np.isfinite(found.picture).all() and np.abs(found.world).max() <= 10.0
        assert len(found.hands) == 2


@pytest.mark.parametrize(
    ("at", "value", "said"),
    [(0, 1, "kind 1"), (1, 9, "version 9"), (2, 3, "3 persons"), (3, MOST_HANDS + 1, "hands"), (17, 255, "pixels")],
)
def test_what_is_wrong_is_said_in_one_line(at: int, value: int, said: str) -> None:
    data = bytearray(encode_landmarks(some(np.random.default_rng(0))))
    data[at] = value
    with pytest.raises(LinkError, match=said) as error:
        decode_landmarks(bytes(data))
    assert "\n" not in str(error.value)


def test_numbers_that_are_none_are_refused() -> None:
    data = bytearray(encode_landmarks(some(np.random.default_rng(0))))
    data[HEAD.size : HEAD.size + 4] = np.array(np.nan, "<f4").tobytes()
    with pytest.raises(LinkError, match="no numbers"):
        decode_landmarks(bytes(data))
