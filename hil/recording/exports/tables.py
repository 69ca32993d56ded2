"""Wide tables with a header (CSV) and arrays by name (NPZ): for R, MATLAB, pandas and NumPy.

Metres, seconds of the recording, quaternions w, x, y, z; an empty cell is a value that was not measured, 1 is yes and 0
no. A row is a tick: one of the person, one of the avatar, one of the markers; and a row a high five of the contacts.
High fives are counted from 1, as in files' names and in the report.
"""

from __future__ import annotations

import csv
import io
import shutil
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from math import isnan
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
from numpy.typing import NDArray

from highfive.hil.recording.exports.export_file import ExportFile, of_bytes
from highfive.hil.recording.exports.trial_arrays import ExportTrial, TrialArrays
from highfive.hil.recording.trial_spans import TrialSpan
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.model.errors import HighFiveError
from highfive.model.files import UNFINISHED, written_whole
from highfive.model.geometry.rotations import Array

CONTACT = (
    "met_time", "distance", "gap", "lateral", "palm_angle", "approach_speed", "peak_force", "uncorrected_error",
    "true_error", "touch_error",
)  # fmt: skip
"""Numbers of a judged contact, as ``/contact`` names them: s after the trial's start, m, rad, m/s, N."""
_TEXTS = ("title", "emotion", "style", "cell")


def csv_files(trials: Sequence[ExportTrial], stem: str) -> list[ExportFile]:
    """``STEM_person.csv``, ``_avatar.csv``, ``_contacts.csv``, and ``_markers.csv`` where markers were recorded."""
    tables: list[tuple[str, Callable[[TrialArrays], dict[str, Array]]]]
    tables = [("person", person_columns), ("avatar", avatar_columns)]
    tables += [("markers", marker_columns)] if trials[0].load().names else []
    ticks = ticks_of(trials)
    files = [ExportFile(f"{stem}_{name}.csv", partial(_tick_table, trials, of), ticks) for name, of in tables]
    return [*files, of_bytes(f"{stem}_contacts.csv", partial(_contact_table, trials))]


def npz_file(trials: Sequence[ExportTrial], name: str) -> ExportFile:
    """One ``.npz`` with all of it, without pickled objects."""
    return ExportFile(name, partial(_npz, trials), ticks_of(trials))


def ticks_of(trials: Sequence[ExportTrial]) -> int:
    """Of all of them."""
    return sum(trial.span.ticks for trial in trials)


def person_columns(arrays: TrialArrays) -> dict[str, Array]:
    """Column -> (T,): the person's points, head and palm."""
    columns = {name: values for point, at in arrays.points.items() for name, values in _xyz(point, at)}
    columns |= dict(_xyz("palm_normal", arrays.palm_normal)) | dict(_quaternion("head", arrays.head_orientation))
    return columns | {"valid": arrays.valid.astype(float), "age": arrays.age}


def avatar_columns(arrays: TrialArrays) -> dict[str, Array]:
    """Column -> (T,): each joint's place in the world, and its rotation relative to its parent (root: the world); then
    the middle of the right palm."""
    columns: dict[str, Array] = {}
    for joint, name in enumerate(avatar_skeleton().names):
        columns |= dict(_xyz(name, arrays.positions[:, joint])) | dict(_quaternion(name, arrays.quaternions[:, joint]))
    return columns | dict(_xyz("palm", arrays.avatar_palm))


def marker_columns(arrays: TrialArrays) -> dict[str, Array]:
    """Column -> (T,): the person's markers, NaN where they were not measured."""
    places = _unseen_as_nan(arrays)
    return {column: values for m, name in enumerate(arrays.names) for column, values in _xyz(name, places[:, m])}


def contact_rows(spans: Iterable[TrialSpan]) -> list[dict[str, Any]]:
    """A row a high five: what it was, when, and how the palms met; None where nothing was judged."""
    rows = []
    for span in spans:
        start, contact = 1e-9 * span.start_ns, span.contact
        where = contact.get("where")
        where = where if isinstance(where, list) and len(where) == 3 else [None] * 3
        met_time = _number(contact.get("met_time"))
        rows.append(
            {"trial": span.number + 1, "start": start, "duration": 1e-9 * (span.end_ns - span.start_ns)}
            | {name: span.text(name) for name in _TEXTS}
            | ({} if span.about.get("simulated") is True else {"emotion": ""})  # of a person nobody knows it
            | {name: _yes(contact.get(name)) for name in ("met", "out_of_reach")}
            | {"contact_time": None if met_time is None else start + met_time}
            | {name: _number(contact.get(name)) for name in CONTACT}
            | {f"where_{axis}": _number(value) for axis, value in zip("xyz", where, strict=True)}
        )
    return rows


def _xyz(name: str, values: Array) -> Iterable[tuple[str, Array]]:
    return ((f"{name}_{axis}", values[:, i]) for i, axis in enumerate("xyz"))


def _quaternion(name: str, values: Array) -> Iterable[tuple[str, Array]]:
    return ((f"{name}_q{axis}", values[:, i]) for i, axis in enumerate("wxyz"))


