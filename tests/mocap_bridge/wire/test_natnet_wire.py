"""NatNet as bytes: both ways, against an independent parser, and with whatever comes instead."""

import math
import struct
import sys
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from any_bytes import a_hundred
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from mutations import mutated
from natnet.data_descriptions import DataDescriptions
from natnet.data_frame import DataFrame
from natnet.packet_buffer import PacketBuffer
from natnet.server_info import ServerInfo as PeerInfo
from natnet.version import Version

from highfive.mocap_bridge.sources.natnet_columns import Columns, marker_frame
from highfive.mocap_bridge.wire.errors import LinkError
from highfive.mocap_bridge.wire.natnet import (
    SIZED,
    Kind,
    ServerInfo,
    decode,
    decode_server_info,
    encode,
    encode_server_info,
)
from highfive.mocap_bridge.wire.natnet_frame import (
    FILLED,
    HAS_MODEL,
    MEASURED,
    OCCLUDED,
    Frame,
    decode_frame,
    encode_frame,
    labelled_markers,
)
from highfive.mocap_bridge.wire.natnet_model import MarkerSet, Model, decode_model, encode_model

VERSIONS = [(3, 0), (3, 1), (4, 0), (4, 1)]
FLOATS = st.floats(width=32, allow_nan=False)
POINTS = hnp.arrays(np.float32, st.tuples(st.integers(0, 5), st.just(3)), elements=FLOATS)
NAMES = st.text(st.characters(min_codepoint=1, exclude_categories=("Cs",)), max_size=10)
SETS = st.lists(st.builds(MarkerSet, NAMES, st.lists(NAMES, max_size=4).map(tuple)), max_size=4)


@st.composite
def frames(draw):
    points = draw(POINTS)
    ids, flags = (draw(hnp.arrays(kind, len(points))) for kind in (np.uint32, np.uint16))
    return Frame(
        draw(st.integers(0, 2**31)),
        tuple(draw(st.lists(st.tuples(NAMES, POINTS), max_size=3))),
        draw(POINTS),
        labelled_markers(ids, points, flags),
        draw(st.floats(0.0, 1e9)),
        draw(st.booleans()),
    )


def u32(*numbers):
    return struct.pack(f"<{len(numbers)}I", *numbers)


def a_frame(markers=8, changed=False):
    rng = np.random.default_rng(5)
    points = rng.normal(size=(markers, 3)).astype(np.float32)
    labelled = labelled_markers(np.arange(markers) + 65537, points, np.full(markers, 10))
    return Frame(77, (("Anna", points), ("all", points)), points[:2] + 1, labelled, 12.5, changed)


def full_frame(version):
    """A frame with something in every section, rigid bodies, skeletons, assets, plates and devices among them."""
    frame, sized = a_frame(3), version >= SIZED
    body = rigid = bytes(38)
    sections = [
        (2, b"".join(name.encode() + b"\0" + u32(len(points)) + points.tobytes() for name, points in frame.sets)),
        (len(frame.others), frame.others.tobytes()),
        (2, rigid * 2),
        (2, (u32(1, 2) + rigid * 2) + (u32(2, 0))),
    ]
    sections += [(1, u32(4, 1) + rigid + u32(1) + bytes(26))] if sized else []
    sections += [
        (len(frame.labelled), frame.labelled.tobytes()),
        (1, u32(1, 2) + (u32(2) + bytes(8)) + (u32(0))),
        (1, u32(9, 1) + u32(1) + bytes(4)),
    ]
    body = u32(frame.number)
    for count, content in sections:
        body += u32(count) + (u32(len(content)) if sized else b"") + content
    body += struct.pack("<IIdQQQ", 0, 0, frame.time, 1, 2, 3) + (bytes(8) if sized else b"") + struct.pack("<HI", 0, 0)
    return frame, body


def full_model(version):
    """Descriptions of every kind."""
    pose = bytes(12) + (bytes(16) if version >= (4, 2) else b"")
    marks = b"one\0two\0" if version >= (4, 0) else b""
    rigid = b"box\0" + u32(2, 0) + pose + u32(2) + bytes(32) + marks
    described = [
        (0, b"Anna\0" + u32(2) + b"RWRA\0RFIN\0"),
        (1, rigid),
        (2, b"Anna\0" + u32(4, 2) + rigid * 2),
        (3, u32(1) + b"serial\0" + bytes(20 + 4 * 144 + 48 + 8) + u32(2) + b"Fx\0Fy\0"),
        (4, u32(1) + b"daq\0serial\0" + bytes(8) + u32(1) + b"volts\0"),
        (5, b"camera\0" + bytes(28)),
        (6, b"thing\0" + u32(1, 9, 1) + rigid + u32(1) + b"m\0" + bytes(22)),
        (0, b"all\0" + u32(2) + b"Anna_RWRA\0Anna_RFIN\0"),
    ]
    described = described if version >= SIZED else [one for one in described if one[0] != 6]
    sizes = [u32(kind) + (u32(len(body)) if version >= SIZED else b"") + body for kind, body in described]
    return u32(len(described)) + b"".join(sizes)


