"""What describes a protocol: how its addresses are written, and what connects to one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from types import MappingProxyType
from urllib.parse import quote

from highfive.mocap_bridge.sources.live import Link
from highfive.mocap_bridge.sources.scheduler import THREADS, Now

FILE = "file"
"""Scheme of an address that is the path of a C3D file."""

UP: Mapping[str, tuple[str, ...]] = MappingProxyType({"up": ("y", "z")})
"""The option of protocols that do not say which axis points up."""


@dataclass(frozen=True)
class Address:
    """An address, checked.

    Attributes:
        scheme: name of a protocol, see :mod:`highfive.mocap_bridge.sources.registry`, or :data:`FILE`.
        host: name or number of the machine; of a protocol that names streams the stream; of a file its path.
        port: TCP or UDP port; 0 where there is none.
        options: what followed the question mark.
    """

    scheme: str
    host: str
    port: int = 0
    options: Mapping[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        """The address as it is written; :func:`highfive.mocap_bridge.sources.address.parse_address` reads it back."""
        if self.scheme == FILE:
            return self.host
        host = f"[{self.host}]" if self.port and ":" in self.host else self.host if self.port else quote(self.host, "")
        port = f":{self.port}" if self.port else ""
        options = "&".join(f"{key}={value}" for key, value in self.options.items())
        return f"{self.scheme}://{host}{port}{'?' + options if options else ''}"


@dataclass(frozen=True)
class Scheme:
    """A protocol that can be listened to: what a plug-in offers in the entry-point group ``highfive.sources``.

    Attributes:
        example: how an address is written; the part before ``://`` is the protocol's name.
        connect: makes a connection to an address within a second or two, or raises
            :class:`highfive.mocap_bridge.wire.errors.LinkError`; a class whose constructor takes the address will do.
            It is called again whenever a connection is lost.
        port: where the system listens if the address does not say; 0 where streams are named, not machines.
        options: what may follow a question mark, each with the values it may have; none listed: anything that
            ``check`` accepts.
        check: what is wrong with an option's value (name, value), or '' where nothing is.
        timed: ``connect`` also takes ``now``, the monotonic clock that its deadlines go by, ns.
    """

    example: str
    connect: Callable[..., Link]
    port: int = 0
    options: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    check: Callable[[str, str], str] = lambda name, value: ""
    timed: bool = False

    def connector(self, address: Address, now: Now = THREADS.now) -> Callable[[], Link]:
        """What makes every connection of one source, by that clock."""
        return partial(self.connect, address, now=now) if self.timed else partial(self.connect, address)
