"""An order of trials, each style so often, and none too many times in a row: all such orders are equally likely."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from itertools import groupby

import numpy as np

_SHUFFLES = 300
"""Shuffles are drawn until one passes, as most do of many styles. Of few styles hardly any may pass; then the orders
are counted, and one is drawn of their number. Both give each order with the same probability."""


def longest_run(order: Sequence[str], free: str = "") -> int:
    """Of the same in a row; ``free`` does not count."""
    return max((len(list(run)) for thing, run in groupby(order) if thing != free), default=0)


def can_be_ordered(counts: Mapping[str, int], alike: int, free: str = "") -> bool:
    """Whether there is such an order: the others have to part the runs of the most frequent."""
    total = sum(counts.values())
    return all(count <= alike * (total - count + 1) for thing, count in counts.items() if thing != free)


def draw_order(counts: Mapping[str, int], alike: int, rng: np.random.Generator, free: str = "") -> list[str]:
    """One of the orders in which nothing comes more than ``alike`` times in a row, but ``free``.

    Args:
        counts: how often each comes; there has to be such an order (:func:`can_be_ordered`).
        alike: at least 1.
        rng: draws.
        free: what may come in a row as often as it likes.
    """
    things = [thing for thing, count in counts.items() for _ in range(count)]
    for _ in range(_SHUFFLES):
        order = [things[place] for place in rng.permutation(len(things))]
        if longest_run(order, free) <= alike:
            return order
    return _counted_out(dict(counts), alike, rng, free)


def _counted_out(counts: dict[str, int], alike: int, rng: np.random.Generator, free: str) -> list[str]:
    """The next thing is drawn by how many orders go on with it."""
    order: list[str] = []
    last, run = "", 0
    while any(counts.values()):
        ways: list[int] = []
        names = [name for name, count in counts.items() if count]
        for name in names:
            left = {**counts, name: counts[name] - 1}
            following = 0 if name == free else run + 1 if name == last else 1
            ways.append(0 if following > alike else _ways_after(name, following, left, alike, free))
        drawn = _below(sum(ways), rng)
        for name, number in zip(names, ways, strict=True):
            if drawn < number:
                run = 0 if name == free else run + 1 if name == last else 1
                last = name
                break
            drawn -= number
        counts[last] -= 1
        order.append(last)
    return order


def _ways_after(last: str, run: int, counts: Mapping[str, int], alike: int, free: str) -> int:
    others = sorted(count for name, count in counts.items() if count and name not in (last, free))
    return _ways(0 if last == free else counts[last], run, tuple(others), counts.get(free, 0), alike)


@cache
def _ways(last: int, run: int, others: tuple[int, ...], free: int, alike: int) -> int:
    """Orders of what is left: of the last thing, of the others (sorted, none 0), of what is free."""
    if not (last or others or free):
        return 1
    ways = _ways(last - 1, run + 1, others, free, alike) if last and run < alike else 0
    for place, count in enumerate(others):
        rest = others[:place] + others[place + 1 :] + ((last,) if last else ())
        ways += _ways(count - 1, 1, tuple(sorted(rest)), free, alike)
    if free:
        ways += _ways(0, 0, tuple(sorted(others + ((last,) if last else ()))), free - 1, alike)
    return ways


def _below(bound: int, rng: np.random.Generator) -> int:
    """A whole number from 0 to below ``bound``, of any size, each as likely."""
    digits = bound.bit_length()
    while True:
        drawn = int.from_bytes(rng.bytes((digits + 7) // 8), "little") >> (-digits % 8)
        if drawn < bound:
            return drawn
