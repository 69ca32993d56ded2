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

if TYPE_CHECKING:  # what trains takes seconds to import
    from model.optimise import Progress as TrainingProgress
    from model.optimise import ProgressCallback

STDERR = Console(stderr=True, highlight=False)
STDOUT = Console(highlight=False)


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
    with Progress(*columns, console=STDERR) as progress:

        def bar(label: str, total: int) -> Advance:
            task = progress.add_task(label, total=total, note="")

            def advance(note: str = "", done: int | None = None) -> None:
                if done is None:
                    progress.update(task, advance=1, note=note)
                else:
                    progress.update(task, completed=done, note=note)

            return advance

        yield bar


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
    """Scores of methods (``scores``: method → metric → value, with ``smallest`` and ``largest``) as a table."""
    scores, smallest, largest = result["scores"], result["smallest"], result["largest"]
    table = Table(box=SIMPLE_HEAD, title=result.get("windows") or result.get("data"), title_justify="left")
    table.add_column("median of seeds (spread)" if result["seeds"] > 1 else "one seed")
    for method in scores:
        table.add_column(method, justify="right")
    for metric in scores["hgpdm"]:
        best = min(values[metric] for values in scores.values())
        cells = []
        for method, values in scores.items():
            spread = largest[method][metric] - smallest[method][metric]
            text = f"{values[metric]:.4f}" + (f" ({spread:.4f})" if spread > 0.0 else "")
            cells.append(f"[bold]{text}[/]" if values[metric] == best else text)
        table.add_row(metric, *cells)
    STDOUT.print(table)


def print_json(value: dict[str, Any]) -> None:
    """One JSON object on standard output."""
    print(json.dumps(value, allow_nan=False, ensure_ascii=False))
