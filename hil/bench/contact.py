"""How well palms meet, cell by cell and emotion by emotion: the avatar's, the twin's plate, and the emulated rig's.

Sessions are run once; what they demand of the arm is then played by the twin, in simulated time, and by the rig, at the
pace of the clock or in virtual time, through retargeting and the safety envelope.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from highfive.hil.arm.arm_files import limits_of, rig_of
from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.arm_trial import MS, ArmTrial, percentiles, played_until_stopped
from highfive.hil.arm.contact_outcome import (
    ContactOutcome,
    ReferenceTrajectory,
    avatar_outcome,
    notice,
    with_known_contact,
)
from highfive.hil.arm.lifecycle import ready_arm
from highfive.hil.arm.loop import ArmLoop
from highfive.hil.arm.planner import Retarget
from highfive.hil.arm.planner_values import ConstraintRelaxation
from highfive.hil.arm.rig_planner import full_errors, retarget_settings
from highfive.hil.arm.simulated_driver import SimulatedDriver, mounted_arm
from highfive.hil.arm_model.arm_folder import DEFAULT_ARM, find_arm
from highfive.hil.arm_model.servo_arm import mounted
from highfive.hil.bench.locked import locked_partners
from highfive.hil.bench.retarget import reference_trajectories, references_of
from highfive.hil.bench.virtual_play import VirtualPlay, default_planner, play_virtually
from highfive.hil.drivers.latch import Latch
from highfive.hil.runtime.console import counted
from highfive.hil.runtime.folders import check_file
from highfive.hil.runtime.threads import parallel_map, quick_switching
from highfive.hil.safety.startup import Check
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.people.grid import CELLS
from highfive.hil.trials.locked_set import SEED, locked_trials
from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.trained import HGPDM

if TYPE_CHECKING:
    from highfive.hil.runtime.console import Bar

PLAYERS = ("avatar", "twin", "rig")


@dataclass(frozen=True)
class ContactOptions:
    """What is measured: emotions and cells (empty: all), by whom, the seed of the simulated people, what it is compared
    with, where its map is drawn, whether the arm is given the exact place and time, as soon as it is given any, whether
    a picture that is there may be replaced, whether the rig plays in virtual time, which arm plays, and whether the
    people are those of the locked set in place of those of a seed."""

    emotions: tuple[str, ...] = ()
    cells: tuple[str, ...] = ()
    players: tuple[str, ...] = PLAYERS
    seed: int = 0
    baseline: Path | None = None
    picture: Path | None = None
    foretold: bool = False
    overwrite: bool = False
    virtual: bool = False
    arm: str = DEFAULT_ARM
    locked: bool = False


def bench_contact(options: ContactOptions, model: HGPDM, bar: Bar) -> dict[str, Any]:
    """Figures of each player, and a row for each high five.

    Returns:
        by player ``error_mm`` (``median``, ``p95``, ``max``), ``time_error_ms`` (the largest), ``max_relative_speed``,
        ``unreachable`` (not in the other figures), ``missed``; of an arm the largest speeds near hand and head, on the
        wire and of the body; of the rig also ``stops``, each of which is a high five that counts as it was; and
        ``rows``.

    Raises:
        HighFiveError: there is no such player, emotion or cell, the baseline cannot be read, the picture not written,
            or the arm was stopped; or a seed, or a map, which has a place for one high five a cell, of the locked set.
    """
    if options.locked and (options.seed or options.picture is not None):
        raise HighFiveError(f"leave {'--seed' if options.seed else '--picture'} out: the locked set has its own people")
    if options.picture is not None:
        if not options.picture.parent.is_dir():
            raise HighFiveError(f"cannot draw {options.picture}: there is no folder {options.picture.parent}")
        check_file(options.picture, options.overwrite, "--picture")
    for what, requested, known in (
        ("player", options.players, PLAYERS),
        ("emotion", options.emotions, tuple(EMOTIONS)),
        ("cell", options.cells, CELLS),
    ):
        if strange := [name for name in requested if name not in known]:
            raise HighFiveError(f"unknown {what} {strange[0]!r}; there are {', '.join(known)}")
    if options.picture is not None and set(options.players) <= {"avatar"}:
        raise HighFiveError("the map shows what an arm can do; let twin or rig play too")
    before = {} if options.baseline is None else read_baseline(options.baseline)
    people, references = _references(options, model, bar)
    references = [with_known_contact(it) for it in references] if options.foretold else references
    result: dict[str, Any] = {
        "high_fives": len(references),
        "seed": SEED if options.locked else options.seed,
        "locked": options.locked,
        "foretold": options.foretold,
        "virtual": options.virtual,
        "arm": options.arm,
        "gives_up": find_arm(options.arm).gives_up,
    }
    rows: list[dict[str, Any]] = []
    for player in options.players:
        play = played_in_virtual_time if options.virtual and player == "rig" else partial(played_by, player)
        results, commanded = play(references, bar, options.arm)
        result[player] = contact_figures([one.met for one in results], people) | commanded
        rows += [_row(player, one, before, who) for one, who in zip(results, people, strict=True)]
    if options.picture is not None:
        from highfive.hil.report.contact_map import draw_contact_map  # noqa: PLC0415 (matplotlib takes a second)

        draw_contact_map(options.picture, rows, replace=options.overwrite)
    return result | {"rows": rows}


def _references(options: ContactOptions, model: HGPDM, bar: Bar) -> tuple[list[str], list[ReferenceTrajectory]]:
    """The high fives, and the name of each person; '' of those of a seed."""
    emotions, cells = options.emotions or tuple(EMOTIONS), options.cells or CELLS
    if options.locked:
        asked = [trial for trial in locked_trials() if trial.emotion in emotions and trial.cell in cells]
        if not asked:
            raise HighFiveError("the locked set has no such high five; ask for more cells or emotions")
        trials, partners = locked_partners(asked, bar)
        return [trial.name for trial in trials], references_of(partners, model, bar)
    references = reference_trajectories(model, emotions, cells, options.seed, bar)
    return [""] * len(references), references


def twin_loop(arm: str = DEFAULT_ARM) -> ArmLoop:
    """An arm's twin at rest, ready to play."""
    folder = find_arm(arm)
    rig, limits = rig_of(folder, simulated=True), limits_of(folder)
    twin = SimulatedDriver(mounted_arm(arm), full_errors(rig), folder=folder)
    settings = retarget_settings(rig, limits, on_the_way=0.0, folder=folder)
    retarget = Retarget(mounted(folder), np.array(folder.ready), settings)
    return ArmLoop(twin, retarget, limits, lambda: Check(twin.now(), ()), Latch(twin), twin)


