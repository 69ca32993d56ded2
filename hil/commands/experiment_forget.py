"""What ``highfive experiment forget`` does: a participant is deleted from a study, and it is said what remains."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from highfive.hil.experiments import forget as forgetting
from highfive.hil.runtime.console import counted, say


def forget(code: str, study: Path) -> dict[str, Any]:
    """Deletes her plan, rows and recordings.

    Raises:
        HighFiveError: nothing is known of her, a run is going on, or something cannot be deleted.
    """
    found = forgetting.forget(study, code)
    return {**asdict(found), "study": str(study), "beyond": forgetting.BEYOND}


def print_forgotten(result: dict[str, Any]) -> None:
    """What is gone, and what is not."""
    say(f"{result['participant']}: {counted(len(result['deleted']), 'file')} deleted in {result['study']}")
    if result["shown_to"]:
        say(f"Remains: her trials are in the files of {', '.join(result['shown_to'])}, to whom they are shown")
    if result["mentioned"]:
        say(f"Remains: the code stands in {', '.join(result['mentioned'])}; make results there again")
    say(result["beyond"])
