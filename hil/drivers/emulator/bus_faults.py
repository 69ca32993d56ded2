"""What goes wrong on a servo bus, on demand: how a fault is spelt and when it is on. Pure."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace

from highfive.hil.drivers.bus.packet import LAST_ID
from highfive.model.errors import HighFiveError

KINDS = {
    "dead": "servos hear nothing and say nothing (dead=4+5)",
    "late": "replies come so many ms late (late:20; of one servo: late=4:20)",
    "crc": "a reply's bytes do not fit its CRC (crc=4; of one reply in ten: crc:0.1)",
    "noise": "bytes that mean nothing come before a reply (noise; before one reply in ten: noise:0.1)",
    "half": "the second half of a reply is missing (half=4; of one reply in ten: half:0.1)",
    "overload": "servos report an overload and shut down, until they are started again (overload=2@5)",
    "hot": "servos are so many °C warm (hot=4:85; without a number 5 above their limit)",
    "brownout": "servos have so many V (brownout:8; without a number 8; below half of what they need they are off)",
    "unplug": "the adapter's cable is out: the port is gone, and comes back at the end (unplug@4-6)",
    "echo": "the adapter sends back what it is given",
    "slip": "a servo's horn has slipped, and it says so many degrees more than it should (slip=3:10, slip=3:-10)",
    "twice": "there is a second servo of the same ID (twice=3)",
}
"""Every fault and what it does."""

_DEFAULTS = {"crc": 1.0, "noise": 1.0, "half": 1.0, "hot": math.nan, "brownout": 8.0, "slip": 10.0}
_MOST = {"late": 10_000.0, "crc": 1.0, "noise": 1.0, "half": 1.0, "hot": 200.0, "brownout": 30.0, "slip": 180.0}
_NEEDS_SERVO, _NO_SERVO = {"dead", "overload", "slip", "twice"}, {"unplug", "echo"}
_SPELLING = re.compile(
    r"(?P<kind>[a-z]+)(=(?P<servos>[\d+]+))?(:(?P<amount>-?[\d.]+))?(@(?P<start>[\d.]+)(-(?P<end>[\d.]+))?)?"
)


@dataclass(frozen=True)
class BusFault:
    """One thing that goes wrong from ``start`` to ``end``, s.

    ``kind`` is one of :data:`KINDS`; ``servos`` are IDs, none for all; ``amount`` is in ms, °C, V, °, or a share.
    """

    kind: str
    servos: frozenset[int] = frozenset()
    amount: float = 0.0
    start: float = 0.0
    end: float = math.inf

    def on(self, time: float, servo: int | None = None) -> bool:
        """Whether it is going on at ``time``, s, and, where one is given, for that servo."""
        return self.start <= time < self.end and (servo is None or not self.servos or servo in self.servos)

    def after(self, time: float) -> BusFault:
        """The same with times that count from ``time``, s."""
        return replace(self, start=self.start + time, end=self.end + time)


def parse_fault(text: str) -> BusFault:
    """Reads ``kind=servos:amount@start-end``, times in s; without times all the time, without an end from then on.

    Raises:
        HighFiveError: it is spelt otherwise.
    """
    match = _SPELLING.fullmatch(text.strip())
    kind = match["kind"] if match else ""
    if not match or kind not in KINDS:
        what = "; ".join(f"{name}: {meaning}" for name, meaning in KINDS.items())
        raise HighFiveError(f"no fault {text!r}; a fault is kind=servos:amount@start-end, such as dead=4@2-3. {what}")
    try:
        servos = frozenset(int(one) for one in (match["servos"] or "").split("+") if match["servos"])
        amount = float(match["amount"]) if match["amount"] else _DEFAULTS.get(kind, 0.0)
        start, end = float(match["start"] or 0.0), float(match["end"] or math.inf)
    except ValueError:
        raise HighFiveError(f"fault {text!r}: its IDs, its amount and its times have to be numbers") from None
    if (
        start >= end
        or any(servo > LAST_ID for servo in servos)
        or bool(match["amount"]) > (kind in _MOST)
        or abs(amount) > _MOST.get(kind, 0.0)
        or (amount < 0.0 and kind != "slip")
        or (kind == "late" and not amount)
        or (kind in _NEEDS_SERVO and not servos)
        or (kind in _NO_SERVO and servos)
    ):
        raise HighFiveError(f"fault {text!r} makes no sense; {kind}: {KINDS[kind]}")
    return BusFault(kind, servos, amount, start, end)


def parse_faults(texts: Iterable[str], servos: Collection[int] | None = None) -> tuple[BusFault, ...]:
    """Several of them; a text may hold more than one, with commas between.

    Args:
        texts: the faults.
        servos: IDs that there are; None where that is not known yet.

    Raises:
        HighFiveError: one is spelt otherwise, or of an ID that is not there.
    """
    given = [one for text in texts for one in text.split(",") if one.strip()]
    faults = tuple(parse_fault(one) for one in given)
    for text, fault in zip(given, faults, strict=True):
        if servos is not None and (strange := fault.servos.difference(servos)):
            known = ", ".join(map(str, sorted(servos)))
            raise HighFiveError(f"fault {text!r}: there is no servo {min(strange)}; there are {known}")
    return faults
