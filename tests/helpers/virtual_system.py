"""A live system in virtual time, at the wire's place: what connects to it gets its frames when they are sent."""

from collections.abc import Callable, Sequence

from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.runtime.virtual_scheduler import VirtualCondition, VirtualScheduler
from highfive.hil.trials.live_wiring import LiveWiring
from highfive.mocap_bridge.files.recording import Recording
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.servers.faults import Faults, parse_fault
from highfive.mocap_bridge.servers.serving import serve
from highfive.mocap_bridge.sources.scheme import Address
from highfive.mocap_bridge.wire.errors import LinkError


class VirtualSystem:
    """Sends a recording again and again, with faults, as ``highfive serve --loop`` does, from ``begins_s`` on.

    Attributes:
        wiring: clock, tasks and wire, for who follows it at any address.
        sent: frames so far, and when each was sent, ns.
    """

    port = 0

    def __init__(self, clock: VirtualClock, recording: Recording, *faults: str, begins_s: float = 0.0) -> None:
        self.clock, self.rate_hz = clock, recording.rate_hz
        self.changed = VirtualCondition(clock)
        self.up, self.links = True, list[VirtualLink]()
        self.wiring = LiveWiring(clock, VirtualScheduler(clock), self._connects)
        self.sent: list[tuple[int, int]] = []
        replay = Faults([parse_fault(fault) for fault in faults])
        begins = clock.now() + round(1e9 * begins_s)

        def run() -> None:
            clock.wait_until(begins)
            serve(recording, self, replay, loop=True, stop=self, clock=clock.now)

        clock.start("system", run)

    @property
    def sent_ns(self) -> int:
        return self.sent[-1][1] if self.sent else 0

    def is_set(self) -> bool:
        return False

    def wait(self, timeout: float | None = None) -> bool:
        self.clock.wait_until(self.clock.now() + round(1e9 * (timeout or 0.0)))
        return False

    def send(self, frame: MarkerFrame) -> None:
        self.sent.append((frame.number, self.clock.now()))
        for link in self.links:
            link.come.append(frame)
        self.changed.notify_all()

    def hang_up(self) -> None:
        self.up, self.links = False, []
        self.changed.notify_all()

    def answer(self) -> None:
        self.up = True

    def close(self) -> None:
        self.hang_up()

    def _connects(self, address: Address) -> Callable[[], "VirtualLink"]:
        return lambda: VirtualLink(self)


class VirtualLink:
    """One connection to it."""

    def __init__(self, system: VirtualSystem) -> None:
        if not system.up:
            raise LinkError("nothing listens")
        self._system, self.come = system, list[MarkerFrame]()
        system.links.append(self)

    @property
    def rate_hz(self) -> float:
        return self._system.rate_hz

    def receive(self, timeout_s: float) -> Sequence[MarkerFrame]:
        self._system.changed.wait_for(lambda: bool(self.come) or self not in self._system.links, timeout_s)
        if not self.come and self not in self._system.links:
            raise LinkError("the connection was closed")
        come, self.come = self.come, []
        return come

    def close(self) -> None:
        if self in self._system.links:
            self._system.links.remove(self)
