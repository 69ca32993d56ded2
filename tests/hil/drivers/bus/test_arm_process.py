"""The arm's own process: mailbox, ring, emergency stop, and what happens when either side dies."""

import linecache
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest
from test_servo_bus import until

from highfive.hil.commands.rig.service import check, print_check
from highfive.hil.drivers.bus.arm_process import ArmProcess
from highfive.hil.drivers.bus.cycle_ring import CycleRing, Mode
from highfive.hil.drivers.bus.rig import Rig, angle, count, load_rig, wanted_registers
from highfive.hil.drivers.bus.servo_bus import ServoBus
from highfive.hil.drivers.emulator.emulator_process import EmulatorOptions, EmulatorProcess
from highfive.hil.drivers.values import JointCommand
from highfive.model.errors import HighFiveError

pytestmark = [pytest.mark.slow, pytest.mark.realtime]

HALF = np.full(6, 0.5)
PATIENT_MS = 60.0


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig()  # with the watchdogs that it has


@pytest.fixture
def arm(emulator: EmulatorProcess, rig: Rig) -> Iterator[ArmProcess]:
    arm = ArmProcess(emulator.port, rig, allowance_ms=PATIENT_MS)
    try:
        arm.wait_ready(30.0)
        arm.engage()
        yield arm
    finally:
        arm.close()


def drive_to(arm: ArmProcess, angle: float) -> None:
    def there() -> bool:
        arm.drive(JointCommand(np.full(6, angle), HALF))
        newest = arm.newest()
        return newest is not None and bool(np.allclose(newest.state.positions, angle, atol=0.03))

    until(there)


def drive(arm: ArmProcess, angle: float, seconds: float) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        arm.drive(JointCommand(np.full(6, angle), HALF))
        time.sleep(0.005)


def test_it_reads_and_nothing_is_switched_on_until_it_is_engaged(emulator: EmulatorProcess, rig: Rig) -> None:
    arm = ArmProcess(emulator.port, rig, allowance_ms=PATIENT_MS)
    arm.wait_ready(30.0)
    drive(arm, 0.3, 0.2)
    until(lambda: (newest := arm.newest()) is not None and newest.number > 3)
    newest = arm.newest()
    assert newest is not None
    assert newest.mode is Mode.READING
    assert newest.sent is None
    arm.close()
    bus = ServoBus(emulator.port, rig.baud_rate, rig.models, PATIENT_MS)
    assert not any(bus.read(servo, "torque_enable") for servo in rig.servos)
    bus.close()


def test_what_every_servo_is_set_to_is_read_back_when_it_is_engaged(emulator: EmulatorProcess, rig: Rig) -> None:
    arm = ArmProcess(emulator.port, rig, allowance_ms=PATIENT_MS)
    arm.wait_ready(30.0)
    held = arm.engage()
    assert held == {servo: {**wanted, "torque_enable": 1} for servo, wanted in wanted_registers(rig).items()}
    until(lambda: arm.mode is Mode.HOLDING)
    time.sleep(0.3)
    assert arm.mode is Mode.HOLDING, arm.trouble  # it is read in every cycle, so no watchdog trips
    arm.close()


def test_a_servo_that_is_missing_is_reported_and_nothing_is_switched_on(rig: Rig) -> None:
    with EmulatorProcess(EmulatorOptions()) as emulator:
        arm = ArmProcess(emulator.port, rig, allowance_ms=PATIENT_MS)
        arm.wait_ready(30.0)
        emulator.set_faults(f"dead={rig.joints[1].id}")
        until(lambda: (newest := arm.newest()) is not None and not newest.state.answered[1])
        with pytest.raises(HighFiveError, match=f"{rig.joints[1].name}: no answer; nothing is switched on"):
            arm.engage()
        arm.close()


