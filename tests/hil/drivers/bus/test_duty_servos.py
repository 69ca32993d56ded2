"""A servo that cannot limit its current limits its duty: at the wire, of the WidowX's last joint."""

from collections.abc import Iterator

import numpy as np
import pytest
from virtual_servos import VirtualServos

from highfive.hil.arm.arm_files import rig_file, rig_of
from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.drivers.bus.control_table import load_table
from highfive.hil.drivers.bus.joint_bus import JointBus
from highfive.hil.drivers.bus.rig_setup import differences
from highfive.hil.drivers.bus.servo_bus import ServoBus
from highfive.hil.drivers.emulator.emulator_process import EmulatorOptions
from highfive.hil.drivers.values import JointCommand
from highfive.hil.runtime.virtual_clock import VirtualClock

STALL_A, STALL_NM = 1.4, 1.5  # the maker's page of the XL430-W250, at 12 V


@pytest.fixture
def widow() -> Iterator[tuple[VirtualServos, ServoBus, JointBus]]:
    rig = rig_of(find_arm("wx250s"))
    with VirtualClock() as clock:
        servos = VirtualServos(clock, EmulatorOptions(rig=str(rig_file(find_arm("wx250s")))))
        bus = ServoBus(servos.port, rig.baud_rate, rig.models, wiring=servos.wiring)
        assert differences(bus, rig) == []
        joints = JointBus(bus, rig)
        joints.prepare()
        yield servos, bus, joints


@pytest.mark.parametrize("ampere", [0.2, 0.5, 0.9])
def test_it_pushes_no_harder_than_its_current_says(
    widow: tuple[VirtualServos, ServoBus, JointBus], ampere: float
) -> None:
    """Its goal is out of reach (its horn is held), so that it gives all that it may."""
    servos, bus, joints = widow
    joints.engage()
    last = rig_of(find_arm("wx250s")).joints[-1].id
    emulated = next(one for one in servos.rig.bus.servos if one.id == last)
    for _ in range(60):
        _, sent = joints.cycle(JointCommand(np.array([0.0] * 5 + [1.5]), np.full(6, ampere)))
        servos.sleep(0.004)
    assert sent is not None and sent.currents[-1] == pytest.approx(ampere, abs=0.001)
    now = servos.clock.now()
    torque = emulated.step(0.0, 0.0, now, 0.001)
    assert torque == pytest.approx(ampere / STALL_A * STALL_NM, rel=0.01)
    assert bus.read(last, "goal_pwm") == round(ampere / STALL_A / 0.00113)


@pytest.mark.parametrize(("volts", "share"), [(13.5, 12.0 / 13.5), (11.2, 1.0)])
def test_it_pushes_no_harder_with_more_voltage(
    widow: tuple[VirtualServos, ServoBus, JointBus], volts: float, share: float
) -> None:
    """Duty is a share of the supply, and what it draws goes by volts: with less it pushes less, never more."""
    servos, bus, joints = widow
    last = rig_of(find_arm("wx250s")).joints[-1].id
    emulated = next(one for one in servos.rig.bus.servos if one.id == last)
    emulated.voltage = volts
    joints.engage()
    for _ in range(60):
        _, sent = joints.cycle(JointCommand(np.array([0.0] * 5 + [1.5]), np.full(6, 0.5)))
        servos.sleep(0.004)
    assert sent is not None and sent.currents[-1] == pytest.approx(0.5, abs=0.002)
    assert bus.read(last, "goal_pwm") == pytest.approx(share * 0.5 / STALL_A / 0.00113, abs=1)
    torque = emulated.step(0.0, 0.0, servos.clock.now(), 0.001)
    assert torque == pytest.approx(min(1.0, volts / 12.0) * 0.5 / STALL_A * STALL_NM, rel=0.01)


def test_what_it_says_of_its_load_is_a_current() -> None:
    table = load_table("XL430-W250")
    assert table.ampere("present_current").name == "present_load" and not table.limits_current
    assert table.ampere("present_current").scale == pytest.approx(1e-3 * STALL_A)
    other = load_table("XM430-W350")
    assert other.ampere("goal_current") is other["goal_current"] and other.limits_current
