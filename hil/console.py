"""What the command line shows: progress on standard error, one line for an error, JSON for machines."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

STDERR = Console(stderr=True, highlight=False)
STDOUT = Console(highlight=False)


@contextmanager
def progress_bars() -> Iterator[Callable[[str, int], Callable[[], None]]]:
    """Bars on standard error: open one with a label and a total, call what comes back for each step done."""
    columns = [
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
        TextColumn("[dim]left"), TimeRemainingColumn(),
    ]  # fmt: skip
    with Progress(*columns, console=STDERR) as progress:

        def bar(label: str, total: int) -> Callable[[], None]:
            task = progress.add_task(label, total=total)
            return lambda: progress.advance(task)

        yield bar


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
