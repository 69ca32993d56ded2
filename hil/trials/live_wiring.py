"""What a live system hangs on: the clock that all goes by, what runs beside the reader, and what connects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.mocap_bridge.sources.address import connector
from highfive.mocap_bridge.sources.live import Link
from highfive.mocap_bridge.sources.scheduler import THREADS, Scheduler
from highfive.mocap_bridge.sources.scheme import Address


@dataclass(frozen=True)
class LiveWiring:
    """Clock and scheduler, of one time; ``connects`` gives what connects to an address."""

    clock: Clock
    scheduler: Scheduler
    connects: Callable[[Address], Callable[[], Link]]


MACHINE_WIRING = LiveWiring(MACHINE, THREADS, connector)
"""This computer's clock, threads and network."""
