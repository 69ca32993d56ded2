"""What ``highfive experiment analyse`` finds in a study's trials beside their answers: times, synchrony, ratings."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from highfive.hil.experiments.analysis.questionnaire import read_questionnaire, read_questionnaire_answers, summary
from highfive.hil.experiments.analysis.ratings import ratings_by_style
from highfive.hil.experiments.analysis.times import by_condition
from highfive.hil.experiments.recorded.interaction import SYNCHRONY, TIMING, Interaction
from highfive.hil.experiments.study_rows import StudyRows
from highfive.hil.experiments.trial_row import Key, TrialRow
from highfive.model.errors import HighFiveError


def of_trials(found: StudyRows, moved: Interaction) -> dict[str, Any]:
    """Entries ``timing``, ``motion`` and ``ratings`` of the result."""
    timing = by_condition(_times(found.counted, moved))
    return {
        # Of the recordings' figures such as nobody has are left out: in replays nobody reaches.
        "timing": {
            condition: {name: one for name, one in figures.items() if one["n"] or name in _OF_ROWS}
            for condition, figures in timing.items()
        },
        "motion": {"trials": len(moved.figures), "missing": [_missing(key, why) for key, why in moved.missing.items()]},
        "ratings": ratings_by_style(
            ((row.condition, row.style, _rated(row)) for row in found.counted),
            [style.name for style in found.protocol.styles],
        ),
    }


def of_questionnaires(paths: Sequence[Path], people: Collection[str] | None = None) -> dict[str, Any]:
    """Name -> scores, of the files; of a study's ``people``, where there is one.

    Raises:
        HighFiveError: one cannot be read, is answered by somebody else, or two have the same name.
    """
    found: dict[str, Any] = {}
    for path in paths:
        asked = read_questionnaire(path)
        if asked.name in found:
            raise HighFiveError(f"{path}: {asked.name} was given already; each questionnaire has a name of its own")
        found[asked.name] = summary(asked, read_questionnaire_answers(asked, people))
    return found


_OF_ROWS = ("reaction_s", "reaction_from_contact_s", "contact_after_cue_s", "peak_speed")


def _times(rows: Sequence[TrialRow], moved: Interaction) -> dict[str, list[tuple[str, float | None]]]:
    """Figures of each trial with its condition."""

    def after_cue(row: TrialRow) -> float | None:
        return None if row.contact_ns is None or row.cue_ns is None else 1e-9 * (row.contact_ns - row.cue_ns)

    figures: list[Mapping[str, float | None]] = [
        dict(zip(_OF_ROWS, (row.rt_s, row.rt_contact_s, after_cue(row), row.peak_speed), strict=True))
        | dict(moved.figures.get(row.row_key, {}))
        for row in rows
    ]
    names = (*_OF_ROWS, *TIMING, *SYNCHRONY)
    return {name: [(row.condition, one.get(name)) for row, one in zip(rows, figures, strict=True)] for name in names}


def _rated(row: TrialRow) -> Mapping[str, float]:
    certainty = {} if row.certainty is None else {"certainty": row.certainty}
    return {**certainty, **row.ratings}


def _missing(key: Key, why: str) -> dict[str, Any]:
    participant, session, ask = key
    return {"participant": participant, "session": session, "ask": ask, "why": why}
