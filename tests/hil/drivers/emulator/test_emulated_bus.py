"""The emulated line in time: bytes at their baud, replies in order, faults as they are requested."""

import contextlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from paths import ROOT

from highfive.hil.drivers.bus import instruction_packets as wire
from highfive.hil.drivers.bus.control_table import BAUD_RATES, load_table
from highfive.hil.drivers.bus.instruction_packets import ReadTarget
from highfive.hil.drivers.bus.packet import BROADCAST, Packet
from highfive.hil.drivers.bus.packet_decoder import Decoder
from highfive.hil.drivers.bus.rig import load_rig, required_registers
from highfive.hil.drivers.bus.status_packets import Status, decode_fast_status, decode_status
from highfive.hil.drivers.emulator.bus_faults import KINDS, parse_fault, parse_faults
from highfive.hil.drivers.emulator.emulated_bus import TURNAROUND_NS, EmulatedBus
from highfive.hil.drivers.emulator.emulated_servo import BOOT_NS, EmulatedServo
from highfive.hil.drivers.emulator.servos_of_rig import build_servos
from highfive.hil.drivers.servo_errors import Error
from highfive.model.errors import HighFiveError

MS = 1_000_000
MODEL = load_table("XM430-W350")


def bus_of(count: int = 7, *, baud: int = 1_000_000, delay: int = 0, paced: bool = True) -> EmulatedBus:
    registers = {"baud_rate": BAUD_RATES.index(baud), "return_delay_time": delay}
    return EmulatedBus([EmulatedServo(MODEL, {"id": n + 1} | registers) for n in range(count)], paced=paced)


def ask(bus: EmulatedBus, said: bytes, at: int = 0, baud: int = 1_000_000) -> tuple[bytes, list[int]]:
    """What comes back, and when each piece has come."""
    bus.receive(said, at, baud)
    pieces, bus.pending = list(bus.pending), []
    return b"".join(piece.data for piece in pieces), [piece.time_ns for piece in pieces]


def statuses(data: bytes) -> list[Status]:
    return [decode_status(found) for found in Decoder().feed(data) if isinstance(found, Packet)]


@settings(max_examples=30)
@given(st.sampled_from(BAUD_RATES), st.integers(0, 254), st.integers(1, 60))
def test_a_reply_takes_the_time_of_its_bytes(baud: int, delay: int, length: int) -> None:
    """Ten bits a byte, both ways, and twice the return delay time in µs between."""
    said = wire.read(1, 578, length)
    data, times = ask(bus_of(1, baud=baud, delay=delay), said, 0, baud)
    assert len(data) == 11 + length
    exact = (len(said) + len(data)) * 10e9 / baud + delay * 2_000 + TURNAROUND_NS
    assert times == [pytest.approx(exact, rel=1e-4)]


def test_a_cycle_of_seven_servos_takes_what_was_calculated() -> None:
    """1.76 ms of bytes and 50 µs to turn the line round: 552 Hz; with the factory's delay of 500 µs, 434 Hz."""
    for delay, rate in ((0, 552.5), (250, 432.9)):
        bus = bus_of(delay=delay)
        ask(bus, wire.sync_write(116, dict.fromkeys(range(1, 8), bytes(4))))
        _, times = ask(bus, wire.sync_read(126, 10, range(1, 8), fast=True))
        assert 1e9 / times[-1] == pytest.approx(rate, abs=0.2)
        _, times = ask(bus_of(delay=delay), wire.sync_read(126, 10, range(1, 8)))
        assert len(times) == 7 and np.all(np.diff(times) == 21 * 10_000 + TURNAROUND_NS + delay * 2_000)


