"""An emulated servo against the rules that the maker's manual states."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from highfive.hil.drivers.bus.control_table import decode, encode, load_table, models, to_si
from highfive.hil.drivers.bus.instruction_packets import CLEAR_POSITION
from highfive.hil.drivers.bus.packet import Instruction, Packet
from highfive.hil.drivers.emulator.emulated_servo import BOOT_NS, EmulatedServo
from highfive.hil.drivers.emulator.servo_instructions import obey
from highfive.hil.drivers.emulator.simple_plant import SimplePlant
from highfive.hil.drivers.servo_errors import OVERHEATING, OVERLOAD, VOLTAGE_ERROR, Error

STEP_NS = 1_000_000
BIG = load_table("XM540-W270")


class Bench:
    """One servo on an inertia, with a hand on its clock."""

    def __init__(self, model: str = "XM540-W270", load: float = 0.0, inertia: float = 0.05, **registers: int):
        self.servo = EmulatedServo(load_table(model), registers)
        self.plant, self.load = SimplePlant(1, inertia), load
        self.now, self.at = 0, (np.zeros(1), np.zeros(1))
        self.course: list[tuple[float, float, float]] = []

    def run(self, seconds: float, *, talk: bool = True) -> "Bench":
        for _ in range(round(seconds * 1e3)):
            if talk:
                self.servo.heard(self.now)
            torque = self.servo.step(float(self.at[0][0]), float(self.at[1][0]), self.now, 1e-3)
            self.at = self.plant.step(np.array([torque + self.load]), 1e-3)
            self.course.append((float(self.at[0][0]), float(self.at[1][0]), self.servo.motion.current))
            self.now += STEP_NS
        return self

    def put(self, name: str, raw: int) -> Error:
        register = self.servo.table[name]
        return self.servo.write(register.address, encode(register, raw), self.now)

    def get(self, name: str) -> int:
        register = self.servo.table[name]
        error, data = self.servo.read(register.address, register.size)
        assert not error
        return decode(register, data)


def on(mode: int, **rest) -> Bench:
    bench = Bench(operating_mode=mode, **rest)
    bench.run(0.01)
    assert bench.put("torque_enable", 1) == Error.NONE
    return bench


@settings(max_examples=300)
@given(st.sampled_from(models()), st.integers(0, 700), st.binary(min_size=1, max_size=30), st.booleans())
def test_a_write_does_all_of_it_or_nothing(model: str, address: int, data: bytes, torque: bool) -> None:
    bench = Bench(model)
    bench.put("torque_enable", int(torque))
    before = dict(bench.servo.values)
    error = bench.servo.write(address, data, 0)
    if error:
        assert bench.servo.values == before
    else:
        for register in bench.servo.table:
            if register.address >= address and register.end <= address + len(data):
                assert register.writable and not (register.eeprom and torque)


@pytest.mark.parametrize("model", models())
def test_eeprom_is_locked_while_torque_is_on(model: str) -> None:
    bench = Bench(model)
    bench.put("torque_enable", 1)
    for register in bench.servo.table:
        if register.writable and register.eeprom:
            assert bench.put(register.name, register.initial or 0) == Error.ACCESS
    bench.put("torque_enable", 0)
    assert bench.put("return_delay_time", 0) == Error.NONE


@pytest.mark.parametrize("mode", [3, 4, 5])
def test_it_goes_to_its_goal(mode: int) -> None:
    bench = on(mode, position_p_gain=800)
    assert bench.put("goal_position", 3000) == Error.NONE
    bench.run(3.0)
    assert bench.get("present_position") == pytest.approx(3000, abs=12)
    assert bench.get("moving") == 0 and bench.get("moving_status") & 1
    assert bench.at[0][0] == pytest.approx(to_si(BIG["goal_position"], 3000 - 2048), abs=0.02)
    assert max(abs(speed) for _, speed, _ in bench.course) <= BIG.motor.no_load_speed + 1e-6


def test_a_profile_is_followed_and_told() -> None:
    bench = on(3)
    assert bench.put("profile_velocity", 50) == Error.NONE and bench.put("profile_acceleration", 10) == Error.NONE
    bench.put("goal_position", 3048)
    bench.run(0.4)
    assert bench.get("moving") == 1 and bench.get("moving_status") & 0x32 == 0x32
    assert bench.get("velocity_trajectory") == pytest.approx(50, abs=1)
    expected = to_si(BIG["profile_velocity"], 50)
    assert bench.course[-1][1] == pytest.approx(expected, rel=0.1)
    bench.run(3.0)
    assert bench.get("moving") == 0 and bench.get("position_trajectory") == 3048


def test_a_time_based_profile_takes_its_time() -> None:
    bench = on(3, drive_mode=4)
    bench.put("profile_velocity", 1000), bench.put("profile_acceleration", 300)
    bench.put("goal_position", 3048)
    bench.run(0.98)
    assert bench.get("moving_status") & 2
    bench.run(0.05)
    assert not bench.get("moving_status") & 2 and bench.get("position_trajectory") == 3048


def test_velocity_mode() -> None:
    bench = on(1)
    bench.put("goal_velocity", -60)
    bench.run(3.0)
    assert bench.get("present_velocity") == pytest.approx(-60, abs=3)
    assert bench.put("goal_velocity", 129) == Error.DATA_LIMIT


def test_current_mode_pushes_as_hard_as_it_is_commanded() -> None:
    bench = on(0, load=0.0, inertia=1e6)
    bench.put("goal_current", 400)
    bench.run(0.1)
    assert bench.get("present_current") == 400
    torque = bench.servo.step(0.0, 0.0, bench.now, 1e-3)
    assert torque == pytest.approx(400 * 0.00269 / 4.4 * 10.6, rel=1e-6)


def test_pwm_mode_runs_to_the_speed_of_its_voltage() -> None:
    bench = on(16)
    bench.put("goal_pwm", 885)
    bench.run(3.0)
    assert bench.course[-1][1] == pytest.approx(math.pi, rel=0.02)
    bench.put("goal_pwm", -442)
    bench.run(3.0)
    assert bench.course[-1][1] == pytest.approx(-math.pi / 2, rel=0.04)


def test_current_based_position_yields() -> None:
    """Pushed harder than its goal current it gives way; pushed less it stays near its goal."""
    strongest = 10.6 * 0.2 * 2.69 / 4.4  # N·m at 200 counts
    for push, gives in ((0.7 * strongest, False), (1.6 * strongest, True)):
        bench = on(5, load=push)
        bench.put("goal_current", 200)
        bench.run(1.0)
        assert (bench.at[0][0] > 0.5) == gives
        assert max(abs(current) for _, _, current in bench.course) <= 200 * 0.00269 + 1e-9


def test_the_torque_speed_line() -> None:
    """Against a load it stands still at the stall torque and runs at half speed at half of it."""
    for share in (0.25, 0.5, 0.75):
        bench = on(16, load=-share * 10.6)
        bench.put("goal_pwm", 885)
        bench.run(4.0)
        assert bench.course[-1][1] == pytest.approx(math.pi * (1 - share), abs=0.05)


def test_the_bus_watchdog_as_the_manual_tells_it() -> None:
    bench = on(1)
    bench.put("profile_acceleration", 20)
    bench.put("profile_velocity", 100)
    bench.put("goal_velocity", 50)
    bench.run(0.5)
    assert bench.put("bus_watchdog", 4) == Error.NONE
    bench.run(0.5)
    assert bench.get("bus_watchdog") == 4 and bench.get("present_velocity") > 40
    trip = bench.now
    bench.run(0.5, talk=False)
    assert bench.servo.watchdog_trips == 1 and bench.get("bus_watchdog") == -1
    stopped = next(n for n, (_, speed, _) in enumerate(bench.course) if n * STEP_NS > trip and abs(speed) < 0.05)
    assert stopped * STEP_NS - trip < 200_000_000
    assert bench.get("present_velocity") == 0 and bench.get("torque_enable") == 1
    assert bench.get("profile_acceleration") == bench.get("profile_velocity") == 0
    for name in ("goal_velocity", "goal_position", "goal_current", "goal_pwm"):
        assert bench.put(name, 10) == Error.DATA_RANGE
    assert bench.put("bus_watchdog", 5) == Error.DATA_RANGE and bench.put("led", 1) == Error.NONE
    assert bench.put("bus_watchdog", 0) == Error.NONE and bench.put("goal_velocity", 50) == Error.NONE
    bench.run(0.5)
    assert bench.get("present_velocity") > 40


def test_who_clears_the_watchdog_moves_without_the_profile_that_it_had() -> None:
    """A tenth of a turn: 6 s at the profile's velocity, a fraction of that without."""
    for cleared in (False, True):
        bench = on(5)
        bench.put("profile_velocity", 4)
        if cleared:
            bench.put("bus_watchdog", 4)
            bench.run(0.2, talk=False)
            assert bench.put("bus_watchdog", 0) == Error.NONE
        bench.put("goal_position", bench.get("present_position") + 400)
        bench.run(1.0)
        assert (bench.at[0][0] > 0.5) == cleared


