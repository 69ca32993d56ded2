"""An experiment as a frozen value: whom it asks what, in which blocks, and what the avatar does meanwhile.

Read from TOML by :mod:`highfive.hil.experiments.protocol_file`. The source study (Taubert et al. 2013) has interactive
blocks and replays of the person's own trials; another's replays and acting without contingency are ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import product

from highfive.model.settings import Settings, setting


class Mode(StrEnum):
    """What the avatar does in a block."""

    INTERACTIVE = "interactive"
    """It answers the person."""
    OWN_REPLAY = "own_replay"
    """It shows the person's own earlier trials; she watches."""
    OTHER_REPLAY = "other_replay"
    """It shows the trials of the participant before her; she watches."""
    NO_CONTINGENCY = "no_contingency"
    """She acts, and it plays a recorded answer at its own time."""


class Motion(StrEnum):
    """Where the avatar's motion comes from."""

    MODEL = "model"
    CLIPS = "clips"


CERTAINTY = "certainty"
"""A slider beside the ratings: how sure the answer is."""
ADAPTIVE = "adaptive"
"""The style of a trial whose weights are chosen while the block runs."""


@dataclass(frozen=True)
class Timing(Settings):
    """How long things may take."""

    trial_s: float = setting(20.0, "s", above=0.0, most=600.0)
    """From the cue to the end of the motion; a trial that takes longer is broken off. 72 + 72 trials in the 60 to 90
    minutes of the source study are 25 to 38 s each, answer included."""
    answer_s: float = setting(15.0, "s", above=0.0, most=600.0)
    """From the end of the motion to the answer; later answers do not count."""
    between_s: float = setting(2.0, "s", least=0.0, most=600.0)
    """From an answer to the next cue; the same in replays."""
    pause_s: float = setting(600.0, "s", above=0.0, most=86400.0)
    """The longest pause inside a block; after a longer one the block begins again, as what was seen is forgotten."""


@dataclass(frozen=True)
class Order(Settings):
    """Constraints on the order of trials."""

    alike: int = setting(2, least=1, most=1000)
    """Trials of one style in a row, at most. 61 % of the shuffles of 3 styles × 4 have no more than two."""
    easy_share: float = setting(0.1, least=0.0, most=0.5)
    """Share of an adaptive block's trials that show one of the two pure styles: they fix the lapses."""


@dataclass(frozen=True)
class Style:
    """What the avatar shows.

    Attributes:
        name: in the plan and the log.
        weights: emotion -> share, which sum to one; none of an adaptive trial.
        answer: the right one; empty where none is.
    """

    name: str
    weights: Mapping[str, float]
    answer: str = ""


@dataclass(frozen=True)
class Block:
    """A row of trials with one mode.

    Attributes:
        name: in the plan and the log.
        mode: what the avatar does.
        of: the interactive block that is shown again; empty for an interactive one.
        other: whether that is the block of the participant before.
        repetitions: of each style.
        filler: it stands between a block and its replay: not part of the balance of cells and clips.
        part: of the experiment; the order of parts goes by a Williams square between people.
    """

    name: str
    mode: Mode
    of: str = ""
    other: bool = False
    repetitions: int = 1
    filler: bool = False
    part: str = ""


@dataclass(frozen=True)
class Rating:
    """A question after a trial.

    Attributes:
        name: of its column.
        text: the question.
        low, high: what its two ends are called.
        points: 1 to so many; 0 for a slider from 0 to 1.
    """

    name: str
    text: str
    low: str
    high: str
    points: int = 0


@dataclass(frozen=True)
class Morph:
    """Two styles, and shares of the second.

    Attributes:
        start, end: emotions.
        levels: shares of ``end`` that are shown; none where each is chosen by the answers before.
    """

    start: str
    end: str
    levels: tuple[float, ...]

    @property
    def adaptive(self) -> bool:
        """Whether each share is chosen by the answers before."""
        return not self.levels


@dataclass(frozen=True)
class Replay:
    """How replays are shown: it is in the data.

    Attributes:
        viewpoint: ``live`` (looks right when the head moves) or ``recorded`` (the same pixels, which makes some sick).
        own_arm: ``live`` (it hangs) or ``ghost`` (the recorded one).
    """

    viewpoint: str = "live"
    own_arm: str = "live"


@dataclass(frozen=True)
class Protocol:
    """An experiment.

    Attributes:
        name: letters, digits, ``_`` and ``-``.
        kind: ``tipping``, ``high_five``, ``morph``, or a name of the lab's own.
        participants: how many.
        seed: of all plans.
        consent: version of the consent form.
        instructions: language -> Markdown.
        words: language -> words of her page, where there are some (:mod:`highfive.hil.experiments.words`).
        motion: where the avatar's motion comes from.
        styles: what it shows.
        blocks: in their order within each part.
        labels: the answers.
        keys: by which they are given; which is which is drawn for each person.
        certainty: whether it is asked how sure the answer is.
        ratings: asked after each trial.
        practice: trials of each style before the first block; not scored.
        cells: of the grid, in which palms meet; none where the place is free.
        clips: recordings of each style; 0 where the model makes the motion.
        morph: where styles are the levels of one.
        replay: how replays are shown.
        timing: limits.
        order: constraints.
        codes: of the participants, in their order; by default P01, P02, …
    """

    name: str
    kind: str
    participants: int
    seed: int
    consent: str
    instructions: Mapping[str, str]
    motion: Motion
    styles: tuple[Style, ...]
    blocks: tuple[Block, ...]
    labels: tuple[str, ...]
    keys: tuple[str, ...]
    certainty: bool = False
    ratings: tuple[Rating, ...] = ()
    practice: int = 0
    cells: tuple[str, ...] = ()
    clips: int = 0
    morph: Morph | None = None
    replay: Replay = field(default_factory=Replay)
    timing: Timing = field(default_factory=Timing)
    order: Order = field(default_factory=Order)
    codes: tuple[str, ...] = ()
    words: Mapping[str, Mapping[str, Mapping[str, str]]] = field(default_factory=dict)

    @property
    def variants(self) -> list[tuple[str, int]]:
        """Every cell with every clip, a style is shown in; ``""`` and 0 stand for none."""
        return list(product(self.cells or ("",), range(1, self.clips + 1) if self.clips else (0,)))

    @property
    def sources(self) -> list[Block]:
        """The interactive blocks over which cells and clips are balanced."""
        return [block for block in self.blocks if block.mode is Mode.INTERACTIVE and not block.filler]

    @property
    def shown_again(self) -> list[Block]:
        """Interactive blocks that are shown again to the same person: what a study compares."""
        again = {block.of for block in self.blocks if block.mode is Mode.OWN_REPLAY}
        return [block for block in self.sources if block.name in again]

    @property
    def adaptive(self) -> bool:
        """Whether weights are chosen while a block runs."""
        return self.morph is not None and self.morph.adaptive

    @property
    def parts(self) -> list[str]:
        """Names of the parts, as the file has them."""
        return list(dict.fromkeys(block.part for block in self.blocks))

    @property
    def needs_donor(self) -> bool:
        """Whether the first participant is shown the trials of somebody before: participant 0, the pilot."""
        return any(block.other for block in self.blocks)

    def code(self, number: int) -> str:
        """Of a participant, counted from 1; 0 is the pilot."""
        return self.codes[number - 1] if self.codes and number else f"P{number:02d}"

    def trials_of(self, block: Block) -> int:
        """How many trials a block has; a replay has those of its source."""
        named = {other.name: other for other in self.blocks}
        source = named[block.of] if block.of else block
        return source.repetitions * (1 if self.adaptive else len(self.styles))
