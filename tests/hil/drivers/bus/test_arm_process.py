"""The arm's own process: that clock, pseudo-terminal, processes, signals and priority are joined rightly.

What the driver does, and when, is in test_cycle_loop.py, in virtual time.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from highfive.hil.drivers.bus.arm_process import ArmProcess
from highfive.hil.drivers.bus.cycle_ring import Mode
from highfive.hil.drivers.bus.rig import Rig, load_rig
from highfive.hil.drivers.bus.servo_bus import ServoBus
from highfive.hil.drivers.emulator.emulator_process import EmulatorOptions, EmulatorProcess
from highfive.hil.drivers.values import JointCommand
from highfive.model.errors import HighFiveError

pytestmark = pytest.mark.slow

HALF = np.full(6, 0.5)
PATIENT_MS = 250.0


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig()  # with the watchdogs that it has


@pytest.fixture
def emulator() -> Iterator[EmulatorProcess]:
    with EmulatorProcess(EmulatorOptions()) as emulator:
        yield emulator


@pytest.fixture
def arm(emulator: EmulatorProcess, rig: Rig) -> Iterator[ArmProcess]:
    arm = ArmProcess(emulator.port, rig, allowance_ms=PATIENT_MS)
    try:
        arm.wait_ready(30.0)
        arm.engage()
        yield arm
    finally:
        arm.close()


def until(condition: Callable[[], object], seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.003)


@pytest.mark.realtime
def test_it_reads_drives_there_and_leaves_it_there(arm: ArmProcess, emulator: EmulatorProcess, rig: Rig) -> None:
    newest = arm.newest()
    assert newest is not None and newest.state.answered.all()

    def there() -> bool:
        arm.drive(JointCommand(np.full(6, 0.2), HALF))
        newest = arm.newest()
        return newest is not None and bool(np.allclose(newest.state.positions, 0.2, atol=0.03))

    until(there)
    numbers = [cycle.number for cycle in arm.unread()]
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    arm.estop.pull()
    until(lambda: arm.mode is Mode.STOPPED)
    arm.close()
    bus = ServoBus(emulator.port, rig.baud_rate, rig.models, PATIENT_MS)
    assert all(bus.read(servo, "torque_enable") for servo in rig.servos)
    bus.close()


@pytest.mark.realtime
@pytest.mark.skipif(not hasattr(os, "sched_getscheduler"), reason="the system has no such schedules")
def test_it_goes_before_programs_that_compute_where_that_is_allowed(arm: ArmProcess) -> None:
    asked = "import sys; from highfive.hil.drivers.priority import go_first; sys.exit(not go_first())"
    allowed = subprocess.run([sys.executable, "-c", asked], check=False).returncode == 0
    schedule = os.sched_getscheduler(arm.pid) & ~os.SCHED_RESET_ON_FORK
    assert schedule == (os.SCHED_FIFO if allowed else os.SCHED_OTHER)
    assert os.sched_getscheduler(0) == os.SCHED_OTHER  # not the host


@pytest.mark.realtime
def test_a_process_that_hangs_is_killed_and_that_is_no_trouble_of_its_own(arm: ArmProcess) -> None:
    os.kill(arm.pid, signal.SIGSTOP)
    arm.close(timeout_s=0.2)
    assert arm.mode is Mode.ENDED
    assert not arm.trouble


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


@pytest.mark.realtime
@pytest.mark.parametrize(("number", "end"), [(signal.SIGTERM, "close"), (signal.SIGHUP, "forget")])
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


@pytest.mark.realtime
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