def test_a_bus_that_was_silent_stops_the_arm_and_says_so(arm: ArmProcess) -> None:
    """Servos whose watchdogs have stopped them refuse goals; the driver does not go on as if they took them."""
    drive_to(arm, 0.3)
    os.kill(arm.pid, signal.SIGSTOP)
    time.sleep(0.4)
    os.kill(arm.pid, signal.SIGCONT)
    until(lambda: arm.mode is Mode.STOPPED)
    assert "watchdog" in arm.trouble
    newest = arm.newest()
    assert newest is not None
    assert newest.state.tripped.all()


def test_what_the_watchdogs_have_stopped_is_freed_where_it_stands(
    emulator: EmulatorProcess, rig: Rig, capsys: pytest.CaptureFixture[str]
) -> None:
    def started() -> ArmProcess:
        arm = ArmProcess(emulator.port, rig, allowance_ms=PATIENT_MS)
        arm.wait_ready(30.0)
        arm.engage()
        return arm

    first = started()
    drive_to(first, 0.2)
    drive(first, 0.6, 0.1)
    os.kill(first.pid, signal.SIGKILL)
    time.sleep(0.5)
    first.close()
    result = check(emulator.port, None)
    assert result["ready"]
    assert all(servo["stopped_by_watchdog"] for servo in result["servos"])
    print_check(result)
    assert "the watchdog has stopped servos 1, 2, 3, 4, 5, 6, 7, 8" in capsys.readouterr().out
    again = started()
    cycles = again.unread()
    positions = np.array([cycle.state.positions for cycle in cycles])
    np.testing.assert_allclose(positions, positions[:1].repeat(len(positions), 0), atol=0.02)
    assert cycles[0].state.tripped.all()
    until(lambda: (newest := again.newest()) is not None and not newest.state.tripped.any())
    assert again.mode is Mode.HOLDING
    assert not again.trouble
    drive_to(again, 0.3)
    again.close()


@pytest.mark.skipif(not hasattr(os, "sched_getscheduler"), reason="the system has no such schedules")
def test_it_goes_before_programs_that_compute_where_that_is_allowed(arm: ArmProcess) -> None:
    asked = "import sys; from highfive.hil.drivers.priority import go_first; sys.exit(not go_first())"
    allowed = subprocess.run([sys.executable, "-c", asked], check=False).returncode == 0
    schedule = os.sched_getscheduler(arm.pid) & ~os.SCHED_RESET_ON_FORK
    assert schedule == (os.SCHED_FIFO if allowed else os.SCHED_OTHER)
    assert os.sched_getscheduler(0) == os.SCHED_OTHER  # not the host


def test_it_goes_where_it_is_commanded(arm: ArmProcess) -> None:
    drive_to(arm, 0.3)
    assert arm.mode is Mode.DRIVING
    cycles = arm.unread()
    numbers = [cycle.number for cycle in cycles]
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    assert all(cycle.begun_ns >= cycle.due_ns for cycle in cycles)
    assert any(cycle.sent is not None for cycle in cycles)


@pytest.mark.parametrize("phase", [-0.12, 0.5])
def test_each_command_goes_out_once_whatever_the_phase_of_the_hosts_clock(arm: ArmProcess, phase: float) -> None:
    """Where a cycle repeats a command, the next one goes two steps at once, at twice the speed."""
    period, count, step = 1.0 / 120.0, 240, 2.0 * 2.0 * np.pi / 4096  # rad: two counts of the servos
    drive_to(arm, 0.2)
    arm.unread()
    newest = arm.newest()
    assert newest is not None
    start = 1e-9 * newest.due_ns + (2.0 + phase) * period
    angles = 0.2 + step * np.arange(count)
    for number, position in enumerate(angles):
        due = start + number * period + (0.0018 if number % 2 else 0.0002)  # what the host's tick takes, s
        time.sleep(max(0.0, due - time.monotonic()))
        arm.drive(JointCommand(np.full(6, position), HALF))
    sent = [cycle.sent.positions[0] for cycle in arm.unread() if cycle.sent is not None]
    steps = np.rint(np.diff([position for position in sent if position > angles[1]]) / step)
    assert len(steps) > 0.9 * count
    assert np.mean(steps == 1) > 0.9  # the rest: pauses of the machine


