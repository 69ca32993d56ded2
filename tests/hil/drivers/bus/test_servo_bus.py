"""The maker's SDK with its traps closed, against emulated servos in virtual time."""

import contextlib
import os
import threading
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from virtual_servos import VirtualServos

from highfive.hil.drivers.bus import ports
from highfive.hil.drivers.bus.ports import Port, latency_ms, serial_ports
from highfive.hil.drivers.bus.rig import Rig
from highfive.hil.drivers.bus.servo_bus import DamagedAnswer, NoAnswer, ServoBus, ServoError
from highfive.hil.drivers.bus.servo_port import PortError, ServoPort
from highfive.hil.drivers.bus.status_packets import status
from highfive.model.errors import HighFiveError

PATIENT_MS = 5000.0
"""On a pseudo-terminal, whose other end a thread of this process is."""

POSITION = 132, 4


def test_registers_go_there_and_back_with_their_signs(bus: ServoBus) -> None:
    bus.write(4, "homing_offset", -345)
    assert bus.read(4, "homing_offset") == -345
    assert bus.read(4, "model_number") == 1120
    bus.write(8, "goal_current", -7)
    assert bus.read(8, "goal_current") == -7


def test_everyone_is_found_and_told_by_model(servos: VirtualServos, rig: Rig) -> None:
    bus = ServoBus(servos.port, rig.baud_rate, wiring=servos.wiring)
    found, damaged = bus.scan(range(10))
    assert {one.servo: one.model for one in found} == rig.models
    assert not damaged
    bus.close()


def test_a_refusal_is_the_servos_own_and_not_an_index_error(bus: ServoBus) -> None:
    bus.write(2, "torque_enable", 1)
    with pytest.raises(ServoError, match=r"servo 2, operating_mode: .*torque is on") as refused:
        bus.write(2, "operating_mode", 3)
    assert refused.value.code == 7
    with pytest.raises(HighFiveError, match="read-only"):
        bus.write(2, "present_position", 0)
    with pytest.raises(HighFiveError, match="no register 'gaol'"):
        bus.read(2, "gaol")


def test_one_dead_servo_silences_the_fast_read_only(bus: ServoBus, servos: VirtualServos) -> None:
    ids = [1, 2, 4, 6]
    assert set(bus.fast_sync_read(*POSITION, ids)) == set(ids)
    servos.set_faults("dead=4")
    servos.until(lambda: bus.sync_read(*POSITION, [4]) == {})
    with pytest.raises(NoAnswer, match="1, 2, 4, 6"):
        bus.fast_sync_read(*POSITION, ids)
    assert set(bus.sync_read(*POSITION, ids)) == {1, 2}  # up to the first gap
    assert set(bus.sync_read(*POSITION, [6])) == {6}
    with pytest.raises(NoAnswer, match="servo 4"):
        bus.read(4, "present_position")


def test_a_servo_with_an_error_still_answers(bus: ServoBus, servos: VirtualServos) -> None:
    """Its alert bit is no refusal."""
    servos.set_faults("overload=2")
    servos.until(lambda: bus.read(2, "hardware_error_status") == 1 << 5)
    assert bus.read(2, "model_number") == 1120


def test_damaged_answers_are_told_from_none(bus: ServoBus, servos: VirtualServos) -> None:
    servos.set_faults("crc=6,dead=7")
    servos.until(lambda: bus.sync_read(*POSITION, [7]) == {})
    with pytest.raises(DamagedAnswer):
        bus.read(6, "present_position")
    found, damaged = bus.scan([1, 6, 7])
    assert [one.servo for one in found] == [1]
    assert damaged == [6]


REGISTERS = (
    "max_position_limit",
    "velocity_limit",
    "min_position_limit",
    "homing_offset",
    "current_limit",
    "pwm_limit",
    "position_p_gain",
    "id",
    "operating_mode",
)


@pytest.mark.parametrize("late_ms", [5, 9, 20, 40, 55, 58, 70, 130, 400])
def test_a_late_answer_is_not_taken_for_the_next_one(servos: VirtualServos, rig: Rig, late_ms: int) -> None:
    bus = ServoBus(servos.port, rig.baud_rate, rig.models, PATIENT_MS, servos.wiring)
    truth = {name: bus.read(2, name) for name in REGISTERS}
    bus.close()
    bus = ServoBus(servos.port, rig.baud_rate, rig.models, wiring=servos.wiring)
    servos.hold_s = 1e-3 * late_ms
    right = 0
    for name in 2 * REGISTERS:
        try:
            assert bus.read(2, name) == truth[name], name
            right += 1
        except NoAnswer:
            pass
    bus.close()
    assert right > 0 or late_ms > 50


