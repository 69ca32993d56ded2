"""What starting costs: help, first frame, first high five; memory of commands; and how large an installation is.

Commands are run as a user runs them, in a terminal of their own, by the interpreter that runs this; what they show on
their progress bars is what is waited for. All of it is warm: files have been read and code compiled once before.
"""

from __future__ import annotations

import json
import os
import pty
import re
import select
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

from highfive.hil.bench.installed import installed_sizes
from highfive.hil.bench.resident import peak_resident
from highfive.hil.runtime.console import Bar
from highfive.hil.trials.partners import simulated_person
from highfive.mocap_bridge.files.c3d import write_c3d
from highfive.model.errors import HighFiveError

MAIN = "from highfive.hil.cli.main import main; main()"
COMMANDS = """
import json
from typer.main import get_command
from highfive.hil.cli.main import app
def leaves(command, way):
    inside = getattr(command, "commands", None)
    return [way] if inside is None else [leaf for name in inside for leaf in leaves(inside[name], [*way, name])]
print(json.dumps(leaves(get_command(app), [])))
"""
HEAVIEST = 5
LONGEST_S = 300.0


@dataclass(frozen=True)
class StartOptions:
    """How often each is measured."""

    repeats: int = 3


@dataclass(frozen=True)
class Started:
    """One run of a command.

    Attributes:
        first_s: s, until what was waited for was shown; None where it ended without.
        seconds: until it ended.
        processor_s: user and system, of it and the processes that it waited for.
        memory_mb: its largest resident set, without processes that it starts, looked at every 20 ms.
        code: of its exit.
        shown: all that it showed.
    """

    first_s: float | None
    seconds: float
    processor_s: float
    memory_mb: float
    code: int
    shown: str


def started(arguments: Sequence[str], folder: Path, shows: str | None = None) -> Started:
    """Runs ``highfive`` with these arguments in a ``folder``, in a pseudo-terminal, until it ends.

    Args:
        arguments: of the command line.
        folder: the working directory.
        shows: regular expression of what is waited for, in what it shows without colours.

    Raises:
        HighFiveError: it takes longer than :data:`LONGEST_S`.
    """
    begun = time.monotonic()
    pid, terminal = pty.fork()
    if pid == 0:
        os.chdir(folder)
        os.environ.update(COLUMNS="200", TERM="xterm", PYTHONWARNINGS="ignore")
        os.execv(sys.executable, [sys.executable, "-c", MAIN, *arguments])
    shown, first, memory = "", None, 0.0
    try:
        while True:
            if time.monotonic() - begun > LONGEST_S:
                os.kill(pid, 9)
                raise HighFiveError(f"highfive {' '.join(arguments)} has not ended within {LONGEST_S:g} s")
            with suppress(OSError):  # it has ended
                memory = peak_resident(pid) / 2**20 or memory
            if not select.select([terminal], [], [], 0.02)[0]:
                continue
            try:
                part = os.read(terminal, 65536)
            except OSError:  # a terminal that nobody writes to any more
                part = b""
            if not part:
                break
            shown += re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", part.decode(errors="replace"))
            if first is None and shows is not None and re.search(shows, shown):
                first = time.monotonic() - begun
    finally:
        os.close(terminal)
        _, status, used = os.wait4(pid, 0)
    processor = used.ru_utime + used.ru_stime
    code = os.waitstatus_to_exitcode(status)
    return Started(first, time.monotonic() - begun, processor, memory, code, shown)


def bench_start(options: StartOptions, bar: Bar) -> dict[str, Any]:
    """Help of each command, time to the first frame and high five, memory, causes, and installed megabytes.

    Raises:
        HighFiveError: a command fails, or does not show what is waited for.
    """
    found = subprocess.run([sys.executable, "-c", COMMANDS], capture_output=True, check=True, text=True)
    commands: list[list[str]] = json.loads(found.stdout)
    with TemporaryDirectory() as made:
        folder = Path(made)
        recording = "person.c3d"
        write_c3d(folder / recording, simulated_person().recording)
        ways = {
            "track": (["track", recording, "--out", "tracked", "--overwrite"], r"tracking\D*[1-9]\d*/\d+"),
            "stream": (["stream", recording, "--seconds", "0"], None),
            "simulate": (["simulate", *ONE, "--no-pictures", "--overwrite"], r"high five\D*1/1"),
        }
        done = bar("commands", options.repeats * (len(commands) + len(ways)) + len(ways) + len(ALSO))
        helps = {}
        for way in commands:
            runs = []
            for _ in range(options.repeats):
                runs.append(_ended([*way, "--help"], folder))
                done()
            helps[" ".join(way)] = round(median(run.seconds for run in runs), 3)
        firsts, memory = {}, {"--help": round(runs[-1].memory_mb)}
        for name, (arguments, shows) in ways.items():
            _ended(arguments, folder, shows)  # compiles, where nothing is compiled yet
            done()
            runs = []
            for _ in range(options.repeats):
                runs.append(_ended(arguments, folder, shows))
                done()
            firsts[name] = round(median(run.seconds if shows is None else run.first_s or 0.0 for run in runs), 2)
            memory[name] = round(max(run.memory_mb for run in runs))
        (folder / "observer.toml").write_text(OBSERVER)
        for name, arguments in ALSO.items():
            memory[name] = round(_ended(arguments.split(), folder).memory_mb)
            done()
    return {
        "help_s": helps,
        "first_s": firsts,
        "memory_mb": memory,
        "causes_s": {name: _causes(module) for name, module in CAUSES.items()},
        "installed_mb": installed_sizes("high-five", HEAVIEST),
    }


