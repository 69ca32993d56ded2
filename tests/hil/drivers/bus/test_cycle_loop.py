"""The driver's cycle in virtual time: what it sends, when it holds, how the arm is left, what a fault brings about."""

import linecache
import sys
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any

import numpy as np
import pytest
from virtual_servos import VirtualServos

from highfive.hil.commands.rig.service import check, print_check
from highfive.hil.drivers.bus.arm_host import ArmHost
from highfive.hil.drivers.bus.cycle_ring import CycleRing, Mode
from highfive.hil.drivers.bus.rig import Rig, angle, count, load_rig, required_registers
from highfive.hil.drivers.bus.servo_bus import ServoBus
from highfive.hil.drivers.emulator.virtual_rig import VirtualArm
from highfive.hil.drivers.values import JointCommand
from highfive.model.errors import HighFiveError

HALF = np.full(6, 0.5)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig()  # with the watchdogs that it has


@pytest.fixture
def arm(servos: VirtualServos, rig: Rig) -> Iterator[VirtualArm]:
    arm = servos.rig.start_arm(rig)
    arm.wait_ready(30.0)
    arm.engage()
    yield arm
    arm.close()


def drive_to(servos: VirtualServos, arm: VirtualArm, angle: float) -> None:
    def there() -> bool:
        arm.drive(JointCommand(np.full(6, angle), HALF))
        newest = arm.newest()
        return newest is not None and bool(np.allclose(newest.state.positions, angle, atol=0.03))

    servos.until(there)


def drive(servos: VirtualServos, arm: VirtualArm, angle: float, seconds: float) -> None:
    end = servos.now_s + seconds
    while servos.now_s < end:
        arm.drive(JointCommand(np.full(6, angle), HALF))
        servos.sleep(0.005)


def test_it_reads_and_nothing_is_switched_on_until_it_is_engaged(servos: VirtualServos, rig: Rig) -> None:
    arm = servos.rig.start_arm(rig)
    arm.wait_ready(30.0)
    drive(servos, arm, 0.3, 0.2)
    servos.until(lambda: (newest := arm.newest()) is not None and newest.number > 3)
    newest = arm.newest()
    assert newest is not None
    assert newest.mode is Mode.READING
    assert newest.sent is None
    arm.close()
    bus = ServoBus(servos.port, rig.baud_rate, rig.models, wiring=servos.wiring)
    assert not any(bus.read(servo, "torque_enable") for servo in rig.servos)
    bus.close()


def test_what_every_servo_is_set_to_is_read_back_when_it_is_engaged(servos: VirtualServos, rig: Rig) -> None:
    arm = servos.rig.start_arm(rig)
    arm.wait_ready(30.0)
    held = arm.engage()
    assert held == {servo: {**required, "torque_enable": 1} for servo, required in required_registers(rig).items()}
    servos.until(lambda: arm.mode is Mode.HOLDING)
    servos.sleep(0.3)
    assert arm.mode is Mode.HOLDING, arm.trouble  # it is read in every cycle, so no watchdog trips
    arm.close()


def test_a_servo_that_is_missing_is_reported_and_nothing_is_switched_on(servos: VirtualServos, rig: Rig) -> None:
    arm = servos.rig.start_arm(rig)
    arm.wait_ready(30.0)
    servos.set_faults(f"dead={rig.joints[1].id}")
    servos.until(lambda: (newest := arm.newest()) is not None and not newest.state.answered[1])
    with pytest.raises(HighFiveError, match=f"{rig.joints[1].name}: no answer; nothing is switched on"):
        arm.engage()
    arm.close()
    assert not any(servo.values["torque_enable"] for servo in servos.rig.bus.servos)


def test_a_bus_that_was_silent_stops_the_arm_and_says_so(servos: VirtualServos, arm: VirtualArm) -> None:
    """Servos whose watchdogs have stopped them refuse goals; the driver does not go on as if they took them."""
    drive_to(servos, arm, 0.3)
    arm.task.hold(servos.clock.now() + 400_000_000)
    servos.sleep(0.4)
    servos.until(lambda: arm.mode is Mode.STOPPED)
    assert "watchdog" in arm.trouble
    newest = arm.newest()
    assert newest is not None
    assert newest.state.tripped.all()


def test_what_the_watchdogs_have_stopped_is_freed_where_it_stands(
    servos: VirtualServos, rig: Rig, capsys: pytest.CaptureFixture[str]
) -> None:
    def started() -> VirtualArm:
        arm = servos.rig.start_arm(rig)
        arm.wait_ready(30.0)
        arm.engage()
        return arm

    first = started()
    drive_to(servos, first, 0.2)
    drive(servos, first, 0.6, 0.1)
    first.task.kill()
    servos.sleep(0.5)
    first.close()
    result = check(servos.port, None, servos.wiring)
    assert result["ready"]
    assert all(servo["stopped_by_watchdog"] for servo in result["servos"])
    print_check(result)
    assert "the watchdog has stopped servos 1, 2, 3, 4, 5, 6, 7, 8" in capsys.readouterr().out
    again = started()
    cycles = again.unread()
    positions = np.array([cycle.state.positions for cycle in cycles])
    np.testing.assert_allclose(positions, positions[:1].repeat(len(positions), 0), atol=0.02)
    assert cycles[0].state.tripped.all()
    servos.until(lambda: (newest := again.newest()) is not None and not newest.state.tripped.any())
    assert again.mode is Mode.HOLDING
    assert not again.trouble
    drive_to(servos, again, 0.3)
    again.close()