def test_a_host_that_stalls_is_held_and_goes_on(arm: ArmProcess) -> None:
    drive_to(arm, 0.3)
    until(lambda: arm.mode is Mode.HOLDING)
    held = arm.newest()
    time.sleep(0.2)
    later = arm.newest()
    assert held is not None and later is not None
    np.testing.assert_allclose(later.state.positions, held.state.positions, atol=0.05)
    assert later.state.answered.all()  # the bus is not silent: no watchdog trips
    drive_to(arm, 0.2)


def test_the_emergency_stop_is_the_last_motion(arm: ArmProcess) -> None:
    drive(arm, 0.5, 0.2)
    arm.estop.pull()
    pulled = time.monotonic_ns()
    drive(arm, 0.9, 0.3)  # whoever goes on asking is not heard
    assert arm.mode is Mode.STOPPED
    sent = [cycle for cycle in arm.unread() if cycle.sent is not None]
    last, *after = [cycle for cycle in sent if cycle.mode is Mode.STOPPED]
    assert sent[-1 - len(after)] is last
    hold = last.sent
    assert hold is not None
    assert (hold.positions < 0.51).all()
    assert all((cycle.sent.positions == hold.positions).all() for cycle in after if cycle.sent is not None)
    assert last.begun_ns - pulled < 200_000_000  # its time is the bench's business
    newest = arm.newest()
    assert newest is not None
    np.testing.assert_allclose(newest.state.positions, hold.positions, atol=0.05)


def test_an_arm_that_was_stopped_brakes_with_full_current_and_then_yields(
    arm: ArmProcess, emulator: EmulatorProcess, rig: Rig
) -> None:
    drive(arm, 0.6, 0.15)
    arm.unread()
    arm.estop.pull()
    until(lambda: arm.mode is Mode.STOPPED)
    time.sleep(0.5)
    hold, *lowered = [cycle.sent for cycle in arm.unread() if cycle.mode is Mode.STOPPED and cycle.sent is not None]
    assert (hold.currents > 1.0).all()
    assert len(lowered) == 1
    np.testing.assert_array_equal(lowered[0].positions, hold.positions)  # that moved nothing
    np.testing.assert_allclose(lowered[0].currents, HALF, atol=0.002)
    newest = arm.newest()
    assert newest is not None
    np.testing.assert_allclose(newest.state.positions, hold.positions, atol=0.05)
    arm.close()
    bus = ServoBus(emulator.port, rig.baud_rate, rig.models, PATIENT_MS)
    held = {bus.read(servo, "goal_current") for servo in rig.servos}
    bus.close()
    assert all(abs(2.69e-3 * current - 0.5) < 0.002 for current in held)


@pytest.mark.parametrize("pull", [True, False])
def test_an_arm_that_is_left_while_it_moves_is_held_where_it_is_and_yields(
    pull: bool, arm: ArmProcess, emulator: EmulatorProcess, rig: Rig
) -> None:
    drive(arm, 0.6, 0.15)
    if pull:
        arm.estop.pull()
    arm.close()
    bus = ServoBus(emulator.port, rig.baud_rate, rig.models, PATIENT_MS)
    held = {bus.read(servo, "goal_current") for servo in rig.servos}
    goals = [angle(joint, bus.read(joint.id, "goal_position")) for joint in rig.joints]
    watched = [bus.read(servo, "bus_watchdog") for servo in rig.servos]
    bus.close()
    assert all(abs(2.69e-3 * current - 0.5) < 0.002 for current in held)
    assert all(goal < 0.59 for goal in goals)  # not the last command's
    assert not any(watched)