def test_the_watchdog_needs_torque_and_stops_within_its_time() -> None:
    bench = Bench(operating_mode=5)
    bench.put("bus_watchdog", 4)
    bench.run(1.0, talk=False)
    assert bench.get("bus_watchdog") == 4
    bench.put("torque_enable", 1)
    bench.run(0.079, talk=False)
    assert bench.get("bus_watchdog") == 4
    bench.run(0.003, talk=False)
    assert bench.get("bus_watchdog") == -1


def test_indirect_data_is_what_it_points_at() -> None:
    bench = Bench()
    for n, address in enumerate([65, 116, 117, 118, 119]):
        assert bench.servo.write(168 + 2 * n, address.to_bytes(2, "little"), 0) == Error.NONE
    assert bench.servo.write(224, b"\1" + (1024).to_bytes(4, "little"), 0) == Error.NONE
    assert (bench.get("led"), bench.get("goal_position")) == (1, 1024)
    assert bench.servo.write(225, b"\0\0", 0) == Error.DATA_LENGTH
    assert bench.servo.write(224, b"\2", 0) == Error.DATA_RANGE
    assert bench.servo.write(168, (11).to_bytes(2, "little"), 0) == Error.DATA_RANGE, "EEPROM cannot be pointed at"
    assert bench.put("led", 0) == Error.NONE and bench.servo.read(224, 1) == (Error.NONE, b"\0")
    assert bench.servo.write(230, b"\x2a", 0) == Error.NONE and bench.servo.read(230, 1) == (Error.NONE, b"\x2a")


