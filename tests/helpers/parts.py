"""Files of tests, shared out over parts that take about as long as each other."""

from __future__ import annotations

from collections.abc import Mapping


def shared_out(seconds: Mapping[str, float], parts: int) -> dict[str, int]:
    """Part of each file, 0 to ``parts`` - 1: the longest first, each to the part that has least so far.

    Args:
        seconds: what each file takes.
        parts: how many.
    """
    load, part_of = [0.0] * parts, dict[str, int]()
    for name, takes in sorted(seconds.items(), key=lambda one: (-one[1], one[0])):
        part_of[name] = load.index(min(load))
        load[part_of[name]] += takes
    return part_of
