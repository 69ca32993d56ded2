"""Servos that take goals and show answers in different places, on one bus: the Koch's, XL430 and XL330, at the wire."""

from collections.abc import Iterator

import numpy as np
import pytest
from virtual_servos import VirtualServos

from highfive.hil.arm.arm_files import rig_file, rig_of
from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.drivers.bus.control_table import load_table, models
from highfive.hil.drivers.bus.joint_bus import DEAD_AFTER, JointBus
from highfive.hil.drivers.bus.rig_setup import differences
from highfive.hil.drivers.bus.servo_bus import ServoBus
from highfive.hil.drivers.emulator.bus_faults import parse_faults
from highfive.hil.drivers.emulator.emulator_process import EmulatorOptions
from highfive.hil.drivers.values import JointCommand
from highfive.hil.runtime.virtual_clock import VirtualClock

KOCH = find_arm("koch_v1_1")
AMPERE = np.full(5, 0.6)
Koch = tuple[VirtualServos, ServoBus, JointBus]


@pytest.fixture
def koch() -> Iterator[Koch]:
    rig = rig_of(KOCH)
    with VirtualClock() as clock:
        servos = VirtualServos(clock, EmulatorOptions(rig=str(rig_file(KOCH))))
        bus = ServoBus(servos.port, rig.baud_rate, rig.models, wiring=servos.wiring)
        assert differences(bus, rig) == []
        joints = JointBus(bus, rig)
        joints.prepare()
        yield servos, bus, joints


@pytest.mark.parametrize("model", models())
def test_goals_and_answers_lie_where_the_table_says(model: str) -> None:
    """What a write from the goals' address covers, register by register, and what is shown in the manual's window."""
    table = load_table(model)
    places, (current, position) = table.places, table.goals
    shown = sum(register.size for register in places.shown)
    window = range(table.indirect[0].data, table.indirect[0].data + table.indirect[0].count)
    assert places.answers in window and places.answers + sum(r.size for r in table.answers) - 1 in window
    assert shown <= len(window)
    if places.between:
        covered = [r for r in table if places.goals <= r.address < position.end]
        assert [r.name for r in covered] == [
            "goal_current", "goal_velocity", "profile_acceleration", "profile_velocity", "goal_position",
        ]  # fmt: skip
        assert all(r.writable and (r.minimum or 0) <= 0 for r in covered)
        assert current.end + places.between == position.address
    else:
        assert places.goals == window[0]


def test_all_go_where_they_are_sent_and_say_so(koch: Koch) -> None:
    servos, bus, joints = koch
    start = joints.engage().positions
    goals = start + np.array([0.2, 0.15, -0.1, 0.12, -0.2])
    for _ in range(250):
        state, sent = joints.cycle(JointCommand(goals, AMPERE))
        servos.sleep(0.006)
    assert sent is not None
    np.testing.assert_allclose(sent.positions, goals, atol=0.001)
    np.testing.assert_allclose(sent.currents, AMPERE, atol=0.003)
    assert state.answered.all() and joints.fallbacks == 0 and not state.errors.any()
    np.testing.assert_allclose(state.positions, goals, atol=0.06)
    there = [servos.rig.bus.body[0][rig_of(KOCH).joints.index(joint)] for joint in rig_of(KOCH).joints]
    np.testing.assert_allclose(state.positions, there, atol=0.01)
    assert [bus.read(servo, "goal_position") for servo in (1, 3)] == [
        2048 + round(goals[n] * 4096 / (2 * np.pi)) for n in (0, 2)
    ]
    assert bus.read(3, "profile_velocity") == 0 and bus.read(3, "goal_current") == 600
    np.testing.assert_allclose(joints.health().voltages, [12.0, 12.0, 5.0, 5.0, 5.0])


def test_a_silent_one_costs_the_others_nothing(koch: Koch) -> None:
    servos, _, joints = koch
    joints.engage()
    servos.rig.bus.add_faults(parse_faults(["dead=4@0-1000"]), servos.rig.now())
    for _ in range(DEAD_AFTER + 6):
        state = joints.read()
        servos.sleep(0.008)
    assert joints.dead == (4,)
    assert state.answered.tolist() == [True, True, True, False, True]


def test_watchdogs_are_fed_by_a_cycle_and_stop_them_without(koch: Koch) -> None:
    servos, _, joints = koch
    positions = joints.engage().positions
    joints.arm_watchdog()
    for _ in range(60):
        state, _ = joints.cycle(JointCommand(positions, AMPERE))
        servos.sleep(0.008)
    assert not state.tripped.any()
    servos.sleep(0.3)
    assert joints.read().tripped.all()
