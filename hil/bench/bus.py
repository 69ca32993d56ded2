"""How often servos can be commanded and read, on the emulated bus with its bytes in time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from highfive.hil.bench.arm_faults import driver_figures
from highfive.hil.bench.benched_bus import BenchedBus, machine_bus
from highfive.hil.bench.wakes import percentiles, sleeping_process
from highfive.hil.drivers.bus.control_table import load_table
from highfive.hil.drivers.bus.instruction_packets import sync_read, sync_write
from highfive.hil.drivers.bus.packet import PacketError
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.bus.serial_line import Line
from highfive.hil.drivers.bus.status_packets import FastStatus, decode_fast_status
from highfive.hil.drivers.emulator.emulated_bus import TURNAROUND_NS
from highfive.hil.runtime.clock import Clock
from highfive.model.errors import HighFiveError

if TYPE_CHECKING:
    from highfive.hil.runtime.console import Bar

WRITTEN, READ = 4, 10
"""Bytes of a servo in one cycle: goal position; current, velocity and position."""

_PATIENCE_NS = 10**9  # a reply that is late where the machine stalls makes a long cycle, not a failed one
_WARM_UP = 50  # cycles


@dataclass(frozen=True)
class BusBenchOptions:
    """What is measured: ``seconds`` of each client, ``servos`` of the rig's bus, ``trials`` of each way to stop it."""

    seconds: float = 10.0
    servos: int = 7
    trials: int = 5


def bench_bus(options: BusBenchOptions, bar: Bar) -> dict[str, Any]:
    """Cycles a second: a sync write and a fast sync read of all servos, one after another.

    Returns:
        What :func:`client_figures` and :func:`highfive.hil.bench.arm_faults.driver_figures` give; ``limit_hz``, which
        the line allows; ``servos``, ``baud_rate``, ``seconds``; ``sleeper_late_ms`` (``p50``, ``p99``, ``max``): how
        late the machine woke, meanwhile, a process that only sleeps, with the driver's priority and period.

    Raises:
        HighFiveError: the emulator does not start, or nothing comes back.
    """
    rig = load_rig()
    servos = list(rig.models)[: options.servos]
    if len(servos) < options.servos:
        raise HighFiveError(f"the rig has {len(servos)} servos; {options.servos} were requested")
    advance = bar("bus", 2)
    with sleeping_process() as wakes:
        with machine_bus() as bus:
            figures = client_figures(bus, rig.baud_rate, servos, options.seconds, advance)
        driver = driver_figures(rig, options.seconds, options.trials, bar)
    return {
        **figures,
        "limit_hz": round(limit_hz(servos, rig.baud_rate), 1),
        "servos": len(servos),
        "baud_rate": rig.baud_rate,
        "seconds": options.seconds,
        **driver,
        "sleeper_late_ms": percentiles(wakes),
    }


def client_figures(
    bus: BenchedBus, baud_rate: int, servos: list[int], seconds: float, advance: Callable[[str], object]
) -> dict[str, Any]:
    """How fast ``servos`` can be commanded and read, each client for ``seconds``; ``advance`` is told which is done.

    Returns:
        ``cycle_hz`` of a client that does nothing but write and read bytes, and its ``cycle_ms`` (``p50``, ``p99``,
        ``max``) and ``failed`` cycles; ``sdk_hz`` of the maker's SDK and its ``sdk_failed``.

    Raises:
        HighFiveError: nothing comes back.
    """
    periods, failed = _raw(bus, baud_rate, servos, seconds)
    advance("bytes")
    sdk_hz, sdk_failed = _sdk(bus, baud_rate, servos, seconds)
    advance("SDK")
    p50, p99, longest = np.percentile(periods, [50.0, 99.0, 100.0]) * 1e-6
    return {
        "cycle_hz": round(1e9 * len(periods) / float(np.sum(periods)), 1),
        "cycle_ms": {"p50": round(p50, 3), "p99": round(p99, 3), "max": round(longest, 3)},
        "failed": failed,
        "sdk_hz": round(sdk_hz, 1),
        "sdk_failed": sdk_failed,
    }


def limit_hz(servos: list[int], baud_rate: int) -> float:
    """Cycles a second that the line allows, with a return delay of 0 and the time a servo takes to turn it round."""
    reply = FastStatus([READ] * len(servos))
    sent = len(_goals(servos, 0)) + len(_question(servos)) + sum(len(reply.part(n, 0, bytes(READ))) for n in servos)
    return 1.0 / (sent * 10.0 / baud_rate + TURNAROUND_NS * 1e-9)


