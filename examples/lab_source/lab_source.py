"""A laboratory's own marker protocol: a line of text a frame over UDP.

    12 0.100 RSHO 0.01 -0.20 1.41 RELB nan nan nan …

is frame 12, at 0.1 s of the sender's clock; each marker has x, y, z in metres, z up, and ``nan`` where it is hidden.

    pip install examples/lab_source
    highfive stream lab://0.0.0.0:9763
    python examples/lab_source/send.py recording.c3d
"""

from __future__ import annotations

import socket
from collections.abc import Sequence

import numpy as np

from highfive import Address, LinkError, MarkerFrame, Scheme


class LabLink:
    """One connection: a socket that lines come to."""

    rate_hz = 0.0
    """The protocol does not say how many frames per second there are."""

    def __init__(self, address: Address):
        """Begins to listen; ``LinkError`` says why it cannot be done, and High Five tries again."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((address.host, address.port))
        except OSError as error:
            self._socket.close()
            raise LinkError(f"{address}: {error.strerror or error}") from None

    def receive(self, timeout_s: float) -> Sequence[MarkerFrame]:
        """The frames that have come, after at most ``timeout_s``."""
        self._socket.settimeout(timeout_s)
        try:
            return [frame_of(self._socket.recv(65536))]
        except TimeoutError:
            return []

    def close(self) -> None:
        """Lets the port go."""
        self._socket.close()


def frame_of(datagram: bytes) -> MarkerFrame:
    """A line as a frame; a marker that is hidden is not valid."""
    try:
        number, time_s, *rest = datagram.decode("ascii").split()
        points = np.array([rest[k + 1 : k + 4] for k in range(0, len(rest), 4)], dtype=float).reshape(-1, 3)
        valid = np.isfinite(points).all(axis=1)
        return MarkerFrame(
            names=tuple(rest[0::4]),
            positions=np.where(valid[:, None], points, 0.0),
            valid=valid,
            number=int(number),
            source_time_ns=round(float(time_s) * 1e9),
            arrival_time_ns=0,
            unlabelled=np.zeros((0, 3)),
        )
    except ValueError as error:
        raise LinkError(f"a line that is not of the protocol: {error}") from None


SCHEME = Scheme("lab://0.0.0.0:9763", LabLink, port=9763)
"""What the entry point names: how an address is written, and what connects."""
