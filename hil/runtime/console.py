"""What the command line shows: progress on standard error, one line for an error, JSON for machines."""

from __future__ import annotations

import json
import logging
import os
import shlex
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

LOGGER = logging.getLogger("highfive")
STDERR = Console(stderr=True, highlight=False)
STDOUT = Console(highlight=False)
FINISHED_SHOWN = 4
"""Finished bars that stay in view when another one opens."""


@contextmanager
def libraries_aside() -> Iterator[None]:
    """What libraries print by themselves goes to standard error meanwhile, as Gloo's word of who is connected:
    standard output is the result's."""
    sys.stdout.flush()
    kept = os.dup(1)
    os.dup2(2, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


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


def say_aside(line: str, level: int = logging.INFO) -> None:
    """A line beside the results: into the log, which the command line shows on standard error."""
    LOGGER.log(level, "%s", line)


def confirm(question: str) -> bool | None:
    """Whether the user says yes, or just Enter; None where nobody is there to be asked."""
    if not (sys.stdin is not None and sys.stdin.isatty() and STDERR.is_terminal):
        return None
    STDERR.print(f"{question} [Y/n] ", end="", markup=False)
    return not sys.stdin.readline().strip().lower().startswith("n")


def ask_line(question: str) -> str | None:
    """What the user types; None where nobody is there to be asked."""
    if not (sys.stdin is not None and sys.stdin.isatty() and STDERR.is_terminal):
        return None
    STDERR.print(f"{question}: ", end="", markup=False)
    return sys.stdin.readline().strip()


class _OnStandardError(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        """Shows the line, whole, above the progress bars."""
        STDERR.print(record.getMessage(), soft_wrap=True, markup=False)


def show_log() -> None:
    """From now on what the library says goes to standard error; a second call does nothing."""
    if not any(isinstance(handler, _OnStandardError) for handler in LOGGER.handlers):
        LOGGER.addHandler(_OnStandardError())
        LOGGER.setLevel(logging.INFO)


def escape(text: str) -> str:
    """Text that holds no markup of the console's."""
    return text.replace("[", r"\[")


def given_command() -> str:
    """The command that runs, as a shell takes it again."""
    return shlex.join(["highfive", *sys.argv[1:]])


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
