"""The motion of a study's trials: each row's high five in the recording that it names."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from highfive.hil.experiments.study import session_folder
from highfive.hil.experiments.trial_row import TrialRow
from highfive.hil.recording.exports.trial_arrays import ExportTrial, export_trials
from highfive.hil.recording.session_reader import read_session
from highfive.hil.recording.trial_spans import TrialSpan
from highfive.model.errors import HighFiveError


@dataclass(frozen=True)
class TrialMotion:
    """A trial and its motion.

    Attributes:
        row: of the log.
        motion: its high five; None where there is none.
        missing: why; empty where no recording was made.
    """

    row: TrialRow
    motion: ExportTrial | None
    missing: str = ""


def trial_motions(study: Path, rows: Sequence[TrialRow]) -> Iterator[TrialMotion]:
    """Every row with its motion, of two ticks and more; each recording is opened once where its rows come together."""
    opened: tuple[Path, dict[int, ExportTrial], str] | None = None
    for row in rows:
        if not row.recording:
            yield TrialMotion(row, None)
            continue
        path = session_folder(study, row.participant, row.session) / Path(row.recording).name
        if opened is None or opened[0] != path:
            opened = (path, *_high_fives(path))
        _, found, why = opened
        motion = found.get(row.ask)
        yield TrialMotion(row, motion, "" if motion else why or f"{path} has no motion of trial {row.trial}")


def on_motion(span: TrialSpan, session_ns: int | None) -> float | None:
    """A time of the session's clock in s of the recording; None where it, or the recording's own zero, is not known."""
    host_ns = span.about.get("host_ns")
    if session_ns is None or type(host_ns) is not int:
        return None
    return 1e-9 * (session_ns - host_ns + span.start_ns)


def _high_fives(path: Path) -> tuple[dict[int, ExportTrial], str]:
    """Those of a recording by their number in the session, from 1; or why there are none."""
    try:
        found = export_trials(read_session(path))
    except HighFiveError as error:
        return {}, str(error)
    return {trial.span.number + 1: trial for trial in found if trial.span.ticks > 1}, ""
