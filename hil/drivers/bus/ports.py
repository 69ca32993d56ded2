"""Serial ports of this machine, and what holds up the answers of their adapters."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from serial.tools import list_ports

SLOW_MS = 2
"""An adapter that keeps bytes back for longer, ms, cannot serve 120 cycles a second."""

SYSTEM = Path("/sys/bus/usb-serial/devices")
"""Where Linux shows the adapters, and how long each keeps bytes back."""


@dataclass(frozen=True)
class Port:
    """A serial port.

    Attributes:
        path: such as ``/dev/ttyUSB0``.
        description: what the system says of it.
        latency_ms: for how long its adapter keeps bytes back before it hands them over; None where nothing is known.
    """

    path: str
    description: str
    latency_ms: int | None

    @property
    def advice(self) -> str:
        """How to make a slow adapter quick; '' where there is nothing to do."""
        if self.latency_ms is None or self.latency_ms < SLOW_MS:
            return ""
        return f"the adapter keeps answers back for {self.latency_ms} ms: echo 1 | sudo tee {_timer(self.path)}"


def serial_ports() -> list[Port]:
    """The serial ports that the system knows."""
    return [
        Port(port.device, port.description or "", latency_ms(port.device)) for port in sorted(list_ports.comports())
    ]


def latency_ms(path: str) -> int | None:
    """The latency timer of an FTDI adapter, ms; None where there is none, or it cannot be read."""
    try:
        return int(_timer(path).read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None


def too_slow(path: str) -> str:
    """How to make a port's adapter quick, where opening the port (:mod:`highfive.hil.drivers.bus.servo_port`) did
    not; '' where that is not needed."""
    return Port(path, "", latency_ms(path)).advice


def _timer(path: str) -> Path:
    return SYSTEM / Path(path).resolve().name / "latency_timer"