def contact_figures(met: Sequence[ContactOutcome], people: Sequence[str] | None = None) -> dict[str, Any]:
    """Of one player, over the high fives that are possible; with names of the people, where they have any."""
    named = [
        " ".join([*filter(None, [who]), one.emotion, one.cell])
        for one, who in zip(met, people or [""] * len(met), strict=True)
    ]
    able = [one for one in met if one.possible]
    touched = [one for one in able if one.touched]
    errors = [MS * one.error for one in able if math.isfinite(one.error)]
    late = [abs(MS * one.late) for one in touched]
    return {
        "error_mm": {
            "median": round(float(np.median(errors)), 2) if errors else None,
            "p95": round(float(np.percentile(errors, 95)), 2) if errors else None,
            "max": round(max(errors), 2) if errors else None,
        },
        "time_error_ms": round(max(late), 1) if late else None,
        "time_error_median_ms": round(float(np.median(late)), 1) if late else None,
        "max_relative_speed": round(max((one.speed for one in met if one.touched), default=0.0), 3),
        "missed": [name for name, one in zip(named, met, strict=True) if one.possible and not one.touched],
        "unreachable": [name for name, one in zip(named, met, strict=True) if not one.possible],
    }


def read_baseline(path: Path) -> dict[str, float]:
    """Errors, mm, by player, emotion and cell, as an earlier run wrote them (``--json``).

    Raises:
        HighFiveError: it is no such file.
    """
    try:
        rows = json.loads(path.read_text(encoding="utf-8"))["rows"]
        return {
            _key(row["player"], row["emotion"], row["cell"], row.get("subject", "")): float(row["error_mm"])
            for row in rows
        }
    except OSError as error:
        raise HighFiveError(f"cannot read {path}: {error.strerror or error}") from None
    except (ValueError, KeyError, TypeError):
        raise HighFiveError(f"{path} is no result of highfive bench contact --json") from None


