"""The codec against the packets that the manual prints and the maker's own CRC; and against anything at all."""

import numpy as np
import pytest
from dynamixel_sdk.protocol2_packet_handler import Protocol2PacketHandler
from hypothesis import given
from hypothesis import strategies as st

from highfive.hil.drivers.bus import instruction_packets as wire
from highfive.hil.drivers.bus.instruction_packets import ReadTarget, WriteTarget, read_targets, write_targets
from highfive.hil.drivers.bus.packet import (
    BROADCAST,
    HEADER,
    LONGEST,
    Instruction,
    Packet,
    PacketError,
    crc16,
    encode,
    stuff,
    unstuff,
)
from highfive.hil.drivers.bus.packet_decoder import Damaged, Decoder
from highfive.hil.drivers.bus.status_packets import FastStatus, Status, decode_fast_status, decode_status, status


def bytes_of(text: str) -> bytes:
    return bytes.fromhex("FF FF FD 00 " + text)


# Printed in the manual, https://emanual.robotis.com/docs/en/dxl/protocol2/
PRINTED = {
    "ping": (wire.ping(1), "01 03 00 01 19 4E"),
    "broadcast ping": (wire.ping(), "FE 03 00 01 31 42"),
    "ping, reply 1": (status(1, 0, b"\x06\x04\x26"), "01 07 00 55 00 06 04 26 65 5D"),
    "ping, reply 2": (status(2, 0, b"\x06\x04\x26"), "02 07 00 55 00 06 04 26 6F 6D"),
    "read": (wire.read(1, 132, 4), "01 07 00 02 84 00 04 00 1D 15"),
    "read, reply": (status(1, 0, b"\xa6\0\0\0"), "01 08 00 55 00 A6 00 00 00 8C C0"),
    "write": (wire.write(1, 116, b"\0\x02\0\0"), "01 09 00 03 74 00 00 02 00 00 CA 89"),
    "write, reply": (status(1, 0), "01 04 00 55 00 A1 0C"),
    "reg write": (wire.reg_write(1, 104, b"\xc8\0\0\0"), "01 09 00 04 68 00 C8 00 00 00 AE 8E"),
    "action": (wire.action(1), "01 03 00 05 02 CE"),
    "factory reset": (wire.factory_reset(1, 1), "01 04 00 06 01 A1 E6"),
    "reboot": (wire.reboot(1), "01 03 00 08 2F 4E"),
    "clear": (wire.clear(1), "01 08 00 10 01 44 58 4C 22 B1 DC"),
    "sync read": (wire.sync_read(132, 4, [1, 2]), "FE 09 00 82 84 00 04 00 01 02 CE FA"),
    "sync read, reply 2": (status(2, 0, b"\x1f\x08\0\0"), "02 08 00 55 00 1F 08 00 00 BA BE"),
    "sync write": (
        wire.sync_write(116, {1: b"\x96\0\0\0", 2: b"\xaa\0\0\0"}),
        "FE 11 00 83 74 00 04 00 01 96 00 00 00 02 AA 00 00 00 82 87",
    ),
    "bulk read": (
        wire.bulk_read([ReadTarget(1, 144, 2), ReadTarget(2, 146, 1)]),
        "FE 0D 00 92 01 90 00 02 00 02 92 00 01 00 1A 05",
    ),
    "bulk read, reply 1": (status(1, 0, b"\x77\0"), "01 06 00 55 00 77 00 C3 69"),
    "bulk read, reply 2": (status(2, 0, b"\x24"), "02 05 00 55 00 24 8B A9"),
    "bulk write": (
        wire.bulk_write([WriteTarget(1, 32, b"\xa0\0"), WriteTarget(2, 31, b"\x50")]),
        "FE 10 00 93 01 20 00 02 00 A0 00 02 1F 00 01 00 50 B7 68",
    ),
}


@pytest.mark.parametrize("name", PRINTED)
def test_packets_as_the_manual_prints_them(name: str) -> None:
    ours, printed = PRINTED[name]
    assert ours == bytes_of(printed)
    (found,) = Decoder().feed(ours)
    assert isinstance(found, Packet)
    assert encode(found) == ours


@given(st.binary(max_size=300), st.integers(0, 0xFFFF))
def test_crc_is_the_makers(data: bytes, start: int) -> None:
    assert crc16(data, start) == Protocol2PacketHandler().updateCRC(start, data, len(data))