def originals(version):
    """Datagrams of each kind, as a server sends them."""
    sets = [MarkerSet("Anna", tuple(f"M{m}" for m in range(8))), MarkerSet("all", ("a", "b"))]
    return [
        encode_server_info(ServerInfo("Motive", version, "239.255.42.99", 1511)),
        encode_model(sets, version),
        encode(Kind.MODEL, full_model(version)),
        encode_frame(a_frame(), version),
        encode(Kind.FRAME, full_frame(version)[1]),
        encode(Kind.RESPONSE, struct.pack("<f", 120.0)),
    ]


def digest(datagram, version, columns):
    """Everything that a client does with a datagram: what comes out, or our own error."""
    try:
        kind, body = decode(datagram)
        if kind == Kind.SERVER_INFO:
            decode_server_info(body)
        elif kind == Kind.MODEL:
            Columns(decode_model(body, version))
        elif kind == Kind.FRAME:
            frame = decode_frame(body, version)
            if columns.fit(frame):
                made = marker_frame(frame, columns, y_up=True)
                assert made.positions.shape == (len(columns.names), 3)
                assert math.isfinite(made.positions.sum() + made.unlabelled.sum())
    except LinkError as error:
        assert "\n" not in str(error)
        return error
    return None


def damaged(original, rng):
    """A damaged datagram, often with its length put right."""
    data = mutated(original, rng)
    if len(data) >= 4 and rng.random() < 0.7:
        data[2:4] = (len(data) - 4).to_bytes(2, "little")
    return bytes(data)


