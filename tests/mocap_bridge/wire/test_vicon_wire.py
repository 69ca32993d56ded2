import math
import struct
import sys
import tracemalloc

import numpy as np
import pytest
from any_bytes import a_hundred
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from highfive.mocap_bridge.wire import vicon as wire
from highfive.mocap_bridge.wire.vicon import (
    Kind,
    Labelled,
    Packet,
    Subject,
    ViconWireError,
    body_length,
    decode,
    encode,
)

U32 = st.integers(0, 2**32 - 1)
TEXT = st.text(max_size=12)
AMOUNTS = st.lists(st.tuples(TEXT, st.floats(allow_nan=False)), max_size=4).map(tuple)
POINTS = hnp.arrays(np.float64, st.tuples(st.integers(0, 6), st.just(3)), elements=st.floats(-1e6, 1e6))
KINDS = st.frozensets(U32, max_size=6)
SUBJECTS = st.lists(
    st.builds(Subject, U32, TEXT, st.lists(st.tuples(U32, TEXT), max_size=5).map(tuple)), max_size=3
).map(tuple)


@st.composite
def labelled(draw):
    points = draw(POINTS)
    return Labelled(draw(hnp.arrays(np.uint32, (len(points), 2))), points)


PACKETS = st.builds(
    Packet,
    enums=st.none() | KINDS,
    stream=st.none() | st.booleans(),
    more=U32,
    ping=st.none() | st.integers(0, 2**64 - 1),
    unchanged=KINDS,
    period=st.none() | st.integers(-(2**63), 2**63 - 1),
    y_up=st.none() | st.booleans(),
    subjects=SUBJECTS,
    number=U32,
    labelled=st.none() | labelled(),
    unlabelled=st.none() | POINTS,
    latencies=AMOUNTS,
    rates=AMOUNTS,
)


def a_frame(markers=5, loose=2, static=True):
    """A message such as a server sends, its header taken off."""
    rng = np.random.default_rng(7)
    ids = np.stack([np.ones(markers), np.arange(1, markers + 1)], axis=1).astype(np.uint32)
    packet = Packet(
        unchanged=frozenset() if static else wire.STATIC,
        period=1_125_000 if static else None,
        y_up=False if static else None,
        subjects=(Subject(1, "Anna", tuple((m, f"M{m}") for m in range(1, markers + 1))),) if static else (),
        number=1234,
        labelled=Labelled(ids, rng.normal(size=(markers, 3))),
        unlabelled=rng.normal(size=(loose, 3)),
        latencies=(("Data Collected", 0.001), ("Labelled", 0.0015)),
        rates=(("System", 120.0),),
        posed=(1,),
    )
    return encode(packet)[wire.HEADER.size :]


@given(PACKETS)
def test_what_is_encoded_is_decoded(packet):
    message = encode(packet)
    assert body_length(message) == len(message) - wire.HEADER.size
    read = decode(message[wire.HEADER.size :])
    for name in (
        "enums", "stream", "more", "ping", "unchanged", "period", "y_up", "subjects", "number", "latencies", "rates",
    ):  # fmt: skip
        assert getattr(read, name) == getattr(packet, name), name
    if packet.labelled is None:
        assert read.labelled is None
    else:
        assert read.labelled is not None
        np.testing.assert_array_equal(read.labelled.ids, packet.labelled.ids)
        np.testing.assert_allclose(read.labelled.points, packet.labelled.points, rtol=1e-15, atol=1e-300)
    if packet.unlabelled is None:
        assert read.unlabelled is None
    else:
        np.testing.assert_allclose(read.unlabelled, packet.unlabelled, rtol=1e-15, atol=1e-300)


def words(*values):
    return b"".join(struct.pack("<I", value) for value in values)


def text(value):
    return words(len(value)) + value


def block(kind, body):
    return words(kind, len(body)) + body


def doubles(*values):
    return struct.pack(f"<{len(values)}d", *values)


# Written out from the facts, with nothing of ours: two markers, a point without a label, a block of an unknown kind.
GOLDEN = (
    block(100004, words(2) + words(5, 1) + words(6, 1) + words(2) + words(1, 2))
    + block(1, struct.pack("<q", 1_350_000))
    + block(65001, b"\x01\x02\x03")
    + block(
        2,
        words(3)
        + text(b"Anna")
        + words(1)
        + (words(0, 1) + struct.pack("<6f", *range(6)) + text(b"Pelvis"))
        + words(2)
        + (words(11) + text(b"RFIN"))
        + (words(12) + text("Ré".encode()))
        + words(1)
        + words(11, 1),
    )
    + block(5, words(77))
    + block(
        6,
        words(2)
        + (words(3, 12) + doubles(7.0) + doubles(1000.0, -2000.0, 500.0) + doubles(*range(9)) + words(41))
        + (words(3, 11) + doubles(7.0) + doubles(1.0, 2.0, 3.0) + doubles(*range(9)) + words(42)),
    )
    + block(7, words(1) + doubles(7.0) + doubles(250.0, 0.0, math.inf) + doubles(*range(9)) + words(43))
    + block(9, words(3) + words(1) + words(1) + doubles(*range(12)))
    + block(26, words(2) + text(b"Camera") + doubles(0.002) + text(b"") + doubles(0.003))
    + block(39, words(1) + text(b"System") + doubles(100.0))
    + block(37, b"\x01")
)


