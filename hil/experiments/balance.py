"""Whether an experiment can be balanced as it is asked for; if not, why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import groupby

from highfive.hil.experiments.protocol import ADAPTIVE, Block, Mode, Protocol
from highfive.hil.experiments.sequence import can_be_ordered
from highfive.hil.experiments.williams import williams
from highfive.model.errors import HighFiveError

PRACTICE = "practice"
"""The block before the first one."""


def part_orders(protocol: Protocol) -> list[list[Block]]:
    """The blocks in each order of the parts between people; participant n has the (n − 1)th, round and round."""
    parts = protocol.parts
    return [
        [block for part in row for block in protocol.blocks if block.part == parts[part]]
        for row in williams(len(parts))
    ]  # fmt: skip


def style_counts(protocol: Protocol, block: Block) -> dict[str, int]:
    """How often an interactive block shows each style; an adaptive one has places for weights, and two pure styles."""
    if not protocol.adaptive:
        return {style.name: block.repetitions for style in protocol.styles}
    easy = round(0.5 * protocol.order.easy_share * block.repetitions)
    return {ADAPTIVE: block.repetitions - 2 * easy, **{style.name: easy for style in protocol.styles}}


def resized(protocol: Protocol, participants: int | None, seed: int | None) -> Protocol:
    """With another number of people, or another seed, where one is given."""
    return replace(
        protocol,
        participants=protocol.participants if participants is None else participants,
        seed=protocol.seed if seed is None else seed,
    )


def check_balance(protocol: Protocol) -> None:
    """Every participant's plan can be drawn.

    Raises:
        HighFiveError: it cannot be balanced; says why, and what to change.
    """
    _check_codes(protocol)
    if [part for part, _ in groupby(block.part for block in protocol.blocks)] != protocol.parts:
        raise HighFiveError("blocks of one part have to stand together; move them, or name the parts anew")
    if any(block.name == PRACTICE for block in protocol.blocks):
        raise HighFiveError(f"a block is called {PRACTICE}, as the trials before the first one; give it another name")
    orders = part_orders(protocol)
    if protocol.participants % len(orders):
        fewer = protocol.participants // len(orders) * len(orders)
        raise HighFiveError(
            f"{len(protocol.parts)} parts have {len(orders)} orders, of which {protocol.participants} participants "
            f"cannot have each equally often; plan {_or([fewer, fewer + len(orders)])} people"
        )
    for block in protocol.blocks:
        if block.mode is Mode.INTERACTIVE:
            _check_alike(protocol, block)
    _check_variants(protocol)
    for order in orders:
        _check_replays(order)


def _check_codes(protocol: Protocol) -> None:
    codes = protocol.codes
    if codes and len(codes) < protocol.participants:
        raise HighFiveError(f"{protocol.participants} participants, and codes for {len(codes)}; give more codes")
    if protocol.code(0) in (code.upper() for code in codes):
        raise HighFiveError(f"{protocol.code(0)} is the pilot's code; give the participant another one")


def _check_alike(protocol: Protocol, block: Block) -> None:
    counts, alike = style_counts(protocol, block), protocol.order.alike
    if not can_be_ordered(counts, alike, ADAPTIVE):
        most = max((count, name) for name, count in counts.items() if name != ADAPTIVE)
        raise HighFiveError(
            f"block {block.name} cannot be balanced: {most[1]} comes {most[0]} times among "
            f"{sum(counts.values())} trials, and at most {alike} alike may stand in a row; give more "
            "styles, or [order] alike"
        )


def _check_variants(protocol: Protocol) -> None:
    variants, sources = len(protocol.variants), protocol.sources
    total = sum(block.repetitions for block in sources)
    if not sources:
        raise HighFiveError("all interactive blocks are fillers, or there is none; there is nothing to measure")
    if total % variants:
        cells, clips = len(protocol.cells), protocol.clips
        what = " × ".join(f"{count} {name}" for count, name in ((cells, "cells"), (clips, "clips")) if count)
        fewer = total // variants * variants
        raise HighFiveError(
            f"{'the trials come' if protocol.adaptive else 'each style comes'} {total} times in the interactive blocks "
            f"that count ({', '.join(block.name for block in sources)}), and cannot have each of {what} equally often; "
            f"change repetitions to {_or([fewer, fewer + variants])} in all"
        )


def _check_replays(order: Sequence[Block]) -> None:
    """Each comes after its source, with an interactive block between them."""
    places = {block.name: place for place, block in enumerate(order)}
    for place, block in enumerate(order):
        if not block.of or block.other:
            continue
        between = order[places[block.of] + 1 : place]
        if places[block.of] > place:
            raise HighFiveError(
                f"block {block.name} shows {block.of} before it was played; put it behind, in the same part"
            )
        if not any(other.mode is Mode.INTERACTIVE for other in between):
            raise HighFiveError(
                f"block {block.name} comes right after its source {block.of}; put an interactive block between them, "
                "a filler if need be"
            )


def _or(numbers: Iterable[int]) -> str:
    return " or ".join(str(number) for number, _ in sorted(Counter(numbers).items()) if number)
