"""Where markers come from, as one line of text: ``vicon://host:801``, ``lsl://name``, the path of a C3D file."""

from __future__ import annotations

import ipaddress
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from urllib.parse import parse_qsl, quote, unquote, urlsplit

from highfive.mocap_bridge.files.c3d import read_c3d
from highfive.mocap_bridge.sources.live import Link, LiveSource
from highfive.mocap_bridge.sources.source import C3DSource, Source
from highfive.mocap_bridge.sources.tap import Tap, tapped
from highfive.model.errors import HighFiveError

FILE = "file"
"""Scheme of an address that is the path of a C3D file."""


@dataclass(frozen=True)
class Scheme:
    """One kind of address.

    Attributes:
        example: how one is written.
        port: where the system listens if the address does not say; 0 for none.
        options: what may follow a question mark: each with the values it may have; none listed: see :func:`_checked`.
    """

    example: str
    port: int
    options: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


SCHEMES: Mapping[str, Scheme] = MappingProxyType(
    {
        "vicon": Scheme("vicon://192.168.10.1:801?mode=pull", 801, {"mode": ("push", "pull")}),
        "qtm": Scheme("qtm://192.168.10.1:22223", 22223),
        "natnet": Scheme(
            "natnet://192.168.10.1?up=z&multicast=239.255.42.99",
            1510,
            {"up": ("y", "z"), "multicast": (), "data_port": ()},
        ),
        "lsl": Scheme("lsl://name", 0, {"up": ("y", "z")}),
    }
)
"""Every live system that can be listened to."""