def test_it_goes_where_it_is_commanded(servos: VirtualServos, arm: VirtualArm) -> None:
    drive_to(servos, arm, 0.3)
    assert arm.mode is Mode.DRIVING
    cycles = arm.unread()
    numbers = [cycle.number for cycle in cycles]
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    assert all(cycle.begun_ns >= cycle.due_ns for cycle in cycles)
    assert any(cycle.sent is not None for cycle in cycles)


@pytest.mark.parametrize("phase", [-0.4, -0.12, 0.0, 0.25, 0.5])
@pytest.mark.slow
def test_each_command_goes_out_once_whatever_the_phase_of_the_hosts_clock(
    servos: VirtualServos, arm: VirtualArm, phase: float
) -> None:
    """Where a cycle repeats a command, the next one goes two steps at once, at twice the speed."""
    period, count, step = 1.0 / 120.0, 240, 2.0 * 2.0 * np.pi / 4096  # rad: two counts of the servos
    drive_to(servos, arm, 0.2)
    arm.unread()
    newest = arm.newest()
    assert newest is not None
    start = 1e-9 * newest.due_ns + (2.0 + phase) * period
    angles = 0.2 + step * np.arange(count)
    for number, position in enumerate(angles):
        due = start + number * period + (0.0018 if number % 2 else 0.0002)  # what the host's tick takes, s
        servos.sleep(max(0.0, due - servos.now_s))
        arm.drive(JointCommand(np.full(6, position), HALF))
    sent = [cycle.sent.positions[0] for cycle in arm.unread() if cycle.sent is not None]
    steps = np.rint(np.diff([position for position in sent if position > angles[1]]) / step)
    assert len(steps) >= count - 5
    assert (steps[3:] == 1).all()


def test_a_host_that_stalls_is_held_and_goes_on(servos: VirtualServos, arm: VirtualArm) -> None:
    drive_to(servos, arm, 0.3)
    servos.until(lambda: arm.mode is Mode.HOLDING)
    held = arm.newest()
    servos.sleep(0.2)
    later = arm.newest()
    assert held is not None and later is not None
    np.testing.assert_allclose(later.state.positions, held.state.positions, atol=0.05)
    assert later.state.answered.all()  # the bus is not silent: no watchdog trips
    drive_to(servos, arm, 0.2)


def test_the_emergency_stop_is_the_last_motion(servos: VirtualServos, arm: VirtualArm) -> None:
    drive(servos, arm, 0.5, 0.2)
    arm.estop.pull()
    pulled = servos.clock.now()
    drive(servos, arm, 0.9, 0.3)  # whoever goes on asking is not heard
    assert arm.mode is Mode.STOPPED
    sent = [cycle for cycle in arm.unread() if cycle.sent is not None]
    last, *after = [cycle for cycle in sent if cycle.mode is Mode.STOPPED]
    assert sent[-1 - len(after)] is last
    hold = last.sent
    assert hold is not None
    assert (hold.positions < 0.51).all()
    assert all((cycle.sent.positions == hold.positions).all() for cycle in after if cycle.sent is not None)
    assert 0 <= last.begun_ns - pulled < 10_000_000
    newest = arm.newest()
    assert newest is not None
    np.testing.assert_allclose(newest.state.positions, hold.positions, atol=0.05)


def test_an_arm_that_was_stopped_brakes_with_full_current_and_then_yields(
    arm: VirtualArm, servos: VirtualServos, rig: Rig
) -> None:
    drive(servos, arm, 0.6, 0.15)
    arm.unread()
    arm.estop.pull()
    servos.until(lambda: arm.mode is Mode.STOPPED)
    servos.sleep(0.5)
    hold, *lowered = [cycle.sent for cycle in arm.unread() if cycle.mode is Mode.STOPPED and cycle.sent is not None]
    assert (hold.currents > 1.0).all()
    assert len(lowered) == 1
    np.testing.assert_array_equal(lowered[0].positions, hold.positions)  # that moved nothing
    np.testing.assert_allclose(lowered[0].currents, HALF, atol=0.002)
    newest = arm.newest()
    assert newest is not None
    np.testing.assert_allclose(newest.state.positions, hold.positions, atol=0.05)
    arm.close()
    bus = ServoBus(servos.port, rig.baud_rate, rig.models, wiring=servos.wiring)
    held = {bus.read(servo, "goal_current") for servo in rig.servos}
    bus.close()
    assert all(abs(2.69e-3 * current - 0.5) < 0.002 for current in held)