@pytest.mark.parametrize(
    ("cause", "bit", "off"), [("overload", OVERLOAD, True), ("hot", OVERHEATING, True), ("dim", VOLTAGE_ERROR, False)]
)
def test_protection_and_shutdown(cause: str, bit: int, off: bool) -> None:
    """Shutdown is 52 from the factory: overload, shock and overheating switch the torque off, voltage does not."""
    bench = on(3)
    if cause == "overload":
        bench.load, bench.plant = 0.0, SimplePlant(1, 1e6)
        bench.put("goal_position", 4000)
    elif cause == "hot":
        bench.servo.hot = 85.0
    else:
        bench.servo.power(9.0, bench.now)
    bench.run(3.0)
    assert bench.get("hardware_error_status") == bit and bench.servo.alert
    assert bench.get("torque_enable") == (0 if off else 1)
    assert bench.put("torque_enable", 1) == (Error.RESULT_FAIL if off else Error.NONE)
    bench.servo.hot, bench.servo.voltage = None, 12.0
    bench.servo.reboot(bench.now)
    assert bench.get("hardware_error_status") == 0 and not bench.servo.alert


def test_it_warms_up_and_cools_down() -> None:
    bench = on(0, inertia=1e6, shutdown=0)
    bench.put("goal_current", 1600)
    start = bench.servo.motion.temperature
    bench.run(10.0)
    hot = bench.servo.motion.temperature
    assert start + 2.0 < hot < start + 10.0
    bench.put("torque_enable", 0)
    bench.run(5.0)
    assert bench.servo.motion.temperature < hot


