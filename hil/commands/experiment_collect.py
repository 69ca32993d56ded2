"""What ``highfive experiment collect`` does: two people are led through high fives that a model then learns from."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from highfive.hil.commands.page import open_page
from highfive.hil.commands.page_options import check_port
from highfive.hil.commands.simulate_options import PageOptions
from highfive.hil.commands.typed_commands import TypedCommands
from highfive.hil.datasets.collection import REASONS, REJECTED, SETTINGS, Collection, CollectionFolder, Take
from highfive.hil.datasets.dyads import Role
from highfive.hil.datasets.take_check import check_take
from highfive.hil.experiments.desk import Desk, Page
from highfive.hil.experiments.stage import RunStoppedError
from highfive.hil.experiments.words import PAGE
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.runtime.console import Bar, counted, say, say_aside
from highfive.hil.runtime.folders import results_folder
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.people.grid import CELLS, GRID_Y, GRID_Z
from highfive.hil.trials.live_partner import live_source
from highfive.hil.trials.live_wiring import MACHINE_WIRING, LiveWiring
from highfive.hil.trials.two_people import TwoPeople
from highfive.hil.view.live_page import LivePage
from highfive.mocap_bridge.files.c3d import write_c3d
from highfive.mocap_bridge.files.trial_table import TABLE
from highfive.mocap_bridge.sources.address import WEBCAM, is_live, parse_address
from highfive.model.errors import HighFiveError

TRIES = 3
"""So often a take is recorded before the next one comes; what is not good yet is asked again behind all others."""
ROUNDS = 2
"""So often all that is left is gone through."""
PLACES = {cell: (GRID_Y[int(cell[1]) - 1], GRID_Z["ABC".index(cell[0])]) for cell in CELLS}
"""y and z of the grid's cells, m, in the avatar's world."""
INSTRUCTIONS = """# High fives for a model to learn from

One of you raises the right hand, the other answers, in the emotion that is said before each row of takes.

At the tone, raise the hand, meet palm to palm, and lower it again; then stand as before. Where the palms are to meet is
said each time: A, B, C are low, middle and high; 1, 2, 3 go from the right to the left of the one who answers.
"""


@dataclass(frozen=True)
class CollectOptions:
    """What is collected, from whom.

    Attributes:
        out: the data folder; gone on with where it was begun.
        source: address of the live system.
        asked: what is to be recorded.
        human_set, avatar_set: marker sets; None finds them.
        seconds: of a take, from the cue on, s.
        between: before each cue, s.
        any_cell: hands may meet anywhere.
        typed: commands are typed at this terminal, too.
        view: where the page is.
    """

    out: Path
    source: str
    asked: Collection
    human_set: str | None = None
    avatar_set: str | None = None
    seconds: float = 10.0
    between: float = 2.0
    any_cell: bool = False
    typed: bool = False
    view: PageOptions = field(default_factory=PageOptions)


def asked(
    emotions: Sequence[str] | None, cells: Sequence[str] | None, repetitions: int, held_out: int, seed: int, human: str,
    avatar: str, simulated: bool,
) -> Collection:  # fmt: skip
    """What is to be recorded; without emotions or cells those of the simulated people and of the grid.

    Raises:
        HighFiveError: a cell is none of the grid's.
    """
    if unknown := [name for name in cells or () if name not in CELLS]:
        raise HighFiveError(f"unknown cell {unknown[0]!r}; the grid has {', '.join(CELLS)}")
    chosen = tuple(dict.fromkeys(cells or CELLS))
    return Collection(tuple(emotions or EMOTIONS), chosen, repetitions, held_out, seed, human, avatar, simulated)


@dataclass
class _Run:
    options: CollectOptions
    folder: CollectionFolder
    people: TwoPeople
    desk: Desk
    block: str = ""
    recorded: int = 0
    bad: int = 0


def collect(
    options: CollectOptions, bar: Bar, wiring: LiveWiring | None = None,
    opened: Callable[[LivePage], None] | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Records what is left; ``opened`` opens the page, instead of somebody.

    Raises:
        HighFiveError: something does not fit, is not there, or cannot be written; what was recorded stays.
    """
    _check(options)
    check_port(options.view)
    with ExitStack() as stack:
        folder = _folder(options, stack)
        if not folder.left:
            return _result(options, folder, 0, 0, "")
        people = _people(options, wiring or MACHINE_WIRING, stack)
        about = {"mode": "experiment", "title": options.out.name, "emotions": [], "cells": []}
        page = stack.enter_context(open_page(options.view, about, opened=opened))
        return led(options, folder, people, page, bar, MACHINE)


def led(
    options: CollectOptions, folder: CollectionFolder, people: TwoPeople, page: Page, bar: Bar, clock: Clock
) -> dict[str, Any]:
    """Leads two people, who are there, through what is left of a folder.

    Raises:
        HighFiveError: somebody is sent no more, or a file cannot be written.
    """
    desk = Desk(page, clock, TypedCommands() if options.typed else lambda: ())
    desk.open(
        name=options.out.name, participant="both", keys={}, sliders=[], limit_s=0.0, language="en",
        instructions=INSTRUCTIONS, words=dict(PAGE), shown={},
    )  # fmt: skip
    folder.begin()
    run, why = _Run(options, folder, people, desk), ""
    advance = bar("takes", len(folder.left))
    try:
        for _ in range(ROUNDS):
            for take in folder.left:
                if _good_take(run, take):
                    advance()
    except RunStoppedError as stopped:
        why = str(stopped)
    finally:
        left = len(folder.left)
        desk.tell(message=why or "it is over", left=left)
        desk.close(finished=not left)
    return _result(options, folder, run.recorded, run.bad, why)