def test_replies_come_in_the_order_asked() -> None:
    bus = bus_of()
    data, _ = ask(bus, wire.sync_read(7, 1, [5, 2, 7]))
    assert statuses(data) == [Status(n, 0, False, bytes((n,))) for n in (5, 2, 7)]
    data, _ = ask(bus, wire.sync_read(7, 1, [5, 2, 7], fast=True))
    assert [s.id for s in decode_fast_status(data, dict.fromkeys((5, 2, 7), 1))] == [5, 2, 7]
    data, _ = ask(bus, wire.bulk_read([ReadTarget(3, 0, 2), ReadTarget(1, 7, 1)], fast=True))
    assert [s.data for s in decode_fast_status(data, {3: 2, 1: 1})] == [MODEL.number.to_bytes(2, "little"), b"\1"]
    data, _ = ask(bus, wire.ping())
    assert [s.id for s in statuses(data)] == list(range(1, 8))


def test_another_baud_rate_is_not_heard() -> None:
    bus = bus_of(2)
    assert ask(bus, wire.ping(1), 0, 57_600) == (b"", [])
    assert ask(bus, wire.ping(1), 100 * MS, 1_020_000)[0], "three in a hundred make no difference"
    assert ask(bus, wire.write(1, 8, b"\1"), 200 * MS)[0]
    assert ask(bus, wire.ping(1), 300 * MS) == (b"", [])
    assert ask(bus, wire.ping(1), 400 * MS, 57_600)[0]


@pytest.mark.parametrize(("level", "speaks"), [(0, [1, 0, 0]), (1, [1, 1, 0]), (2, [1, 1, 1])])
def test_status_return_level(level: int, speaks: list[int]) -> None:
    bus = bus_of(1)
    ask(bus, wire.write(1, 68, bytes((level,))))
    for n, (said, expected) in enumerate(
        zip([wire.ping(1), wire.read(1, 0, 2), wire.write(1, 65, b"\1")], speaks, strict=True)
    ):
        assert bool(ask(bus, said, (n + 1) * 100 * MS)[0]) == bool(expected)
    assert bus.servos[0].values["led"] == 1
    assert bool(ask(bus, wire.sync_read(0, 2, [1]), 500 * MS)[0]) == (level > 0)


def test_to_all_nobody_replies_but_to_a_ping() -> None:
    bus = bus_of(3)
    assert ask(bus, wire.write(BROADCAST, 65, b"\1"))[0] == b""
    assert [servo.values["led"] for servo in bus.servos] == [1, 1, 1]
    assert ask(bus, wire.factory_reset(BROADCAST, 0xFF), 100 * MS)[0] == b""
    assert [servo.id for servo in bus.servos] == [1, 2, 3]
    assert ask(bus, wire.reboot(BROADCAST), 200 * MS)[0] == b""
    assert ask(bus, wire.ping(), 210 * MS)[0] == b"", "they are starting"
    assert len(statuses(ask(bus, wire.ping(), 210 * MS + BOOT_NS)[0])) == 3


def test_a_damaged_instruction_is_answered_with_a_crc_error() -> None:
    bus = bus_of(2)
    said = bytearray(wire.read(1, 132, 4))
    said[-1] ^= 1
    assert statuses(ask(bus, bytes(said))[0]) == [Status(1, Error.CRC, False, b"")]
    assert ask(bus, wire.read(1, 132, 4)[:9], 100 * MS)[0] == b""
    assert statuses(ask(bus, wire.ping(2), 200 * MS)[0]), "half a packet does not hide what comes after a pause"
    assert bus.counts.damaged == 2


def test_who_speaks_into_a_reply_spoils_both() -> None:
    bus = bus_of(1)
    bus.receive(wire.read(1, 132, 4), 0, 1_000_000)
    bus.receive(wire.write(1, 65, b"\1"), 200_000, 1_000_000)
    assert bus.counts.collisions == 1 and bus.servos[0].values["led"] == 0
    data = b"".join(piece.data for piece in bus.due(10 * MS))
    assert data and not statuses(data)
    assert statuses(ask(bus, wire.ping(1), 100 * MS)[0])


