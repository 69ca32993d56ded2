"""An emulated arm in virtual time for the tests of this folder."""

from collections.abc import Iterator
from dataclasses import replace

import pytest
from virtual_servos import VirtualServos

from highfive.hil.drivers.bus.rig import Rig, load_rig
from highfive.hil.drivers.bus.servo_bus import ServoBus
from highfive.hil.runtime.virtual_clock import VirtualClock

WATCHDOG_S = 2.0
"""Where watchdogs are not what is tested."""


@pytest.fixture(scope="session")
def rig() -> Rig:
    rig = load_rig()
    return replace(rig, settings=replace(rig.settings, watchdog=WATCHDOG_S))


@pytest.fixture
def servos() -> Iterator[VirtualServos]:
    with VirtualClock() as clock:
        yield VirtualServos(clock)


@pytest.fixture
def bus(servos: VirtualServos, rig: Rig) -> ServoBus:
    return ServoBus(servos.port, rig.baud_rate, rig.models, wiring=servos.wiring)