@dataclass(frozen=True)
class Address:
    """An address, checked.

    Attributes:
        scheme: one of :data:`SCHEMES`, or :data:`FILE`.
        host: name or number of the machine; of an LSL stream its name; of a file its path.
        port: TCP or UDP port; 0 where there is none.
        options: what followed the question mark.
    """

    scheme: str
    host: str
    port: int = 0
    options: Mapping[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        """The address as it is written; :func:`parse_address` reads it back."""
        if self.scheme == FILE:
            return self.host
        host = quote(self.host, safe="") if self.scheme == "lsl" else self.host
        host = f"[{host}]" if ":" in host else host
        port = f":{self.port}" if self.port else ""
        options = "&".join(f"{key}={value}" for key, value in self.options.items())
        return f"{self.scheme}://{host}{port}{'?' + options if options else ''}"


def is_live(text: str) -> bool:
    """Whether it is the address of a live system, and not a file.

    Raises:
        HighFiveError: as :func:`parse_address`.
    """
    return parse_address(text).scheme != FILE


def parse_address(text: str) -> Address:
    """Reads an address; whether anything is there is not looked at.

    Raises:
        HighFiveError: an unknown scheme or option, no host, a port or value that is none.
    """
    scheme, separator, rest = text.strip().partition("://")
    if not separator:
        if not text.strip():
            raise HighFiveError(f"an address is empty; expected {_examples()} or the path of a C3D file")
        return Address(FILE, text.strip())
    scheme = scheme.lower()
    if scheme not in SCHEMES:
        raise HighFiveError(f"unknown address {text!r}: there are {_examples()} and the paths of C3D files")
    kind = SCHEMES[scheme]
    if scheme == "lsl":  # a name may be anything, where a host may not
        name, _, query = rest.partition("?")
        host, port = unquote(name.removesuffix("/")).strip(), 0
    else:
        host, port, query = _host(text, rest, kind)
    if not host or any(c in "'\"" or (c.isspace() and scheme != "lsl") for c in host):
        raise HighFiveError(
            f"address {text!r} names no {'stream' if scheme == 'lsl' else 'host'}; as in {kind.example}"
        )
    options = parse_qsl(query, keep_blank_values=True)
    if len(dict(options)) != len(options):
        raise HighFiveError(f"address {text!r} gives an option twice")
    return Address(scheme, host, port or kind.port, {k: _checked(text, kind, k, v) for k, v in options})


def _host(text: str, rest: str, kind: Scheme) -> tuple[str, int, str]:
    """Host, port (0 where none is given) and what follows the question mark."""
    try:
        parts = urlsplit(f"//{rest}")
        host, port = parts.hostname or "", parts.port
    except ValueError as error:
        raise HighFiveError(f"address {text!r}: {_lower(str(error))}; write it as {kind.example}") from None
    if port == 0:
        raise HighFiveError(f"address {text!r}: port 0 is none; expected 1 to 65535")
    if parts.path not in ("", "/") or parts.fragment or "@" in parts.netloc:
        raise HighFiveError(f"address {text!r}: not understood beyond the host; write it as {kind.example}")
    return host, port or 0, parts.query


def _checked(text: str, kind: Scheme, key: str, value: str) -> str:
    """The value of an option, if it may have it."""
    if key not in kind.options:
        known = ", ".join(kind.options) or "none"
        raise HighFiveError(f"address {text!r}: unknown option {key!r}; there are: {known}")
    if kind.options[key] and value not in kind.options[key]:
        raise HighFiveError(f"address {text!r}: {key} is {value!r}; expected {' or '.join(kind.options[key])}")
    if key == "data_port" and not (value.isdecimal() and 1 <= int(value) <= 65535):
        raise HighFiveError(f"address {text!r}: data_port is {value!r}; expected 1 to 65535")
    if key == "multicast":
        try:
            good = ipaddress.ip_address(value).is_multicast
        except ValueError:
            good = False
        if not good:
            raise HighFiveError(f"address {text!r}: {value!r} is no multicast group, such as 239.255.42.99")
    return value


def _examples() -> str:
    return ", ".join(scheme.example for scheme in SCHEMES.values())


def _lower(message: str) -> str:
    return message[:1].lower() + message[1:]


def open_source(
    address: Address | str, person: str | None = None, rate_hz: float | None = None, tap: Tap | None = None
) -> Source:
    """Starts to listen to a live system, or to replay a file in real time from now.

    Args:
        address: where the markers come from.
        person: prefix of the person's markers; None takes the only one there is.
        rate_hz: frames a second: of a file, resampled (default: its own); of a live system that does not say its own.
        tap: is told of every frame of a live system as it came, of all persons.

    Raises:
        HighFiveError: a bad address; no such file; no such person in it; a tap on a file.
    """
    address = parse_address(address) if isinstance(address, str) else address
    if address.scheme == FILE:
        if tap is not None:
            raise HighFiveError(f"{address} is a recording already; recording goes with a live system")
        recording = read_c3d(address.host).person(person)
        return C3DSource(recording, rate_hz or recording.rate_hz, start_ns=time.monotonic_ns())
    connect = connector(address)
    return LiveSource(str(address), connect if tap is None else tapped(connect, tap), person, rate_hz or 120.0)


def connector(address: Address) -> Callable[[], Link]:
    """What connects to a live system; each protocol's library is imported only where it is wanted."""
    host, port, options = address.host, address.port, address.options
    if address.scheme == "vicon":
        from highfive.mocap_bridge.sources.vicon import connect_vicon  # noqa: PLC0415

        return lambda: connect_vicon(host, port, pull=options.get("mode") == "pull")
    if address.scheme == "qtm":
        from highfive.mocap_bridge.sources.qtm import connect_qtm  # noqa: PLC0415

        return lambda: connect_qtm(host, port)
    if address.scheme == "natnet":
        from highfive.mocap_bridge.sources.natnet import DATA_PORT, connect_natnet  # noqa: PLC0415

        data_port, y_up = int(options.get("data_port", DATA_PORT)), options.get("up", "y") == "y"
        return lambda: connect_natnet(host, port, data_port, options.get("multicast"), y_up, options=options)
    if address.scheme == "lsl":
        from highfive.mocap_bridge.sources.lsl import FrameCounter, connect_lsl  # noqa: PLC0415

        counter = FrameCounter()  # of all connections
        return lambda: connect_lsl(host, y_up=options.get("up") == "y", counter=counter)
    raise HighFiveError(f"{address} is no live system")