def print_bus_bench(result: dict[str, Any]) -> None:
    """The figures, for people."""
    share = 100.0 * result["cycle_hz"] / result["limit_hz"]
    print(
        f"{result['servos']} servos at {result['baud_rate']:,} baud, write {WRITTEN} B and fast sync read {READ} B each"
    )
    print(f"  bytes alone    {result['cycle_hz']:.0f} Hz, {share:.0f} % of the {result['limit_hz']:.0f} Hz of the line")
    cycle = result["cycle_ms"]
    print(f"  one cycle      median {cycle['p50']:.2f} ms, p99 {cycle['p99']:.2f} ms, {result['failed']} failed")
    print(f"  maker's SDK    {result['sdk_hz']:.0f} Hz, {result['sdk_failed']} failed")
    longest = result["dead_servo_longest_ms"]
    print(
        f"  driver, one servo dead: {result['dead_servo_hz']:.0f} Hz from its death on, longest cycle {longest:.1f} ms"
    )
    print(f"  emergency stop to the last goal: {result['estop_ms']:.1f} ms at worst")
    print(f"  process killed to servos stopped by their watchdogs: {result['watchdog_ms']:.0f} ms")
    wakes = result["sleeper_late_ms"]
    print(
        f"  the machine itself: a process that only sleeps wakes {wakes['p50']:.2f} (p50), {wakes['p99']:.2f} (p99), "
        f"{wakes['max']:.2f} ms (max) late"
    )


def _address(name: str) -> int:
    return load_table("XM540-W270")[name].address


def _goals(servos: list[int], cycle: int) -> bytes:
    goal = 2048 + cycle % 100
    return sync_write(_address("goal_position"), dict.fromkeys(servos, goal.to_bytes(WRITTEN, "little")))


def _question(servos: list[int]) -> bytes:
    return sync_read(_address("present_current"), READ, servos, fast=True)


def _raw(bus: BenchedBus, baud_rate: int, servos: list[int], seconds: float) -> tuple[list[int], int]:
    """Periods of the cycles, ns, and how many did not bring every servo's answer."""
    goals = [_goals(servos, n) for n in range(100)]
    question, lengths = _question(servos), dict.fromkeys(servos, READ)
    whole = 8 + (4 + READ) * len(servos)
    clock, times, failed, reply = bus.wiring.clock, list[int](), 0, b""
    line = bus.wiring.open_line(bus.port, baud_rate)
    try:
        end = clock.now() + round(1e9 * seconds)
        while not times or times[-1] < end:
            line.write(goals[len(times) % len(goals)] + question)
            if times:  # the reply before is looked at while the next one is on the line
                failed += not _is_whole(reply, lengths)
            reply = _reply(line, clock, whole)
            times.append(clock.now())
            if len(reply) < whole:
                line.clear()  # what is left of it must not be taken for the next one
    finally:
        line.close()
    if failed >= len(times) - 1:
        raise HighFiveError(f"nothing comes back from {bus.port}")
    return np.diff(times[_WARM_UP:]).tolist(), failed


def _is_whole(reply: bytes, lengths: dict[int, int]) -> bool:
    try:
        return len(decode_fast_status(reply, lengths)) == len(lengths)
    except PacketError:
        return False


def _reply(line: Line, clock: Clock, length: int) -> bytes:
    """So many bytes, or those that came in time."""
    got = b""
    end = clock.now() + _PATIENCE_NS
    while len(got) < length and clock.wait_for(line, end):
        got += line.read(length - len(got))
    return got


def _sdk(bus: BenchedBus, baud_rate: int, servos: list[int], seconds: float) -> tuple[float, int]:
    """Cycles a second of the maker's SDK, and how many failed."""
    from dynamixel_sdk import COMM_SUCCESS, GroupSyncRead, GroupSyncWrite, Protocol2PacketHandler  # noqa: PLC0415

    clock = bus.wiring.clock
    with bus.sdk_port(baud_rate) as line:
        protocol = Protocol2PacketHandler()
        write = GroupSyncWrite(line, protocol, _address("goal_position"), WRITTEN)
        read = GroupSyncRead(line, protocol, _address("present_current"), READ)
        for servo in servos:
            read.addParam(servo)
            write.addParam(servo, list((2048).to_bytes(WRITTEN, "little")))
        cycles = failed = 0
        start = clock.now()
        while (elapsed := 1e-9 * (clock.now() - start)) < seconds:
            write.txPacket()
            failed += read.fastSyncRead() != COMM_SUCCESS
            cycles += 1
    return cycles / elapsed, failed
