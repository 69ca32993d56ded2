"""QTM's real-time protocol as bytes: both ways, against the maker's own parser, and with whatever comes instead."""

import math
import tracemalloc

import numpy as np
import pytest
from any_bytes import a_hundred
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from mutations import mutated
from qtm_rt.packet import QRTPacket

from highfive.mocap_bridge.sources.qtm import marker_frame
from highfive.mocap_bridge.wire import qtm as wire
from highfive.mocap_bridge.wire.errors import LinkError
from highfive.mocap_bridge.wire.qtm import Component, Kind

FLOATS = st.floats(width=32, allow_nan=True, allow_infinity=True)
POINTS = hnp.arrays(np.float32, st.tuples(st.integers(0, 8), st.just(3)), elements=FLOATS)
NAMES = st.text(st.characters(min_codepoint=32, exclude_categories=("Cs", "Cc", "Cn", "Zl", "Zp")), max_size=12)
EVERY = (Component.LABELLED_RESIDUALS, Component.UNLABELLED_RESIDUALS)


def body_of(message):
    return wire.split(bytearray(message))[0][1]


def messages(markers=41, loose=3):
    """One message of each kind, as a server sends them."""
    rng = np.random.default_rng(3)
    points = (rng.normal(size=(markers, 3)) * 1000).astype(np.float32)
    points[3] = np.nan
    free = points[:loose]
    return [
        wire.encode_text(Kind.COMMAND, wire.GREETING),
        wire.encode_text(Kind.ERROR, "Parse error"),
        wire.encode_text(Kind.XML, wire.encode_parameters([f"A:M{m}" for m in range(5)], 120.0)),
        wire.encode(Kind.EVENT, b"\x0b"),
        wire.encode_data(8333, 7, points, free),
        wire.encode_data(8333, 7, points, free, (Component.LABELLED, Component.UNLABELLED)),
        wire.encode_data(16666, 8, points[:2], free[:1], tuple(Component)),
    ]


def digest(stream):
    """Everything that a client does with bytes: what comes out, or our own error."""
    try:
        for kind, body in wire.split(bytearray(stream)):
            if kind == Kind.DATA:
                data = wire.decode_data(body)
                labels = ("M",) * (0 if data.labelled is None else len(data.labelled))
                for up in ("+Y", "+Z"):
                    frame = marker_frame(data, wire.Parameters(labels, up=up))
                    assert frame.positions.shape == (len(labels), 3)
                    assert math.isfinite(frame.positions.sum() + frame.unlabelled.sum())
            elif kind == Kind.XML:
                parameters = wire.decode_parameters(body)
                assert parameters.metres(np.ones((1, 3), np.float32)).shape == (1, 3)
            elif kind == Kind.EVENT:
                assert 0 <= wire.decode_event(body) < 256
            else:
                wire.decode_text(body)
    except LinkError as error:
        return error
    return None


@given(st.integers(0, 2**64 - 1), st.integers(0, 2**32 - 1), POINTS, POINTS, st.permutations(list(Component)))
def test_a_frame_comes_back_as_it_was(time_us, number, labelled, loose, components):
    data = wire.decode_data(body_of(wire.encode_data(time_us, number, labelled, loose, components)))
    assert (data.time_us, data.number) == (time_us, number)
    np.testing.assert_array_equal(data.labelled, labelled)
    np.testing.assert_array_equal(data.unlabelled, loose)


@given(st.integers(0, 2**63 - 1), st.integers(0, 2**32 - 1), POINTS, POINTS)
def test_the_maker_reads_the_same_frame(time_us, number, labelled, loose):
    packet = QRTPacket(body_of(wire.encode_data(time_us, number, labelled, loose, tuple(Component))))
    assert (packet.timestamp, packet.framenumber) == (time_us, number)
    for theirs in (packet.get_3d_markers(), packet.get_3d_markers_residual()):
        np.testing.assert_array_equal(np.array([point[:3] for point in theirs[1]]).reshape(-1, 3), labelled)
    for theirs in (packet.get_3d_markers_no_label(), packet.get_3d_markers_no_label_residual()):
        np.testing.assert_array_equal(np.array([point[:3] for point in theirs[1]]).reshape(-1, 3), loose)
        assert [point.id for point in theirs[1]] == list(range(1, len(loose) + 1))


@given(st.lists(NAMES, max_size=6), st.floats(1.0, 2000.0))
def test_parameters_come_back_as_they_were(labels, rate):
    body = wire.encode_parameters(labels, rate).encode() + b"\0"
    assert wire.decode_parameters(body) == wire.Parameters(tuple(labels), float(f"{rate:g}"))


