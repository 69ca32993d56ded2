"""What a page says that it has shown: some pictures a message, in text; whatever else comes is dropped."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, cast

from highfive.hil.session.shown import Shown

MOST = 128
"""Pictures in a message: a page tells four times a second."""
_LATEST_MS = 1e12  # 30 years; beyond it no time is meant
_MOST_COUNTED = 1 << 31


@dataclass(frozen=True)
class PageShown:
    """One picture of one page.

    Attributes:
        page: number of the page, counted by the server as they come.
        shown: the picture; its times are of this computer's monotonic clock as the page knows it.
        bound_ns: how far the page's clock may be off: half of the least round trip of its questions for the time.
        tracks: its camera or headset is the one that is tracked.
    """

    page: int
    shown: Shown
    bound_ns: int
    tracks: bool = False


def parse_shown(message: str) -> tuple[float, list[list[float]]] | None:
    """The bound, ms, and pictures (number, pose's time, ms, time seen, ms, dropped) of a message; None of any other."""
    with suppress(ValueError, RecursionError):
        told: Any = json.loads(message)
        if not isinstance(told, dict) or cast("dict[str, Any]", told).get("kind") != "shown":
            return None
        told = cast("dict[str, Any]", told)
        pictures, bound = told.get("pictures"), told.get("bound_ms")
        if isinstance(pictures, list) and _is_number(bound, 0.0, _LATEST_MS) and _are_pictures(pictures):
            return float(cast("float", bound)), cast("list[list[float]]", pictures)
    return None


def _are_pictures(found: list[Any]) -> bool:
    return 0 < len(found) <= MOST and all(
        isinstance(one, list)
        and len(cast("list[Any]", one)) == 4
        and all(_is_number(time, -_LATEST_MS, _LATEST_MS) for time in one[1:3])
        and all(type(count) is int and 0 <= count < _MOST_COUNTED for count in (one[0], one[3]))
        for one in found
    )


def _is_number(value: object, low: float, high: float) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return low <= value <= high and math.isfinite(value)


def page_shown(page: int, bound_ms: float, pictures: Sequence[Sequence[float]], tracks: bool) -> list[PageShown]:
    """The pictures of a message as values."""
    shown = (
        Shown(int(number), round(1e6 * pose), round(1e6 * seen), int(dropped))
        for number, pose, seen, dropped in pictures
    )
    return [PageShown(page, one, round(1e6 * bound_ms), tracks) for one in shown]