def test_reverse_turns_the_other_way_and_counts_the_same() -> None:
    for reverse in (0, 1):
        bench = on(3, drive_mode=reverse)
        bench.put("goal_position", 2500)
        bench.run(3.0)
        assert bench.get("present_position") == pytest.approx(2500, abs=12)
        assert math.copysign(1, bench.at[0][0]) == (-1 if reverse else 1)
        bench.put("goal_position", 2000)
        bench.run(0.2)
        assert bench.get("present_velocity") < 0 and bench.get("present_pwm") < 0


def test_torque_by_goal_update() -> None:
    bench = Bench(drive_mode=8)
    assert bench.put("goal_position", 2300) == Error.NONE
    assert bench.get("torque_enable") == 1
    bench.run(2.0)
    assert bench.get("present_position") == pytest.approx(2300, abs=12)
    bench = Bench()
    bench.put("goal_position", 2300)
    assert bench.run(1.0).get("present_position") == 2048


def test_homing_offset_is_added() -> None:
    assert Bench(homing_offset=500).run(0.01).get("present_position") == 2548
    assert Bench(homing_offset=5000).run(0.01).get("present_position") == 2048, "one turn takes only a quarter"
    assert Bench(homing_offset=5000, operating_mode=4).run(0.01).get("present_position") == 7048


def test_turns_are_forgotten_by_clear_and_by_reboot() -> None:
    bench = on(4)
    bench.put("goal_position", 2048 + 2 * 4096)
    bench.run(0.5)
    assert obey(bench.servo, Packet(1, Instruction.CLEAR, CLEAR_POSITION), bench.now)[0] == Error.RESULT_FAIL
    bench.run(9.0)
    assert bench.get("present_position") == pytest.approx(2048 + 2 * 4096, abs=12)
    assert obey(bench.servo, Packet(1, Instruction.CLEAR, CLEAR_POSITION), bench.now)[0] == Error.NONE
    assert bench.get("present_position") == pytest.approx(2048, abs=12)
    assert obey(bench.servo, Packet(1, Instruction.CLEAR, b"\2"), bench.now)[0] == Error.DATA_RANGE


def test_reboot_keeps_the_eeprom_alone() -> None:
    bench = Bench(return_delay_time=7, bus_watchdog=4, led=1)
    assert (bench.get("bus_watchdog"), bench.get("led")) == (4, 1)
    bench.servo.reboot(bench.now)
    assert not bench.servo.listening(bench.now) and bench.servo.listening(bench.now + BOOT_NS)
    assert (bench.get("bus_watchdog"), bench.get("led"), bench.get("return_delay_time")) == (0, 0, 7)
    assert bench.servo.factory_reset(1, bench.now) == Error.NONE
    assert bench.get("return_delay_time") == 250
    assert bench.servo.factory_reset(3, bench.now) == Error.DATA_RANGE


def test_a_new_mode_resets_what_the_manual_says() -> None:
    bench = Bench(position_p_gain=400, profile_velocity=50, operating_mode=3)
    assert bench.put("goal_current", 10) == Error.NONE
    assert bench.put("operating_mode", 5) == Error.NONE
    assert [bench.get(n) for n in ("position_p_gain", "profile_velocity", "goal_current", "goal_pwm")] == [
        800,
        0,
        2047,
        885,
    ]
    assert Bench("XL430-W250").put("operating_mode", 5) == Error.DATA_RANGE


@given(st.integers(0, 255), st.binary(max_size=20))
def test_any_instruction_is_obeyed_or_refused(instruction: int, parameters: bytes) -> None:
    error, data = obey(Bench().servo, Packet(1, instruction, parameters), 0)
    assert error in set(Error) and isinstance(data, bytes)
    if instruction == Instruction.CONTROL_TABLE_BACKUP or instruction not in set(Instruction):
        assert error == Error.INSTRUCTION
