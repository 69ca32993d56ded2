"""The emulated bus against two clients that know nothing of it, nor of each other: the maker's SDK and rustypot.

Every instruction both can send gives the same values and the same errors.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any

import dynamixel_sdk as sdk
import dynamixel_sdk.port_handler as sdk_port
import pytest
import rustypot

from highfive.hil.drivers.bus.control_table import Table, encode, load_table
from highfive.hil.drivers.emulator.emulator_process import EmulatorOptions, EmulatorProcess
from highfive.hil.drivers.servo_errors import ALERT, Error

BAUD = 1_000_000
PATIENCE_S = 5.0
BOOT_S = 0.3
CONTROLLERS = {"XL430-W250": rustypot.Xl430PyController, "XL330-M288": rustypot.Xl330PyController}


@pytest.fixture(autouse=True, scope="module")
def patient() -> Iterator[None]:
    """A busy machine is not what is tested here."""
    before, sdk_port.LATENCY_TIMER = sdk_port.LATENCY_TIMER, PATIENCE_S * 500.0
    yield
    sdk_port.LATENCY_TIMER = before


class Maker:
    """The maker's SDK, as bytes and error bytes."""

    def __init__(self, port: str):
        self.port, self.protocol = sdk.PortHandler(port), sdk.PacketHandler(2.0)
        assert self.port.openPort() and self.port.setBaudRate(BAUD)

    def ping(self, servo: int) -> int:
        number, result, error = self.protocol.ping(self.port, servo)
        assert (result, error) == (sdk.COMM_SUCCESS, 0)
        return number

    def read(self, servo: int, address: int, length: int) -> tuple[bytes, int]:
        data, result, error = self.protocol.readTxRx(self.port, servo, address, length)
        assert result == sdk.COMM_SUCCESS
        return (b"" if error & ~ALERT else bytes(data)), error

    def write(self, servo: int, address: int, data: bytes) -> int:
        result, error = self.protocol.writeTxRx(self.port, servo, address, len(data), list(data))
        assert result == sdk.COMM_SUCCESS
        return error

    def sync_read(self, servos: list[int], address: int, length: int, *, fast: bool) -> list[bytes]:
        group = sdk.GroupSyncRead(self.port, self.protocol, address, length)
        for servo in servos:
            assert group.addParam(servo)
        assert (group.fastSyncRead() if fast else group.txRxPacket()) == sdk.COMM_SUCCESS
        return [bytes(group.data_dict[servo]) for servo in servos]

    def sync_write(self, address: int, data: dict[int, bytes]) -> None:
        group = sdk.GroupSyncWrite(self.port, self.protocol, address, len(next(iter(data.values()))))
        for servo, own in data.items():
            assert group.addParam(servo, list(own))
        assert group.txPacket() == sdk.COMM_SUCCESS

    def close(self) -> None:
        self.port.closePort()


Client = Callable[[], closing[Any]]


def wait_for_boot(client: Any, servo: int) -> None:
    """Until a servo answers again, however long a busy machine takes."""
    time.sleep(BOOT_S)  # what is asked before that is lost, and waited for
    for _ in range(10):
        maker = isinstance(client, Maker)
        if client.protocol.ping(client.port, servo)[1] == sdk.COMM_SUCCESS if maker else client.ping(servo):
            return
    raise AssertionError(f"servo {servo} does not start")


@pytest.fixture(scope="module", params=CONTROLLERS)
def both(request: pytest.FixtureRequest) -> Iterator[tuple[Table, Client, Client]]:
    """One emulator; clients of either kind, which take turns."""
    model = request.param
    servos = tuple(f"{servo}={model}" for servo in (1, 2, 3))
    with EmulatorProcess(EmulatorOptions(servos=servos, baud_rate=BAUD, paced=False)) as emulator:
        yield (
            load_table(model),
            lambda: closing(Maker(emulator.port)),
            lambda: closing(CONTROLLERS[model](emulator.port, BAUD, PATIENCE_S)),
        )


def test_tables_are_rustypots_as_well(both) -> None:
    table, _, other = both
    names = {"secondary_id": "shadow_id"}
    with other() as client:
        known = {register.name: register for register in client.registers()}
    agreed = 0
    for name, register in known.items():
        older = table.model == "XL330-M288" and name.startswith("indirect_data")  # theirs is the older firmware's
        if (ours := names.get(name, name)) in table and not older:
            own = table[ours]
            assert (own.address, own.size) == (register.addr, register.size), name
            agreed += 1
    assert agreed > 45


