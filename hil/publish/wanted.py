"""Who is to hear a session, as the command line says it: ``lsl,vmc://192.168.1.7:39539,foxglove``."""

from __future__ import annotations

from dataclasses import dataclass
from urllib.parse import urlsplit

from highfive.model.errors import HighFiveError

LSL, VMC, FOXGLOVE = "lsl", "vmc", "foxglove"
WAYS = {
    LSL: "lsl",
    VMC: "vmc or vmc://HOST:PORT",
    FOXGLOVE: "foxglove or foxglove://:PORT",
}
"""How each way is written."""
VMC_PORT, FOXGLOVE_PORT = 39539, 8765
_HERE = "127.0.0.1"


@dataclass(frozen=True)
class Wanted:
    """One way in which a session is published.

    Attributes:
        way: one of :data:`WAYS`.
        host: to which it is sent; '' where whoever listens comes here.
        port: UDP port of the receiver, or TCP port here; 0 where there is none.
    """

    way: str
    host: str = ""
    port: int = 0


def parse_wanted(text: str) -> tuple[Wanted, ...]:
    """The ways that a list separated by commas names.

    Raises:
        HighFiveError: one is unknown, there twice, or its address is wrong.
    """
    found: dict[str, Wanted] = {}
    for word in (part.strip() for part in text.split(",")):
        one = _parsed(word)
        if one.way in found:
            raise HighFiveError(f"--publish {text}: {one.way} is there twice; give each once")
        found[one.way] = one
    return tuple(found.values())


def _parsed(word: str) -> Wanted:
    way, scheme, _ = word.partition("://")
    if way not in WAYS:
        raise HighFiveError(f"cannot publish by {word!r}; there are {', '.join(WAYS.values())}")
    host, port = _address(word) if scheme else ("", None)
    if way == LSL and scheme:
        raise HighFiveError(f"--publish {word}: LSL streams are found by their names; write lsl")
    if way == FOXGLOVE and host:
        raise HighFiveError(f"--publish {word}: Foxglove comes to this computer; write foxglove://:{FOXGLOVE_PORT}")
    if way == VMC:
        return Wanted(VMC, host or _HERE, port or VMC_PORT)
    return Wanted(way, "", (port or FOXGLOVE_PORT) if way == FOXGLOVE else 0)


def _address(word: str) -> tuple[str, int | None]:
    """Host and port of an address that says nothing else."""
    example = f"{FOXGLOVE}://:{FOXGLOVE_PORT}" if word.startswith(FOXGLOVE) else f"{VMC}://127.0.0.1:{VMC_PORT}"
    try:
        parts = urlsplit(word)
        host, port = parts.hostname or "", parts.port
    except ValueError:
        raise HighFiveError(f"--publish {word}: expected a port of 1 to 65535, as in {example}") from None
    if port == 0 or parts.path or parts.query or parts.fragment or parts.username is not None or not (host or port):
        raise HighFiveError(f"--publish {word}: expected an address such as {example}")
    return host, port
