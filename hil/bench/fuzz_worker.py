"""The process in which inputs are read: with little memory and time, in a folder of its own, and watched.

What a reader may do with an input: give a value, or raise a :class:`HighFiveError` of one line. All else is a finding.
"""

from __future__ import annotations

import io
import logging
import os
import resource
import shutil
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from highfive.hil.bench.fuzz_reader import Seed, drawn
from highfive.hil.bench.fuzz_readers import READERS
from highfive.hil.bench.resident import peak_resident
from highfive.hil.experiments.protocol_file import TEMPLATES
from highfive.model.errors import HighFiveError

LONGEST_S = 2.0
"""Of processor, that an input may take."""
MOST_BYTES = 1 << 30
"""By which an input may make the process larger: what it asks for beyond, it does not get."""
MOST_RESIDENT = 256 << 20
"""By which the memory that is really used may grow with one input: the inputs have half a megabyte at most."""
LONGEST_LINE = 2000
"""Characters of an error."""
_REPORT_S = 0.5
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_CHANGES = frozenset(
    ("os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.symlink", "os.link", "os.truncate", "os.chmod", "os.chown")
)
_STARTS = frozenset(
    ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.fork", "exec", "pickle.find_class")
)


@dataclass(frozen=True)
class Task:
    """Inputs of one reader, from ``first`` on."""

    reader: str
    seed: int
    first: int
    count: int


@dataclass(frozen=True)
class Finding:
    """What an input did that none may.

    Attributes:
        reader, number: of the input.
        what: in one line.
        where: file and line of ours in which it happened, or the path that was touched.
    """

    reader: str
    number: int
    what: str
    where: str = ""


class _TooLong(BaseException):
    """An input takes too long: no reader catches it."""


class _Watch:
    """Sees what files are written, what programs are started and what is printed while an input is read."""

    def __init__(self, folder: Path) -> None:
        self._folder, self.on, self.seen = str(folder) + os.sep, False, list[str]()
        sys.addaudithook(self._audit)

    def _audit(self, event: str, given: tuple[Any, ...]) -> None:
        if not self.on:
            return
        if event == "open" and isinstance(given[2], int) and given[2] & _WRITING:
            self._look(event, given[0])
        elif event in _CHANGES:
            for path in given[:2] if event in ("os.rename", "os.link", "os.symlink") else given[:1]:
                self._look(event, path)
        elif event in _STARTS and event != "exec":
            self.seen.append(f"{event} {given[0]!r:.80}")

    def _look(self, event: str, path: object) -> None:
        if isinstance(path, str | bytes | os.PathLike):
            whole = os.path.realpath(os.fsdecode(path))
            if not whole.startswith(self._folder):
                self.seen.append(f"{event} {whole}")


class _Listening(io.StringIO):
    """Takes what is printed."""


class _Lines(logging.Handler):
    """Holds the library to one line a message."""

    def __init__(self) -> None:
        super().__init__()
        self.wrong = ""

    def emit(self, record: logging.LogRecord) -> None:
        if not _is_line(record.getMessage()):
            self.wrong = f"logged more than a line: {record.getMessage()[:80]!r}"


def run_tasks(tasks: Sequence[Task], at: Any, said: Connection) -> None:
    """Reads the inputs of all tasks in turn.

    ``at`` holds the task's and the input's number, for whoever watches; ``said`` takes findings, and how far it is.
    """
    try:
        _run_tasks(tasks, at, said)
    except Exception:  # of the fuzzer itself: an input's never comes so far
        said.send(("failed", traceback.format_exc()))