def _good_take(run: _Run, take: Take) -> bool:
    """Records it until it is good, or was not often enough."""
    for _ in range(TRIES):
        _ask(run, take)
        why = _record(run, take)
        run.recorded += 1
        run.desk.tell(
            last={"trial": take.name, "answer": "bad" if why else "good", "expected": "", "why": why},
            blocks=run.folder.blocks, trial="",
        )  # fmt: skip
        if not why:
            return True
        run.bad += 1
        say_aside(f"{take.name} is not good: {why}", logging.WARNING)
    return False


def _ask(run: _Run, take: Take) -> None:
    """Tells both what comes; begins a row of one emotion when they say so."""
    desk, following = run.desk, {"trial": take.name, "style": take.emotion, "cell": take.cell, "condition": ""}
    desk.tell(blocks=run.folder.blocks, next=following, left=len(run.folder.left), trial="")
    if take.block != run.block:
        desk.show(
            "ready", block=take.block, first=not run.block, practice=False, task="go", text=f"Now: {take.emotion}"
        )
        desk.wait_ready()
        run.block = take.block
    desk.show("wait", task="go", text=f"{take.emotion}, {take.cell}")
    desk.wait(run.options.between)


def _record(run: _Run, take: Take) -> str:
    """One take on the disk: among the data, or apart with why it is not good, which is given back."""
    desk, folder = run.desk, run.folder
    desk.begin_trial()
    desk.show("cue", task="go", text=f"{take.emotion}, {take.cell}")
    desk.tell(trial=take.name, style=take.emotion, weights={take.emotion: 1.0}, cell=take.cell, condition="")

    def ends() -> bool:
        desk.look()
        return desk.breaks_off

    recording = run.people.record(run.options.seconds, ends)
    rejected = folder.rejects(take)
    rejected.parent.mkdir(exist_ok=True)
    write_c3d(rejected, recording)  # kept there until it is found good
    why = _why_not(run, rejected, take)
    if why:
        folder.reject(rejected, why)
    else:
        rejected.replace(folder.folder / f"{take.name}.c3d")
        folder.accept(take)
    if desk.stopping:
        raise RunStoppedError("stopped by the experimenter")
    return why


def _why_not(run: _Run, path: Path, take: Take) -> str:
    options = run.options
    if run.desk.breaks_off:
        return "broken off by the experimenter"
    try:
        found = check_take(
            path, Role(options.asked.human, options.human_set), Role(options.asked.avatar, options.avatar_set), PLACES,
            "" if options.any_cell else take.cell,
        )  # fmt: skip
    except HighFiveError as error:
        return str(error)
    return "; ".join(found.troubles)


def _check(options: CollectOptions) -> None:
    """That the source has two people, and the rest fits."""
    options.asked.check()
    if not is_live(options.source):
        raise HighFiveError(
            f"--source {options.source}: people are recorded live; give an address, such as vicon://HOST"
        )
    if parse_address(options.source).scheme in ("headset", WEBCAM):
        raise HighFiveError(f"--source {options.source} sees one person; two need a motion capture system")


def _folder(options: CollectOptions, stack: ExitStack) -> CollectionFolder:
    """The data folder, nobody else's meanwhile."""
    begun = CollectionFolder(options.out, options.asked)  # says what does not fit before the folder is locked
    own = {row.file for row in begun.rows} | {SETTINGS, TABLE, REASONS, REJECTED}
    own |= {f"{take.name}.c3d" for take in begun.left}
    stack.enter_context(results_folder(options.out, resumed=lambda entry: entry.name in own))
    return CollectionFolder(options.out, options.asked)


def _people(options: CollectOptions, wiring: LiveWiring, stack: ExitStack) -> TwoPeople:
    human, avatar = options.asked.human, options.asked.avatar
    sources = (
        stack.enter_context(closing(live_source(options.source, human, wiring))),
        stack.enter_context(closing(live_source(options.source, avatar, wiring))),
    )
    people = TwoPeople(sources, (human, avatar), wiring.clock)
    say_aside(f"{options.source}: {human} with {people.markers[0]} markers, {avatar} with {people.markers[1]}")
    return people


def _result(options: CollectOptions, folder: CollectionFolder, recorded: int, bad: int, why: str) -> dict[str, Any]:
    left = folder.left
    return {
        "folder": str(options.out),
        "recorded": recorded,
        "bad": bad,
        "good": len(folder.rows),
        "left": len(left),
        "left_by_emotion": dict(Counter(take.emotion for take in left)),
        "why": why,
        "simulated": options.asked.simulated,
    }


def print_collected(result: dict[str, Any]) -> None:
    """The same for people."""
    folder = result["folder"]
    say(
        f"{folder}: {counted(result['recorded'], 'take')} recorded, {result['bad']} of them not good; "
        f"{result['good']} good ones in all, {result['left']} left"
    )
    if result["left"]:
        say(f"{result['why'] or 'what is left was not good'}; the same command goes on")
    elif result["good"]:
        say(f"train on them with: highfive train {folder}")