def test_an_old_acknowledgement_is_none_for_the_next_write(servos: VirtualServos, rig: Rig) -> None:
    bus = ServoBus(servos.port, rig.baud_rate, rig.models, wiring=servos.wiring)
    for hold in (0.006, 0.012, 0.03, 0.064):
        servos.hold_s = hold
        with contextlib.suppress(NoAnswer):
            bus.write(2, "goal_current", 10)
        servos.set_faults("dead=2")  # what comes now is an answer to what was before
        with pytest.raises(NoAnswer):
            bus.write(2, "goal_current", 20)
            bus.write(2, "profile_velocity", 30)
        servos.set_faults()
        servos.sleep(0.2)
        servos.hold_s = 0.0
        bus.write(2, "goal_current", 10)
        servos.sleep(0.1)
    bus.close()


def test_an_answer_of_another_length_is_passed_over(rig: Rig) -> None:
    """Such as one that a servo gives to somebody before us."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    bus = ServoBus(os.ttyname(theirs), rig.baud_rate, rig.models, PATIENT_MS)

    def answer() -> None:
        os.read(ours, 100)
        os.write(ours, status(2, 0, bytes((1, 2, 3, 4))) + status(2, 0, b"") + status(2, 0, bytes((7, 0))))

    thread = threading.Thread(target=answer)
    thread.start()
    assert bus.read(2, "current_limit") == 7
    thread.join()
    bus.close()
    os.close(ours)
    os.close(theirs)


def test_a_lost_port_is_reported_and_opens_again(servos: VirtualServos, bus: ServoBus) -> None:
    assert bus.read(1, "id") == 1
    servos.set_faults("unplug@0-0.5")
    with pytest.raises(PortError, match="gone"):
        for _ in range(1000):
            bus.sync_read(*POSITION, [1])
    assert not works(bus.reopen, PortError)
    servos.until(lambda: works(bus.reopen, PortError), 0.6)
    assert bus.read(1, "id") == 1


def works(call: Callable[[], object], error: type[Exception]) -> bool:
    try:
        call()
    except error:
        return False
    return True


@pytest.fixture
def silent() -> Iterator[str]:
    """A serial port on which nobody speaks."""
    ours, theirs = os.openpty()
    yield os.ttyname(theirs)
    os.close(ours)
    os.close(theirs)


def test_ports_that_cannot_be_used_are_reported_in_a_line(tmp_path: Path, silent: str) -> None:
    (tmp_path / "file").write_text("no port")
    first = ServoPort(silent, 1_000_000)
    for path, baud, said in (
        (str(tmp_path / "none"), 1_000_000, "no such port"),
        (str(tmp_path / "file"), 1_000_000, "not a serial port"),
        (str(tmp_path), 1_000_000, "not a serial port"),
        (silent, 1_000_000, "busy"),
        (silent, 4_500_000, "4,500,000 baud"),
        (silent, 12_345, "12,345 baud"),
    ):
        with pytest.raises(PortError, match=said) as error:
            ServoPort(path, baud)
        assert "\n" not in str(error.value)
    first.close()
    first.close()
    with pytest.raises(PortError, match="closed"):
        first.writePort(b"x")


def test_waiting_for_an_answer_sleeps(silent: str, rig: Rig) -> None:
    """The SDK's own port takes a whole core while it waits: as much processor as there is time. Less may be lent."""
    bus = ServoBus(silent, rig.baud_rate, rig.models, 250.0)
    begun, busy = time.monotonic(), time.thread_time()
    for _ in range(4):
        assert bus.sync_read(*POSITION, [1]) == {}
    waited, busy = time.monotonic() - begun, time.thread_time() - busy
    assert waited >= 1.0  # 4 of 250 ms
    assert busy < waited / 4.0
    bus.close()


def test_a_silent_device_is_no_bus(silent: str, rig: Rig) -> None:
    bus = ServoBus(silent, rig.baud_rate, rig.models)
    assert bus.scan([1, 2]) == ([], [])
    bus.close()


def test_the_latency_of_an_adapter_is_read_and_advised_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ports, "SYSTEM", tmp_path)
    (tmp_path / "ttyUSB7").mkdir()
    (tmp_path / "ttyUSB7" / "latency_timer").write_text("16\n")
    assert latency_ms("/dev/ttyUSB7") == 16
    assert latency_ms("/dev/ttyUSB8") is None
    assert "latency_timer" in Port("/dev/ttyUSB7", "", 16).advice
    assert not Port("/dev/ttyUSB7", "", 1).advice
    assert all(port.path for port in serial_ports())
