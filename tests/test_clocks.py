"""Nobody asks the system for the time but the clocks, and whoever measures how long something takes."""

import ast
from collections.abc import Iterator
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


def asks(path: Path) -> Iterator[str]:
    """The functions of the module ``time`` that ask for one, wherever a file names them."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "time":
            yield node.attr.removesuffix("_ns")
        elif isinstance(node, ast.ImportFrom) and node.module == "time":
            yield from (alias.name.removesuffix("_ns") for alias in node.names)
        elif isinstance(node, ast.Import):
            assert not any(alias.name == "time" and alias.asname for alias in node.names), f"{path}: import time as"


@pytest.mark.parametrize("folder", OURS)
def test_who_asks_the_system_for_the_time(folder: str) -> None:
    asking = {
        path.relative_to(ROOT).as_posix() for path in (ROOT / folder).rglob("*.py") if ASKS.intersection(asks(path))
    }
    benches = {path for path in asking if path.startswith("hil/bench/")}
    assert asking - benches == {path for path in CLOCKS | STOPWATCHES.keys() if path.startswith(f"{folder}/")}
