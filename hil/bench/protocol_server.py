"""A server of one live protocol in a process of its own, which remembers when it sent what: for ``highfive bench``.

Arguments: protocol, C3D file, and where the send times go (.npz). Prints the address to listen to, and sends, again and
again, until its standard input ends; then it writes frame numbers and, ns on the monotonic clock, when each was sent.
"""

from __future__ import annotations

import os
import sys
import threading
from pathlib import Path

import numpy as np

from highfive.hil.commands.serve import ServeOptions, address_of, make_server
from highfive.hil.runtime.shutdown import until_ended
from highfive.mocap_bridge.files.c3d import read_c3d
from highfive.mocap_bridge.files.recording import Recording, resample
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.servers.serving import Server, serve
from highfive.mocap_bridge.sources.scheme import Address
from highfive.mocap_bridge.sources.source import RATE_HZ


class Stamped:
    """A server that notes when each frame went to the operating system: what comes before is the system's own time."""

    def __init__(self, server: Server):
        """Nothing is sent yet."""
        self._server = server
        self.numbers: list[int] = []
        self.times_ns: list[int] = []

    @property
    def port(self) -> int:
        """The port that it listens at."""
        return self._server.port

    @property
    def sent_ns(self) -> int:
        """As the server says."""
        return self._server.sent_ns

    def send(self, frame: MarkerFrame) -> None:
        """Sends and notes the time."""
        self._server.send(frame)
        self.numbers.append(frame.number)
        self.times_ns.append(self._server.sent_ns)

    def hang_up(self) -> None:
        """As the server does."""
        self._server.hang_up()

    def answer(self) -> None:
        """As the server does."""
        self._server.answer()

    def close(self) -> None:
        """Ends everything."""
        self._server.close()


def start_server(protocol: str, recording: Recording) -> tuple[Stamped, Address]:
    """The server, at a free port or under a name of its own, and what a client gives to get its stream.

    Raises:
        HighFiveError: it cannot listen.
    """
    if protocol == "lsl":
        from highfive.mocap_bridge.servers.lsl import LslServer  # noqa: PLC0415

        name = f"HighFiveBench{os.getpid()}"
        return Stamped(LslServer(recording.names, recording.rate_hz, name)), Address("lsl", name)
    options = ServeOptions(protocol, Path(recording.source), port=0)
    server = make_server(options, recording)
    return Stamped(server), address_of(options, server.port)


def main() -> None:
    """Sends until it is ended."""
    protocol, file, out = sys.argv[1:]
    recording = resample(read_c3d(file), RATE_HZ)
    with until_ended() as end:
        server, address = start_server(protocol, recording)
        threading.Thread(target=lambda: (sys.stdin.read(), end.set()), daemon=True).start()
        try:
            print(address, flush=True)
            serve(recording, server, loop=True, stop=end)
        finally:
            server.close()
            np.savez(out, numbers=np.array(server.numbers), times_ns=np.array(server.times_ns))


if __name__ == "__main__":
    main()