def print_contact(result: Mapping[str, Any]) -> None:
    """The table and the figures, for people."""
    whom = "people of the locked set" if result["locked"] else f"seed {result['seed']}"
    print(f"{counted(result['high_fives'], 'high five')}, {whom}; error: plate (or palm) to palm where they touch")
    if result["gives_up"]:
        print(f"{result['arm']} gives up {result['gives_up']}")
    if result["virtual"]:
        print("the rig plays in virtual time")
    if result["foretold"]:
        print("the arm is given the exact place and time, as soon as it is given any")
    heads = f"{'emotion':<10}{'cell':<6}{'error, mm':>10}{'change':>9}{'late, ms':>10}{'speed, m/s':>12}"
    print(f"{'':8}{'person':<8}{heads}" if result["locked"] else f"{'':8}{heads}")
    for row in result["rows"]:
        change = "" if row["change_mm"] is None else f"{row['change_mm']:+.1f}"
        late = "–" if row["late_ms"] is None else f"{row['late_ms']:.0f}"
        note = "" if row["touched"] else "  not met" if row["possible"] else "  not possible"
        note += f" (stopped: {row['stopped']})" if row["stopped"] else ""
        error = "–" if row["error_mm"] is None else f"{row['error_mm']:.1f}"
        speed = "–" if row["speed"] is None else f"{row['speed']:.2f}"
        who = f"{row['player']:<8}" + (f"{row['subject']:<8}" if result["locked"] else "")
        print(f"{who}{row['emotion']:<10}{row['cell']:<6}{error:>10}{change:>9}{late:>10}{speed:>12}{note}")
    for player in PLAYERS:
        if player not in result:
            continue
        of = result[player]
        error = of["error_mm"]
        median, most, worst = ("–" if value is None else f"{value:.1f}" for value in error.values())
        print(
            f"{player}: median {median} mm, 95 % {most} mm, largest {worst} mm, "
            f"time error up to {of['time_error_ms']} ms, relative speed up to {of['max_relative_speed']} m/s, "
            f"{len(of['missed'])} missed, {len(of['unreachable'])} not possible"
        )
        if "body_closing_speed" in of:
            print(
                f"{'':{len(player)}}  near the hand {of['commanded_closing_speed']} m/s on the wire, "
                f"{of['body_closing_speed']} of the body; near the head {of['commanded_face_speed']} and "
                f"{of['body_face_speed']}"
            )
        if "retarget_ms" in of:
            print(
                f"{'':{len(player)}}  retargeting {of['retarget_ms']['p50']} / {of['retarget_ms']['p99']} ms, with the "
                f"envelope {of['step_ms']['p50']} / {of['step_ms']['p99']} ms (p50 / p99 of a tick)"
            )


@dataclass(frozen=True)
class Played:
    """How one high five went, and why the arm was stopped in it; '' where it was not."""

    met: ContactOutcome
    stopped: str = ""


def played(reference: ReferenceTrajectory, loop: ArmLoop) -> ArmTrial:
    """Has the arm play one high five to its end.

    Raises:
        HighFiveError: it was not allowed to, or stopped by itself; it says why.
    """
    trial = played_until_stopped(reference, loop)
    if trial is None or loop.trouble:
        raise HighFiveError(f"{reference.emotion} {reference.cell}: {loop.trouble or 'too short to be played'}")
    return trial


def played_by(
    player: str, references: Sequence[ReferenceTrajectory], bar: Bar, arm: str = DEFAULT_ARM
) -> tuple[list[Played], dict[str, Any]]:
    """How each high five went, and figures of all: speeds, m/s, planning, ms, and for the rig which were stopped.

    Args:
        player: one of :data:`PLAYERS`.
        references: the high fives.
        bar: shows how far it is.
        arm: name or folder of the arm.

    Raises:
        HighFiveError: the twin stopped by itself, or the rig cannot be made ready.
    """
    if player == "avatar":
        return [Played(avatar_outcome(it)) for it in references], {}
    advance = bar(player, len(references))
    trials: list[ArmTrial] = []
    if player == "twin":
        for it in references:
            trials.append(played(it, twin_loop(arm)))  # anew: where it came to rest must not tell in the next
            advance()
        return [Played(trial.met) for trial in trials], _commanded(trials, arm)
    results: list[Played] = []
    while len(results) < len(references):  # one that was stopped counts as it is; the arm is then made ready again
        with quick_switching(), ready_arm(ArmOptions(arm=arm)) as loop:
            while len(results) < len(references) and not loop.trouble:
                it = references[len(results)]
                trial = played_until_stopped(it, loop)
                trials += [] if trial is None else [trial]
                met = _not_met(it, loop.retarget) if trial is None or trial.broken_off else trial.met
                results.append(Played(met, loop.trouble))
                advance()
    return results, _rig_figures(results, trials, arm)


