"""``highfive capture``: the simulated data set."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from highfive.hil.runtime.console import Bar
from highfive.hil.sim.people.capture import capture
from highfive.hil.sim.people.emotions import EMOTIONS


def capture_pairs(
    out: Path,
    emotions: Sequence[str] | None,
    repetitions: int,
    test_repetitions: int | None,
    seed: int,
    overwrite: bool,
    bar: Bar,
) -> dict[str, Any]:
    """Writes the data set into ``out``, and says what it is.

    Args:
        out: folder.
        emotions: None for all.
        repetitions: trials for each emotion and cell.
        test_repetitions: so many of them are held out; None for the last of several.
        seed: of what differs between trials.
        overwrite: write into a folder that holds something.
        bar: shows progress.

    Raises:
        HighFiveError: an unknown emotion, or the folder cannot be written.
    """
    chosen = tuple(emotions or EMOTIONS)
    held_out = min(1, repetitions - 1) if test_repetitions is None else test_repetitions
    count = capture(out, chosen, repetitions, held_out, seed, lambda total: bar("trials", total), overwrite)
    return {"trials": count, "emotions": list(chosen), "seed": seed, "folder": str(out), "simulated": True}


def print_captured(result: dict[str, Any]) -> None:
    """The same for people."""
    folder = result["folder"]
    print(f"{result['trials']} simulated trials in {folder}; train on them with: highfive train {folder}")
