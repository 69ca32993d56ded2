"""What one participant does, trial by trial: drawn once from the experiment, its seed and her number, and kept.

Each block has each style equally often and at most ``order.alike`` of one in a row; over the interactive blocks that
count each style is in each cell, or shown by each clip, equally often. A replay has the trials of its source in an
order of its own. Which key means what is drawn for each person.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from highfive.hil.experiments.balance import PRACTICE, part_orders, style_counts
from highfive.hil.experiments.protocol import ADAPTIVE, Block, Mode, Protocol
from highfive.hil.experiments.sequence import draw_order
from highfive.hil.experiments.williams import williams

# What is drawn for, so that none depends on how much another one drew; blocks are counted on from _BLOCKS.
_KEYS, _VARIANTS, _PRACTICE, _BLOCKS = 0, 1, 2, 10


@dataclass(frozen=True)
class PlannedTrial:
    """A trial to be asked.

    Attributes:
        name: of its block, and its number there from 1: ``I1-03``.
        block, mode: where it is, and what the avatar does.
        style, weights: which it shows; ``adaptive`` and none where the answers before it decide.
        answer: the right one; empty where none is.
        cell, clip: where palms meet, which recording is shown; empty and 0 for none.
        source: the trial that is shown again; another's with the code before it: ``P03:I1-07``.
    """

    name: str
    block: str
    mode: str
    style: str
    weights: Mapping[str, float]
    answer: str = ""
    cell: str = ""
    clip: int = 0
    source: str = ""


@dataclass(frozen=True)
class Plan:
    """All trials of a participant, in their order.

    Attributes:
        experiment: its name.
        protocol: digest of the experiment.
        participant, number: code, and place among the participants from 1; 0 is the pilot.
        seed: that it was drawn from.
        consent: version of the form.
        keys: answer -> key.
        viewpoint, own_arm: of replays.
        pause_s: the longest pause inside a block.
        trials: to be asked.
    """

    experiment: str
    protocol: str
    participant: str
    number: int
    seed: int
    consent: str
    keys: Mapping[str, str]
    viewpoint: str
    own_arm: str
    pause_s: float
    trials: tuple[PlannedTrial, ...]

    @property
    def digest(self) -> str:
        """Of all that it says."""
        return digest_of(asdict(self))

    def block(self, name: str) -> list[PlannedTrial]:
        """The trials of a block."""
        return [trial for trial in self.trials if trial.block == name]


def digest_of(content: Mapping[str, Any]) -> str:
    """16 hexadecimal digits that stand for what is in it, in whatever order."""
    text = json.dumps(content, sort_keys=True, ensure_ascii=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def protocol_digest(protocol: Protocol) -> str:
    """Of an experiment, whoever takes part: more people are no other experiment."""
    return digest_of(asdict(replace(protocol, participants=0, codes=())))


def draw_plan(protocol: Protocol, number: int) -> Plan:
    """The plan of participant ``number``, counted from 1; of the pilot, 0, who plays the interactive blocks.

    The experiment has to be balanced (:func:`highfive.hil.experiments.balance.check_balance`).
    """
    orders = part_orders(protocol)
    blocks: Sequence[Block] = orders[(number - 1) % len(orders)] if number else protocol.blocks
    own = _interactive_trials(protocol, number)
    other = _interactive_trials(protocol, number - 1) if number and protocol.needs_donor else {}
    trials = _practice(protocol, number)
    for block in blocks:
        if block.mode is Mode.INTERACTIVE:
            trials += own[block.name]
        elif number:
            source = other[block.of] if block.other else own[block.of]
            whose = f"{protocol.code(number - 1)}:" if block.other else ""
            trials += _shown_again(protocol, block, source, whose, _rng(protocol, number, block))
    keys = [str(key) for key in _rng(protocol, number, _KEYS).permutation(protocol.keys)]
    return Plan(
        protocol.name, protocol_digest(protocol), protocol.code(number), number, protocol.seed, protocol.consent,
        dict(zip(protocol.labels, keys, strict=True)), protocol.replay.viewpoint, protocol.replay.own_arm,
        protocol.timing.pause_s, tuple(trials),
    )  # fmt: skip


def draw_plans(protocol: Protocol) -> list[Plan]:
    """Everybody's; the pilot's first, where somebody is shown her trials."""
    return [
        draw_plan(protocol, number) for number in range(0 if protocol.needs_donor else 1, protocol.participants + 1)
    ]


def _rng(protocol: Protocol, number: int, use: int | Block) -> np.random.Generator:
    place = use if isinstance(use, int) else _BLOCKS + protocol.blocks.index(use)
    return np.random.default_rng([protocol.seed, number, place])


def _interactive_trials(protocol: Protocol, number: int) -> dict[str, list[PlannedTrial]]:
    """Block -> its trials, of the interactive ones."""
    rng = _rng(protocol, number, _VARIANTS)
    # An adaptive run has its cells equally often, whatever it shows there.
    decks = {("" if protocol.adaptive else style.name): _Deck(protocol, rng) for style in protocol.styles}
    found: dict[str, list[PlannedTrial]] = {}
    for block in protocol.blocks:
        if block.mode is not Mode.INTERACTIVE:
            continue
        draws = _rng(protocol, number, block)
        deals = {name: _Deck(protocol, draws) for name in decks} if block.filler else decks
        styles = draw_order(style_counts(protocol, block), protocol.order.alike, draws, ADAPTIVE)
        found[block.name] = [
            _trial(protocol, block.name, place, style, deals["" if protocol.adaptive else style].take())
            for place, style in enumerate(styles)
        ]
    return found


class _Deck:
    """Cells and clips in a random order, all of them before any comes again."""

    def __init__(self, protocol: Protocol, rng: np.random.Generator) -> None:
        self._variants, self._rng = protocol.variants, rng
        self._left: list[int] = []

    def take(self) -> tuple[str, int]:
        """The next one."""
        self._left = self._left or self._rng.permutation(len(self._variants)).tolist()
        return self._variants[self._left.pop()]


def _trial(protocol: Protocol, block: str, place: int, style: str, variant: tuple[str, int] = ("", 0)) -> PlannedTrial:
    named = {one.name: one for one in protocol.styles}
    weights, answer = (named[style].weights, named[style].answer) if style in named else ({}, "")
    name = f"{block}-{place + 1:02d}"
    return PlannedTrial(name, block, Mode.INTERACTIVE.value, style, dict(weights), answer, *variant)


def _practice(protocol: Protocol, number: int) -> list[PlannedTrial]:
    """Each style once a round, in an order of a Williams square."""
    rows = williams(len(protocol.styles))
    deck = _Deck(protocol, _rng(protocol, number, _PRACTICE))
    styles = [
        protocol.styles[place].name
        for turn in range(protocol.practice)
        for place in rows[(number + turn) % len(rows)]
    ]  # fmt: skip
    return [_trial(protocol, PRACTICE, place, style, deck.take()) for place, style in enumerate(styles)]


def _shown_again(
    protocol: Protocol, block: Block, source: Sequence[PlannedTrial], whose: str, rng: np.random.Generator
) -> list[PlannedTrial]:
    """The trials of a block in a new order."""
    by_style: dict[str, list[PlannedTrial]] = {}
    for place in rng.permutation(len(source)):
        by_style.setdefault(source[place].style, []).append(source[place])
    counts = {style: len(trials) for style, trials in sorted(by_style.items())}
    shown = [by_style[style].pop() for style in draw_order(counts, protocol.order.alike, rng, ADAPTIVE)]
    return [
        replace(
            trial, name=f"{block.name}-{place + 1:02d}", block=block.name, mode=block.mode.value,
            source=f"{whose}{trial.name}",
        )
        for place, trial in enumerate(shown)
    ]  # fmt: skip