def test_an_arm_that_stands_where_it_was_told_is_left_with_that_goal(
    arm: ArmProcess, emulator: EmulatorProcess, rig: Rig
) -> None:
    """With the place where it is as its goal it would sag further, each time that it is left."""
    drive(arm, 0.3, 1.5)
    arm.close()
    bus = ServoBus(emulator.port, rig.baud_rate, rig.models, PATIENT_MS)
    goals = [bus.read(joint.id, "goal_position") for joint in rig.joints]
    held = {bus.read(servo, "goal_current") for servo in rig.servos}
    bus.close()
    assert goals == [count(joint, 0.3) for joint in rig.joints]
    assert all(abs(2.69e-3 * current - 0.5) < 0.002 for current in held)


def test_an_arm_that_is_kept_from_its_goal_is_left_where_it_is(
    arm: ArmProcess, emulator: EmulatorProcess, rig: Rig
) -> None:
    """As by a hand: here by having no current. It shall not go on to its goal once the way is free."""
    drive(arm, 0.0, 0.3)
    end = time.monotonic() + 0.5
    while time.monotonic() < end:
        arm.drive(JointCommand(np.full(6, 0.2), np.zeros(6)))
        time.sleep(0.005)
    arm.close()
    bus = ServoBus(emulator.port, rig.baud_rate, rig.models, PATIENT_MS)
    goals = [angle(joint, bus.read(joint.id, "goal_position")) for joint in rig.joints]
    bus.close()
    assert max(np.abs(goals)) < 0.1


def test_an_arm_that_falls_silent_before_it_is_left_is_left_in_time(
    arm: ArmProcess, emulator: EmulatorProcess, rig: Rig
) -> None:
    drive(arm, 0.3, 0.3)
    emulator.set_faults([f"dead={servo}" for servo in rig.servos])
    begun = time.monotonic()
    arm.close()
    assert time.monotonic() - begun < 2.8  # it ended by itself: it was not killed
    assert not arm.trouble


def test_a_process_that_hangs_is_killed_and_that_is_no_trouble_of_its_own(arm: ArmProcess) -> None:
    os.kill(arm.pid, signal.SIGSTOP)
    arm.close(timeout_s=0.2)
    assert arm.mode is Mode.ENDED
    assert not arm.trouble


class Interrupt(BaseException):
    pass


def interrupted(arm: ArmProcess, angle: float) -> None:
    """Gives a command and is interrupted in the midst of it, as by Ctrl-C."""
    half = 'head["drive"][0] = 1'

    def interrupt(frame: FrameType, event: str, argument: object) -> Callable[..., Any] | None:
        if frame.f_code in (ArmProcess.drive.__code__, CycleRing.give.__code__):
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


def test_an_interrupt_in_the_midst_of_a_command_blinds_nobody(arm: ArmProcess) -> None:
    drive_to(arm, 0.2)
    interrupted(arm, 0.9)
    until(lambda: arm.mode is Mode.HOLDING)  # a command that is half written is none
    drive_to(arm, 0.3)
    assert arm.mode is Mode.DRIVING
    interrupted(arm, 0.9)
    arm.estop.pull()
    pulled = time.monotonic()
    until(lambda: arm.mode is Mode.STOPPED, 2.0)
    stopped = [cycle for cycle in arm.unread() if cycle.mode is Mode.STOPPED]
    assert 1e-9 * stopped[0].begun_ns - pulled < 0.1
    assert all((cycle.sent.positions < 0.4).all() for cycle in stopped if cycle.sent is not None)
    begun = time.monotonic()
    arm.close()
    assert time.monotonic() - begun < 1.5  # it ended by itself: it was not killed


def test_a_lost_port_is_reported_and_found_again_but_not_driven(tmp_path: Path, rig: Rig) -> None:
    with EmulatorProcess(EmulatorOptions(link=str(tmp_path / "arm"))) as emulator:
        arm = ArmProcess(str(tmp_path / "arm"), rig, allowance_ms=PATIENT_MS)
        arm.wait_ready(30.0)
        arm.engage()
        drive(arm, 0.2, 0.2)
        emulator.set_faults("unplug@0-1")
        until(lambda: arm.mode is Mode.PORT_LOST)
        assert "gone" in arm.trouble
        until(lambda: arm.mode is Mode.STOPPED)
        count = len(arm.unread())
        drive(arm, 0.9, 0.3)
        assert all(cycle.sent is None for cycle in arm.unread()[-5:]), count
        arm.close()
    assert arm.mode is Mode.ENDED


