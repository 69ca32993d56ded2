"""What pages on other machines are told of this one: of a file its name, and not where it lies."""

from __future__ import annotations

import json
from collections.abc import Sequence
from ipaddress import ip_address
from pathlib import PurePath
from typing import Any

from highfive.hil.view.wire import encode_text


def is_here(peer: Sequence[Any] | None, own: Sequence[Any] | None) -> bool:
    """Whether a connection's ends, each an address and a port, are both on this machine; no, where that is unknown.

    A browser here that asks for this machine's address in the network comes from that address. What is led here by a
    cable (``adb reverse``) or a tunnel comes from this machine.
    """
    if not peer or not own:
        return False
    return ip_address(peer[0]).is_loopback or peer[0] == own[0]


def for_elsewhere(text: str) -> str:
    """The text ``over`` as a page on another machine has it."""
    told = json.loads(text)
    if told.get("report"):
        told["report"] = PurePath(told["report"]).name
    return encode_text(**told)
