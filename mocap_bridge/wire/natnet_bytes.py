"""Reads the body of a NatNet datagram from front to back."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.wire.errors import LinkError

_U32, COUNT_AND_SIZE = struct.Struct("<I"), struct.Struct("<II")


class BodyReader:
    """Reads a body from front to back; what is not there is an error before anything is made of it."""

    def __init__(self, data: bytes) -> None:
        """At the front of ``data``; ``end`` may be set nearer."""
        self.data, self.at, self.end = data, 0, len(data)

    @property
    def left(self) -> int:
        """Bytes that have not been read."""
        return self.end - self.at

    def skip(self, count: int, what: str) -> int:
        """Goes on by ``count`` bytes; where it was."""
        start = self.at
        if not 0 <= count <= self.end - start:
            raise LinkError(f"{what} takes {count} bytes where {self.left} are left")
        self.at = start + count
        return start

    def count(self, size: int, what: str) -> int:
        """A number of things of at least ``size`` bytes each."""
        count = self.u32(what)
        if count * size > self.left:
            raise LinkError(f"{count} x {what} take at least {count * size} bytes where {self.left} are left")
        return count

    def u32(self, what: str) -> int:
        """An unsigned number of 32 bits."""
        return _U32.unpack_from(self.data, self.skip(4, what))[0]

    def text(self, what: str) -> str:
        """Text up to a zero byte."""
        stop = self.data.find(b"\0", self.at, self.end)
        if stop < 0:
            raise LinkError(f"{what} without an end")
        text = self.data[self.at : stop].decode("utf-8", "replace")
        self.at = stop + 1
        return text

    def points(self, what: str) -> NDArray[np.float32]:
        """A count, and so many positions (n, 3)."""
        count = self.count(12, what)
        return np.frombuffer(self.data, "<f4", 3 * count, self.skip(12 * count, what)).reshape(count, 3)
