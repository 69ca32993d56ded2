"""Where markers come from, as one line of text: ``vicon://host:801``, ``lsl://name``, the path of a C3D file."""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import partial
from urllib.parse import parse_qsl, unquote, urlsplit

from highfive.mocap_bridge.files.c3d import read_c3d
from highfive.mocap_bridge.sources.live import Link, LiveSource
from highfive.mocap_bridge.sources.merged import MergedSource
from highfive.mocap_bridge.sources.merged_address import merged_part, parts_of
from highfive.mocap_bridge.sources.registry import examples, is_known, scheme_named
from highfive.mocap_bridge.sources.scheduler import THREADS, Now, Scheduler
from highfive.mocap_bridge.sources.scheme import FILE, MERGED, Address, Scheme
from highfive.mocap_bridge.sources.source import C3DSource, Source
from highfive.mocap_bridge.sources.tap import Tap, tapped
from highfive.model.errors import HighFiveError

MERGES = "vicon://192.168.10.1+qtm://192.168.10.2?at=1.2,0.4,0,90"
"""How systems that see one person are joined."""

WEBCAM = "webcam"
"""The camera of whoever has the live page of ``highfive simulate`` open; ``webcam?hand=left`` follows a left hand."""


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
    if len(parts := parts_of(text)) > 1:
        return _merged(text, parts)
    name, _, options = text.strip().partition("?")
    if name.lower() == "headset":  # there is one page: its headset needs no further name
        text = f"headset://page{options and '?' + options}"
    if name.lower() == WEBCAM:
        if options not in ("", "hand=left", "hand=right"):
            raise HighFiveError(f"address {text!r}: a webcam is told hand=left or hand=right, and nothing else")
        return Address(WEBCAM, "page", options=dict(parse_qsl(options)))
    scheme, separator, rest = text.strip().partition("://")
    if not separator:
        if not text.strip():
            raise HighFiveError(f"an address is empty; expected {examples()} or the path of a C3D file")
        return Address(FILE, text.strip())
    scheme = scheme if is_known(scheme) else scheme.lower()  # a plug-in's name may have capitals
    if not is_known(scheme):
        raise HighFiveError(f"unknown address {text!r}: there are {examples()} and the paths of C3D files")
    kind = scheme_named(scheme)
    if not kind.port:  # a stream's name may be anything, where a host may not
        name, _, query = rest.partition("?")
        host, port = unquote(name.removesuffix("/")).strip(), 0
    else:
        host, port, query = _host(text, rest, kind)
    if not host or any(c in "'\"" or (c.isspace() and kind.port) for c in host):
        raise HighFiveError(f"address {text!r} names no {'host' if kind.port else 'stream'}; as in {kind.example}")
    if kind.port and "+" in host:  # no host has one: a system of several is missing or is not understood
        raise HighFiveError(f"address {text!r}: + joins two whole addresses, as in {MERGES}")
    options = parse_qsl(query, keep_blank_values=True)
    if len(dict(options)) != len(options):
        raise HighFiveError(f"address {text!r} gives an option twice")
    return Address(scheme, host, port or kind.port, {k: _checked(text, kind, k, v) for k, v in options})


def _merged(text: str, parts: tuple[str, ...]) -> Address:
    """The address of several systems, of which each has been looked at."""
    seen = set[str]()
    for part in parts:
        address = parse_address(merged_part(part).address)
        if address.scheme in (FILE, WEBCAM, "headset"):
            raise HighFiveError(f"{part!r} is not merged with another: expected systems of the network, as in {MERGES}")
        if str(address) in seen:
            raise HighFiveError(f"address {text!r} names {address} twice; name each system once")
        seen.add(str(address))
    return Address(MERGED, text.strip())


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
    if wrong := kind.check(key, value):
        raise HighFiveError(f"address {text!r}: {wrong}")
    return value


def _lower(message: str) -> str:
    return message[:1].lower() + message[1:]


def connector(address: Address, now: Now = THREADS.now) -> Callable[[], Link]:
    """What connects to a live system, by the clock ``now``, ns; each protocol's library is imported only where it is
    needed."""
    if address.scheme == FILE:
        raise HighFiveError(f"{address} is no live system")
    if address.scheme == MERGED:
        raise HighFiveError(f"{address} is of several systems; connect to each of them")
    if address.scheme == WEBCAM:
        raise HighFiveError("a webcam is seen by the live page alone: highfive simulate --source webcam")
    return scheme_named(address.scheme).connector(address, now)


def open_source(
    address: Address | str,
    person: str | None = None,
    rate_hz: float | None = None,
    tap: Tap | None = None,
    scheduler: Scheduler = THREADS,
    connects: Callable[[Address], Callable[[], Link]] | None = None,
    beside: Collection[str] = (),
) -> Source:
    """Starts to listen to a live system, or to replay a file in real time from now.

    Args:
        address: where the markers come from.
        person: prefix of the person's markers; None takes the only one there is.
        rate_hz: frames per second: of a file, resampled (default: its own); of a live system that does not say its own.
        tap: gets every frame of a live system as it came, of all persons.
        scheduler: time, and what a live system is followed by.
        connects: gives what connects to a live system; None connects as its protocol does.
        beside: labels of what is no person in a live system, such as an arm's plate.

    Raises:
        HighFiveError: a bad address; no such file; no such person in it; a tap on a file.
    """
    address = parse_address(address) if isinstance(address, str) else address
    if address.scheme == FILE:
        if tap is not None:
            raise HighFiveError(f"{address} is a recording already; recording goes with a live system")
        recording = read_c3d(address.host).person(person)
        return C3DSource(recording, rate_hz or recording.rate_hz, start_ns=scheduler.now())
    connects = connects or partial(connector, now=scheduler.now)
    if address.scheme == MERGED:
        parts = [merged_part(part) for part in parts_of(address.host)]
        addresses = [parse_address(part.address) for part in parts]
        connecting = [connects(one) for one in addresses]  # all of them are known before the first thread runs
        systems = [
            (LiveSource(str(one), connect, part.person or person, rate_hz or 120.0, scheduler, beside), part.placed)
            for one, connect, part in zip(addresses, connecting, parts, strict=True)
        ]
        return MergedSource(str(address), systems, tap, scheduler)
    connect = connects(address)
    if tap is not None:
        connect = tapped(connect, tap, scheduler.now)
    return LiveSource(str(address), connect, person, rate_hz or 120.0, scheduler, beside)