def _run_tasks(tasks: Sequence[Task], at: Any, said: Connection) -> None:
    shared = Path("/dev/shm")
    with TemporaryDirectory(prefix="highfive-fuzz-", dir=shared if shared.is_dir() else None) as place:
        folder = Path(place).resolve()
        os.chdir(folder)
        worker = _Worker(folder)
        for number, task in enumerate(tasks):
            at[0], at[1] = number, task.first
            seeds = READERS[task.reader]()
            worker.warm_up(seeds)
            begun, told = time.process_time(), time.monotonic()
            done = 0
            for own in range(task.first, task.first + task.count):
                at[1] = own
                seed, content = drawn(seeds, task.reader, task.seed, own)
                if (wrong := worker.wrong(seed, content)) is not None:
                    said.send(("finding", asdict(Finding(task.reader, own, *wrong)), content))
                done += 1
                if time.monotonic() - told > _REPORT_S:
                    told = time.monotonic()
                    said.send(("done", number, done, 0.0))
                    done = 0
            said.send(("done", number, done, time.process_time() - begun))
        said.send(("over",))
        os.chdir("/")


class _Worker:
    """Reads one input after the other."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._watch, self._lines = folder, _Watch(folder), _Lines()
        self._out = _Listening()
        sys.stdout = sys.stderr = self._out
        logging.getLogger().addHandler(self._lines)
        logging.getLogger("highfive").setLevel(logging.INFO)
        warnings.simplefilter("error")
        signal.signal(signal.SIGPROF, self._too_long)

    def warm_up(self, seeds: Sequence[Seed]) -> None:
        """Loads and compiles what is loaded and compiled once; from then on the process may grow so much."""
        resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        for _ in range(2):
            for seed in seeds:
                self._empty()
                with suppress(*([HighFiveError] if seed.ends else [])):
                    seed.read(seed.content, self._folder)
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        most = pages * resource.getpagesize() + MOST_BYTES
        resource.setrlimit(resource.RLIMIT_AS, (most, resource.RLIM_INFINITY))
        self._out.seek(0)
        self._out.truncate(0)

    def wrong(self, seed: Seed, content: bytes) -> tuple[str, str] | None:
        """What is wrong with how an input is read, and where; None where nothing is."""
        self._empty()
        before, self._lines.wrong = peak_resident(), ""
        wrong = self._read(seed.read, content)
        self._watch.on = False
        if wrong is None and peak_resident() - before > MOST_RESIDENT:
            wrong = f"took {(peak_resident() - before) >> 20} MB", ""
        if self._watch.seen:
            wrong = "touched what is not its own", self._watch.seen[0]
        self._watch.seen = []
        if self._lines.wrong:
            wrong = wrong or (self._lines.wrong, "")
        if self._out.tell():
            wrong = wrong or (f"printed {self._out.getvalue()[:80]!r}", "")
            self._out.seek(0)
            self._out.truncate(0)
        return wrong

    def _read(self, read: Callable[[bytes, Path], Any], content: bytes) -> tuple[str, str] | None:
        try:
            try:
                signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
                self._watch.on = True
                read(content, self._folder)
            finally:
                signal.setitimer(signal.ITIMER_PROF, 0.0)
        except HighFiveError as error:
            said = str(error)
            return None if _is_line(said) else (f"no line: {said[:120]!r}", _place(error))
        except _TooLong as error:
            return f"takes more than {LONGEST_S:g} s", _place(error)
        except BaseException as error:
            return f"{type(error).__name__}: {' '.join(str(error).split())[:200]}", _place(error)
        return None

    def _too_long(self, number: int, frame: object) -> None:
        raise _TooLong

    def _empty(self) -> None:
        """Only what an experiment's file needs lies in the folder."""
        for path in self._folder.iterdir():
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink()
        for texts in TEMPLATES.glob("*_instructions"):
            (self._folder / texts.name).symlink_to(texts)


def _is_line(text: str) -> bool:
    """Whether a terminal shows it as a line, and as nothing else."""
    return 0 < len(text) <= LONGEST_LINE and not any(ord(sign) < 32 or 127 <= ord(sign) < 160 for sign in text)


def _place(error: BaseException) -> str:
    """The last line of ours, outside the fuzzer, that an error came through."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "/bench/fuzz" not in frame.filename]
    ours = [frame for frame in frames if "highfive" in frame.filename or "/hil/" in frame.filename] or frames
    return f"{Path(ours[-1].filename).name}:{ours[-1].lineno}" if ours else ""