ONE = ("--trials", "1", "--emotion", "neutral", "--cell", "B2", "--out", "session")
SIMULATED = "--study study --no-avatar --simulate-participant observer.toml"
OBSERVER = "seed = 1\n[interactive]\nright = 0.85\n[replay]\nright = 0.75\n"
ALSO = {
    "simulate, with film and report": f"simulate {' '.join(ONE)} --overwrite",
    "simulate --rig virtual": "simulate --trials 1 --cell B2 --rig virtual --no-pictures --out with_arm",
    "export --to csv": "export session --to csv --out tables",
    "export --to glb": "export session --to glb --out animation",
    "rig reach --quick": "rig reach --quick --picture reach.png",
    "experiment plan": "experiment plan --template high_five",
    "experiment plan --study": "experiment plan high_five.toml --study study",
    "experiment power": "experiment power high_five.toml",
    "experiment run --no-avatar": f"experiment run --participant P00 {SIMULATED}",
    "experiment run --no-avatar, of the next": f"experiment run --participant P01 {SIMULATED}",
    "experiment analyse": "experiment analyse study --out results",
    "capture": "capture --emotion angry --repetitions 2 --test-repetitions 1 --out captured",
    "train, 9 trials": "train captured --iterations 50 --no-distractors --out small.safetensors",
    "evaluate": "evaluate default captured --seeds 1 --no-false-starts",
}
"""Commands whose memory alone is looked at, once each and in this order: some need what those before leave."""

CAUSES = {
    "--help": "highfive.hil.cli.main",
    "track": "highfive.hil.commands.track",
    "stream": "highfive.hil.commands.stream.stream",
    "simulate": "highfive.hil.commands.simulate",
}
"""What a command imports before it begins."""


def _ended(arguments: Sequence[str], folder: Path, shows: str | None = None) -> Started:
    run = started(arguments, folder, shows)
    if run.code != 0 or (shows is not None and run.first_s is None):
        last = run.shown.strip().splitlines()[-1:] or ["nothing was shown"]
        raise HighFiveError(f"highfive {' '.join(arguments)} ended with exit code {run.code}: {last[0]}")
    return run


def _causes(module: str) -> dict[str, float]:
    """s that each of the heaviest packages takes to be imported, by what ``-X importtime`` says of its modules."""
    run = subprocess.run(
        [sys.executable, "-X", "importtime", "-c", f"import {module}"], capture_output=True, check=True, text=True
    )
    spent: Counter[str] = Counter()
    for line in run.stderr.splitlines():
        if match := re.match(r"import time:\s+(\d+) \|\s+\d+ \|\s+(\w+)", line):
            name = match[2]
            spent["the standard library" if name in sys.stdlib_module_names else name] += int(match[1])
    return {name: round(1e-6 * microseconds, 3) for name, microseconds in spent.most_common(HEAVIEST)}


def print_start(result: dict[str, Any]) -> None:
    """The figures, for people."""
    slowest = sorted(result["help_s"].items(), key=lambda it: -it[1])[:HEAVIEST]
    print(f"--help of {len(result['help_s'])} commands: {median(result['help_s'].values()):.2f} s, slowest ", end="")
    print(", ".join(f"{name} {seconds:.2f}" for name, seconds in slowest))
    for name, what in (("track", "first frame"), ("stream", "first frame"), ("simulate", "first high five")):
        print(f"{name}: {result['first_s'][name]:.1f} s to the {what}")
    print("memory: " + ", ".join(f"{name} {mb} MB" for name, mb in result["memory_mb"].items()))
    for name, causes in result["causes_s"].items():
        print(f"imports of {name}: " + ", ".join(f"{package} {seconds:.2f} s" for package, seconds in causes.items()))
    for extra, size in result["installed_mb"].items():
        name = f"extra {extra}" if extra else "installed"
        total = "not installed here" if size["mb"] is None else f"{size['mb']} MB"
        parts = ", ".join(f"{package} {mb}" for package, mb in size["heaviest"].items())
        print(f"{name}: {total}" + (f" ({parts})" if parts else ""))
