"""Open Sound Control 1.0 in bytes: messages and bundles (Wright & Freed 2002, opensoundcontrol.org/spec-1_0).

Big endian; every part is filled up with zeros to a multiple of four bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator

_BUNDLE = b"#bundle\0" + struct.pack(">Q", 1)  # the time tag that means at once


def message(address: str, *values: int | float | str) -> bytes:
    """A message; whole numbers are int32, others float32, texts end with a zero."""
    kinds, data = ",", b""
    for value in values:
        if isinstance(value, str):
            kinds, data = kinds + "s", data + _text(value)
        elif isinstance(value, int):
            kinds, data = kinds + "i", data + struct.pack(">i", value)
        else:
            kinds, data = kinds + "f", data + struct.pack(">f", value)
    return _text(address) + _text(kinds) + data


def bundles(messages: Iterable[bytes], longest: int) -> Iterator[bytes]:
    """Bundles of at most ``longest`` bytes, each with as many of the messages, in order, as fit."""
    whole = _BUNDLE
    for one in messages:
        element = struct.pack(">i", len(one)) + one
        if len(whole) + len(element) > longest and whole != _BUNDLE:
            yield whole
            whole = _BUNDLE
        whole += element
    if whole != _BUNDLE:
        yield whole


def _text(value: str) -> bytes:
    data = value.encode()
    return data + b"\0" * (4 - len(data) % 4)
