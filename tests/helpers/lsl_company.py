"""Other programs on LSL beside a session: one that hears all of it, one that says something twenty times a second."""

import socket
import threading
from collections.abc import Iterator

import pylsl


class Hearing:
    """Inlets for the session's streams, opened as soon as these are there; and a UDP port for VMC."""

    def __init__(self, count: int = 3) -> None:
        """Waits for so many of the session's streams."""
        self._count = count
        self.receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        self.receiver.bind(("127.0.0.1", 0))
        self.heard: dict[str, list[tuple[list[float | str], float]]] = {}
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        inlets: dict[str, pylsl.StreamInlet] = {}
        while len(inlets) < self._count:
            for info in pylsl.resolve_bypred("starts-with(name,'HighFive-')", self._count, 2.0):
                inlets.setdefault(info.name(), pylsl.StreamInlet(info, recover=False))
        threads = [threading.Thread(target=self._hear, args=one) for one in inlets.items()]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()

    def _hear(self, name: str, inlet: pylsl.StreamInlet) -> None:
        kept = self.heard[name] = []
        try:
            while True:
                values, stamps = inlet.pull_chunk(0.5, 1024, min_samples=1, as_numpy=False)
                kept += zip(values, stamps, strict=True)
        except pylsl.util.LostError:
            return

    def finish(self) -> dict[str, list[tuple[list[float | str], float]]]:
        """Samples and stamps of each stream, once all have ended."""
        self._thread.join(60.0)
        assert not self._thread.is_alive()
        return self.heard

    def datagrams(self) -> Iterator[bytes]:
        """Those of VMC that wait."""
        self.receiver.setblocking(False)
        while True:
            try:
                yield self.receiver.recv(65536)
            except BlockingIOError:
                return


class Stimuli:
    """The stream ``TestStimuli``, with one text after the other until it is told to finish."""

    def __init__(self) -> None:
        self._over, self._said = threading.Event(), list[str]()
        info = pylsl.StreamInfo("TestStimuli", "Markers", 1, 0, pylsl.cf_string, "test-stimuli")
        about = info.desc().append_child("channels")
        about.append_child("channel").append_child_value("label", "shown")
        self._outlet = pylsl.StreamOutlet(info)
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        while not self._over.wait(0.05):
            self._said.append(f"stimulus {len(self._said)}")
            self._outlet.push_sample([self._said[-1]])

    def finish(self) -> list[str]:
        """All that was said."""
        self._over.set()
        return self._said