EVIL = st.binary(max_size=40) | st.lists(st.sampled_from([0xFF, 0xFD, 0x00, 0x55]), max_size=40).map(bytes)
IDS = st.integers(0, 252) | st.just(BROADCAST)
PACKETS = st.builds(Packet, IDS, st.sampled_from([i for i in Instruction if i != Instruction.STATUS]), EVIL)


@given(EVIL)
def test_stuffing_comes_off_again_and_hides_every_header(body: bytes) -> None:
    assert unstuff(stuff(body)) == body
    assert HEADER not in stuff(body)


@given(EVIL)
def test_stuffing_is_the_makers(parameters: bytes) -> None:
    ours = encode(Packet(1, Instruction.WRITE, parameters))
    packet = [0xFF, 0xFF, 0xFD, 0, 1, len(parameters) + 3, 0, Instruction.WRITE, *parameters, 0, 0]
    assert bytes(Protocol2PacketHandler().addStuffing(packet)[:-2]) == ours[:-2]


def fast_parts(replies: list[tuple[int, int, bytes]]) -> list[bytes]:
    whole = FastStatus([len(data) for _, _, data in replies])
    return [whole.part(*reply) for reply in replies]


def cut_up(data: bytes, seed: int) -> list[bytes]:
    cuts = np.sort(np.random.default_rng(seed).integers(0, len(data) + 1, size=5))
    return [data[a:b] for a, b in zip([0, *cuts], [*cuts, len(data)], strict=True)]


@given(st.lists(PACKETS, max_size=5), st.integers(0, 2**32))
def test_packets_come_back_however_they_are_cut(packets: list[Packet], seed: int) -> None:
    decoder = Decoder()
    found = [one for piece in cut_up(b"".join(map(encode, packets)), seed) for one in decoder.feed(piece)]
    assert found == packets
    assert (decoder.pending, decoder.skipped) == (0, 0)


@given(st.lists(st.one_of(EVIL, PACKETS.map(encode)), max_size=6), st.integers(0, 2**32))
def test_pieces_make_no_difference(parts: list[bytes], seed: int) -> None:
    data = b"".join(parts)
    whole, pieces = Decoder(), Decoder()
    assert whole.feed(data) == [one for piece in cut_up(data, seed) for one in pieces.feed(piece)]
    assert whole.pending == pieces.pending <= LONGEST + 7
    assert whole.idle() == pieces.idle()


@given(st.binary(max_size=60), PACKETS)
def test_found_again_after_noise(noise: bytes, packet: Packet) -> None:
    """The line is silent between the noise and the packet, as it is before every instruction."""
    decoder = Decoder()
    decoder.feed(noise)
    decoder.idle()
    assert decoder.feed(encode(packet)) == [packet]


@given(PACKETS, st.data())
def test_a_packet_cut_short_does_not_hide_the_next(packet: Packet, data: st.DataObject) -> None:
    whole = encode(packet)
    short = whole[: data.draw(st.integers(0, len(whole) - 1))]
    assert Decoder().feed(short + whole)[-1] == packet


def test_a_length_is_not_trusted() -> None:
    decoder = Decoder()
    assert decoder.feed(bytes_of("01 FF FF 03") + bytes(100_000)) == []
    assert decoder.pending < 8
    cut = encode(Packet(3, Instruction.WRITE, bytes(1000)))[:20]
    assert decoder.feed(cut + wire.ping(1)) == [Damaged(3, Instruction.WRITE, True), Packet(1, Instruction.PING)]
    assert decoder.feed(cut) == [] and decoder.pending == 20
    assert decoder.idle() == [Damaged(3, Instruction.WRITE, True)] and decoder.pending == 0


def test_a_hundred_thousand_damaged_packets() -> None:
    """Packets or our own errors come of any bytes, and the servo's view of them as well: nothing else is raised."""
    rng = np.random.default_rng(5)
    wires = [ours for ours, _ in PRINTED.values()]
    wires += [wire.sync_read(126, 10, range(1, 8), fast=True), wire.bulk_read([ReadTarget(1, 126, 10)], fast=True)]
    wires += [b"".join(fast_parts([(1, 0, bytes(10)), (2, 0x80, bytes(10))]))]
    counts = {Packet: 0, Damaged: 0}
    decoder = Decoder()
    dice = rng.integers(1 << 16, size=(100_000, 11)).tolist()
    for one, changes, *where_and_how in dice:
        damaged = bytearray(wires[one % len(wires)])
        for n in range(0, changes % 4 * 3, 3):
            where, how, what = where_and_how[n : n + 3]
            where %= len(damaged)
            match how % 3:
                case 0:
                    damaged[where] ^= 1 << what % 8
                case 1:
                    damaged[where] = (0, 0xFF, 0xFD, 0xFE)[what % 4]
                case _ if len(damaged) > 1:
                    del damaged[where]
        for found in decoder.feed(bytes(damaged)):
            counts[type(found)] += 1
            if isinstance(found, Packet):
                ask_everything(found)
        assert decoder.pending <= LONGEST + 7
    assert counts[Packet] > 25_000 and counts[Damaged] > 10_000


