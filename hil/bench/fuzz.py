"""Damaged inputs for every reader: a value or one line, never a traceback, a hang, all of the memory, or an escape."""

from __future__ import annotations

import multiprocessing
import signal
import time
from collections import Counter, defaultdict
from dataclasses import dataclass
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any

from highfive.hil.bench.fuzz_readers import READERS
from highfive.hil.bench.fuzz_worker import Finding, Task, run_tasks
from highfive.hil.runtime.console import Bar, counted, say_aside
from highfive.model.errors import HighFiveError

STUCK_S = 90.0
"""A process whose input has not ended after so long, by the clock, is ended: it waits, or no signal reaches it."""
STORED = 20
"""Inputs that are kept of each kind of finding."""


@dataclass(frozen=True)
class FuzzOptions:
    """What is read.

    Attributes:
        readers: names in :data:`READERS`; empty for all.
        inputs: of each.
        seed: of what is damaged, and how.
        first: number of the first input: with ``inputs`` 1 one is read again.
        jobs: processes.
        out: folder for inputs that did what none may; None keeps none.
    """

    readers: tuple[str, ...] = ()
    inputs: int = 1000
    seed: int = 0
    first: int = 0
    jobs: int = 1
    out: Path | None = None


def bench_fuzz(options: FuzzOptions, bar: Bar) -> dict[str, Any]:
    """Reads damaged inputs.

    Returns:
        ``inputs`` in all; ``readers``: name → ``inputs``, ``findings`` and ``per_s``, inputs a second of processor;
        ``broken``: each finding with ``reader``, ``number``, ``what`` and ``where``.

    Raises:
        HighFiveError: there is no such reader, or inputs cannot be kept.
    """
    names = options.readers or tuple(READERS)
    if unknown := [name for name in names if name not in READERS]:
        raise HighFiveError(f"no reader {unknown[0]!r}; there are {', '.join(READERS)}")
    run = _Run(options, bar)
    shares = [_share(options, number) for number in range(options.jobs)]
    run.all([[Task(name, options.seed, first, count) for name in names] for first, count in shares if count])
    counts = Counter(finding.reader for finding in run.findings)
    return {
        "inputs": sum(run.done.values()),
        "seed": options.seed,
        "readers": {
            name: {
                "inputs": run.done[name],
                "findings": counts[name],
                "per_s": round(run.done[name] / run.took[name]) if run.took[name] else None,
            }
            for name in names
        },
        "broken": [vars(finding) for finding in run.findings],
    }