def test_every_register_reads_the_same(both) -> None:
    table, maker, other = both
    ours = [register for register in table if register.address < 256]
    with maker() as client:
        theirs = {register.name: client.read(1, register.address, register.size) for register in ours}
    with other() as client:
        for register in ours:
            data, error = client.read_raw_data_with_error(1, register.address, register.size)
            if register.name != "realtime_tick":
                assert (bytes(data), error) == theirs[register.name], register.name
            if register.initial is not None and register.name not in {"id", "baud_rate", "moving_status"}:
                assert bytes(data) == encode(register, register.initial), register.name


WRITES = {
    "good": ("led", 1, 1, Error.NONE),
    "too large": ("led", 2, 1, Error.DATA_RANGE),
    "beyond its limit register": ("goal_velocity", 5_000, 4, Error.DATA_LIMIT),
    "beyond its position limit": ("goal_position", 5_000, 4, Error.DATA_LIMIT),
    "read only": ("present_position", 0, 4, Error.ACCESS),
    "not there": (66, 0, 1, Error.ACCESS),
    "half a register": ("goal_position", 0, 2, Error.DATA_LENGTH),
    "no such mode": ("operating_mode", 2, 1, Error.DATA_RANGE),
    "torque": ("torque_enable", 1, 1, Error.NONE),
    "EEPROM with torque on": ("operating_mode", 1, 1, Error.ACCESS),
    "torque off": ("torque_enable", 0, 1, Error.NONE),
    "EEPROM": ("return_delay_time", 10, 1, Error.NONE),
}


def test_every_write_is_taken_or_refused_the_same(both) -> None:
    table, maker, other = both
    for kind in (maker, other):
        with kind() as client:
            for what, (where, raw, length, error) in WRITES.items():
                address = where if isinstance(where, int) else table[where].address
                data = raw.to_bytes(length, "little")
                if isinstance(client, Maker):
                    assert client.write(1, address, data) == error, what
                else:
                    assert client.write_raw_data_with_error(1, address, list(data)) == error, what


def test_groups_read_and_write_the_same(both) -> None:
    table, maker, other = both
    position = table["goal_position"].address
    goals = {1: 100, 2: 2000, 3: 4000}
    wires = {servo: goal.to_bytes(4, "little") for servo, goal in goals.items()}
    with maker() as client:
        client.sync_write(position, wires)
        for fast in (False, True):
            assert client.sync_read([1, 2, 3], position, 4, fast=fast) == list(wires.values())
    with other() as client:
        for fast in (False, True):
            client.set_fast_sync_read(fast)
            assert client.sync_read_raw_data([3, 1, 2], position, 4) == [wires[3], wires[1], wires[2]]
        client.sync_write_raw_data([1, 2, 3], position, [list(wires[4 - servo]) for servo in (1, 2, 3)])
    with maker() as client:
        assert client.sync_read([1, 2, 3], position, 4, fast=True) == [wires[3], wires[2], wires[1]]


def test_everyone_is_found_by_both(both) -> None:
    table, maker, other = both
    with maker() as client:
        assert [client.ping(servo) for servo in (1, 2, 3)] == [table.number] * 3
        sdk_port.LATENCY_TIMER = 16
        found, result = client.protocol.broadcastPing(client.port)
        sdk_port.LATENCY_TIMER = PATIENCE_S * 500.0
        assert result == sdk.COMM_SUCCESS and found == {servo: [table.number, table.firmware] for servo in (1, 2, 3)}
    with other() as client:
        assert all(client.ping(servo) for servo in (1, 2, 3))
        assert client.broadcast_scan() == dict.fromkeys((1, 2, 3), table.number)


def test_reboot_and_factory_reset_by_both(both) -> None:
    table, maker, other = both
    led, delay = table["led"].address, table["return_delay_time"].address
    for kind in (maker, other):
        with kind() as client:
            ours = isinstance(client, Maker)

            def put(address: int, value: int, client: Any = client, ours: bool = ours) -> None:
                error = (
                    client.write(2, address, bytes((value,)))
                    if ours
                    else client.write_raw_data_with_error(2, address, [value])
                )
                assert error == 0

            def get(address: int, client: Any = client, ours: bool = ours) -> list[int]:
                return list(client.read(2, address, 1)[0] if ours else client.read_raw_data(2, address, 1))

            put(led, 1)
            put(delay, 20)
            assert client.protocol.reboot(client.port, 2) == (sdk.COMM_SUCCESS, 0) if ours else client.reboot(2)
            wait_for_boot(client, 2)
            assert (get(led), get(delay)) == ([0], [20])
            if ours:
                assert client.protocol.factoryReset(client.port, 2, 2) == (sdk.COMM_SUCCESS, 0)
            else:
                client.factory_reset(2, True, True)
            wait_for_boot(client, 2)
            assert get(delay) == [250]


