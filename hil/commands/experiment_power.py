"""What ``highfive experiment power`` does: how many people a study needs, by simulated ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from math import isfinite
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.table import Table

from highfive.hil.experiments.analysis.power import PowerSettings, people_needed, power_of_pse_shift, power_of_rates
from highfive.hil.experiments.analysis.pse_error import adaptive_error, constant_error
from highfive.hil.experiments.protocol import Protocol
from highfive.hil.experiments.protocol_file import read_protocol
from highfive.hil.runtime.console import STDOUT, Bar, say
from highfive.model.errors import HighFiveError

PEOPLE = (5, 8, 12, 16, 24, 32, 48)
DIFFERENCES, SHIFTS = (0.05, 0.08, 0.12), (0.04, 0.06, 0.10)
TRIALS = 36
"""A condition of the source study, as its text has it: 3 blocks of 12."""
MOST_PEOPLE = 120
MOST_EFFECTS = 20


@dataclass(frozen=True)
class PowerOptions:
    """What is asked.

    Attributes:
        file: an experiment, whose trials are taken; None for ``trials``.
        trials: a condition and person; None for the source study's.
        differences: of the rate of right answers, interactive − replay.
        shifts: of the PSE, in place of those.
        people: numbers of them.
        wanted: power that will do.
        settings: who is simulated.
        pse_error: of one PSE; None for what the experiment's trials are worth, or the usual one.
        seed: of the simulated studies.
    """

    file: Path | None = None
    trials: int | None = None
    differences: tuple[float, ...] = ()
    shifts: tuple[float, ...] = ()
    people: tuple[int, ...] = ()
    wanted: float = 0.8
    settings: PowerSettings = field(default_factory=PowerSettings)
    pse_error: float | None = None
    seed: int = 0


def power(options: PowerOptions, bar: Bar) -> dict[str, Any]:
    """How often effects are found with so many people, and how many are needed.

    Raises:
        HighFiveError: options that do not go together, an experiment that cannot be read or that compares nothing.
    """
    protocol = None if options.file is None else read_protocol(options.file)
    morphs = bool(options.shifts) or (protocol is not None and protocol.morph is not None)
    _check(options, protocol, morphs)
    trials = options.trials or (TRIALS if protocol is None else _compared(protocol))
    settings = options.settings
    if morphs:
        settings = replace(settings, pse_error=_pse_error(options, protocol, trials))
    effects = options.shifts or options.differences or (SHIFTS if morphs else DIFFERENCES)
    people = options.people or PEOPLE
    advance = bar("effects", len(effects))
    rows: list[dict[str, Any]] = []
    for effect in effects:
        found = _power_of(effect, trials, morphs, options.seed, settings)
        needed = people_needed(found, options.wanted, tuple(range(3, MOST_PEOPLE + 1)))
        rows.append({"effect": effect, "power": [found(count) for count in people], "needed": needed})
        advance(f"{effect:g}")
    return {
        "of": "pse_shift" if morphs else "rate_difference",
        "experiment": None if protocol is None else protocol.name,
        "planned": None if protocol is None else protocol.participants,
        "trials": trials,
        "people": list(people),
        "effects": rows,
        "wanted": options.wanted,
        "most_people": MOST_PEOPLE,
        "assumed": asdict(settings),
        "seed": options.seed,
    }


def _check(options: PowerOptions, protocol: Protocol | None, morphs: bool) -> None:
    if options.shifts and options.differences:
        raise HighFiveError("--difference and --shift are of two kinds of study; give one of them")
    if options.file is not None and options.trials is not None:
        raise HighFiveError(f"{options.file} says how many trials there are; leave out --trials, or the file")
    if options.shifts and options.trials is not None:
        raise HighFiveError("--trials is of right answers; a PSE is as good as --pse-error says, or an experiment's is")
    if protocol is not None and options.shifts and protocol.morph is None:
        raise HighFiveError(f"{options.file} shows no morphs, so it has no PSE; give --difference")
    if protocol is not None and options.differences and morphs:
        raise HighFiveError(f"{options.file} shows morphs, which have no right answer; give --shift")
    if options.pse_error is not None and not morphs:
        raise HighFiveError("--pse-error is of morphs; give --shift, or an experiment that shows some")
    if len(options.shifts or options.differences) > MOST_EFFECTS:
        raise HighFiveError(f"more than {MOST_EFFECTS} effects; give fewer")
    for difference in () if morphs else options.differences or DIFFERENCES:
        if not 0.0 < options.settings.rate + difference < 1.0:
            raise HighFiveError(
                f"--difference {difference:g} from a rate of {options.settings.rate:g}: expected a rate between 0 and 1"
            )
    if not all(map(isfinite, options.shifts)):
        raise HighFiveError(f"--shift {options.shifts}: expected a number of shares")
    if bad := [count for count in options.people if not 2 <= count <= 10_000]:
        raise HighFiveError(f"--people {bad[0]}: expected 2 to 10000; what differs between people needs two or more")


def _compared_blocks(protocol: Protocol) -> list[str]:
    """Names of the blocks that are shown again to the same person."""
    blocks = [block.name for block in protocol.shown_again]
    if not blocks:
        raise HighFiveError(
            f"{protocol.name} shows nobody her own trials again: there is nothing to compare; add a block with mode "
            '= "own_replay"'
        )
    return blocks


def _compared(protocol: Protocol) -> int:
    """Trials a condition and person that are compared."""
    named = {block.name: block for block in protocol.blocks}
    return sum(protocol.trials_of(named[name]) for name in _compared_blocks(protocol))


def _pse_error(options: PowerOptions, protocol: Protocol | None, trials: int) -> float:
    if options.pse_error is not None:
        return options.pse_error
    if protocol is None or protocol.morph is None:
        return options.settings.pse_error
    if protocol.adaptive:
        return adaptive_error(trials, protocol.order.easy_share, options.seed)
    levels = list(protocol.morph.levels)
    return constant_error(levels * (trials // len(levels)), options.seed)


def _power_of(effect: float, trials: int, morphs: bool, seed: int, settings: PowerSettings) -> Callable[[int], float]:
    """Power of a number of people."""
    if morphs:
        return lambda people: power_of_pse_shift(people, effect, seed, settings)
    return lambda people: power_of_rates(people, trials, effect, seed, settings)


def print_power(result: dict[str, Any]) -> None:
    """The same as a table."""
    shift = result["of"] == "pse_shift"
    what = "PSE shift" if shift else "difference"
    shown = Table(what, *map(str, result["people"]), f"for {result['wanted']:.0%}", box=SIMPLE_HEAD)
    for row in result["effects"]:
        needed = f"over {result['most_people']}" if row["needed"] is None else str(row["needed"])
        shown.add_row(f"{row['effect']:g}", *(f"{one:.2f}" for one in row["power"]), needed)
    STDOUT.print(shown)
    compared = "PSE in interaction and in replays" if shift else "rate of right answers in interaction and in replays"
    say(f"Compared: the same people's {compared}; one style against another, or against chance, is not")
    assumed = result["assumed"]
    if shift:
        who = f"each PSE ± {assumed['pse_error']:.3f}, its shift ± {assumed['shift_spread']:g} between people"
    else:
        who = (
            f"{result['trials']} trials a condition, rate {assumed['rate']:g}, people ± {assumed['people_spread']:g}, "
            f"effects ± {assumed['effect_spread']:g} logit"
        )
    say(f"Share of {assumed['studies']:,} simulated studies in which a t-test finds it: {who}")
    say("These spreads are assumed, not measured")
    if result["planned"] is not None:
        say(f"{result['experiment']} is planned with {result['planned']} participants")
