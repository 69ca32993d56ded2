"""An emulated arm in virtual time for the tests of this folder."""

from collections.abc import Iterator

import pytest
from virtual_servos import VirtualServos

from highfive.hil.drivers.bus.rig import Rig
from highfive.hil.drivers.bus.servo_bus import ServoBus
from highfive.hil.runtime.virtual_clock import VirtualClock


@pytest.fixture
def servos() -> Iterator[VirtualServos]:
    with VirtualClock() as clock:
        yield VirtualServos(clock)


@pytest.fixture
def bus(servos: VirtualServos, rig: Rig) -> ServoBus:
    return ServoBus(servos.port, rig.baud_rate, rig.models, wiring=servos.wiring)