def test_angles_as_rustypot_converts_them() -> None:
    """Its XL330 class has conversions of its own; what it writes in rad arrives as the counts that ours says."""
    with EmulatorProcess(EmulatorOptions(servos=("1=XL330-M288",), baud_rate=BAUD, paced=False)) as emulator:
        client = rustypot.Xl330PyController(emulator.port, BAUD, PATIENCE_S)
        table = load_table("XL330-M288")
        client.write_goal_position(1, 0.5)
        raw = int.from_bytes(bytes(client.read_raw_data(1, 116, 4)), "little", signed=True)
        assert (raw - 2048) * table["goal_position"].scale == pytest.approx(0.5, abs=table["goal_position"].scale)


@pytest.fixture(scope="module")
def arm() -> Iterator[tuple[EmulatorProcess, Maker]]:
    with EmulatorProcess(EmulatorOptions(paced=False)) as emulator:
        client = Maker(emulator.port)
        yield emulator, client
        client.close()


def test_what_only_the_makers_sdk_can_send(arm) -> None:
    _, client = arm
    port, protocol = client.port, client.protocol
    goal = list((1500).to_bytes(4, "little"))
    assert protocol.regWriteTxRx(port, 1, 116, 4, goal) == (sdk.COMM_SUCCESS, 0)
    assert client.read(1, 69, 1) == (b"\1", 0)
    assert client.read(1, 116, 4)[0] != bytes(goal)
    assert protocol.action(port, sdk.BROADCAST_ID) == sdk.COMM_SUCCESS
    assert client.read(1, 116, 4) == (bytes(goal), 0)
    assert protocol.clearMultiTurn(port, 1) == (sdk.COMM_SUCCESS, 0)

    writing = sdk.GroupBulkWrite(port, protocol)
    assert writing.addParam(1, 116, 4, goal) and writing.addParam(6, 65, 1, [1])
    assert writing.txPacket() == sdk.COMM_SUCCESS
    reading = sdk.GroupBulkRead(port, protocol)
    assert reading.addParam(1, 116, 4) and reading.addParam(6, 65, 1) and reading.addParam(8, 0, 2)
    for read in (reading.txRxPacket, reading.fastBulkRead):
        assert read() == sdk.COMM_SUCCESS
        assert [reading.getData(1, 116, 4), reading.getData(6, 65, 1), reading.getData(8, 0, 2)] == [1500, 1, 1020]


def test_indirect_data_through_the_makers_sdk(arm) -> None:
    """What the driver reads each cycle: current, velocity, position and hardware error in eleven bytes."""
    _, client = arm
    for servo in (1, 2):
        for n, address in enumerate([*range(126, 136), 70]):
            assert client.write(servo, 168 + 2 * n, address.to_bytes(2, "little")) == 0
    straight = client.sync_read([1, 2], 126, 10, fast=True)
    assert client.sync_read([1, 2], 224, 11, fast=True) == [data + b"\0" for data in straight]


def test_a_shadow_follows_and_does_not_reply(arm) -> None:
    _, client = arm
    for servo in (2, 3):
        assert client.write(servo, 65, b"\0") == 0
    assert client.write(2, 65, b"\1") == 0
    assert (client.read(2, 65, 1), client.read(3, 65, 1)) == ((b"\1", 0), (b"\1", 0))
    client.sync_write(65, {2: b"\0"})
    assert client.read(3, 65, 1) == (b"\0", 0)
    assert client.write(2, 9, b"\5") == 0
    assert (client.read(2, 9, 1), client.read(3, 9, 1)) == ((b"\5", 0), (b"\0", 0)), "EEPROM stays its own"
    assert client.write(2, 9, b"\0") == 0


def test_an_alert_is_in_every_reply(arm) -> None:
    emulator, client = arm
    emulator.set_faults("overload=7")
    deadline = time.monotonic() + 60.0
    while client.read(7, 70, 1) != (b"\x20", ALERT):
        assert time.monotonic() < deadline
    assert client.write(7, 65, b"\1") == ALERT
    assert client.write(7, 64, b"\1") == ALERT | Error.RESULT_FAIL
    assert client.protocol.reboot(client.port, 7)[0] == sdk.COMM_SUCCESS
    emulator.set_faults("")
    wait_for_boot(client, 7)
    assert client.read(7, 70, 1) == (b"\0", 0)