def test_bytes_written_by_hand_are_read():
    packet = decode(GOLDEN)
    assert packet.unchanged == {1, 2}
    assert wire.rate_of(packet) == 100.0
    assert packet.subjects == (Subject(3, "Anna", ((11, "RFIN"), (12, "Ré"))),)
    assert packet.number == 77
    assert packet.labelled is not None
    assert packet.labelled.ids.tolist() == [[3, 12], [3, 11]]
    np.testing.assert_allclose(packet.labelled.points, [[1.0, -2.0, 0.5], [0.001, 0.002, 0.003]], rtol=1e-15)
    np.testing.assert_array_equal(packet.unlabelled, [[0.25, 0.0, math.inf]])
    assert packet.latencies == (("Camera", 0.002), ("", 0.003))
    assert packet.rates == (("System", 100.0),)
    assert packet.y_up is True


def test_a_frame_is_written_as_by_hand():
    packet = Packet(
        unchanged=frozenset({1, 2}),
        number=5,
        labelled=Labelled(np.array([[1, 2]], dtype=np.uint32), np.array([[0.25, -0.5, 2.0]])),
        posed=(1,),
    )
    pose = words(1, 1, 1) + doubles(0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1)
    body = (
        block(100004, words(4) + words(5, 1) + words(6, 1) + words(8, 1) + words(9, 1) + words(2) + words(1, 2))
        + block(5, words(5))
        + block(6, words(1, 1, 2) + doubles(7.0, 250.0, -500.0, 2000.0) + doubles(*[0.0] * 9) + words(1))
        + block(8, pose)
        + block(9, pose)
    )
    assert encode(packet) == block(0x1A2B0001, body)


def test_the_talk_about_frames_is_written_as_by_hand():
    assert encode(Packet(enums=frozenset({6, 5}))) == block(0x1A2B0001, block(100001, words(2, 5, 6)))
    assert encode(Packet(stream=True)) == block(0x1A2B0001, block(100002, b"\x01"))
    assert encode(Packet(stream=False)) == block(0x1A2B0001, block(100002, b"\x00"))
    assert encode(Packet(more=1)) == block(0x1A2B0001, block(100008, words(1)))
    assert encode(Packet(ping=9)) == block(0x1A2B0001, block(42, words(9, 0)))
    assert decode(block(100008, b"")).more == 1


def test_a_subject_has_a_root_that_its_markers_hang_on():
    message = encode(Packet(subjects=(Subject(1, "A", ((4, "X"),)),)), requested={2})
    root = words(0, 1) + struct.pack("<6f", *[0.0] * 6) + text(b"root")  # of no parent, number 1
    body = words(1) + text(b"A") + words(1) + root + words(1) + words(4) + text(b"X") + words(1) + words(4, 1)
    assert message == block(0x1A2B0001, block(2, body))


def test_only_what_is_wanted_is_sent():
    packet = decode(a_frame())
    message = encode(packet, requested={Kind.FRAME_INFO, Kind.LABELED_RECONS})
    read = decode(message[8:])
    assert (read.number, read.subjects, read.unlabelled, read.latencies) == (1234, (), None, ())
    assert read.labelled is not None
    assert len(read.labelled.ids) == 5


def test_a_rate_that_makes_no_sense_is_none():
    assert wire.rate_of(Packet()) == 0.0
    assert wire.rate_of(Packet(period=-5)) == 0.0
    assert wire.rate_of(Packet(period=1)) == 0.0
    assert wire.rate_of(Packet(rates=(("a", math.nan), ("b", 50.0)))) == 50.0
    assert wire.rate_of(Packet(period=1_125_000, rates=(("b", 50.0),))) == 120.0


def test_another_protocol_is_told_by_what_came():
    with pytest.raises(ViconWireError, match=r"another protocol.*SSH-2\.0-OpenSSH.*port"):
        body_length(b"SSH-2.0-OpenSSH_9.6 Debian")