@pytest.mark.parametrize("pull", [True, False])
def test_an_arm_that_is_left_while_it_moves_is_held_where_it_is_and_yields(
    pull: bool, arm: VirtualArm, servos: VirtualServos, rig: Rig
) -> None:
    drive(servos, arm, 0.6, 0.15)
    if pull:
        arm.estop.pull()
    arm.close()
    bus = ServoBus(servos.port, rig.baud_rate, rig.models, wiring=servos.wiring)
    held = {bus.read(servo, "goal_current") for servo in rig.servos}
    goals = [angle(joint, bus.read(joint.id, "goal_position")) for joint in rig.joints]
    watched = [bus.read(servo, "bus_watchdog") for servo in rig.servos]
    bus.close()
    assert all(abs(2.69e-3 * current - 0.5) < 0.002 for current in held)
    assert all(goal < 0.59 for goal in goals)  # not the last command's
    assert not any(watched)


def test_an_arm_that_stands_where_it_was_told_is_left_with_that_goal(
    arm: VirtualArm, servos: VirtualServos, rig: Rig
) -> None:
    """With the place where it is as its goal it would sag further, each time that it is left."""
    drive(servos, arm, 0.3, 1.5)
    arm.close()
    bus = ServoBus(servos.port, rig.baud_rate, rig.models, wiring=servos.wiring)
    goals = [bus.read(joint.id, "goal_position") for joint in rig.joints]
    held = {bus.read(servo, "goal_current") for servo in rig.servos}
    bus.close()
    assert goals == [count(joint, 0.3) for joint in rig.joints]
    assert all(abs(2.69e-3 * current - 0.5) < 0.002 for current in held)


def test_an_arm_that_is_kept_from_its_goal_is_left_where_it_is(
    arm: VirtualArm, servos: VirtualServos, rig: Rig
) -> None:
    """As by a hand: here by having no current. It shall not go on to its goal once the way is free."""
    drive(servos, arm, 0.0, 0.3)
    end = servos.now_s + 0.5
    while servos.now_s < end:
        arm.drive(JointCommand(np.full(6, 0.2), np.zeros(6)))
        servos.sleep(0.005)
    arm.close()
    bus = ServoBus(servos.port, rig.baud_rate, rig.models, wiring=servos.wiring)
    goals = [angle(joint, bus.read(joint.id, "goal_position")) for joint in rig.joints]
    bus.close()
    assert max(np.abs(goals)) < 0.1


def test_an_arm_that_falls_silent_before_it_is_left_is_left_in_time(
    arm: VirtualArm, servos: VirtualServos, rig: Rig
) -> None:
    drive(servos, arm, 0.3, 0.3)
    servos.set_faults(*(f"dead={servo}" for servo in rig.servos))
    begun = servos.now_s
    arm.close()
    assert servos.now_s - begun < 2.8  # it ended by itself: it was not killed
    assert not arm.trouble


class Interrupt(BaseException):
    pass


def interrupted(arm: VirtualArm, angle: float) -> None:
    """Gives a command and is interrupted in the midst of it, as by Ctrl-C."""
    half = 'head["drive"][0] = 1'

    def interrupt(frame: FrameType, event: str, argument: object) -> Callable[..., Any] | None:
        if frame.f_code in (ArmHost.drive.__code__, CycleRing.give.__code__):
            if event == "line" and linecache.getline(frame.f_code.co_filename, frame.f_lineno).strip() == half:
                raise Interrupt
            return interrupt
        return None

    sys.settrace(interrupt)
    try:
        with pytest.raises(Interrupt):
            arm.drive(JointCommand(np.full(6, angle), HALF))
    finally:
        sys.settrace(None)


def test_an_interrupt_in_the_midst_of_a_command_blinds_nobody(servos: VirtualServos, arm: VirtualArm) -> None:
    drive_to(servos, arm, 0.2)
    interrupted(arm, 0.9)
    servos.until(lambda: arm.mode is Mode.HOLDING)  # a command that is half written is none
    drive_to(servos, arm, 0.3)
    assert arm.mode is Mode.DRIVING
    interrupted(arm, 0.9)
    arm.estop.pull()
    pulled = servos.now_s
    servos.until(lambda: arm.mode is Mode.STOPPED, 2.0)
    stopped = [cycle for cycle in arm.unread() if cycle.mode is Mode.STOPPED]
    assert 1e-9 * stopped[0].begun_ns - pulled < 0.01
    assert all((cycle.sent.positions < 0.4).all() for cycle in stopped if cycle.sent is not None)
    begun = servos.now_s
    arm.close()
    assert servos.now_s - begun < 1.5  # it ended by itself: it was not killed


def test_a_lost_port_is_reported_and_found_again_but_not_driven(servos: VirtualServos, arm: VirtualArm) -> None:
    drive(servos, arm, 0.2, 0.2)
    servos.set_faults("unplug@0-1")
    servos.until(lambda: arm.mode is Mode.PORT_LOST, 0.1)
    assert "gone" in arm.trouble
    servos.until(lambda: arm.mode is Mode.STOPPED, 1.5)
    arm.unread()
    drive(servos, arm, 0.9, 0.3)
    cycles = arm.unread()
    assert cycles and all(cycle.sent is None for cycle in cycles[-5:])
    arm.close()
    assert arm.mode is Mode.ENDED
