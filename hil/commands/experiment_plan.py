"""What ``highfive experiment plan`` does: an experiment is checked, and everybody's plan drawn, shown and written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.table import Table

from highfive.hil.experiments.balance import check_balance, resized
from highfive.hil.experiments.plan import Plan, draw_plans
from highfive.hil.experiments.protocol import Motion, Protocol
from highfive.hil.experiments.protocol_file import read_protocol
from highfive.hil.experiments.study import PROTOCOL, check_plans, has_run, write_study, write_template
from highfive.hil.report import plan_figure
from highfive.hil.report.drawing import to_png
from highfive.hil.runtime.console import STDOUT, Bar, counted, escape, say
from highfive.hil.runtime.folders import check_file, results_folder
from highfive.model.errors import HighFiveError
from highfive.model.files import write_whole

PICTURE = "plan.png"
FEW_CLIPS = 4
"""Fewer of a style are told apart by themselves."""


@dataclass(frozen=True)
class PlanOptions:
    """What is planned.

    Attributes:
        file: the experiment.
        study: the folder that gets the plans; may be a study already, whose plans stay as they are.
        participants, seed: others than the file says.
        overwrite: draw those plans anew of people who did not take part yet.
    """

    file: Path
    study: Path
    participants: int | None = None
    seed: int | None = None
    overwrite: bool = False


def template(name: str, out: Path, overwrite: bool) -> dict[str, Any]:
    """Writes an experiment that comes along to ``out``.

    Raises:
        HighFiveError: there is no such template, or the file cannot be written.
    """
    check_file(out, overwrite)
    return {"template": name, "file": str(out), "instructions": str(write_template(name, out, overwrite))}


def plan(options: PlanOptions, bar: Bar) -> dict[str, Any]:
    """Draws and writes everybody's plan.

    Raises:
        HighFiveError: the experiment is wrong, cannot be balanced, or differs from what the study has.
    """
    protocol = resized(read_protocol(options.file), options.participants, options.seed)
    try:
        check_balance(protocol)
    except HighFiveError as error:
        raise HighFiveError(f"experiment {options.file}: {error}") from None
    extended = (options.study / PROTOCOL).is_file()
    with results_folder(options.study, options.overwrite or extended):
        plans = draw_plans(protocol)
        new = check_plans(options.study, plans, options.overwrite)
        advance = bar("plans", len(plans))
        write_study(options.study, options.file, protocol, new)
        advance("written", len(plans))
        draw_picture(options.study, protocol, plans)
    return _result(protocol, plans, new, options.study)


def draw_picture(study: Path, protocol: Protocol, plans: Sequence[Plan]) -> None:
    """The picture of some plans, in the study's folder; of none, there is none.

    Raises:
        HighFiveError: it cannot be written.
    """
    try:
        if plans:
            write_whole(study / PICTURE, to_png(plan_figure.draw_plans(protocol, plans).figure))
        else:
            (study / PICTURE).unlink(missing_ok=True)
    except OSError as error:
        raise HighFiveError(f"cannot write {study / PICTURE}: {error.strerror or error}") from None


def _result(protocol: Protocol, plans: Sequence[Plan], new: Sequence[Plan], study: Path) -> dict[str, Any]:
    fresh = {plan.participant for plan in new}
    return {
        "experiment": protocol.name,
        "kind": protocol.kind,
        "study": str(study),
        "picture": str(study / PICTURE),
        "seed": protocol.seed,
        "styles": [style.name for style in protocol.styles],
        "blocks": {block.name: _block(protocol, block.name) for block in protocol.blocks},
        "trials": len(plans[-1].trials),
        "compares": protocol.morph is not None or bool(protocol.shown_again),
        "notes": _notes(protocol),
        "participants": [
            {
                "participant": plan.participant,
                "digest": plan.digest,
                "new": plan.participant in fresh,
                "took_part": has_run(study, plan.participant),
                "keys": dict(plan.keys),
                "blocks": [name for name, _ in groupby(trial.block for trial in plan.trials)],
                "trials": [
                    {"trial": trial.name, "style": trial.style, "cell": trial.cell, "source": trial.source}
                    for trial in plan.trials
                ],
            }
            for plan in plans
        ],
    }


def _block(protocol: Protocol, name: str) -> dict[str, Any]:
    block = next(block for block in protocol.blocks if block.name == name)
    return {"mode": block.mode.value, "of": block.of, "filler": block.filler, "trials": protocol.trials_of(block)}


def _notes(protocol: Protocol) -> list[str]:
    """What the lab should know of the plan."""
    notes: list[str] = []
    if protocol.motion is Motion.CLIPS and protocol.clips < FEW_CLIPS:
        notes.append(f"{counted(protocol.clips, 'clip')} of each style: people may know a clip again; give {FEW_CLIPS}")
    if protocol.needs_donor:
        notes.append(
            f"{protocol.code(0)} is the pilot: {protocol.code(1)} is shown her trials, so let her take part first"
        )
    return notes


def print_plan(result: dict[str, Any]) -> None:
    """The plans as tables: blocks, and each person's order, keys and digest."""
    blocks = Table("block", "mode", "shows", "trials", box=SIMPLE_HEAD)
    for name, block in result["blocks"].items():
        mode = block["mode"].replace("_", " ") + (", filler" if block["filler"] else "")
        blocks.add_row(name, mode, block["of"], str(block["trials"]))
    STDOUT.print(blocks)
    people = Table("participant", "blocks", "keys", "digest", "", box=SIMPLE_HEAD)
    for person in result["participants"]:
        keys = ", ".join(f"{key} {answer}" for answer, key in sorted(person["keys"].items(), key=lambda one: one[1]))
        state = "took part" if person["took_part"] else "new" if person["new"] else "as before"
        people.add_row(person["participant"], " ".join(person["blocks"]), escape(keys), person["digest"], state)
    STDOUT.print(people)
    for note in result["notes"]:
        say(note)
    say(f"{result['experiment']}: {counted(result['trials'], 'trial')} a participant, practice included")
    say(f"plans: {result['study']}, picture: {result['picture']}")
    if result["compares"]:
        say(f"whether that is enough people: highfive experiment power {Path(result['study']) / PROTOCOL}")


def print_template(result: dict[str, Any]) -> None:
    """Where the template is."""
    say(f"{result['file']}, with its instructions in {result['instructions']}")
    say(f"next: highfive experiment plan {result['file']}")