def test_what_cannot_begin_says_why(tmp_path: Path, rig: Rig) -> None:
    arm = ArmProcess(str(tmp_path / "none"), rig)
    with pytest.raises(HighFiveError, match="no such port"):
        arm.wait_ready(30.0)
    arm.close()


HOST = """
import sys, time
import numpy as np
from highfive.hil.drivers.bus.arm_process import ArmProcess
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.values import JointCommand
if __name__ == "__main__":
    arm = ArmProcess(sys.argv[1], load_rig(), allowance_ms=60.0)
    arm.wait_ready(30.0)
    arm.engage()
    print(arm.pid, flush=True)
    while True:
        arm.drive(JointCommand(np.full(6, 0.4), np.full(6, 0.5)))
        time.sleep(0.005)
"""


def started(script: Path, argument: str, **more: Any) -> subprocess.Popen[str]:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path.cwd()), *sys.path])}
    return subprocess.Popen(
        [sys.executable, str(script), argument], stdout=subprocess.PIPE, text=True, env=environment, **more
    )


ORDERLY = """
import signal, sys, time
import numpy as np
from highfive.hil.drivers.bus.arm_process import ArmProcess
from highfive.hil.drivers.bus.cycle_ring import CycleRing, Mode
from highfive.hil.drivers.emulator.emulator_process import EmulatorOptions, EmulatorProcess
from highfive.hil.drivers.bus.rig import load_rig
if __name__ == "__main__":
    told = []
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda number, frame: told.append(number))
    with EmulatorProcess(EmulatorOptions()) as emulator:
        arm = ArmProcess(emulator.port, load_rig(), allowance_ms=60.0)
        arm.wait_ready(30.0)
        arm.engage()
        print("ready", flush=True)
        while not told:
            time.sleep(0.01)
        time.sleep(0.3)
        before = arm.newest().number
        time.sleep(0.3)
        print(arm.mode.name, arm.newest().number > before, flush=True)
        if sys.argv[1] == "close":
            arm.close()
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("end", ["close", "forget"])
def test_what_tells_the_whole_group_to_end_leaves_the_ending_to_the_host(
    number: signal.Signals, end: str, tmp_path: Path
) -> None:
    script = tmp_path / "host.py"
    script.write_text(ORDERLY)
    host = started(script, end, start_new_session=True)
    assert host.stdout is not None
    assert host.stdout.readline() == "ready\n"
    os.killpg(host.pid, number)
    assert host.stdout.readline() == "HOLDING True\n"
    assert host.wait(20.0) == 0
    host.stdout.close()
    until(lambda: not left(host.pid))


def left(group: int) -> bool:
    """Whether somebody of a process group is left."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize("killed", ["host", "arm"])
def test_whoever_is_killed_the_watchdogs_stop_the_arm(
    killed: str, emulator: EmulatorProcess, rig: Rig, tmp_path: Path
) -> None:
    script = tmp_path / "host.py"
    script.write_text(HOST)
    host = started(script, emulator.port)
    assert host.stdout is not None
    arm_pid = int(host.stdout.readline())
    time.sleep(0.5)
    os.kill(host.pid if killed == "host" else arm_pid, signal.SIGKILL)
    time.sleep(0.5)
    if killed == "arm":
        host.kill()
    host.wait()
    host.stdout.close()
    time.sleep(0.3)
    bus = ServoBus(emulator.port, rig.baud_rate, rig.models, PATIENT_MS)
    assert all(bus.read(servo, "bus_watchdog") == -1 for servo in rig.servos)
    assert bus.read(1, "torque_enable") == 1  # stopped, not dropped
    bus.close()