def test_two_servos_of_one_id_cannot_be_understood() -> None:
    bus = EmulatedBus([EmulatedServo(MODEL, {"id": n, "baud_rate": 3}) for n in (1, 2, 2)])
    assert len(statuses(ask(bus, wire.ping(1))[0])) == 1
    data, _ = ask(bus, wire.ping(2), 100 * MS)
    assert data and not statuses(data)


def test_motion_goes_on_between_the_instructions() -> None:
    bus = bus_of(1)
    ask(bus, wire.write(1, 64, b"\1"))
    ask(bus, wire.write(1, 116, (3000).to_bytes(4, "little")), 10 * MS)
    seen = [
        int.from_bytes(statuses(ask(bus, wire.read(1, 132, 4), time * MS)[0])[0].data, "little")
        for time in range(20, 1500, 50)
    ]
    assert seen[0] < seen[2] < seen[5] and seen[-1] == pytest.approx(3000, abs=15)


def test_the_arm_moves_as_its_rig_says() -> None:
    """Reversed or shadowing: a count that grows is an angle that grows, and both servos of a joint count alike."""
    servos, joints = build_servos(load_rig())
    bus = EmulatedBus(servos, joints)
    ask(bus, wire.sync_write(64, {n: b"\1" for n in (1, 2, 4, 6, 7, 8)}))
    ask(bus, wire.sync_write(116, {n: (2300).to_bytes(4, "little") for n in (1, 2, 4, 6, 7, 8)}), MS)
    for time in range(10, 1500, 10):  # the watchdog is armed: silence would stop them
        data, _ = ask(bus, wire.sync_read(132, 4, range(1, 9), fast=True), time * MS)
    counts = [int.from_bytes(s.data, "little") for s in decode_fast_status(data, dict.fromkeys(range(1, 9), 4))]
    assert counts == [pytest.approx(2300, abs=20)] * 8
    assert bus.watchdog_trips == 0
    bus.advance(2500 * MS)
    assert bus.watchdog_trips == 8


def test_the_rig_is_as_the_driver_wants_it_or_as_from_the_factory() -> None:
    rig = load_rig()
    for configured in (True, False):
        servos, _ = build_servos(rig, configured=configured)
        for servo, required in zip(servos, required_registers(rig).values(), strict=True):
            assert all(servo.values[name] == raw for name, raw in required.items()) == configured


# Faults.


def replies_with(text: str, said: bytes = wire.sync_read(7, 1, [1, 2, 3, 4]), at: int = 0) -> tuple[list[int], bytes]:
    bus = bus_of()
    bus.set_faults(parse_faults([text]))
    bus.advance(at)
    data, _ = ask(bus, said, at)
    return [status.id for status in statuses(data)], data


def test_a_dead_servo_silences_those_after_it() -> None:
    assert replies_with("dead=3")[0] == [1, 2]
    assert replies_with("dead=3@2-3")[0] == [1, 2, 3, 4]
    assert replies_with("dead=3@2-3", at=2500 * MS)[0] == [1, 2]
    assert replies_with("dead=3@2-3", at=3500 * MS)[0] == [1, 2, 3, 4]
    assert replies_with("dead=3", wire.ping(3))[1] == b""
    _, data = replies_with("dead=3", wire.sync_read(7, 1, [1, 2, 3, 4], fast=True))
    assert [s.id for s in decode_fast_status(data, dict.fromkeys((1, 2, 3, 4), 1))] == [1, 2]


@pytest.mark.parametrize(
    ("text", "left"), [("crc=2", [1, 3, 4]), ("noise", [1, 2, 3, 4]), ("half=4", [1, 2, 3]), ("twice=2", [1, 3, 4])]
)
def test_what_a_fault_leaves_of_the_replies(text: str, left: list[int]) -> None:
    assert replies_with(text)[0] == left


