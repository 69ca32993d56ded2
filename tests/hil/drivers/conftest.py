"""An emulated arm for the tests of this folder."""

from collections.abc import Iterator

import pytest

from hil.drivers.emulator_process import EmulatorOptions, EmulatorProcess
from hil.drivers.rig import Rig, load_rig
from hil.drivers.servo_bus import ServoBus

ALLOWANCE_MS = 60.0
"""Patience with answers: these machines are busy, and only the driver's decisions are tested, not its times."""


@pytest.fixture(scope="session")
def rig() -> Rig:
    return load_rig()


@pytest.fixture
def emulator() -> Iterator[EmulatorProcess]:
    with EmulatorProcess(EmulatorOptions()) as process:
        yield process


@pytest.fixture
def bus(emulator: EmulatorProcess, rig: Rig) -> Iterator[ServoBus]:
    bus = ServoBus(emulator.port, rig.baud_rate, rig.models, ALLOWANCE_MS)
    yield bus
    bus.close()