def _tick_table(
    trials: Sequence[ExportTrial], columns_of: Callable[[TrialArrays], dict[str, Array]], path: Path
) -> None:
    with written_whole(path) as partly, partly.open("w", encoding="utf-8", newline="\n") as table:
        first: list[str] = []
        for trial in trials:
            arrays = trial.load()
            columns = columns_of(arrays)
            if not first:
                first = list(columns)
                table.write(",".join(("time", "trial", "phase", *first)) + "\n")
            _check_same(list(columns), first, trial.span)
            for time, phase, row in zip(
                arrays.times, arrays.phases, np.stack(list(columns.values()), axis=1), strict=True
            ):
                cells = ",".join(["" if isnan(value) else f"{value:.6g}" for value in row.tolist()])
                table.write(f"{time:.9f},{trial.span.number + 1},{phase},{cells}\n")


def _check_same(names: Sequence[str], first: Sequence[str], span: TrialSpan) -> None:
    if names != first:
        raise HighFiveError(
            f"high five {span.number + 1} has other markers than the first one; take each by itself (--trial)"
        )


def _contact_table(trials: Sequence[ExportTrial]) -> bytes:
    text, rows = io.StringIO(), contact_rows(trial.span for trial in trials)
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: _cell(value) for name, value in row.items()} for row in rows)
    return text.getvalue().encode()


def _cell(value: Any) -> Any:
    if isinstance(value, float):
        return f"{value:.9g}"
    return "" if value is None else int(value) if isinstance(value, bool) else value


def _npz(trials: Sequence[ExportTrial], path: Path) -> None:
    """High five by high five, each array first in a file of its own: all of an hour together has no room."""
    with written_whole(path) as partly, TemporaryDirectory(prefix=UNFINISHED, dir=path.parent) as folder:
        names: list[str] = []
        phases: list[NDArray[Any]] = []
        shapes: dict[str, tuple[np.dtype[Any], list[int]]] = {}
        for trial in trials:
            arrays = trial.load()
            names = names or list(arrays.names)
            _check_same(list(arrays.names), names, trial.span)
            phases.append(arrays.phases)
            for name, values in _tick_arrays(arrays).items():
                _, shape = shapes.setdefault(name, (values.dtype, [0, *values.shape[1:]]))
                shape[0] += len(values)
                with (Path(folder) / name).open("ab") as file:
                    file.write(np.ascontiguousarray(values).data)
        rows = contact_rows(trial.span for trial in trials)
        small: dict[str, NDArray[Any]] = {
            "phase": np.concatenate(phases),
            "avatar_joints": np.array(avatar_skeleton().names),
            "marker_names": np.array(names, dtype=np.str_),
            **{f"trials_{name}": _array([row[name] for row in rows]) for name in rows[0]},
        }
        with ZipFile(partly, "w", ZIP_DEFLATED) as held:
            for name, (kind, shape) in shapes.items():
                about = {"descr": np.lib.format.dtype_to_descr(kind), "fortran_order": False, "shape": tuple(shape)}
                with held.open(f"{name}.npy", "w", force_zip64=True) as file, (Path(folder) / name).open("rb") as ticks:
                    np.lib.format.write_array_header_1_0(file, about)
                    shutil.copyfileobj(ticks, file)
            for name, values in small.items():
                with held.open(f"{name}.npy", "w", force_zip64=True) as file:
                    np.lib.format.write_array(file, values, allow_pickle=False)


def _tick_arrays(arrays: TrialArrays) -> dict[str, NDArray[Any]]:
    """A row a tick."""
    return {
        "time": arrays.times, "trial": np.full(len(arrays), arrays.span.number + 1, dtype=np.int64),
        **{f"person_{name}": values for name, values in arrays.points.items()},
        "person_palm_normal": arrays.palm_normal, "person_head_quaternion": arrays.head_orientation,
        "person_valid": arrays.valid, "person_age": arrays.age, "avatar_root": arrays.root,
        "avatar_quaternions": arrays.quaternions, "avatar_positions": arrays.positions,
        "avatar_orientations": arrays.orientations, "avatar_palm": arrays.avatar_palm,
        "markers": _unseen_as_nan(arrays),
    }  # fmt: skip


def _unseen_as_nan(arrays: TrialArrays) -> Array:
    return np.where(arrays.seen[..., None], arrays.markers, np.nan)


def _array(values: list[Any]) -> NDArray[Any]:
    """Numbers with NaN for what is not known, or texts."""
    if all(isinstance(value, str) for value in values):
        return np.array(values, dtype=np.str_)
    if all(isinstance(value, int) and not isinstance(value, bool) for value in values):
        return np.array(values, dtype=np.int64)
    return np.array([np.nan if value is None else float(value) for value in values])


def _number(value: Any) -> float | None:
    return 0.0 + value if isinstance(value, int | float) and not isinstance(value, bool) else None  # and no -0


def _yes(value: Any) -> bool | None:
    return value if isinstance(value, bool) else None