def test_a_share_of_the_replies() -> None:
    bus = bus_of(1)
    bus.set_faults(parse_faults(["crc:0.3"]))
    whole = sum(len(statuses(ask(bus, wire.ping(1), n * 100 * MS)[0])) for n in range(300))
    assert 180 < whole < 240


def test_late_and_echo() -> None:
    bus = bus_of(2)
    bus.set_faults(parse_faults(["late=2:20"]))
    first, second = ask(bus, wire.ping(1))[1][0], ask(bus, wire.ping(2), 100 * MS)[1][0] - 100 * MS
    assert second - first == 20 * MS
    bus.set_faults(parse_faults(["echo"]), 200 * MS)
    data, times = ask(bus, wire.ping(1), 300 * MS)
    assert data.startswith(wire.ping(1)) and times[0] == 300 * MS + 100_000


def test_a_fault_of_a_servo_that_is_not_there_is_refused() -> None:
    assert len(parse_faults(["dead=1+3,noise", "late:20"], bus_of(3).ids)) == 3
    for text in ("dead=4", "dead=1,late=2+9:20"):
        with pytest.raises(HighFiveError, match=r"there is no servo \d; there are 1, 2, 3$"):
            parse_faults([text], bus_of(3).ids)


def test_what_happens_to_servos() -> None:
    bus = bus_of(3)
    bus.set_faults(parse_faults(["overload=1@0.5,hot=2:95@0.5,brownout=3:5@0.5-1"]))
    bus.advance(400 * MS)
    assert not any(servo.alert for servo in bus.servos)
    bus.advance(700 * MS)
    assert [servo.values["hardware_error_status"] for servo in bus.servos] == [0x20, 0x04, 0x01]
    assert [s.id for s in statuses(ask(bus, wire.ping(), 700 * MS)[0])] == [1, 2]
    assert [s.alert for s in statuses(ask(bus, wire.ping(), 1500 * MS)[0])] == [True, True, False]


@pytest.mark.parametrize("kind", KINDS)
def test_every_fault_can_be_spelt_and_is_documented(kind: str) -> None:
    assert f"| `{kind}" in (ROOT / "docs" / "rig.md").read_text(encoding="utf-8")
    values = {"late": ":20", "brownout": ":8", "dead": "=3", "overload": "=3", "slip": "=3:-10", "twice": "=3"}
    value = values.get(kind, "")
    fault = parse_fault(f"{kind}{value}@2-3.5")
    assert (fault.kind, fault.start, fault.end) == (kind, 2.0, 3.5)
    assert fault.on(2.0) and not fault.on(3.5) and fault.after(10.0).on(12.0)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "ded=4",
        "dead",
        "dead=253",
        "late",
        "late:0",
        "crc:2",
        "dead=4@3-2",
        "unplug=3",
        "echo:1",
        "dead=4:2",
        "late:-20",
        "slip:10",
        "slip=3:181",
        "hot:1.2.3",
        "dead=+",
        "x" * 500,
    ],
)
def test_nonsense_is_one_line(text: str) -> None:
    with pytest.raises(HighFiveError) as caught:
        parse_fault(text)
    assert "\n" not in str(caught.value)


@given(st.text(max_size=30))
def test_any_text_is_a_fault_or_our_own_error(text: str) -> None:
    with contextlib.suppress(HighFiveError):
        parse_fault(text)


@settings(max_examples=40)
@given(st.lists(st.binary(max_size=40), max_size=8), st.booleans())
def test_any_bytes_leave_the_bus_working(said: list[bytes], paced: bool) -> None:
    bus = bus_of(3, paced=paced)
    for n, data in enumerate(said):
        bus.receive(data, n * MS, 1_000_000)
        bus.due(n * MS)
    bus.due(300 * MS)
    required = {
        servo.id for servo in bus.servos if servo.baud_rate == 1_000_000 and servo.values["status_return_level"] >= 0
    }
    found = statuses(ask(bus, wire.ping(), 300 * MS)[0])
    assert len(required) < 3 or {status.id for status in found} == required
