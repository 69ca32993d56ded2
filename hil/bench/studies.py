"""Simulated studies from plan to analysis: are the truths that were put in within the intervals that come out?

Each study is planned by its template, every participant is a simulated one with a truth of her own, who answers as a
page does, in virtual time. Each session is broken off once, between two trials, with a torn line at the end of its log,
and resumed. Analysis is that of ``highfive experiment analyse DIR``.
"""

from __future__ import annotations

import json
import logging
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from highfive.hil.commands.experiment_analyse import AnalyseOptions, analyse
from highfive.hil.commands.experiment_options import RunOptions
from highfive.hil.commands.experiment_run import run
from highfive.hil.experiments.balance import resized
from highfive.hil.experiments.plan import draw_plans
from highfive.hil.experiments.protocol_file import read_protocol
from highfive.hil.experiments.study import LOG, session_folder, stored_plan, write_study, write_template
from highfive.hil.experiments.trial_log import read_session
from highfive.hil.runtime.console import LOGGER, Advance, Bar
from highfive.model.errors import HighFiveError

LEVEL, NULL_LEVEL = 0.9, 0.95
TORN = b'{"kind": "trial", "ask": 1'
"""What a crash in the middle of a line leaves."""

Truths = Mapping[str, Mapping[str, float]]
"""Estimator → whose, or whole, → its truth."""


@dataclass(frozen=True)
class StudiesOptions:
    """How many studies of each kind, of how many people, and where their numbers begin."""

    studies: int = 200
    people: int = 5
    first: int = 0


@dataclass(frozen=True)
class _Study:
    """What is simulated: template, each person's observer as its file has it, and truths."""

    template: str
    observers: Sequence[Mapping[str, Mapping[str, float]]]
    truths: Truths


def bench_studies(options: StudiesOptions, bar: Bar) -> dict[str, Any]:
    """Share of truths within 90 % intervals, a row an estimator; null studies that are called an effect at 5 %.

    Raises:
        HighFiveError: fewer than two people, or a trial that was lost or asked twice unmarked.
    """
    if options.people < 2:
        raise HighFiveError(f"{options.people} people; what differs between people needs two or more")
    held: dict[str, list[bool]] = defaultdict(list)
    called = list[bool]()
    advance = bar("studies", 3 * options.studies)
    with _unheard_warnings():
        for number in range(options.first, options.first + options.studies):
            for kind in (_effects, _morphs):
                rng = np.random.default_rng([number, kind is _morphs])
                for name, one in _held(_played(kind(rng, options.people), rng, LEVEL)):
                    held[name].append(one)
                advance()
            rng = np.random.default_rng([number, 2])
            found, _ = _played(_effects(rng, options.people, effect=0.0), rng, NULL_LEVEL)
            low, high = found["hierarchical"]["interval"]
            called.append(not low <= 0.0 <= high)
            advance()
    return {
        "studies": options.studies,
        "people": options.people,
        "first": options.first,
        "level": LEVEL,
        "within": {name: {"share": float(np.mean(ones)), "of": len(ones)} for name, ones in held.items()},
        "null_called": float(np.mean(called)),
    }


@contextmanager
def _unheard_warnings() -> Iterator[None]:
    """Warnings are not shown: each run tells of its torn line, which is meant."""
    level = LOGGER.level
    LOGGER.setLevel(logging.ERROR)
    try:
        yield
    finally:
        LOGGER.setLevel(level)


def _effects(rng: np.random.Generator, people: int, effect: float | None = None) -> _Study:
    """Recognition: rates .75 ± 0.58 logit between people, effects N(μ, 0.25), μ of N(0, 0.4) logit."""
    mean = 0.4 * rng.standard_normal() if effect is None else effect
    base = np.log(3.0) + 0.58 * rng.standard_normal(people)
    own = mean + 0.25 * rng.standard_normal(people)
    rates = 1.0 / (1.0 + np.exp(-np.stack([base + own, base])))
    observers = [{"interactive": {"right": float(i)}, "replay": {"right": float(r)}} for i, r in rates.T]
    shares = {"interactive": float(rates[0].mean()), "replay": float(rates[1].mean())}
    truths = {"difference of right answers, logit": {"": mean}, "rate of an emotion": shares}
    return _Study("tipping", observers, truths)


def _morphs(rng: np.random.Generator, people: int) -> _Study:
    """Morphs: each person's PSE and JND, and a shift of the PSE by interaction."""
    middle, shift = 0.5 + 0.1 * rng.standard_normal(), 0.06 * rng.standard_normal()
    log_jnd = np.log(0.1) + 0.3 * rng.standard_normal()
    replayed = middle + 0.08 * rng.standard_normal(people)
    pses = {"interactive": replayed + shift + 0.05 * rng.standard_normal(people), "replay": replayed}
    jnds = np.exp(log_jnd + 0.3 * rng.standard_normal(people))
    # Of an observer's lapses half go to either answer.
    lapses = np.minimum(2.0 * rng.exponential(0.03, people), 0.2)
    observers = [
        {mode: {"pse": float(pses[mode][p]), "jnd": float(jnds[p]), "lapse": float(lapses[p])} for mode in pses}
        for p in range(people)
    ]
    truths = {
        "PSE of a person": {f"{mode}/{p}": float(pses[mode][p]) for mode in pses for p in range(people)},
        "JND of a person": {f"{mode}/{p}": float(jnds[p]) for mode in pses for p in range(people)},
        "lapses of a person": {f"{mode}/{p}": float(lapses[p] / 2.0) for mode in pses for p in range(people)},
        "shift of the PSE": {"": shift},
        "PSE over people": {"replay": middle},
        "ln JND over people": {mode: log_jnd for mode in pses},
    }
    return _Study("morph", observers, truths)


