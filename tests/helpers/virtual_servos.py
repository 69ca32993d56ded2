"""An emulated bus in virtual time, behind a cable that can keep answers back as USB adapters do."""

from collections import deque
from collections.abc import Callable

from highfive.hil.drivers.bus.serial_line import Line, Wiring
from highfive.hil.drivers.emulator.bus_faults import parse_faults
from highfive.hil.drivers.emulator.emulator_process import EmulatorOptions, make_bus
from highfive.hil.drivers.emulator.virtual_rig import PATH, VirtualRig
from highfive.hil.runtime.virtual_clock import VirtualClock

NS = 1_000_000_000


class VirtualServos:
    """Bus, cable and clock.

    Attributes:
        port, wiring: what a bus is opened by.
        hold_s: so long bytes of the servos are kept back from now on, s; none is lost.
        newest_s: when the newest bytes that the host was given had come from the servos, s.
    """

    port = PATH

    def __init__(self, clock: VirtualClock, options: EmulatorOptions | None = None) -> None:
        """Just switched on."""
        self.clock = clock
        self.rig = VirtualRig(clock, make_bus(options or EmulatorOptions()), self._relay)
        self.hold_s = self.newest_s = 0.0
        self._cables: list[Cable] = []
        self._line = self.rig.wiring.open_line
        self.wiring = self.rig.wiring = Wiring(clock, self._open)

    @property
    def now_s(self) -> float:
        return self.clock.now() / NS

    def set_faults(self, *texts: str) -> None:
        """From now on only these."""
        self.rig.bus.set_faults(parse_faults(texts), self.rig.now())

    def sleep(self, seconds: float) -> None:
        """Lets time pass."""
        self.clock.wait_until(self.clock.now() + round(seconds * NS))

    def until(self, condition: Callable[[], object], seconds: float = 20.0) -> None:
        """Lets time pass until that is so."""
        end = self.clock.now() + round(seconds * NS)
        while not condition():
            assert self.clock.now() < end, "it did not happen"
            self.sleep(0.003)

    def later(self, seconds: float, call: Callable[[], object]) -> None:
        """Has something happen meanwhile."""

        def wait_and_call() -> None:
            self.sleep(seconds)
            call()

        self.clock.start("later", wait_and_call)

    def _open(self, path: str, baud: int) -> Line:
        cable = Cable(self, self._line(path, baud))
        self._cables.append(cable)
        return cable

    def _relay(self, _: int) -> None:
        for cable in self._cables:
            cable.relay()


class Cable:
    """A line whose answers come later."""

    def __init__(self, servos: VirtualServos, line: Line) -> None:
        self._servos, self._line = servos, line
        self._kept: deque[tuple[int, int, bytes]] = deque()  # when it is given, when it came, what
        self._given = b""

    def fileno(self) -> int:
        return self._line.fileno()

    @property
    def due_ns(self) -> int | None:
        if self._given or self._line.due_ns == 0:
            return 0
        if self._kept:
            return self._kept[0][0]
        due = self._line.due_ns
        return None if due is None else due + round(self._servos.hold_s * NS)

    def relay(self) -> None:
        """Takes what has come from the servos, and lets through what was kept for long enough."""
        clock = self._servos.clock
        while (due := self._line.due_ns) is not None and 0 < due <= clock.now():
            self._kept.append((due + round(self._servos.hold_s * NS), due, self._line.read(4096)))
        while self._kept and self._kept[0][0] <= clock.now():
            _, came, data = self._kept.popleft()
            self._servos.newest_s = came / NS
            self._given += data

    def read(self, length: int) -> bytes:
        if self._line.due_ns == 0:  # the cable was pulled
            return self._line.read(length)
        self.relay()
        found, self._given = self._given[:length], self._given[length:]
        return found

    def write(self, data: bytes) -> None:
        self._line.write(data)

    def clear(self) -> None:
        self.relay()
        self._given = b""

    def close(self) -> None:
        self._line.close()
        self._servos._cables.remove(self)
