"""Nobody asks the system for the time, or sleeps by it, but the clocks, whoever measures how long something takes, and
whoever waits for what is outside of this process.

Who waits at a descriptor (``select``) for a socket, a terminal or another process is not looked for: what is there has
a time of its own, and in virtual time something else stands in its place.
"""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from paths import ROOT

OURS = ("calibration", "hil", "mocap_bridge", "model", "scenes", "highfive")
ASKS = {"monotonic", "perf_counter", "time", "process_time", "thread_time"}

CLOCKS = {"hil/runtime/clock.py", "mocap_bridge/sources/scheduler.py"}
"""The machine's clock, and the same for the bridge, which imports nothing of ``hil``. All else gets one passed."""

STOPWATCHES = {
    "hil/arm/loop.py": "what planning and envelope take in a tick is recorded beside it",
    "hil/trials/trial.py": "what a tick takes is recorded beside it",
    "hil/evaluation/step_times.py": "what a model's step takes is a score",
    "hil/report/film.py": "the quality at which a film can be drawn in the time that there is",
}
"""Who measures what computing took; nothing that is played, sent or decided in a session goes by it."""

SLEEPERS = {
    "hil/evaluation/shared_work.py": "who waits for a training of another process asks again",
    "hil/runtime/clock.py": "the machine's clock",
    "hil/runtime/interrupts.py": "a Ctrl-C that was swallowed is raised again a moment later, in a thread of its own",
    "hil/drivers/emulator/emulator.py": "servos on a pseudo-terminal, which virtual time has not",
    "mocap_bridge/sources/vicon.py": "1 ms, before a server on the wire that has no new frame yet is asked once more",
}
"""Who sleeps, and what for."""


@cache
def asks(path: Path) -> tuple[str, ...]:
    """What a file uses of the module ``time``, without ``_ns``."""
    return tuple(_asks(path))


def _asks(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "time":
            yield node.attr.removesuffix("_ns")
        elif isinstance(node, ast.ImportFrom) and node.module == "time":
            yield from (alias.name.removesuffix("_ns") for alias in node.names)
        elif isinstance(node, ast.Import):
            assert not any(alias.name == "time" and alias.asname for alias in node.names), f"{path}: import time as"


def users(folder: str, names: set[str]) -> set[str]:
    """The files of a folder that use one of those; benches may."""
    files = [path for path in (ROOT / folder).rglob("*.py") if names.intersection(asks(path))]
    return {path for file in files if not (path := file.relative_to(ROOT).as_posix()).startswith("hil/bench/")}


@pytest.mark.parametrize("folder", OURS)
def test_who_asks_the_system_for_the_time(folder: str) -> None:
    assert users(folder, ASKS) == {path for path in CLOCKS | STOPWATCHES.keys() if path.startswith(f"{folder}/")}


@pytest.mark.parametrize("folder", OURS)
def test_who_sleeps(folder: str) -> None:
    assert users(folder, {"sleep"}) == {path for path in SLEEPERS if path.startswith(f"{folder}/")}
