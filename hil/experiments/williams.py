"""Williams squares: orders in which each thing follows each other one equally often.

E. J. Williams 1949, "Experimental designs balanced for the estimation of residual effects of treatments": a cyclic
square for an even number of things, that square and its mirror image for an odd one.
"""

from __future__ import annotations


def williams(count: int) -> list[tuple[int, ...]]:
    """The orders of ``count`` things: ``count`` of an even number, twice as many of an odd one (one of one).

    Each thing is at each place equally often, and each ordered pair of neighbours as often as any other.
    """
    first = [0]
    for step in range(1, count):  # 0, n−1, 1, n−2, 2, …: the differences between neighbours are all different
        first.append((first[-1] + (count - step if step % 2 else step)) % count)
    rows = [tuple((place + shift) % count for place in first) for shift in range(count)]
    return rows if count % 2 == 0 or count == 1 else rows + [row[::-1] for row in rows]