def _share(options: FuzzOptions, number: int) -> tuple[int, int]:
    """First and count of one process."""
    cuts = [options.first + options.inputs * n // options.jobs for n in (number, number + 1)]
    return cuts[0], cuts[1] - cuts[0]


class _Run:
    """Some processes and what they have found."""

    def __init__(self, options: FuzzOptions, bar: Bar) -> None:
        self._options, self._bar = options, bar
        self.done, self.took, self.findings = Counter[str](), defaultdict[str, float](float), list[Finding]()
        self._advance: dict[str, Any] = {}

    def all(self, shares: list[list[Task]]) -> None:
        """Until every task is done."""
        open_ones = [_Process(tasks) for tasks in shares]
        try:
            while open_ones:
                wait([one.heard for one in open_ones], timeout=1.0)
                for one in open_ones:
                    self._hear(one)
                open_ones = [again for one in open_ones if (again := self._looked_after(one)) is not None]
        finally:
            for one in open_ones:
                one.kill()

    def _hear(self, one: _Process) -> None:
        while one.heard.poll():
            try:
                kind, *rest = one.heard.recv()
            except EOFError:
                return
            if kind == "over":
                one.over = True
            elif kind == "failed":
                raise RuntimeError(f"the fuzzer itself failed: {rest[0]}")
            elif kind == "done":
                number, count, took = rest
                self._add(one.tasks[number].reader, count, took)
                one.counted(number, count)
            else:
                self._keep(Finding(**rest[0]), rest[1])

    def _looked_after(self, one: _Process) -> _Process | None:
        """The process, one that goes on for it, or None where all is done."""
        if one.over:
            one.close()
            return None
        number, at = one.place
        why = ""
        if not one.alive:
            self._hear(one)
            if one.over:
                one.close()
                return None
            why = f"ended the process ({_of_exit(one.exit_code)})"
        elif one.stands_still():
            why = f"had not ended after {STUCK_S:g} s"
        if not why:
            return one
        one.kill()
        task = one.tasks[number]
        self._keep(Finding(task.reader, at, why), b"")
        self._add(task.reader, at + 1 - one.begun(number), 0.0)
        left = Task(task.reader, task.seed, at + 1, task.first + task.count - at - 1)
        rest = [left, *one.tasks[number + 1 :]]
        return _Process([task for task in rest if task.count > 0]) if any(task.count for task in rest) else None

    def _add(self, reader: str, count: int, took: float) -> None:
        self.done[reader] += count
        self.took[reader] += took
        if reader not in self._advance:
            self._advance[reader] = self._bar(reader, self._options.inputs)
        self._advance[reader](done=self.done[reader])
        if count and self.done[reader] >= self._options.inputs:
            found = sum(finding.reader == reader for finding in self.findings)
            pace = f", {self.done[reader] / took:,.0f} a second" if took and self._options.jobs == 1 else ""
            say_aside(f"{reader}: {self.done[reader]:,} inputs, {counted(found, 'finding')}{pace}")

    def _keep(self, finding: Finding, content: bytes) -> None:
        self.findings.append(finding)
        same = sum(
            (one.reader, one.what, one.where) == (finding.reader, finding.what, finding.where) for one in self.findings
        )
        if same == 1:
            where = finding.where and f" at {finding.where}"
            say_aside(f"{finding.reader} {finding.number}: {finding.what}{where}")
        if self._options.out is None or same > STORED:
            return
        try:
            self._options.out.mkdir(parents=True, exist_ok=True)
            (self._options.out / f"{finding.reader}-{self._options.seed}-{finding.number}.bin").write_bytes(content)
        except OSError as error:
            raise HighFiveError(f"cannot keep an input in {self._options.out}: {error.strerror or error}") from None


class _Process:
    """One process with its tasks."""

    def __init__(self, tasks: list[Task]) -> None:
        context = multiprocessing.get_context("spawn")
        self.tasks, self.over = tasks, False
        self._at = context.RawArray("q", [0, tasks[0].first])
        self.heard, said = context.Pipe(duplex=False)
        self._process = context.Process(target=run_tasks, args=(tasks, self._at, said), daemon=True)
        self._process.start()
        said.close()
        self._counted, self._stood, self._since = Counter[int](), self.place, time.monotonic()

    @property
    def place(self) -> tuple[int, int]:
        """Number of the task, and of the input."""
        return self._at[0], self._at[1]

    def counted(self, number: int, count: int) -> None:
        """So many inputs of a task are done."""
        self._counted[number] += count

    def begun(self, number: int) -> int:
        """The first input of a task that was not counted."""
        return self.tasks[number].first + self._counted[number]

    @property
    def alive(self) -> bool:
        """It runs."""
        return self._process.is_alive()

    @property
    def exit_code(self) -> int:
        """Of a process that has ended; negative for a signal."""
        self._process.join()
        return self._process.exitcode or 0

    def stands_still(self) -> bool:
        """Whether it has been at one input for too long."""
        if self.place != self._stood:
            self._stood, self._since = self.place, time.monotonic()
        return time.monotonic() - self._since > STUCK_S

    def kill(self) -> None:
        """Ends it."""
        self._process.kill()
        self.close()

    def close(self) -> None:
        """Waits for its end."""
        self._process.join()
        self.heard.close()


def _of_exit(code: int) -> str:
    return signal.Signals(-code).name if code < 0 else f"exit code {code}"


def print_fuzz(result: dict[str, Any]) -> None:
    """The same for people."""
    for name, of in result["readers"].items():
        pace = f", {of['per_s']:,} a second of processor" if of["per_s"] else ""
        print(f"{name}: {of['inputs']:,} inputs, {counted(of['findings'], 'finding')}{pace}")
    kinds = Counter((one["reader"], one["what"], one["where"]) for one in result["broken"])
    first = {(one["reader"], one["what"], one["where"]): one["number"] for one in reversed(result["broken"])}
    for (reader, what, where), count in kinds.most_common():
        print(f"{reader} {first[reader, what, where]} and {count - 1} more: {what}{where and f' at {where}'}")
    print(f"{result['inputs']:,} inputs with seed {result['seed']}, {counted(len(result['broken']), 'finding')}")
