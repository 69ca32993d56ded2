"""An emulated arm for the tests of this folder."""

import os
import select
import threading
import time
import tty
from collections import deque
from collections.abc import Iterator
from dataclasses import replace

import pytest
import serial

from highfive.hil.drivers.bus.rig import Rig, load_rig
from highfive.hil.drivers.bus.servo_bus import ServoBus
from highfive.hil.drivers.emulator.emulator_process import EmulatorOptions, EmulatorProcess

ALLOWANCE_MS = 250.0
WATCHDOG_S = 2.0
"""Patience with answers and hosts: machines stand still, and only the driver's decisions are tested, not its times."""


@pytest.fixture(scope="session")
def rig() -> Rig:
    rig = load_rig()
    return replace(rig, settings=replace(rig.settings, watchdog=WATCHDOG_S))


@pytest.fixture
def emulator() -> Iterator[EmulatorProcess]:
    with EmulatorProcess(EmulatorOptions()) as process:
        yield process


@pytest.fixture
def bus(emulator: EmulatorProcess, rig: Rig) -> Iterator[ServoBus]:
    bus = ServoBus(emulator.port, rig.baud_rate, rig.models, ALLOWANCE_MS)
    yield bus
    bus.close()


class Adapter:
    """A cable that keeps what comes from the servos back for a while, as USB adapters do, and loses none of it.

    Attributes:
        port: what a host opens.
        hold_s: how long bytes are kept back from now on, s.
        newest_s: when the newest bytes that the host was given had come from the servos, monotonic, s.
    """

    def __init__(self, port: str, baud: int) -> None:
        self._servos = serial.Serial(port, baud, timeout=0, exclusive=True)
        self._host, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        self.hold_s = self.newest_s = 0.0
        self._ended = False
        self._thread = threading.Thread(target=self._relay)
        self._thread.start()

    def close(self) -> None:
        self._ended = True
        self._thread.join()
        self._servos.close()
        os.close(self._host)
        os.close(self._slave)

    def _relay(self) -> None:
        kept: deque[tuple[float, float, bytes]] = deque()
        while not self._ended:
            wait = max(0.0, min(0.02, kept[0][0] - time.monotonic())) if kept else 0.02
            ready = select.select([self._host, self._servos], [], [], wait)[0]
            if self._host in ready:
                self._servos.write(os.read(self._host, 4096))
            now = time.monotonic()
            if self._servos in ready:
                kept.append((now + self.hold_s, now, self._servos.read(4096)))
            while kept and kept[0][0] <= now:
                _, self.newest_s, data = kept.popleft()
                os.write(self._host, data)


@pytest.fixture
def adapter(emulator: EmulatorProcess, rig: Rig) -> Iterator[Adapter]:
    adapter = Adapter(emulator.port, rig.baud_rate)
    yield adapter
    adapter.close()