def test_parameters_of_qtm_itself():
    """As QTM writes them: declared, indented, with sections that are not requested."""
    xml = b"""<?xml version="1.0" encoding="UTF-8"?>
<QTM_Parameters_Ver_1.25>
    <General><Frequency>100</Frequency><Camera><ID>1</ID><Frequency>7</Frequency></Camera></General>
    <The_3D><AxisUpwards>+Y</AxisUpwards><CalibrationTime>2024.01.01 10:00:00</CalibrationTime><Labels>2</Labels>
        <Label><Name>A_RWRA</Name><RGBColor>65280</RGBColor><Trajectory_type/></Label>
        <Label><Name>R&amp;D</Name></Label>
        <Bones><Bone From="a" To="b"/></Bones></The_3D>
    <The_6D><Body><Name>box</Name></Body></The_6D>
</QTM_Parameters_Ver_1.25>\0"""
    assert wire.decode_parameters(xml) == wire.Parameters(("A_RWRA", "R&D"), 100.0, 1e-3, "+Y")
    metres = wire.decode_parameters(xml.replace(b"<Labels>", b"<Unit_Length>m</Unit_Length><Labels>"))
    np.testing.assert_allclose(metres.metres(np.array([[1.0, 2.0, 3.0]])), [[1.0, -3.0, 2.0]])


@pytest.mark.parametrize("up", ["+X", "-X", "+Y", "-Y", "+Z", "-Z"])
def test_whatever_axis_is_up_becomes_z_by_a_rotation(up):
    turned = wire.Parameters((), up=up, unit=1.0).metres(np.eye(3))
    assert np.linalg.det(turned) == pytest.approx(1.0)
    assert turned["XYZ".index(up[1])] @ [0, 0, 1] == (1.0 if up[0] == "+" else -1.0)


@given(st.lists(st.sampled_from(messages()), max_size=5), st.lists(st.integers(1, 4000), max_size=5))
def test_messages_are_whole_however_the_bytes_arrive(sent, cuts):
    stream, buffer, found, at = b"".join(sent), bytearray(), [], 0
    for cut in [*cuts, len(stream)]:
        buffer += stream[at : at + cut]
        at += cut
        found += wire.split(buffer)
    assert [wire.encode(kind, body) for kind, body in found] == sent
    assert not buffer


def test_components_that_are_not_known_are_passed_over():
    known = body_of(messages()[4])
    other = (24).to_bytes(4, "little") + (18).to_bytes(4, "little") + bytes(16)
    data = wire.decode_data(known[:12] + (3).to_bytes(4, "little") + other + known[16:])
    np.testing.assert_array_equal(data.labelled, wire.decode_data(known).labelled)


@pytest.mark.parametrize(
    ("stream", "says"),
    [
        (b"HTTP/1.1 400 Bad Request\r\n", "sent b'HTTP/1.1 400"),
        (b"\0\0\0\x23\0\0\0\1QTM RT Interface connected\0", "22223"),
        (b"\7\0\0\0\1\0\0\0", "sent"),
        (wire.encode(Kind.DATA, b"short"), "5 bytes"),
        (wire.encode(Kind.DATA, bytes(12) + b"\xff\xff\xff\xff"), "4294967295 components"),
        (wire.encode(Kind.EVENT, b""), "event"),
        (wire.encode(Kind.XML, b"<a><b></a>\0"), "not XML"),
        (wire.encode(Kind.XML, b"<a>" * 60), "within each other"),
        (wire.encode(Kind.XML, b'<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>'), "entities"),
        (wire.encode(Kind.XML, b"<a><The_3D><AxisUpwards>up</AxisUpwards></The_3D></a>"), "axis"),
    ],
)
def test_what_is_not_of_the_protocol_is_reported(stream, says):
    error = digest(stream)
    assert error is not None
    assert says in str(error)
    assert "\n" not in str(error)


def test_a_length_is_not_believed():
    """Counts of four thousand million take neither memory nor time."""
    message = messages()[4]
    tracemalloc.start()
    for at in range(0, 120, 2):
        for value in (b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\xff\xff\x3f\0"):
            digest(message[:at] + value + message[at + 4 :])
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1e6


@pytest.mark.parametrize("count", [10_000, pytest.param(100_000, marks=pytest.mark.slow)])
def test_damaged_messages_give_values_or_our_own_error(count: int):
    rng, originals, refused = np.random.default_rng(11), messages(markers=8), 0
    for k in range(count):
        refused += digest(mutated(originals[k % len(originals)], rng)) is not None
    assert 0.1 * count < refused < 0.9 * count  # neither everything nor nothing is damage that shows


ANYTHING = st.binary(max_size=300) | st.tuples(st.sampled_from(list(Kind)), st.binary(max_size=200)).map(
    lambda m: wire.encode(*m)
)


@given(ANYTHING)
def test_any_bytes_give_values_or_our_own_error(stream):
    digest(stream)


@pytest.mark.slow
@settings(max_examples=1_000, deadline=None)
@given(st.integers(0, 2**60), st.permutations(list(Kind)))
def test_a_hundred_thousand_times_any_bytes_give_values_or_our_own_error(seed, kinds):
    for number, body in enumerate(a_hundred(seed)):
        digest(body if number % 4 == 0 else wire.encode(kinds[number % len(kinds)], body))
