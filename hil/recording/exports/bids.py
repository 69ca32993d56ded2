"""A session as a BIDS data set of motion: one run a high five, one file a tracking system.

Format: Brain Imaging Data Structure, motion (Jeung et al. 2024; bids-specification, "Motion"). ``tracksys-person`` is
what the session tracked of the person, ``tracksys-avatar`` what it showed her. The files of a run have the same rows:
they need no alignment. ``acq_time`` counts from 1 January 1900, by which BIDS says that the date was taken out: when
somebody took part is personal. Only differences mean anything; the recording's ``/trial`` has the time of day.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import partial
from math import isnan
from typing import Any

import numpy as np

from highfive.hil.recording.exports.export_file import ExportFile, of_bytes
from highfive.hil.recording.exports.tables import contact_rows
from highfive.hil.recording.exports.trial_arrays import ExportTrial, TrialArrays
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.model.geometry.rotations import Array

VERSION = "1.10.0"
"""Of the specification."""
NO_DATE = datetime(1900, 1, 1)
SIMULATED = "The person is simulated: nobody took part."
SOME_SIMULATED = "In some runs the person is simulated; their motion.json says so (Simulated)."
SYSTEMS = ("person", "avatar")
"""Tracking systems of a run."""
_SUBJECT = "sub-01"
_WORLD, _PARENT = "world", "parent"
_DESCRIPTION = (
    "A person raises the right hand, and an avatar, or a servo arm, meets it with its own in an emotional style."
)


@dataclass(frozen=True)
class Task:
    """What people did: its label in file names, letters and digits alone, and in words."""

    label: str
    description: str


TASK = Task("highfive", _DESCRIPTION)


@dataclass(frozen=True)
class Channel:
    """A column of a motion file: as ``_channels.tsv`` describes it, and its values (T,)."""

    name: str
    component: str
    kind: str
    point: str
    units: str
    frame: str
    values: Array


def bids_files(trials: Sequence[ExportTrial], source: str) -> list[ExportFile]:
    """All files of the data set; ``source`` names the recording in its README."""
    simulated = {trial.span.about.get("simulated") is True for trial in trials}
    said = SIMULATED if simulated == {True} else SOME_SIMULATED if True in simulated else ""
    which = "n/a" if len(simulated) > 1 else str(int(True in simulated))
    species = "n/a" if simulated == {True} else "homo sapiens"
    people = [("participant_id", "species", "simulated"), (_SUBJECT, species, which)]
    files = [
        of_bytes("dataset_description.json", partial(json_bytes, _dataset(source, said))),
        of_bytes("README.md", partial(_readme, source, said)),
        of_bytes("participants.tsv", partial(tsv_bytes, people)),
        of_bytes("participants.json", partial(json_bytes, PARTICIPANTS)),
    ]
    scans = []
    numbers = [trial.span.number for trial in trials]
    runs = numbers if len(set(numbers)) == len(numbers) else range(len(trials))  # some were broken off
    for trial, number in zip(trials, runs, strict=True):
        run = f"{_SUBJECT}_task-{TASK.label}_%srun-{number + 1:02d}"
        folder = f"{_SUBJECT}/motion"
        for system in SYSTEMS:
            name = run % f"tracksys-{system}_"
            files += motion_files(f"{folder}/{name}", trial, system, TASK)
            scans.append((f"motion/{name}_motion.tsv", 1e-9 * trial.span.start_ns))
        files += [
            of_bytes(f"{folder}/{run % ''}_events.tsv", partial(_events, trial)),
            of_bytes(f"{folder}/{run % ''}_events.json", partial(json_bytes, _EVENTS)),
        ]
    scan_rows = [("filename", "acq_time"), *((name, dateless(start)) for name, start in scans)]
    return [*files, of_bytes(f"{_SUBJECT}/{_SUBJECT}_scans.tsv", partial(tsv_bytes, scan_rows))]


def person_channels(trial: TrialArrays) -> list[Channel]:
    """Points, head and palm as the tracker knew them, and the markers, NaN where they were not measured."""
    channels = [channel for point, at in trial.points.items() for channel in _positions(point, at)]
    channels += _turns("head", trial.head_orientation, _WORLD)
    markers = np.where(trial.seen[..., None], trial.markers, np.nan)
    for marker, name in enumerate(trial.names):
        channels += _positions(f"marker_{name}", markers[:, marker])
    valid = Channel("valid", "n/a", "MISC", "n/a", "n/a", "n/a", trial.valid.astype(float))
    return [*channels, valid, _latency(trial)]


def avatar_channels(trial: TrialArrays) -> list[Channel]:
    """Each joint's place in the world, and its rotation relative to its parent (the pelvis': to the world); and the
    middle of the right palm."""
    channels = []
    for joint, name in enumerate(avatar_skeleton().names):
        channels += _positions(name, trial.positions[:, joint])
        channels += _turns(name, trial.quaternions[:, joint], _PARENT if joint else _WORLD)
    return [*channels, *_positions("palm", trial.avatar_palm), _latency(trial)]


def _positions(point: str, values: Array) -> Iterable[Channel]:
    return (Channel(f"{point}_{axis}", axis, "POS", point, "m", _WORLD, values[:, i]) for i, axis in enumerate("xyz"))


def _turns(point: str, values: Array, frame: str) -> Iterable[Channel]:
    columns = {"x": 1, "y": 2, "z": 3, "w": 0}
    return (
        Channel(f"{point}_q{axis}", f"quat_{axis}", "ORNT", point, "n/a", frame, values[:, column])
        for axis, column in columns.items()
    )


def _latency(trial: TrialArrays) -> Channel:
    return Channel("latency", "n/a", "LATENCY", "n/a", "s", "n/a", trial.times - trial.times[0])


def motion_files(name: str, trial: ExportTrial, system: str, task: Task) -> list[ExportFile]:
    """The four files of one of the :data:`SYSTEMS` in one run; ``name`` is what theirs begin with."""
    channels_of = {"person": person_channels, "avatar": avatar_channels}[system]
    return [
        of_bytes(f"{name}_motion.tsv", lambda: _rows(channels_of(trial.load())), trial.span.ticks),
        of_bytes(f"{name}_motion.json", lambda: json_bytes(_motion(trial.load(), system, task, channels_of))),
        of_bytes(f"{name}_channels.tsv", lambda: _channels(channels_of(trial.load()))),
        of_bytes(f"{name}_channels.json", partial(json_bytes, _FRAMES)),
    ]


def _motion(
    trial: TrialArrays, system: str, task: Task, channels_of: Callable[[TrialArrays], list[Channel]]
) -> dict[str, Any]:
    channels = channels_of(trial)
    simulated = trial.span.about.get("simulated") is True
    kinds = [channel.kind for channel in channels]
    steps = np.diff(trial.times)
    nominal = round(1.0 / float(np.median(steps)), 3) if len(steps) else 120.0
    effective = float(1.0 / steps.mean()) if len(steps) else nominal
    return {
        "TaskName": task.label,
        "TaskDescription": f"{task.description} {SIMULATED}" if simulated else task.description,
        "Simulated": simulated,
        "TrackingSystemName": system,
        "Manufacturer": "High Five",
        "RecordingType": "continuous",
        "RecordingDuration": round(float(trial.times[-1] - trial.times[0]), 6),
        "SamplingFrequency": nominal,
        "SamplingFrequencyEffective": round(effective, 6),
        "MotionChannelCount": len(channels),
        **{f"{kind}ChannelCount": kinds.count(kind) for kind in ("POS", "ORNT", "LATENCY", "MISC")},
        "TrackedPointsCount": len({channel.point for channel in channels} - {"n/a"}),
        "MissingValues": "n/a",
    }


def _rows(channels: Sequence[Channel]) -> bytes:
    text = io.StringIO()
    for row in np.stack([channel.values for channel in channels], axis=1).tolist():
        text.write("\t".join(["n/a" if isnan(value) else f"{value:.6g}" for value in row]) + "\n")
    return text.getvalue().encode()


def _channels(channels: Sequence[Channel]) -> bytes:
    head = ("name", "component", "type", "tracked_point", "units", "reference_frame")
    return tsv_bytes([head, *((c.name, c.component, c.kind, c.point, c.units, c.frame) for c in channels)])


def _events(of: ExportTrial) -> bytes:
    trial, (row,) = of.load(), contact_rows([of.span])
    more = [cell_text(row[name]) for name in _MORE]
    events = [("0", f"{trial.times[-1] - trial.times[0]:.6f}", "high_five", *more)]
    if row["met_time"] is not None:
        events.append((f"{row['met_time']:.6f}", "0", "contact", *more))
    for time, style in trial.changes:
        about = [style if name == "style" else value for name, value in zip(_MORE, more, strict=True)]
        events.append((f"{time - trial.times[0]:.6f}", "0", "answer_changed", *about))
    events.sort(key=lambda event: float(event[0]))
    return tsv_bytes([("onset", "duration", "trial_type", *_MORE), *events])


def cell_text(value: Any) -> str:
    """Of a value in a table: ``n/a`` of nothing, 1 and 0 of yes and no."""
    if isinstance(value, float):
        return f"{value:.6g}"
    return "n/a" if value is None or value == "" else str(int(value)) if isinstance(value, bool) else str(value)


def dateless(start_s: float) -> str:
    """A time of which the date was taken out: s after 1 January 1900."""
    return (NO_DATE + timedelta(seconds=float(start_s))).isoformat(timespec="microseconds")


def tsv_bytes(rows: Iterable[Sequence[str]]) -> bytes:
    """A table, the first row its head."""
    return "".join(
        "\t".join(cell.replace("\t", " ").replace("\n", " ") for cell in row) + "\n" for row in rows
    ).encode()


def json_bytes(value: Mapping[str, Any]) -> bytes:
    """A JSON file."""
    return (json.dumps(value, indent=2, ensure_ascii=False) + "\n").encode()


def _dataset(source: str, said: str) -> dict[str, Any]:
    return dataset(f"High fives of {source}" + (" (simulated)" if said == SIMULATED else ""), said)


def dataset(name: str, said: str) -> dict[str, Any]:
    """``dataset_description.json``; ``said`` is of who is simulated."""
    return {
        "Name": name,
        "BIDSVersion": VERSION,
        "DatasetType": "raw",
        "GeneratedBy": [{"Name": "High Five", "Description": f"highfive export --to bids. {said}".rstrip()}],
    }


def _readme(source: str, said: str) -> bytes:
    return (
        f"# High fives of {source}\n\n{_DESCRIPTION}{said and ' '}{said}\n\n"
        "One run a high five, numbered as in the session's report. tracksys-person: what was tracked of the person, in "
        "metres (x from the avatar to the person, y to the avatar's left, z up; the floor is z = 0). tracksys-avatar: "
        "what the avatar did. acq_time in scans.tsv counts from 1 January 1900: the date was taken out.\n"
    ).encode()


_AXES = {
    "SpatialAxes": "ALS",
    "RotationRule": "right-hand",
    "RotationOrder": "n/a",
}
_FRAMES = {
    "reference_frame": {
        "Description": "Axes in which positions and rotations are given.",
        "Levels": {
            _WORLD: {
                **_AXES,
                "Description": "x from the avatar to the person, y to the avatar's left, z up; origin on the floor "
                "under the avatar's pelvis at rest.",
            },
            _PARENT: {
                **_AXES,
                "Description": "The parent joint's own axes, which are those of the world while the body stands with "
                "hanging arms.",
            },
        },
    }
}
PARTICIPANTS = {
    "species": {"Description": "Of who raised the hand; n/a where nobody did."},
    "simulated": {
        "Description": "Whether the person is simulated; n/a where she is in some of the runs.",
        "Levels": {"1": "yes", "0": "no"},
    },
}
_MORE = ("trial", "emotion", "style", "cell", "met", "distance", "approach_speed")
_EVENTS = {
    "onset": {"Description": "From the first sample of the run.", "Units": "s"},
    "duration": {"Description": "0 for what has none.", "Units": "s"},
    "trial_type": {
        "Description": "What happened.",
        "Levels": {
            "high_five": "One high five, from its first tick to its last.",
            "contact": "The palms met.",
            "answer_changed": "The style, or whether palms are corrected, was changed; style is that from then on.",
        },
    },
    "trial": {"Description": "Number of the high five in the session."},
    "emotion": {"Description": "In which the person raised the hand, as far as that is known."},
    "style": {"Description": "In which the avatar answered."},
    "cell": {"Description": "Where the hand was raised: A to C low to high, 1 to 3 from the avatar's right."},
    "met": {"Description": "Whether the palms met.", "Levels": {"1": "yes", "0": "no"}},
    "distance": {"Description": "From palm to palm at their nearest, some ms after their first touch.", "Units": "m"},
    "approach_speed": {"Description": "Of the palms towards each other as they met.", "Units": "m/s"},
}
