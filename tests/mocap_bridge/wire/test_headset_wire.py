"""What a headset's page sends: what goes in comes out, and what nobody can be is refused."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highfive.mocap_bridge.wire.errors import LinkError
from highfive.mocap_bridge.wire.headset import HEAD, JOINTS, LENGTH, HeadsetPose, decode_headset, encode_headset


def pose(seed: int = 0, **changes: object) -> HeadsetPose:
    rng = np.random.default_rng(seed)
    turn = rng.normal(size=4)
    hands = np.array([[0.5, 0.3, 1.2], [0.5, -0.3, 1.3]])[:, None] + rng.uniform(-0.1, 0.1, (2, JOINTS, 3))
    fields = {
        "number": 7, "place": 3, "holds_ms": 123456.789,
        "viewer": np.concatenate([[0.9, 0.0, 1.65], turn / np.linalg.norm(turn)]), "viewer_seen": True,
        "hands": hands, "hands_seen": np.ones((2, JOINTS), dtype=bool),
        "limbs": rng.uniform(0.0, 1.5, (4, 3)), "limbs_seen": np.array([True, False, True, True]),
    }  # fmt: skip
    return HeadsetPose(**{**fields, **changes})


@given(st.integers(0, 2**32 - 1), st.booleans(), st.tuples(st.booleans(), st.booleans()), st.integers(0, 255))
def test_what_is_encoded_is_decoded_and_what_is_not_seen_is_zero(
    seed: int, head: bool, hands: tuple[bool, bool], place: int
) -> None:
    seen = np.repeat(np.array(hands)[:, None], JOINTS, axis=1)
    sent = pose(seed, viewer_seen=head, hands_seen=seen, number=seed, place=place)
    data = encode_headset(sent)
    found = decode_headset(data)
    assert len(data) == LENGTH
    assert (found.number, found.place, found.holds_ms) == (seed, place, sent.holds_ms)
    assert found.viewer_seen == head and np.array_equal(found.hands_seen, seen)
    np.testing.assert_allclose(found.hands[seen], sent.hands[seen], atol=1e-6)
    assert not found.hands[~seen].any()
    np.testing.assert_allclose(found.viewer, sent.viewer if head else [0, 0, 0, 1, 0, 0, 0], atol=1e-6)
    assert np.array_equal(found.limbs_seen, sent.limbs_seen) and not found.limbs[1].any()


def put(at: int, value: float) -> bytes:
    data = bytearray(encode_headset(pose()))
    struct.pack_into("<f", data, HEAD.size + 4 * at, value)
    return bytes(data)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "of 0 bytes, expected 700"),
        (encode_headset(pose()) + b"\0", "of 701 bytes"),
        (b"\x01" + encode_headset(pose())[1:], "of kind 1 and version 1"),
        (b"\x02\x09" + encode_headset(pose())[2:], "version 9, expected 2 and 1"),
        (encode_headset(pose(holds_ms=float("nan"))), "expected a time"),
        (put(0, float("nan")), "is no number"),
        (put(1, 21.0), "further than 20 m"),
        (put(6, 3.0), "quaternion has the length"),
        (put(7 + 3 * 8, 1.2), "further than 0.35 m from its wrist"),
        (encode_headset(pose(viewer=np.array([3.0, 0.0, 1.6, 1.0, 0, 0, 0]))), "further than 1.5 m from the eyes"),
        (encode_headset(pose(hands_seen=np.arange(JOINTS) > np.zeros((2, 1)))), "without its wrist"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(data: bytes, says: str) -> None:
    with pytest.raises(LinkError, match=says):
        decode_headset(data)


def test_ten_thousand_changed_messages_are_read_or_refused() -> None:
    rng, data, read = np.random.default_rng(5), encode_headset(pose()), 0
    for _ in range(10_000):
        changed = bytearray(data)
        for at in rng.integers(0, len(data), rng.integers(1, 6)):
            changed[at] = rng.integers(256)
        try:
            found = decode_headset(bytes(changed))
        except LinkError:
            continue
        read += 1
        assert np.isfinite(found.hands).all() and np.isfinite(found.viewer).all() and np.isfinite(found.limbs).all()
    assert 0 < read < 10_000
