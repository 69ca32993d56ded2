"""What the command line shows: progress on standard error, one line for an error, JSON for machines."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Protocol

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from hil.score_table import METHODS, methods_of, rows_of

if TYPE_CHECKING:  # what trains takes seconds to import
    from model.optimise import Progress as TrainingProgress
    from model.optimise import ProgressCallback

STDERR = Console(stderr=True, highlight=False)
STDOUT = Console(highlight=False)
PLAIN_WIDTH = 160  # columns where standard output is no terminal: a file has room
FINISHED_SHOWN = 4
"""Finished bars that stay in view when another one opens."""


class Advance(Protocol):
    """One step of a bar is done."""

    def __call__(self, note: str = "", done: int | None = None) -> None:
        """``note`` is shown beside the bar; ``done`` says how many steps are done, by default one more."""


Bar = Callable[[str, int], Advance]
"""Opens a progress bar with a label and a total."""


@contextmanager
def progress_bars() -> Iterator[Bar]:
    """Bars on standard error: open one with a label and a total, call what comes back for each step done."""
    columns = [
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[note]}"),
        TimeElapsedColumn(), TextColumn("[dim]left"), TimeRemainingColumn(),
    ]  # fmt: skip
    progress = Progress(*columns, console=STDERR)

    def bar(label: str, total: int) -> Advance:
        progress.start()  # not before: an error that comes first is one line, with none above it
        done = [task.id for task in progress.tasks if task.finished and task.visible]
        for task_id in done[: max(0, len(done) - FINISHED_SHOWN)]:
            progress.update(task_id, visible=False)
        task = progress.add_task(label, total=total, note="")

        def advance(note: str = "", done: int | None = None) -> None:
            if done is None:
                progress.update(task, advance=1, note=note)
            else:
                progress.update(task, completed=done, note=note)

        return advance

    try:
        yield bar
    finally:
        if progress.tasks:
            progress.stop()


def say(line: str) -> None:
    """A line of output, at once."""
    print(line, flush=True)


def say_aside(line: str) -> None:
    """A line on standard error, where standard output is for machines."""
    STDERR.print(line, soft_wrap=True, markup=False)


def training_bars(bar: Bar, label: str = "") -> ProgressCallback:
    """Shows each stage of a training as a bar, with the objective; a resumed stage begins where it was."""
    bars: dict[str, Advance] = {}

    def step(progress: TrainingProgress) -> None:
        if progress.stage not in bars:
            bars[progress.stage] = bar(label + progress.stage, progress.iterations)
        known = math.isfinite(progress.objective)
        bars[progress.stage](f"objective {progress.objective:.3f}" if known else "compiling", progress.iteration)

    return step


def print_scores(result: dict[str, Any]) -> None:
    """The scores of :func:`hil.evaluate.evaluate` as a table: median of the seeds, smallest and largest in brackets."""
    title = str(result.get("windows") or result.get("data"))
    if result.get("leave_out"):
        title += f", each {result['leave_out']} left out in turn"
    console = STDOUT if STDOUT.is_terminal else Console(highlight=False, width=PLAIN_WIDTH)
    table = _score_table(result, title)
    if Console(width=1000).measure(table).maximum > console.width:
        table = _score_table(result, title, ranges=False)
        table.caption = "medians of the seeds; their ranges: --out, --json or a wider window"
    console.print(table)


def _score_table(result: dict[str, Any], title: str, ranges: bool = True) -> Table:
    table = Table(box=SIMPLE_HEAD, title=title, title_justify="left", caption_justify="left", padding=(0, 1, 0, 0))
    table.show_edge = table.pad_edge = False
    several = result["seeds"] > 1
    table.add_column(f"median of seeds{' (range)' if ranges else ''}" if several else "one seed", no_wrap=True)
    for method in methods_of(result):
        table.add_column(METHODS[method], justify="right", no_wrap=True)
    rows = rows_of(result, ranges)
    for number, row in enumerate(rows):
        if len(rows) > 1 and row.group != "error" and row.group != rows[number - 1].group:
            table.add_row(f"[dim]{row.group}[/]")
        table.add_row(row.label, *(f"[bold]{text}[/]" if i in row.best else text for i, text in enumerate(row.cells)))
    return table


def print_observations(result: dict[str, Any]) -> None:
    """What :func:`hil.observe.observe` found, as tables: accuracies, confusions, speeds of the morph."""
    stages = ("captured", "generated", "corrected")
    rows = {f"by {cue}": values for cue, values in result["by_cue"].items()}
    rows |= {f"person: {emotion}": values for emotion, values in result["by_person"].items()}
    recognised = Table("emotion recognised", *stages, box=SIMPLE_HEAD)
    for name, values in rows.items():
        recognised.add_row(name, *(f"{100.0 * values[k]:.1f} %" if k in values else "" for k in stages))
    STDOUT.print(recognised)
    for stage in stages:
        shown = result["confusion"][stage]
        seen = list(next(iter(shown.values())))
        table = Table(f"{stage}, shown as", *(f"seen as {name}" for name in seen), box=SIMPLE_HEAD)
        for name, counts in shown.items():
            table.add_row(name, *(str(counts[other]) for other in seen))
        STDOUT.print(table)
    morph = result["morph"]
    table = Table(
        f"peak palm speed, share of {morph['to']}", *(f"{stage}, m/s" for stage in stages[1:]), box=SIMPLE_HEAD
    )
    for step, weight in enumerate(morph["weights"]):
        name = {0.0: f"{weight}, {morph['from']}", 1.0: f"{weight}, {morph['to']}"}.get(weight, str(weight))
        table.add_row(name, *(f"{morph[stage]['peak_speed'][step]:.2f}" for stage in stages[1:]))
    for key in ("people_faster_at_each_step", "people_faster_in_the_end"):
        counts = (f"{morph[stage][key]} of {morph['people']}" for stage in stages[1:])
        table.add_row(key.replace("_", " "), *counts)
    STDOUT.print(table)


def counted(count: int, thing: str) -> str:
    """``1 trial``, ``2 trials``."""
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"


def print_json(value: dict[str, Any]) -> None:
    """One JSON object on standard output."""
    print(json.dumps(value, allow_nan=False, ensure_ascii=False))


def print_result(result: dict[str, Any], as_json: bool, for_people: Callable[[dict[str, Any]], None]) -> None:
    """A command's result: one JSON object for machines, or as ``for_people`` shows it."""
    if as_json:
        print_json(result)
    else:
        for_people(result)
