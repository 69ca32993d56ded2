"""How late a machine wakes whoever only sleeps: what it adds itself to every figure by the clock of the same run."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Event as ProcessEvent
from threading import Event

import numpy as np

from highfive.hil.drivers.priority import go_first
from highfive.hil.session.session import RATE_HZ

_START_S = 60.0


def sleeps(wakes: list[float], ended: Event | ProcessEvent) -> None:
    """Sleeps to absolute deadlines, 120 a second, until ``ended``; ``wakes`` gets how late each was, ms."""
    period, due = round(1e9 / RATE_HZ), time.monotonic_ns()
    while not ended.is_set():
        due += period
        time.sleep(max(1e-9 * (due - time.monotonic_ns()), 0.0))
        wakes.append(1e-6 * (time.monotonic_ns() - due))
        due = max(due, time.monotonic_ns() - period)


def percentiles(values: Sequence[float]) -> dict[str, float]:
    """``p50``, ``p99`` and ``max``."""
    p50, p99 = np.percentile(values, [50, 99])
    return {"p50": round(float(p50), 3), "p99": round(float(p99), 3), "max": round(max(values), 3)}


@contextmanager
def sleeping_process() -> Iterator[list[float]]:
    """A process that only sleeps meanwhile, with the priority of the driver of an arm, where the system allows it.

    Yields:
        how late it woke, ms: filled at the end of the context.
    """
    context = multiprocessing.get_context("spawn")
    begun, ended = context.Event(), context.Event()
    receives, sends = context.Pipe(duplex=False)
    process = context.Process(target=_sleep_first, args=(begun, ended, sends), daemon=True)
    process.start()
    sends.close()
    begun.wait(_START_S)
    wakes: list[float] = []
    try:
        yield wakes
    finally:
        ended.set()
        if receives.poll(_START_S):
            wakes += receives.recv()
        process.join()


def _sleep_first(begun: ProcessEvent, ended: ProcessEvent, sends: Connection) -> None:
    go_first()
    wakes: list[float] = []
    begun.set()
    sleeps(wakes, ended)
    sends.send(wakes)
