"""Processes that go by the clock before those that merely compute."""

from __future__ import annotations

import os

PRIORITY = 20
"""Of 1 to 99, as POSIX counts them: before every ordinary program, behind what the system itself needs."""


def go_first() -> bool:
    """Gives the calling thread a real-time schedule (POSIX ``SCHED_FIFO``): it runs as soon as it has something to do.

    It must then wait most of its time. Threads and processes that it starts do not inherit it.

    Returns:
        whether the system allows that: Linux does to root, and to whom ``rtprio`` in ``/etc/security/limits.d`` names.
    """
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))
    except (AttributeError, OSError):
        return False
    return True
