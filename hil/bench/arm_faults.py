"""How the driver behaves on the emulated bus when a servo dies, a stop is pulled, or the host is killed."""

from __future__ import annotations

import itertools
import multiprocessing
import time
from collections.abc import Callable
from multiprocessing.synchronize import Event
from typing import Any

import numpy as np

from highfive.hil.bench.benched_bus import BenchedBus, machine_bus
from highfive.hil.drivers.bus.arm_process import ArmProcess
from highfive.hil.drivers.bus.joint_bus import JointBus
from highfive.hil.drivers.bus.rig import Rig
from highfive.hil.drivers.bus.servo_bus import NoAnswer, ServoBus
from highfive.hil.drivers.bus.servo_port import PATIENCE_MS
from highfive.hil.drivers.emulator.emulator_process import EmulatorProcess
from highfive.hil.drivers.servo_errors import WATCHDOG_TRIPPED
from highfive.hil.drivers.values import JointCommand
from highfive.model.errors import HighFiveError

SOONEST_MS, STEP_MS = 60.0, 10.0
"""After a kill the servos are looked at so late, and so much later in the next trial until all have stopped, ms."""

LATEST_MS = 300.0
_START_S = 60.0


def dead_servo(bench: BenchedBus, rig: Rig, seconds: float) -> dict[str, float]:
    """Cycles a second on a bus with one servo dead, from its death on, and the longest one, ms.

    Returns:
        ``dead_servo_hz`` and ``dead_servo_longest_ms``.
    """
    clock = bench.wiring.clock
    bus = ServoBus(bench.port, rig.baud_rate, rig.models, wiring=bench.wiring)
    try:
        joints = JointBus(bus, rig)
        joints.prepare()
        joints.engage()
        joints.arm_watchdog()
        still = JointCommand(joints.read().positions, np.full(len(rig.joints), 0.5))
        bench.set_faults(f"dead={rig.joints[2].id}")
        times = [clock.now()]
        while times[-1] - times[0] < 1e9 * seconds:
            joints.cycle(still)
            times.append(clock.now())
    finally:
        bus.close()
    periods = np.diff(times)
    return {
        "dead_servo_hz": round(1e9 * len(periods) / float(periods.sum()), 1),
        "dead_servo_longest_ms": round(1e-6 * float(periods.max()), 2),
    }


def emergency_stop(rig: Rig, trials: int, advance: Callable[[], object]) -> list[float]:
    """ms from the pull until the last goal was on its way to the wire, a trial each."""
    found = []
    for _ in range(trials):
        with EmulatorProcess() as emulator:
            arm = _driven(emulator.port, rig)
            arm.estop.pull()
            pulled = arm.estop.pulled_ns or 0
            _drive(arm, 0.1)
            goals = [(cycle.begun_ns, cycle.sent.positions) for cycle in arm.unread() if cycle.sent is not None]
            arm.close()
        # A cycle that had begun already takes it along.
        last = goals[0][0]
        for (_, before), (begun, then) in itertools.pairwise(goals):
            last = begun if (then != before).any() else last  # lowering the current afterwards is no goal
        found.append(max(0.0, 1e-6 * (last - pulled)))
        advance()
    return found


def killed_host(rig: Rig, trials: int, advance: Callable[[], object]) -> float:
    """ms after a kill of the host after which the servos of every trial had been stopped by their watchdogs, to
    :data:`STEP_MS`.

    Looking feeds the watchdogs, so that each trial is looked at once.
    """
    context = multiprocessing.get_context("spawn")
    waited = SOONEST_MS
    done = most = 0
    while done < trials and waited < LATEST_MS:
        with EmulatorProcess() as emulator:
            moving = context.Event()
            host = context.Process(target=_host, args=(emulator.port, rig, moving))
            host.start()
            there = moving.wait(_START_S)
            host.kill()
            if not there:
                raise HighFiveError(f"the host did not drive the arm within {_START_S:g} s")
            time.sleep(1e-3 * waited)
            stopped = _stopped(emulator.port, rig)
            host.join()
        done, waited = (done + 1, waited) if stopped else (0, waited + STEP_MS)
        if done > most:
            most = done
            advance()
    if done < trials:
        raise HighFiveError(f"after {waited:.0f} ms the watchdogs have not stopped all servos")
    return waited


def _host(port: str, rig: Rig, moving: Event) -> None:
    """A program that drives an arm until it is killed."""
    arm = _driven(port, rig)
    moving.set()
    while True:
        _drive(arm, 1.0)


def _stopped(port: str, rig: Rig) -> bool:
    bus = ServoBus(port, rig.baud_rate, rig.models, PATIENCE_MS)
    try:
        return all(bus.read(servo, "bus_watchdog") == WATCHDOG_TRIPPED for servo in rig.servos)
    except NoAnswer:
        return False
    finally:
        bus.close()


def _driven(port: str, rig: Rig) -> ArmProcess:
    """An arm on its way."""
    arm = ArmProcess(port, rig)
    arm.wait_ready(30.0)
    arm.engage()
    _drive(arm, 0.5)
    return arm


def _drive(arm: ArmProcess, seconds: float) -> None:
    begun = time.monotonic()
    while (now := time.monotonic() - begun) < seconds:
        arm.drive(JointCommand(np.full(6, 0.3 * np.sin(now)), np.full(6, 0.5)))
        time.sleep(1.0 / 120.0)


def driver_figures(
    rig: Rig, seconds: float, trials: int, bar: Callable[[str, int], Callable[[], object]]
) -> dict[str, Any]:
    """All of them: ``dead_servo_hz``, ``dead_servo_longest_ms``, ``estop_ms`` (the worst trial), ``watchdog_ms``."""
    advance = bar("driver", 1 + 2 * trials)
    with machine_bus() as bench:
        figures: dict[str, Any] = dead_servo(bench, rig, seconds)
    advance()
    figures["estop_ms"] = round(max(emergency_stop(rig, trials, advance)), 2)
    figures["watchdog_ms"] = killed_host(rig, trials, advance)
    return figures