@pytest.mark.parametrize("version", VERSIONS)
@given(frame=frames())
@settings(max_examples=40)
def test_a_frame_comes_back_as_it_was(version, frame):
    kind, body = decode(encode_frame(frame, version))
    back = decode_frame(body, version)
    assert kind == Kind.FRAME
    assert (back.number, back.time, back.models_changed) == (frame.number, frame.time, frame.models_changed)
    assert [name for name, _ in back.sets] == [name for name, _ in frame.sets]
    for (_, ours), (_, theirs) in zip(frame.sets, back.sets, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    np.testing.assert_array_equal(back.others, frame.others)
    np.testing.assert_array_equal(back.labelled, frame.labelled)


@pytest.mark.parametrize("version", VERSIONS)
@given(frame=frames())
@settings(max_examples=40)
def test_an_independent_parser_reads_the_same_frame(version, frame):
    theirs = DataFrame.read_from_buffer(PacketBuffer(decode(encode_frame(frame, version))[1]), Version(*version))
    assert theirs.prefix.frame_number == frame.number
    assert theirs.suffix.timestamp == frame.time
    if version < SIZED:  # of 4.1 it looks for the flags where the precision time stamp is
        assert theirs.suffix.tracked_models_changed == frame.models_changed
    assert [one.model_name for one in theirs.marker_sets] == [name for name, _ in frame.sets]
    for one, (_, points) in zip(theirs.marker_sets, frame.sets, strict=True):
        np.testing.assert_array_equal(np.array(one.marker_pos_list).reshape(-1, 3), points)
    np.testing.assert_array_equal(np.array(theirs.unlabeled_marker_pos).reshape(-1, 3), frame.others)
    for one, marker in zip(theirs.labeled_markers, frame.labelled, strict=True):
        assert (one.id_num, one.param, one.pos) == (marker["id"], marker["flags"], tuple(marker["point"]))
        assert one.occluded == bool(marker["flags"] & OCCLUDED)


@pytest.mark.parametrize("version", VERSIONS)
@given(sets=SETS)
@settings(max_examples=40)
def test_descriptions_are_read_by_both_as_they_were_written(version, sets):
    body = decode(encode_model(sets, version))[1]
    assert decode_model(body, version) == Model(tuple(sets))
    theirs = DataDescriptions.read_from_buffer(PacketBuffer(body), Version(*version))
    assert [(one.name, one.marker_names) for one in theirs.marker_sets] == [(one.name, one.markers) for one in sets]


@given(NAMES, st.sampled_from(VERSIONS), st.sampled_from(["", "239.255.42.99"]), st.integers(0, 65535))
def test_who_serves_is_read_by_both_as_it_was_written(name, version, group, data_port):
    body = decode(encode_server_info(ServerInfo(name, version, group, data_port)))[1]
    assert decode_server_info(body) == ServerInfo(name, version, group, data_port)
    theirs = PeerInfo.read_from_buffer(PacketBuffer(body), Version(3))
    assert (theirs.application_name, theirs.nat_net_protocol_version.truncate(2)) == (name, Version(*version))


@pytest.mark.parametrize("version", [*VERSIONS, (4, 2), (4, 7)])
def test_what_is_not_of_use_is_passed_over(version):
    frame, body = full_frame(version)
    for back in (
        decode_frame(body, version),
        decode_frame(body[:-4], version),
    ):  # with the end mark and without
        np.testing.assert_array_equal(back.labelled, frame.labelled)
        np.testing.assert_array_equal(back.sets[0][1], frame.sets[0][1])
        assert back.time == frame.time
    model = decode_model(full_model(version), version)
    assert [one.name for one in model.sets] == ["Anna", "all"]
    assert model.ids == {"box": 2, "Anna": 4} | ({"thing": 9} if version >= SIZED else {})
    assert Columns(model).names == ("Anna:RWRA", "Anna:RFIN")


def test_additions_of_a_later_version_are_passed_over():
    """Sections and markers that are longer than they are today."""
    frame, version = a_frame(3), (4, 9)
    rows = b"".join(row.tobytes() + b"new!" for row in frame.labelled)
    sections = [(0, b"more"), (0, b""), (1, bytes(50)), (1, bytes(70)), (0, b""), (3, rows), (0, b""), (0, b"")]
    body = u32(1) + b"".join(u32(count, len(content)) + content for count, content in sections)
    body += struct.pack("<IIdQQQ", 0, 0, 1.0, 1, 2, 3) + bytes(8) + struct.pack("<HI", 2, 0)
    back = decode_frame(body, version)
    np.testing.assert_array_equal(back.labelled, frame.labelled)
    assert back.models_changed
    unknown = u32(2) + u32(42, 5) + b"what?" + u32(0, 10) + b"A\0" + u32(1) + b"B\0!!"
    assert decode_model(unknown, version).sets == (MarkerSet("A", ("B",)),)


def test_sizes_that_a_server_leaves_out_are_done_without():
    version = (4, 1)
    frame, body = full_frame((4, 0))
    at, parts, asset_section = 4, [body[:4]], u32(0, 0)
    lengths = [len(part) for part in _sections_of_4_0(frame)]
    for k, length in enumerate(lengths):
        parts += [asset_section] if k == 4 else []
        parts += [body[at : at + 4], u32(0), body[at + 4 : at + length]]
        at += length
    back = decode_frame(b"".join(parts) + body[at:], version)
    np.testing.assert_array_equal(back.labelled, frame.labelled)


def _sections_of_4_0(frame):
    sets = b"".join(name.encode() + b"\0" + u32(len(points)) + points.tobytes() for name, points in frame.sets)
    sizes = [len(sets), 24, 76, 8 + 76 + 8, 26 * 3, 8 + 12 + 4, 8 + 8]
    return [bytes(4 + size) for size in sizes]


@pytest.mark.parametrize(
    ("datagram", "says"),
    [
        (b"HTTP/1.1 400 Bad Request", "sent b'HTTP/1.1"),
        (b"no", "sent b'no'"),
        (encode(Kind.SERVER_INFO, b"Motive\0"), "7 bytes"),
        (encode_server_info(ServerInfo("Motive", (2, 10))), "NatNet 2.10"),
        (encode_server_info(ServerInfo("Motive", (5, 0))), "NatNet 5.0"),
        (encode(Kind.FRAME, u32(1, 0xFFFFFFFF, 4)), "4294967295 x marker set"),
        (encode(Kind.FRAME, full_frame((4, 1))[1][:-20]), "time"),
        (encode(Kind.MODEL, u32(0xFFFFFFFF)), "4294967295"),
        (encode(Kind.MODEL, u32(1, 0, 6) + b"abcdef"), "without an end"),
    ],
)
def test_what_is_not_of_the_protocol_is_reported(datagram, says):
    error = digest(datagram, (4, 1), Columns(Model(())))
    assert error is not None
    assert says in str(error)


def test_what_does_not_fit_into_a_datagram_is_refused():
    with pytest.raises(LinkError, match="datagram"):
        encode_frame(a_frame(2000), (4, 1))


@pytest.mark.parametrize("version", [(3, 0), (4, 1)])
def test_a_length_is_not_believed(version):
    """Counts of four thousand million take neither memory nor time."""
    columns = Columns(Model((MarkerSet("Anna", ("a",) * 8),)))
    tracemalloc.start()
    for datagram in originals(version):
        for at in range(4, len(datagram), 7):
            for value in (b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\0\xff\0\0"):
                digest(datagram[:at] + value + datagram[at + 4 :], version, columns)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1e6


@pytest.mark.parametrize("count", [10_000, pytest.param(100_000, marks=pytest.mark.slow)])
def test_damaged_datagrams_give_values_or_our_own_error(count: int):
    rng, refused = np.random.default_rng(12), 0
    for version in VERSIONS:
        kinds, columns = originals(version), Columns(Model((MarkerSet("Anna", ("a",) * 8),)))
        for k in range(count // len(VERSIONS)):
            refused += digest(damaged(kinds[k % len(kinds)], rng), version, columns) is not None
    assert 0.1 * count < refused < 0.9 * count  # neither everything nor nothing is damage that shows


ANYTHING = st.tuples(
    st.binary(max_size=300) | st.tuples(st.sampled_from(list(Kind)), st.binary(max_size=200)).map(lambda m: encode(*m)),
    st.sampled_from([*VERSIONS, (4, 2)]),
)


@given(ANYTHING)
def test_any_bytes_give_values_or_our_own_error(given_):
    digest(*given_, Columns(Model((MarkerSet("Anna", ("a", "b")),))))


@pytest.mark.slow
@settings(max_examples=1_000, deadline=None)
@given(st.integers(0, 2**60), st.permutations(list(Kind)), st.sampled_from([*VERSIONS, (4, 2)]))
def test_a_hundred_thousand_times_any_bytes_give_values_or_our_own_error(seed, kinds, version):
    for number, body in enumerate(a_hundred(seed)):
        stream = body if number % 4 == 0 else encode(kinds[number % len(kinds)], body)
        digest(stream, version, Columns(Model((MarkerSet("Anna", ("a", "b")),))))


class TestColumns:
    """Which marker is which: ids from descriptions, from equal points, or from the order of the descriptions."""

    POINTS = np.arange(1.0, 13.0, dtype=np.float32).reshape(4, 3)

    def frame(self, ids, flags, sets=(), points=POINTS, others=POINTS[:0]):
        return Frame(1, tuple(sets), others, labelled_markers(np.array(ids), points, np.array(flags)), 0.0)

    def test_numbers_of_the_descriptions(self):
        model = Model((MarkerSet("box", ("a", "b")), MarkerSet("Anna", ("c", "d"))), {"box": 2, "Anna": 5})
        columns = Columns(model)
        frame = self.frame([5 << 16 | 2, 2 << 16 | 2, 5 << 16 | 1, 2 << 16 | 1], [10, 10, 9, 10])
        points, valid, loose = columns.place(frame)
        np.testing.assert_array_equal(points, self.POINTS[[3, 1, 2, 0]])
        assert valid.tolist() == [True, True, False, True]
        assert len(loose) == 0

    def test_numbers_that_show_by_equal_points_and_stay_known(self):
        columns = Columns(Model((MarkerSet("A", ("a", "b")), MarkerSet("B", ("c", "d")))))
        ids = [7 << 16 | 1, 7 << 16 | 2, 3 << 16 | 1, 3 << 16 | 2]
        sets = (("A", self.POINTS[2:]), ("B", self.POINTS[:2]))
        assert columns.place(self.frame(ids, [10] * 4, sets))[1].all()
        points, valid, _ = columns.place(self.frame(ids[::-1], [10, 9, 10, 10]))  # now without the sets, another order
        np.testing.assert_array_equal(points, self.POINTS[[1, 0, 3, 2]])
        assert valid.tolist() == [False, True, True, True]

    def test_the_order_of_the_descriptions_where_nothing_else_tells(self):
        columns = Columns(Model((MarkerSet("A", ("a", "b")), MarkerSet("B", ("c", "d")))))
        points, valid, _ = columns.place(self.frame([65538, 65537, 131073, 131074], [10, 10, 10, 9]))
        np.testing.assert_array_equal(points, self.POINTS[[1, 0, 2, 3]])
        assert valid.tolist() == [True, True, True, False]

    def test_a_marker_filled_in_from_the_shape_was_not_seen(self):
        columns = Columns(Model((MarkerSet("A", ("a", "b", "c", "d")),), {"A": 1}))
        flags = [FILLED | HAS_MODEL, FILLED | MEASURED, OCCLUDED | FILLED, 0]
        assert columns.place(self.frame(np.arange(65537, 65541), flags, [("A", self.POINTS)]))[1].tolist() == [
            False,
            True,
            False,
            True,
        ]

    def test_a_marker_that_is_not_in_the_list_was_not_seen(self):
        columns = Columns(Model((MarkerSet("A", ("a", "b", "c", "d")),), {"A": 1}))
        frame = self.frame([65537, 65539], [10, 10], [("A", self.POINTS)], self.POINTS[[0, 2]])
        assert columns.place(frame)[1].tolist() == [True, False, True, False]

    def test_sets_alone(self):
        columns = Columns(Model((MarkerSet("A", ("a", "b")), MarkerSet("all", ("a", "b")))))
        points = np.array([[1, 2, 3], [0, 0, 0]], np.float32)
        frame = self.frame([], [], [("A", points), ("all", points)], self.POINTS[:0], self.POINTS[:1])
        placed, valid, loose = columns.place(frame)
        np.testing.assert_array_equal(placed, points)
        assert valid.tolist() == [True, False]
        np.testing.assert_array_equal(loose, self.POINTS[:1])

    def test_others_without_label_are_not_given_twice(self):
        """As in a recorded packet of Motive: five labelled markers are among the others, one without label is not."""
        columns = Columns(Model((MarkerSet("A", ("a", "b")),), {"A": 2}))
        frame = self.frame([2 << 16 | 1, 2 << 16 | 2, 50007], [10, 10, 18], (), self.POINTS[:3], self.POINTS[[0, 1, 3]])
        np.testing.assert_array_equal(columns.place(frame)[2], self.POINTS[2:])

    def test_names_hold_the_set_once(self):
        model = Model((MarkerSet("A", ("RWRA", "A_RFIN", "A:RMC5", "B_X")), MarkerSet("", ("Y",))))
        assert Columns(model).names == ("A:RWRA", "A:RFIN", "A:RMC5", "A:B_X", "Y")

    def test_another_number_of_markers_does_not_fit(self):
        columns = Columns(Model((MarkerSet("A", ("a", "b")),)))
        assert columns.fit(self.frame([], [], [("A", self.POINTS[:2])], self.POINTS[:0]))
        assert not columns.fit(self.frame([], [], [("A", self.POINTS[:3])], self.POINTS[:0]))
        assert not columns.fit(self.frame([], [], [("B", self.POINTS[:2])], self.POINTS[:0]))

    def test_the_work_grows_with_sets_and_assets_not_with_their_square(self):
        """As many as a datagram holds, counted in calls: no clock says whether a machine is busy or the code slow."""

        def calls(count):
            body = encode_model([MarkerSet(str(k), ("m",)) for k in range(2 * count)], (4, 0))
            columns = Columns(decode_model(decode(body)[1], (4, 0)))
            points = np.arange(1.0, 3 * count + 1.0, dtype=np.float32).reshape(count, 3)
            frame = self.frame(np.arange(count) << 16, np.full(count, 10), [("7", points[:1])], points)
            made = [0]

            def count_one(_frame, event, _argument):
                made[0] += event in ("call", "c_call")

            before = sys.getprofile()
            sys.setprofile(count_one)
            try:
                columns.place(frame)
            finally:
                sys.setprofile(before)
            return made[0]

        assert 0 < calls(2000) < 32 * calls(125)  # 16 times as many: linear 16, square 256


@pytest.mark.parametrize(("exposed", "sent", "latency_ms"), [(1000, 6000, 5.0), (0, 6000, 0.0), (6000, 1000, 0.0)])
def test_the_latency_that_motive_measures_is_kept(exposed: int, sent: int, latency_ms: float) -> None:
    """A clock of 1 MHz; no latency is made of times that no exposure had. The other client reads the same times."""
    info = decode_server_info(decode(encode_server_info(ServerInfo("Motive", (4, 1), clock_hz=1_000_000)))[1])
    _, body = decode(encode_frame(replace(a_frame(), exposed=exposed, sent=sent), (4, 1)))
    frame, theirs = decode_frame(body, (4, 1)), DataFrame.read_from_buffer(PacketBuffer(body), Version(4, 1)).suffix
    assert not exposed or (theirs.stamp_camera_mid_exposure, theirs.stamp_transmit) == (exposed, sent)
    columns = Columns(Model((MarkerSet("Anna", tuple(f"M{m}" for m in range(8))),)))
    columns.fit(frame)
    assert marker_frame(frame, columns, y_up=True, clock_hz=info.clock_hz).latency_ns == 1e6 * latency_ms
