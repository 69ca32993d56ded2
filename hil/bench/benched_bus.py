"""An emulated bus for a benchmark: in a process of its own with its bytes in time, or in virtual time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import dataclass
from functools import partial

from dynamixel_sdk import PortHandler

from highfive.hil.drivers.bus.serial_line import MACHINE_WIRING, Wiring
from highfive.hil.drivers.bus.servo_port import ServoPort
from highfive.hil.drivers.emulator.bus_faults import parse_faults
from highfive.hil.drivers.emulator.emulator_process import EmulatorOptions, EmulatorProcess, make_bus
from highfive.hil.drivers.emulator.virtual_rig import PATH, VirtualRig
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.model.errors import HighFiveError


@dataclass(frozen=True)
class BenchedBus:
    """A bus of the rig's servos.

    Attributes:
        port: where it is.
        wiring: clock and lines.
        set_faults: from now on only this goes wrong.
        sdk_port: the port, open for the maker's SDK at some baud rate in that context.
    """

    port: str
    wiring: Wiring
    set_faults: Callable[[str], None]
    sdk_port: Callable[[int], AbstractContextManager[PortHandler]]


@contextmanager
def machine_bus() -> Iterator[BenchedBus]:
    """By the machine's clock, on a pseudo-terminal; the SDK has its own port.

    Raises:
        HighFiveError: the emulator does not start.
    """
    with EmulatorProcess() as emulator:
        yield BenchedBus(emulator.port, MACHINE_WIRING, emulator.set_faults, partial(_sdk_port, emulator.port))


@contextmanager
def virtual_bus() -> Iterator[BenchedBus]:
    """In virtual time, where nothing but the line and the servos take time."""
    with VirtualClock() as clock:
        virtual = VirtualRig(clock, make_bus(EmulatorOptions()))
        yield BenchedBus(
            PATH,
            virtual.wiring,
            lambda faults: virtual.bus.set_faults(parse_faults([faults]), virtual.now()),
            lambda baud: closing(ServoPort(PATH, baud, wiring=virtual.wiring)),
        )


@contextmanager
def _sdk_port(path: str, baud: int) -> Iterator[PortHandler]:
    port = PortHandler(path)
    if not (port.openPort() and port.setBaudRate(baud)):
        raise HighFiveError(f"the maker's SDK cannot open {path} at {baud} baud")
    try:
        yield port
    finally:
        port.closePort()