def ask_everything(packet: Packet) -> None:
    for ask in (read_targets, write_targets, decode_status):
        try:
            ask(packet)
        except PacketError as error:
            assert str(error) and "\n" not in str(error)


@given(st.sampled_from(list(Instruction)), IDS, st.binary(max_size=60))
def test_any_parameters_are_targets_or_our_own_error(instruction: Instruction, servo: int, parameters: bytes) -> None:
    ask_everything(Packet(servo, instruction, parameters))


@given(st.dictionaries(st.integers(0, 252), st.tuples(st.integers(0, 1023), EVIL.filter(len)), min_size=1, max_size=7))
def test_targets_come_back(wanted: dict[int, tuple[int, bytes]]) -> None:
    writes = tuple(WriteTarget(servo, *own) for servo, own in wanted.items())
    reads = tuple(ReadTarget(servo, address, len(data)) for servo, (address, data) in wanted.items())
    assert write_targets(_only(wire.bulk_write(writes))) == writes
    for fast in (False, True):
        assert read_targets(_only(wire.bulk_read(reads, fast=fast))) == reads
        same = tuple(ReadTarget(servo, 126, 10) for servo in wanted)
        assert read_targets(_only(wire.sync_read(126, 10, list(wanted), fast=fast))) == same
    four = {servo: data.ljust(4)[:4] for servo, (_, data) in wanted.items()}
    assert write_targets(_only(wire.sync_write(116, four))) == tuple(WriteTarget(s, 116, d) for s, d in four.items())


def _only(data: bytes) -> Packet:
    (found,) = Decoder().feed(data)
    assert isinstance(found, Packet)
    return found


@given(
    st.dictionaries(
        st.integers(0, 252),
        st.tuples(st.integers(0, 255), st.binary(min_size=1, max_size=20) | EVIL),
        min_size=1,
        max_size=8,
    ),
    st.data(),
)
def test_fast_replies_as_far_as_they_came(servos: dict[int, tuple[int, bytes]], data: st.DataObject) -> None:
    replies = [(servo, *own) for servo, own in servos.items()]
    lengths = {servo: len(own[1]) for servo, own in servos.items()}
    parts = fast_parts(replies)
    expected = [Status(s, e & 0x7F, e >= 0x80, d) for s, e, d in replies]
    whole = b"".join(parts)
    assert decode_fast_status(whole, lengths) == expected
    assert len(Decoder().feed(whole)) == 1
    alive = data.draw(st.integers(1, len(parts)))
    assert decode_fast_status(b"".join(parts[:alive]), lengths) == expected[:alive]
    where = data.draw(st.integers(8, len(whole) - 1))
    broken = bytearray(whole)
    broken[where] ^= 0x10
    ends = np.cumsum([len(part) for part in parts])
    assert decode_fast_status(bytes(broken), lengths) == expected[: int(np.searchsorted(ends, where, side="right"))]


def test_the_makers_sdk_takes_the_fast_reply() -> None:
    """Its check: one CRC over all that comes before, the CRCs of the servos before included."""
    whole = b"".join(fast_parts([(1, 0, b"ab"), (2, 0, b"cd"), (3, 0, b"ef")]))
    assert len(whole) == 7 + (whole[5] | whole[6] << 8)
    assert Protocol2PacketHandler().updateCRC(0, whole, len(whole) - 2) == whole[-2] | whole[-1] << 8


@pytest.mark.parametrize(
    "call",
    [
        lambda: wire.ping(253),
        lambda: wire.ping(-1),
        lambda: wire.sync_write(116, {1: b"a", 2: b"bc"}),
        lambda: wire.sync_write(116, {}),
        lambda: wire.write(1, 0, bytes(2000)),
        lambda: FastStatus([2000]),
        lambda: decode_fast_status(status(1, 0), {1: 0}),
        lambda: decode_fast_status(b"", {1: 0}),
        lambda: read_targets(Packet(BROADCAST, Instruction.SYNC_READ, b"\x84\0\4\0\1\1")),
    ],
)
def test_what_cannot_be_said_is_our_own_error(call) -> None:
    with pytest.raises(PacketError):
        call()