def played_in_virtual_time(
    references: Sequence[ReferenceTrajectory], bar: Bar, arm: str = DEFAULT_ARM
) -> tuple[list[Played], dict[str, Any]]:
    """What the emulated rig does with each, on all cores; as :func:`played_by`.

    Raises:
        HighFiveError: the rig cannot be made ready.
    """
    plays = [VirtualPlay(it, number, arm) for number, it in enumerate(references)]
    results: list[Played] = []
    trials: list[ArmTrial] = []
    for play, (trial, trouble) in zip(plays, parallel_map(play_virtually, plays, partial(bar, "rig")), strict=True):
        trials += [] if trial is None else [trial]
        met = _not_met(play.reference, default_planner(arm)) if trial is None or trial.broken_off else trial.met
        results.append(Played(met, trouble))
    return results, _rig_figures(results, trials, arm)


def _rig_figures(results: Sequence[Played], trials: Sequence[ArmTrial], arm: str) -> dict[str, Any]:
    stops = [result.stopped for result in results if result.stopped]
    return {**_commanded(trials, arm), "stops": len(stops), "stopped": stops}


def _not_met(reference: ReferenceTrajectory, retarget: Retarget) -> ContactOutcome:
    """A high five in which the arm was stopped before it met the hand; how near it came says nothing."""
    nan = float("nan")
    return ContactOutcome(
        reference.emotion,
        reference.cell,
        nan,
        False,
        nan,
        nan,
        nan,
        notice(reference, retarget),
        ConstraintRelaxation(),
    )


def _commanded(trials: Sequence[ArmTrial], name: str) -> dict[str, Any]:
    """The largest speeds near hand and head, m/s, of what went on the wire and of the body, and ms of planning.

    What the hand is faster than the limit by itself is not counted: the plate then stands.
    """
    limits, arm = limits_of(find_arm(name)), mounted(find_arm(name))
    speeds = [trial.separation_speeds(arm, limits) for trial in trials]
    ticks = [tick for trial in trials for tick in trial.ticks]
    names = {"wire": "commanded", "body": "body"}
    return {
        **{
            f"{said}_{which}_speed": round(max((one[f"{name}_{which}_speed"] for one in speeds), default=0.0), 3)
            for name, said in names.items()
            for which in ("closing", "face")
        },
        "retarget_ms": percentiles(np.array([tick.retarget_ms for tick in ticks])),
        "step_ms": percentiles(np.array([tick.step_ms for tick in ticks])),
    }


def _row(player: str, result: Played, before: Mapping[str, float], subject: str) -> dict[str, Any]:
    met, had = result.met, result.met.notice
    error = round(MS * met.error, 2) if math.isfinite(met.error) else None
    earlier = before.get(_key(player, met.emotion, met.cell, subject))
    return {
        "player": player,
        "subject": subject,
        "emotion": met.emotion,
        "cell": met.cell,
        "error_mm": error,
        "change_mm": None if earlier is None or error is None else round(error - earlier, 2),
        "late_ms": round(MS * met.late, 1) if met.touched else None,
        "speed": round(met.speed, 3) if math.isfinite(met.speed) else None,
        "touched": met.touched,
        "stopped": result.stopped,
        "possible": met.possible,
        "needed_s": None if had is None or not had.reached else round(had.needed, 3),
        "given_s": None if had is None else round(had.given, 3),
        "place_known_s": None if had is None else round(had.known, 3),
    }


def _key(player: str, emotion: str, cell: str, subject: str) -> str:
    return f"{player} {emotion} {cell} {subject}"
