"""A study as a BIDS data set: a subject a participant, motion and events of every trial, answers as behaviour.

Format: as of :mod:`highfive.hil.recording.exports.bids`; ``beh/…_beh.tsv`` has a row a trial. Out of it stay what says
when somebody took part (time of day, the source's own clock) and the experimenter's notes, in which names may stand.
Times that end in ``_ns`` are of the host's monotonic clock, which is that of LSL's stamps on the same computer: markers
and signals that a recorder of LSL wrote beside (XDF) are on the same line with them.
"""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

from highfive.hil.experiments.recorded.trial_motions import TrialMotion, on_motion, trial_motions
from highfive.hil.experiments.study_rows import StudyRows, reasons
from highfive.hil.experiments.trial_columns import MEANING
from highfive.hil.experiments.trial_row import COLUMNS, Key, TrialRow
from highfive.hil.recording.exports.bids import (
    PARTICIPANTS,
    SIMULATED,
    SOME_SIMULATED,
    SYSTEMS,
    Task,
    cell_text,
    dataset,
    dateless,
    json_bytes,
    motion_files,
    tsv_bytes,
)
from highfive.hil.recording.exports.export_file import ExportFile, of_bytes

PERSONAL = ("notes", "source_ns", "begun_utc_ns", "utc_ns")
"""Columns of the log that are left out: they may say who took part, and when."""
NOT_COUNTED = "not_counted_why"
_EVENT = ("trial", "ask", "block", "condition", "style", "cell", "expected", "answer", NOT_COUNTED)
_KEPT = tuple(name for name in COLUMNS if name not in (*PERSONAL, "participant", "session"))
S = 1_000_000_000


@dataclass(frozen=True)
class StudyExport:
    """What is to be written.

    Attributes:
        files: all of them.
        runs: of trials with motion.
        frames: ticks in them, a tracking system.
        missing: why other trials have none though they should.
    """

    files: list[ExportFile]
    runs: int
    frames: int
    missing: list[str]


def study_bids(study: Path, found: StudyRows) -> StudyExport:
    """All files of the data set of a study's rows."""
    why = reasons(found.excluded)
    task = _task(found)
    trials = list(trial_motions(study, found.rows))
    files = _head(study, found)
    sessions: dict[tuple[str, int], list[TrialMotion]] = {}
    for trial in trials:
        sessions.setdefault((trial.row.participant, trial.row.session), []).append(trial)
    for (code, number), hers in sessions.items():
        begun_ns = min(row.begun_utc_ns for row in found.rows if row.participant == code)
        files += _session(code, number, hers, why, task, begun_ns)
    moving = [trial.motion.span for trial in trials if trial.motion is not None]
    missing = list(dict.fromkeys(trial.missing for trial in trials if trial.missing))
    return StudyExport(files, len(moving), sum(span.ticks for span in moving), missing)


def trials_csv(found: StudyRows) -> bytes:
    """A row a trial of the whole study, without what is personal."""
    why = reasons(found.excluded)
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    names = ("participant", "session", *_KEPT)
    table.writerow([*names, NOT_COUNTED])
    for row in found.rows:
        values = _plain(row)
        table.writerow([*("" if values[name] is None else values[name] for name in names), why.get(row.row_key, "")])
    return text.getvalue().encode()


def _head(study: Path, found: StudyRows) -> list[ExportFile]:
    simulated = {code: {row.simulated for row in found.rows if row.participant == code} for code in _codes(found)}
    kinds = set[bool]().union(*simulated.values())
    said = SIMULATED if kinds == {True} else SOME_SIMULATED if True in kinds else ""
    people = [("participant_id", "species", "simulated")]
    for code, hers in simulated.items():
        species = "n/a" if hers == {True} else "homo sapiens"
        people.append((f"sub-{code}", species, "n/a" if len(hers) > 1 else str(int(True in hers))))
    name = found.protocol.name + (" (simulated)" if said == SIMULATED else "")
    return [
        of_bytes("dataset_description.json", partial(json_bytes, dataset(name, said))),
        of_bytes("README.md", partial(_readme, study, found, said)),
        of_bytes("participants.tsv", partial(tsv_bytes, people)),
        of_bytes("participants.json", partial(json_bytes, PARTICIPANTS)),
        of_bytes("sourcedata/trials.csv", partial(trials_csv, found)),
    ]


def _session(
    code: str, number: int, trials: Sequence[TrialMotion], why: Mapping[Key, str], task: Task,
    begun_ns: int,
) -> list[ExportFile]:  # fmt: skip
    """The files of one session of a participant, who began ``begun_ns``, ns since 1970."""
    folder, stem = f"sub-{code}/ses-{number}", f"sub-{code}_ses-{number}"
    named = f"{stem}_task-{task.label}"
    answers = f"{folder}/beh/{named}_beh"
    rows = [trial.row for trial in trials]
    files = [
        of_bytes(f"{answers}.tsv", partial(_answers, rows, why, begun_ns)),
        of_bytes(f"{answers}.json", partial(json_bytes, _described(("begun", *_KEPT, NOT_COUNTED), task))),
    ]
    scans = [("filename", "acq_time"), (f"beh/{named}_beh.tsv", dateless(_begun(rows[0], begun_ns)))]
    for trial in trials:
        if trial.motion is None:
            continue
        run = f"run-{trial.row.ask:03d}"
        for system in SYSTEMS:
            name = f"{named}_tracksys-{system}_{run}"
            files += motion_files(f"{folder}/motion/{name}", trial.motion, system, task)
            scans.append((f"motion/{name}_motion.tsv", dateless(_started(trial, begun_ns))))
        events = f"{folder}/motion/{named}_{run}_events"
        files += [
            of_bytes(f"{events}.tsv", partial(_events, trial, why.get(trial.row.row_key, ""))),
            of_bytes(f"{events}.json", partial(json_bytes, _EVENTS | _described(_EVENT))),
        ]
    return [*files, of_bytes(f"{folder}/{stem}_scans.tsv", partial(tsv_bytes, scans))]