def _played(study: _Study, rng: np.random.Generator, level: float) -> tuple[dict[str, Any], Truths]:
    """Planned, run, broken off, resumed and analysed."""
    with TemporaryDirectory(prefix="highfive-study-") as name:
        folder, file = Path(name) / "study", Path(name) / "experiment.toml"
        write_template(study.template, file, overwrite=False)
        protocol = resized(read_protocol(file), len(study.observers), int(rng.integers(1 << 31)))
        plans = draw_plans(protocol)
        write_study(folder, file, protocol, plans)
        for who, observer in zip(plans, study.observers, strict=True):
            path = Path(name) / "observer.toml"
            path.write_text(_toml(observer, int(rng.integers(1 << 31))), encoding="utf-8")
            _session(RunOptions(folder, who.participant, simulated=path, dry=True), rng)
        return analyse(AnalyseOptions(None, study=folder, level=level)), study.truths


class _BrokenOffError(Exception):
    """In place of a crash."""


def _session(options: RunOptions, rng: np.random.Generator) -> None:
    """A session that ends too early once, and is resumed.

    Raises:
        HighFiveError: a trial was lost, or asked twice unmarked.
    """
    trials = stored_plan(options.study, options.participant).trials
    last = int(rng.integers(1, len(trials)))

    left = last

    def breaks_off(label: str, total: int) -> Advance:
        def advance(note: str = "", done: int | None = None) -> None:
            nonlocal left
            left -= done is None
            if left < 0:
                raise _BrokenOffError

        return advance

    try:
        run(options, breaks_off)
    except _BrokenOffError:
        with (session_folder(options.study, options.participant, 1) / LOG).open("ab") as file:
            file.write(TORN)
        run(replace(options, resume=True), _quiet)
    standing = [row.trial for row in read_session(options.study, options.participant, 1).standing]
    if sorted(standing) != sorted(trial.name for trial in trials):
        raise HighFiveError(f"{options.participant}: {len(standing)} trials stand of {len(trials)} that were planned")


def _held(played: tuple[dict[str, Any], Truths]) -> list[tuple[str, bool]]:
    """Estimator, and whether its interval holds the truth."""
    found, truths = played
    intervals = _intervals(found)
    return [
        (name, bool(low <= truth <= high))
        for name, own in truths.items()
        for key, truth in own.items()
        for low, high in intervals[name](key)
    ]


def _intervals(found: Mapping[str, Any]) -> dict[str, Callable[[str], list[list[float]]]]:
    """Estimator → the intervals of a key of its truths."""

    def person(figure: str) -> Callable[[str], list[list[float]]]:
        def of(key: str) -> list[list[float]]:
            mode, place = key.split("/")
            people = list(found["psychometric"]["conditions"][mode]["people"].values())
            return [people[int(place)][figure]["interval"]]

        return of

    def over_people(figure: str) -> Callable[[str], list[list[float]]]:
        return lambda mode: [found["psychometric"]["conditions"][mode][figure]["interval"]]

    return {
        "difference of right answers, logit": lambda _: [found["hierarchical"]["interval"]],
        "rate of an emotion": lambda mode: [
            one["interval"] for one in found["confusion"][mode]["emotions"].values()
        ],
        "PSE of a person": person("pse"),
        "JND of a person": person("jnd"),
        "lapses of a person": person("lapse"),
        "shift of the PSE": lambda _: [found["psychometric"]["pse_shift"]["interval"]],
        "PSE over people": over_people("pooled_pse"),
        "ln JND over people": over_people("pooled_log_jnd"),
    }  # fmt: skip


def _toml(observer: Mapping[str, Mapping[str, float]], seed: int) -> str:
    lines = [f"seed = {seed}"]
    for mode, values in observer.items():
        lines += [f"[{mode}]", *(f"{name} = {json.dumps(value)}" for name, value in values.items())]
    return "\n".join(lines) + "\n"


def _quiet(label: str, total: int) -> Advance:
    return lambda note="", done=None: None


def print_studies(result: dict[str, Any]) -> None:
    """The figures, for people."""
    print(f"{result['studies']} simulated studies of each kind, {result['people']} people, each session resumed once")
    for name, row in result["within"].items():
        print(f"  {name:<36} {row['share']:7.1%} of {row['of']:,} within {100.0 * result['level']:g}% intervals")
    print(f"  without an effect, called one at 5 %: {result['null_called']:.1%} (target at most 5 %)")
