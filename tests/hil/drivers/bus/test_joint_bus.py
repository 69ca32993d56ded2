"""Joints in SI units over a bus of servos, whole or not."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from test_servo_bus import works
from virtual_servos import VirtualServos

from highfive.hil.drivers.bus.joint_bus import JointBus
from highfive.hil.drivers.bus.rig import COUNTS, DEFAULT_RIG, PROFILE, Rig, count
from highfive.hil.drivers.bus.rig_setup import configure, differences, missing_servos, read_back, shadow_gaps
from highfive.hil.drivers.bus.servo_bus import NoAnswer, ServoBus
from highfive.hil.drivers.values import JointCommand
from highfive.model.errors import HighFiveError

HALF = np.full(6, 0.5)


@pytest.fixture
def joints(bus: ServoBus, rig: Rig) -> JointBus:
    joints = JointBus(bus, rig)
    joints.prepare()
    return joints


def run(servos: VirtualServos, joints: JointBus, goal: np.ndarray, cycles: int = 150):
    for _ in range(cycles):
        state, sent = joints.cycle(JointCommand(goal, HALF))
        servos.sleep(0.004)
    return state, sent


def watched(bus: ServoBus, rig: Rig) -> JointBus:
    """The joints with torque on and watchdogs of 80 ms armed."""
    joints = JointBus(bus, replace(rig, settings=replace(rig.settings, watchdog=0.08)))
    joints.prepare()
    joints.engage()
    joints.arm_watchdog()
    return joints


def test_joints_go_where_they_are_told_each_its_own_way(
    servos: VirtualServos, joints: JointBus, bus: ServoBus, rig: Rig
) -> None:
    joints.engage()
    goal = np.array([0.3, -0.2, 0.1, -0.4, 0.25, 0.5])
    state, sent = run(servos, joints, goal)
    assert state.answered.all()
    np.testing.assert_allclose(state.positions, goal, atol=0.02)
    assert sent is not None
    assert np.abs(sent.positions - goal).max() <= np.pi / 4096  # to half a count
    for joint, position in zip(rig.joints, state.positions, strict=True):
        for servo in joint.ids:  # a shadow goes with its leader
            assert abs(bus.read(servo, "present_position") - count(joint, position)) <= 3
    health = joints.health()
    hot, volts = health.temperatures, health.voltages
    assert (hot > 20.0).all()
    assert (volts > 11.0).all()


def test_what_is_no_goal_is_not_sent(joints: JointBus) -> None:
    joints.engage()
    for bad in (np.nan, np.inf, 1e9):
        with pytest.raises(HighFiveError, match="waist"):
            joints.write(JointCommand(np.array([bad, 0, 0, 0, 0, 0.0]), HALF))
    state, sent = joints.cycle(JointCommand(np.zeros(6), np.full(6, 1e3)))
    assert sent is not None
    assert sent.currents.max() <= 3.51  # the rig's own limits hold
    assert np.abs(state.positions).max() < 0.01


def test_one_answer_that_does_not_come_keeps_nobody_from_being_switched_on(servos: VirtualServos, rig: Rig) -> None:
    bus = ServoBus(servos.port, rig.baud_rate, rig.models, wiring=servos.wiring)
    joints = JointBus(bus, rig)
    joints.prepare()
    servos.hold_s = 12e-3
    servos.later(2e-3, lambda: setattr(servos, "hold_s", 0.0))
    assert joints.engage().answered.all()
    assert joints.fallbacks > 0
    bus.close()


def test_one_dead_servo_costs_its_own_joint_only(joints: JointBus, servos: VirtualServos) -> None:
    joints.engage()
    run(servos, joints, np.zeros(6), 5)
    servos.set_faults("dead=4")
    servos.until(lambda: joints.cycle(JointCommand(np.full(6, 0.1), HALF))[0] is not None and joints.dead == (4,))
    state, _ = run(servos, joints, np.full(6, 0.1))
    assert state.answered.tolist() == [True, True, False, True, True, True]
    np.testing.assert_allclose(np.delete(state.positions, 2), 0.1, atol=0.02)
    assert joints.fallbacks >= 1
    with pytest.raises(HighFiveError, match="elbow: no answer; nothing is switched on"):
        joints.engage()
    servos.set_faults()
    assert joints.engage().answered.all()  # it is asked again, though it was taken for dead


def test_a_single_hiccup_kills_nobody(joints: JointBus, servos: VirtualServos) -> None:
    joints.engage()
    servos.set_faults("half:0.05")
    for _ in range(100):
        joints.cycle(JointCommand(np.zeros(6), HALF))
    servos.set_faults()
    state, _ = run(servos, joints, np.zeros(6), 20)
    assert joints.dead == ()
    assert state.answered.all()


@pytest.mark.parametrize("late_ms", [7, 10, 16, 33])
def test_a_state_that_comes_late_is_never_the_cycles_own(servos: VirtualServos, rig: Rig, late_ms: int) -> None:
    bus = ServoBus(servos.port, rig.baud_rate, rig.models, wiring=servos.wiring)
    joints = JointBus(bus, rig)
    servos.until(lambda: works(joints.prepare, NoAnswer))

    def cycles(count: int) -> int:
        whole, due = 0, servos.now_s
        for _ in range(count):
            due = max(due + 1 / 120, servos.now_s)
            servos.sleep(max(0.0, due - servos.now_s))
            asked = servos.now_s
            state = joints.read()
            if state.answered.any():
                # A servo's clock counts ms, against its quickest answer so far: half a cycle is distinguished.
                assert servos.newest_s > asked - 0.5 / 120
            whole += bool(state.answered.all())
        return whole

    assert cycles(40) > 5
    servos.hold_s = 1e-3 * late_ms
    cycles(20)
    servos.hold_s = 0.0
    servos.sleep(0.1)
    servos.until(lambda: works(joints.prepare, NoAnswer))
    assert cycles(40) > 5
    bus.close()


def test_hardware_errors_come_with_the_cycle(joints: JointBus, servos: VirtualServos) -> None:
    joints.engage()
    servos.set_faults("overload=3")  # the shadow's is the joint's
    servos.until(lambda: joints.read().errors[1] != 0)
    assert joints.read().errors.tolist() == [0, 1 << 5, 0, 0, 0, 0]


def test_a_silent_host_is_stopped_by_the_watchdogs(
    servos: VirtualServos, joints: JointBus, bus: ServoBus, rig: Rig
) -> None:
    wary = JointBus(bus, replace(rig, settings=replace(rig.settings, watchdog=0.08)))
    wary.engage()
    wary.arm_watchdog()
    wary.cycle(JointCommand(np.full(6, 0.5), HALF))
    servos.sleep(0.3)
    assert bus.read(1, "bus_watchdog") == 255 or bus.read(1, "bus_watchdog") == -1
    stopped = joints.read().positions
    servos.sleep(0.1)
    np.testing.assert_allclose(joints.read().positions, stopped, atol=0.01)
    joints.arm_watchdog()
    state, _ = run(servos, joints, np.full(6, 0.2))
    np.testing.assert_allclose(state.positions, 0.2, atol=0.02)


def test_what_the_watchdogs_stopped_unseen_does_not_go_on_once_they_are_switched_off(
    servos: VirtualServos, bus: ServoBus, rig: Rig
) -> None:
    """The last cycle knew of servos on their way; they have stopped since, and refused to know a new goal."""
    wary = watched(bus, rig)
    wary.cycle(JointCommand(np.full(6, 1.0), HALF))
    servos.sleep(0.4)
    wary.disarm_watchdog(HALF)
    freed = wary.read()
    assert not freed.tripped.any()
    servos.sleep(0.4)
    later = wary.read()
    assert (later.positions < 0.9).all()
    np.testing.assert_allclose(later.positions, freed.positions, atol=0.02)


def test_watchdogs_that_are_armed_and_read_back_on_a_slow_line_trip_nobody(servos: VirtualServos, rig: Rig) -> None:
    """All of it takes far longer than a watchdog waits, and the servos count only what names them."""
    wary = replace(rig, settings=replace(rig.settings, watchdog=0.3))
    bus = ServoBus(servos.port, rig.baud_rate, rig.models, allowance_ms=250.0, wiring=servos.wiring)
    joints = JointBus(bus, wary)
    joints.prepare()
    joints.engage()
    servos.hold_s = 0.02
    joints.arm_watchdog()
    begun = servos.now_s
    held = read_back(bus, wary, joints.feed)
    assert servos.now_s - begun > 2.0
    state = joints.read()
    bus.close()
    assert state.answered.all() and not state.tripped.any()
    assert {registers["bus_watchdog"] for registers in held.values()} == {15}


def test_without_being_fed_they_do_trip(servos: VirtualServos, bus: ServoBus, rig: Rig) -> None:
    wary = watched(bus, rig)
    end = servos.now_s + 0.3
    while servos.now_s < end:  # the line is never silent, but says nothing to the others
        bus.read(1, "id")
    assert wary.read().tripped.tolist() == [False, True, True, True, True, True]


def test_who_is_freed_from_its_watchdog_has_its_profile_before_its_goal(
    servos: VirtualServos, bus: ServoBus, rig: Rig
) -> None:
    """The trip took it away; the rig wants none, and whatever somebody wrote meanwhile is not left there."""
    wary = watched(bus, rig)
    servos.sleep(0.3)
    assert wary.read().tripped.all()
    for servo in rig.servos:
        bus.write(servo, "profile_velocity", 3)
    wary.engage()
    assert not wary.read().tripped.any()
    assert {bus.read(servo, name) for servo in rig.servos for name in PROFILE} == {0}
    wary.arm_watchdog()
    state, _ = run(servos, wary, np.full(6, 0.2))
    np.testing.assert_allclose(state.positions, 0.2, atol=0.02)  # with that profile it would take a minute


def test_servos_that_hold_the_arm_are_not_set_anew(
    servos: VirtualServos, joints: JointBus, bus: ServoBus, rig: Rig
) -> None:
    joints.engage()
    JointBus(bus, rig).prepare()  # as an earlier session left them: nothing to write
    bus.write(4, "position_p_gain", 800)
    before = {servo: bus.read(servo, "indirect_address_1") for servo in rig.servos}
    with pytest.raises(
        HighFiveError, match=r"servo 4 \(elbow\): its torque is on and position_p_gain is 800, not 2400"
    ):
        JointBus(bus, rig).prepare()
    bus.write(4, "position_p_gain", 2400)
    bus.write(1, "torque_enable", 0)
    bus.write(1, "profile_velocity", 9)
    bus.write(5, "indirect_address_1", 65)
    with pytest.raises(
        HighFiveError, match=r"servo 5 \(elbow\).*indirect_address_1 is 65.*highfive rig release virtual"
    ):
        JointBus(bus, rig).prepare()
    assert bus.read(1, "profile_velocity") == 9  # nobody was written to
    bus.write(5, "indirect_address_1", before[5])
    JointBus(bus, rig).prepare()
    assert bus.read(1, "profile_velocity") == 0 and bus.read(1, "torque_enable") == 0


def test_release_lets_go(joints: JointBus, bus: ServoBus, rig: Rig) -> None:
    joints.engage()
    assert joints.release() == []
    assert not any(bus.read(servo, "torque_enable") for servo in rig.models)


def test_settings_are_compared_and_written(bus: ServoBus, rig: Rig) -> None:
    assert differences(bus, rig) == []
    bus.write(2, "drive_mode", 4)
    bus.write(8, "return_delay_time", 250)
    found = differences(bus, rig)
    assert {(one.servo, one.register) for one in found} == {(2, "drive_mode"), (8, "return_delay_time")}
    assert "servo 8 (wrist_rotate): return_delay_time is 250 (0.5 ms), not 0 (0 ms)" in map(str, found)
    configure(bus, rig, found)
    assert differences(bus, rig) == []
    bus.write(1, "torque_enable", 1)
    with pytest.raises(HighFiveError, match="torque is on"):
        configure(bus, rig, found)


def test_servos_that_confirm_nothing_are_set_as_well(bus: ServoBus, rig: Rig) -> None:
    bus.write(4, "return_delay_time", 250)
    bus.write(4, "drive_mode", 4)
    bus.write(4, "status_return_level", 1)
    configure(bus, rig, found := differences(bus, rig))
    assert {one.register for one in found} == {"return_delay_time", "drive_mode", "status_return_level"}
    assert differences(bus, rig) == []


def test_missing_double_and_other_servos_are_reported(bus: ServoBus, rig: Rig, servos: VirtualServos) -> None:
    assert missing_servos(bus, rig) == []
    servos.set_faults("dead=7,twice=6")

    def gone() -> bool:
        try:
            bus.read(7, "id")
        except NoAnswer:
            return True
        return False

    servos.until(gone)
    troubles = missing_servos(bus, rig)
    assert len(troubles) == 2
    assert "servo 6 (forearm_roll)" in troubles[0] and "two servos" in troubles[0]
    assert "servo 7 (wrist_angle): no answer" in troubles[1]


def test_where_nobody_answers_one_line_says_so(bus: ServoBus, rig: Rig, servos: VirtualServos) -> None:
    servos.set_faults(",".join(f"dead={servo}" for servo in rig.servos))
    servos.until(lambda: len(missing_servos(bus, rig)) == 1)
    assert "no servo answers" in missing_servos(bus, rig)[0]


def test_an_offset_of_the_second_servo_is_found_set_and_gone(bus: ServoBus, rig: Rig, servos: VirtualServos) -> None:
    """What the line proposes makes both servos of the joint say the same."""
    most = 8.5 * math.tau / COUNTS
    servos.set_faults("slip=5:-6")
    servos.until(lambda: shadow_gaps(bus, rig, most) != [])
    (line,) = shadow_gaps(bus, rig, most)
    proposed = re.search(r"shadow_offset = (-?\d+)", line)
    assert (
        "elbow: servos 4 and 5 stand 68 counts apart (6.0°), at most 8: look at the horns first" in line
        and proposed is not None
    )
    assert f"into {DEFAULT_RIG} ([[joints]] of elbow)" in line
    own = [replace(joint, shadow_offset=int(proposed[1])) if joint.id == 4 else joint for joint in rig.joints]
    offset = replace(rig, joints=tuple(own))
    configure(bus, offset, differences(bus, offset))
    assert bus.read(5, "homing_offset") == int(proposed[1]) and bus.read(4, "homing_offset") == 0
    assert shadow_gaps(bus, offset, most) == []
    servos.set_faults()
    servos.until(lambda: shadow_gaps(bus, offset, most) != [])