def test_a_length_is_not_believed():
    with pytest.raises(ViconWireError, match="4294967295 bytes"):
        body_length(words(0x1A2B0001, 0xFFFFFFFF))
    for body, what in (
        (words(6), "left over"),
        (words(6, 5, 0), "says it has 5 bytes, 4 are there"),
        (block(6, words(0xFFFFFFFF)), "4294967295 items"),
        (block(6, words(1) + bytes(115)), "1 items"),
        (block(7, words(37_000_000)), "items"),
        (block(5, b"\x01\x02"), "too early"),
        (block(26, words(1) + text(b"x") + bytes(3)), "items"),
        (block(2, words(1) + words(200) + b"Anna"), "200 items"),
        (block(2, words(1) + words(0) + words(0) + words(10_001) + bytes(80_008)), "10001 names"),
        (bytes(8 * 10_001), "more than 10000 blocks"),
    ):
        with pytest.raises(ViconWireError, match=what):
            decode(body)


def test_nothing_is_allocated_for_a_count_that_cannot_be():
    tracemalloc.start()
    try:
        for kind in (1, 2, 5, 6, 7, 26, 39, 100001, 100004):
            for body in (words(0xFFFFFFFF), words(1, 0xFFFFFFFF), words(0, 0, 0xFFFFFFFF), words(1, 0, 0, 0xFFFFFFFF)):
                try:
                    decode(block(kind, body))
                except ViconWireError as error:
                    assert "\n" not in str(error)
        assert tracemalloc.get_traced_memory()[1] < 100_000
    finally:
        tracemalloc.stop()


def digest(message):
    try:
        packet = decode(message)
    except ViconWireError:
        return
    assert isinstance(packet, Packet)


@settings(max_examples=1_000)
@given(st.binary(max_size=200), st.sampled_from(sorted(Kind)))
def test_any_bytes_give_values_or_our_own_error(body, kind):
    digest(body)
    digest(block(kind, body))


@pytest.mark.slow
@settings(max_examples=1_000, deadline=None)
@given(st.integers(0, 2**60), st.permutations(sorted(Kind)))
def test_a_hundred_thousand_times_any_bytes_give_values_or_our_own_error(seed, kinds):
    for number, body in enumerate(a_hundred(seed)):
        digest(body)
        digest(block(kinds[number % len(kinds)], body))


def mutated(message, rng):
    """A message with some bytes changed, cut out, put in, or with one of its words made extreme."""
    spoilt = bytearray(message)
    for _ in range(rng.integers(1, 5)):
        at = int(rng.integers(len(spoilt))) if spoilt else 0
        match rng.integers(5):
            case 0 if spoilt:
                spoilt[at] = rng.integers(256)
            case 1 if spoilt:
                spoilt[at] ^= 1 << int(rng.integers(8))
            case 2:
                del spoilt[at : at + int(rng.integers(1, 40))]
            case 3:
                spoilt[at:at] = rng.bytes(int(rng.integers(1, 40)))
            case _:
                value = (0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)[rng.integers(5)]
                spoilt[at : at + 4] = words(value)
    return bytes(spoilt)


def decode_mutated(count, seed):
    rng = np.random.default_rng(seed)
    sources = [
        GOLDEN,
        a_frame(),
        a_frame(static=False),
        encode(Packet(enums=frozenset(Kind)))[8:],
        encode(Packet(stream=True, more=2, ping=3))[8:],
    ]
    read = refused = 0
    for k in range(count):
        try:
            packet = decode(mutated(sources[k % len(sources)], rng))
        except ViconWireError:
            refused += 1
            continue
        read += 1
        if packet.labelled is not None:
            assert packet.labelled.points.shape == (len(packet.labelled.ids), 3)
        if packet.unlabelled is not None:
            assert packet.unlabelled.shape[1:] == (3,)
        wire.rate_of(packet)
    assert min(read, refused) > 0.1 * count  # both ways were gone


def test_mutated_messages_give_values_or_our_own_error():
    decode_mutated(10_000, seed=1)


@pytest.mark.slow
def test_very_many_mutated_messages_give_values_or_our_own_error_in_bounded_memory():
    tracemalloc.start()
    try:
        decode_mutated(2_000, seed=2)
        tracemalloc.reset_peak()
        before = tracemalloc.get_traced_memory()[0]
        decode_mutated(18_000, seed=3)
        assert tracemalloc.get_traced_memory()[1] - before < 1_000_000
    finally:
        tracemalloc.stop()
    decode_mutated(100_000, seed=4)


@pytest.mark.slow
def test_the_longest_message_takes_bounded_work():
    names = words(wire.MOST_BLOCKS) + bytes(8 * wire.MOST_BLOCKS)
    subject = block(2, words(1) + words(0) + words(0) + names)
    body = subject * (wire.LONGEST // len(subject))
    calls = 0

    def count(frame: object, event: str, argument: object) -> None:
        nonlocal calls
        calls += event in ("call", "c_call")

    sys.setprofile(count)
    try:
        found = decode(body)
    finally:
        sys.setprofile(None)
    assert len(found.subjects) == wire.LONGEST // len(subject)
    assert calls < 2 * len(body)  # of functions: work goes with the length