def _events(trial: TrialMotion, why: str) -> bytes:
    """Onsets in s from the first sample of the run; the cue comes before it, the answer after the last."""
    assert trial.motion is not None
    times, row, span = trial.motion.load().times, trial.row, trial.motion.span
    values = {**_plain(row), NOT_COUNTED: why}
    more = [_text(values[name]) for name in _EVENT]
    happened = [(0.0, times[-1] - times[0], "high_five")]
    for name in ("cue", "contact", "ended", "asked", "answer", "shown"):
        at = on_motion(span, values[f"{name}_ns"])
        if at is not None:
            happened.append((at - times[0], 0.0, _TYPES[name]))
    events = [(f"{onset:.6f}", f"{lasts:.6f}", kind, *more) for onset, lasts, kind in sorted(happened)]
    return tsv_bytes([("onset", "duration", "trial_type", *_EVENT), *events])


def _answers(rows: Sequence[TrialRow], why: Mapping[Key, str], begun_ns: int) -> bytes:
    table: list[Sequence[str]] = [("begun", *_KEPT, NOT_COUNTED)]
    for row in rows:
        values = _plain(row)
        cells = [_text(values[name]) for name in _KEPT]
        table.append((f"{_begun(row, begun_ns):.3f}", *cells, why.get(row.row_key, "") or "n/a"))
    return tsv_bytes(table)


def _begun(row: TrialRow, begun_ns: int) -> float:
    return (row.begun_utc_ns - begun_ns) / S


def _started(trial: TrialMotion, begun_ns: int) -> float:
    """When the run's first tick was, s after the participant began; to 1 ms, as the time of day is recorded."""
    about = trial.motion.span.about if trial.motion is not None else {}
    try:
        return datetime.fromisoformat(str(about.get("utc"))).timestamp() - begun_ns / S
    except ValueError:  # older recordings have none
        return _begun(trial.row, begun_ns)


def _plain(row: TrialRow) -> dict[str, Any]:
    """Column -> value: tables as JSON, yes and no as 1 and 0."""
    return {
        name: json.dumps(value, sort_keys=True)
        if isinstance(value, Mapping)
        else int(value) if isinstance(value, bool) else value
        for name, value in asdict(row).items()
    }  # fmt: skip


def _text(value: Any) -> str:
    return f"{value:.9g}" if isinstance(value, float) else cell_text(value)


def _codes(found: StudyRows) -> Iterator[str]:
    return iter(dict.fromkeys(row.participant for row in found.rows))


def _task(found: StudyRows) -> Task:
    label = re.sub(r"[^A-Za-z0-9]", "", found.protocol.name) or "experiment"
    words = (
        f"{found.protocol.name}: the person and an avatar meet, or she watches; then she says what it felt: "
        f"{', '.join(found.protocol.labels)}."
    )
    return Task(label, words)


def _described(names: Sequence[str], task: Task | None = None) -> dict[str, Any]:
    head = {} if task is None else {"TaskName": task.label, "TaskDescription": task.description}
    return head | {name: {"Description": MEANING[name]} for name in names}


def _readme(study: Path, found: StudyRows, said: str) -> bytes:
    return (
        f"# {found.protocol.name}\n\n{_task(found).description}{said and ' '}{said}\n\n"
        f"Of the study in {study.name}, recorded with version {', '.join(found.software)}. One session a run of the "
        "experiment, one BIDS run a trial that has motion, numbered as it was asked. tracksys-person: what was tracked "
        "of the person, in metres (x from the avatar to the person, y to the avatar's left, z up; the floor is z = 0). "
        "tracksys-avatar: what the avatar did. beh: what she answered, a row a trial, also of those that do not count "
        f"({NOT_COUNTED}); sourcedata/trials.csv: the same of everybody.\n\n"
        "acq_time counts from 1 January 1900, at which each participant began: the date was taken out, and so were the "
        "experimenter's notes. Columns that end in _ns are of the host's monotonic clock, as LSL's stamps on that "
        "computer (times 1e9).\n"
    ).encode()


_TYPES = {
    "cue": "cue", "contact": "contact", "ended": "motion_over", "asked": "question", "answer": "answer",
    "shown": "shown",
}  # fmt: skip
_EVENTS: dict[str, Any] = {
    "onset": {"Description": "From the first sample of the run; below 0, before it.", "Units": "s"},
    "duration": {"Description": "0 for what has none.", "Units": "s"},
    "trial_type": {
        "Description": "What happened.",
        "Levels": {
            "cue": "The person was told to begin.",
            "high_five": "The trial's motion, from its first tick to its last.",
            "contact": "The palms met.",
            "shown": "A page first showed the frame of the contact, or of the motion's end.",
            "motion_over": "The motion was over.",
            "question": "The question was opened.",
            "answer": "It was answered.",
        },
    },
}
