"""What ``highfive experiment forget`` does: a participant is deleted from a study, and it is said what remains."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from highfive.hil.commands.experiment_plan import PICTURE, draw_picture
from highfive.hil.experiments import forget as forgetting
from highfive.hil.experiments.study import participants, stored_plan, study_protocol
from highfive.hil.runtime.console import counted, say
from highfive.model.errors import HighFiveError


def forget(code: str, study: Path) -> dict[str, Any]:
    """Deletes her plan, rows and recordings.

    Raises:
        HighFiveError: nothing is known of her, a run is going on, or something cannot be deleted.
    """
    found = forgetting.forget(study, code)
    drawn = _drawn_again(study) if (study / PICTURE).is_file() else ""
    return {**asdict(found), "study": str(study), "picture": drawn, "beyond": forgetting.BEYOND}


def _drawn_again(study: Path) -> str:
    """The picture of the plans, without her; it is deleted where nobody is left, or the study cannot be read."""
    try:
        plans = [stored_plan(study, other) for other in participants(study)]
        draw_picture(study, study_protocol(study), plans)
    except HighFiveError:
        plans = []
        (study / PICTURE).unlink(missing_ok=True)
    return f"{PICTURE} was {'drawn again without her' if plans else 'deleted'}"


def print_forgotten(result: dict[str, Any]) -> None:
    """What is gone, and what is not."""
    say(f"{result['participant']}: {counted(len(result['deleted']), 'file')} deleted in {result['study']}")
    if result["picture"]:
        say(result["picture"])
    if result["shown_to"]:
        say(
            f"Remains: her trials are in the files of {', '.join(result['shown_to'])}, to whom they are shown: plans, "
            "logs and recordings of what these saw; forget them, too, or keep them as your consent form says"
        )
    if result["mentioned"]:
        say(f"Remains: the code stands in {', '.join(result['mentioned'])}; make results there again")
    if result["beside"]:
        where = ", ".join(result["beside"])
        say(f"Remains beside the study: the code stands in {where}; delete them, or make them again")
    if result["unread"]:
        say(f"Not looked into: {', '.join(result['unread'])} (too large, or not to be read); see whether it is there")
    say(result["beyond"])
