"""Processes that go by the clock before those that merely compute."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

PRIORITY = 20
"""Of 1 to 99, as POSIX counts them: before every ordinary program, behind what the system itself needs."""


LOOP_PRIORITY = 10
"""Of who plans for the arm: behind those that talk to its servos."""


def go_first(priority: int = PRIORITY) -> bool:
    """Gives the calling thread a real-time schedule (POSIX ``SCHED_FIFO``): it runs as soon as it has something to do.

    It must then wait most of its time. Threads and processes that it starts do not inherit it.

    Returns:
        whether the system allows that: Linux does to root, and to whom ``rtprio`` in ``/etc/security/limits.d`` names.
    """
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except (AttributeError, OSError):
        return False
    return True


@contextmanager
def going_first() -> Iterator[None]:
    """The calling thread, which plans for the arm, goes before programs that compute, if the system allows it."""
    before = (os.sched_getscheduler(0), os.sched_getparam(0)) if hasattr(os, "sched_getscheduler") else None
    went = go_first(LOOP_PRIORITY)
    try:
        yield
    finally:
        if went and before is not None:
            os.sched_setscheduler(0, *before)


def may_go_first() -> bool:
    """Whether the system allows it: tried by a thread of its own, which ends at once."""
    allowed: list[bool] = []
    thread = threading.Thread(target=lambda: allowed.append(go_first()))
    thread.start()
    thread.join()
    return allowed == [True]
