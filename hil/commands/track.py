"""``highfive track``: a recording with its gaps filled, the arm's angles, and a report."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.table import Table

from highfive.calibration.personal_set import personal_set
from highfive.hil.commands.stream.arm import prepare_tracker
from highfive.hil.datasets.fitted_subject import fitted_subject
from highfive.hil.report.track_summary import angle_rows, summarise_track
from highfive.hil.runtime.console import STDOUT, Bar, counted, say_aside
from highfive.hil.runtime.folders import next_folder, results_folder, write_file
from highfive.mocap_bridge.files.c3d_fill import write_filled
from highfive.mocap_bridge.files.recording import prefixes_listed
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.markers.one_person import OnePerson, read_person
from highfive.mocap_bridge.tracking.tracked_recording import TrackedRecording, passes, track_recording
from highfive.mocap_bridge.tracking.unobservable import unseen_lines
from highfive.model.errors import HighFiveError

ANGLES_FILE = "angles.csv"


@dataclass(frozen=True)
class TrackOptions:
    """What to track.

    Attributes:
        file: a C3D file.
        person: prefix of the person's markers; None for the only one.
        marker_set: name or file of the marker set; None finds one.
        subject: file of the person's own set, from ``highfive calibrate subject``, instead of ``marker_set``.
        out: folder for the results; None takes ``out/track-1``, ``-2``, ….
        fit: fit the marker set to the person first, from the same recording; never done to a subject's own set.
        overwrite: write into a folder that holds something.
    """

    file: Path
    person: str | None = None
    marker_set: str | None = None
    subject: Path | None = None
    out: Path | None = None
    fit: bool = True
    overwrite: bool = False


def track(options: TrackOptions, bar: Bar) -> dict[str, Any]:
    """Tracks a recording and writes the filled file, the angles and the report.

    Returns:
        The summary; its ``files`` are names in its ``folder``.

    Raises:
        HighFiveError: the file is not usable, the labels do not fit, the folder holds something, or a result cannot be
            written.
    """
    folder = options.out or next_folder("track")
    with results_folder(folder, options.overwrite):
        return _track(options, folder, bar)


def _track(options: TrackOptions, folder: Path, bar: Bar) -> dict[str, Any]:
    if options.marker_set is not None and options.subject is not None:
        raise HighFiveError("give --marker-set or --subject: a subject's file is a marker set")
    filled = f"{options.file.stem}_filled.c3d"
    if (folder / filled).resolve() == options.file.resolve():
        raise HighFiveError(f"{folder / filled} is the recording itself; choose another --out")
    requested = options.marker_set if options.subject is None else str(options.subject)
    person = read_person(options.file, options.person, requested)
    prepare_tracker(say_aside)
    fitted = _fitted(person, bar) if options.fit and options.subject is None else None
    marker_set = fitted or person.marker_set
    advance = bar("tracking", len(person.recording) * passes(person.recording, marker_set))
    tracked = track_recording(person.recording, marker_set, advance)
    files = {"filled": filled, "angles": ANGLES_FILE, "report": "report.html"}
    summary = summarise_track(person, tracked) | {
        "fitted": fitted is not None, "folder": str(folder), "files": files,
    }  # fmt: skip
    _write_angles(folder / ANGLES_FILE, tracked)
    _write_filled(folder / filled, person, tracked)
    from highfive.hil.report.track_report import write_track_report  # noqa: PLC0415 (matplotlib: not before it is needed)

    write_track_report(folder, summary, tracked, _command(options, folder))
    return summary


def _fitted(person: OnePerson, bar: Bar) -> MarkerSet | None:
    """The marker set on this person's own body; None where the recording shows too little of it.

    Where somebody's arms are an eighth shorter than the set's, angles by the set as it is are ten degrees off and more.
    """
    base = person.marker_set
    try:
        subject = fitted_subject(person, bar)
    except HighFiveError:
        return None
    return personal_set(subject, base.name, base.description)


def print_track(summary: dict[str, Any]) -> None:
    """The summary for people."""
    whose = f", {summary['person']}" if summary["person"] else ""
    print(
        f"{Path(summary['file']).name}{whose}: {counted(summary['frames'], 'frame')} at {summary['rate_hz']:g} Hz, "
        f"marker set {summary['marker_set']}{', fitted to the person' if summary['fitted'] else ''}"
    )
    if summary["other_persons"]:
        others = prefixes_listed(summary["other_persons"])
        print(f"  left out              {others}: no right arm by these labels; --person asks for one")
    residual = summary["residual_mm"]
    if residual is not None:
        print(f"  measured to skeleton  median {residual['median']:.1f} mm, 95 % within {residual['p95']:.1f} mm")
    hidden, filled = summary["hidden_points"], summary["filled_points"]
    print(f"  hidden points         {hidden} in {summary['gaps']} gaps, {filled} filled")
    print(f"  not believed          {summary['disbelieved_points']}")
    if summary["refused_frames"]:
        print(f"  frames not used       {summary['refused_frames']}: their markers span what no person does")
    if summary["missing"]:
        print(f"  never there           {', '.join(summary['missing'])}")
    if unused := summary["unused"]:
        names = ", ".join(unused[:8]) + (" …" if len(unused) > 8 else "")
        print(f"  of no marker set      {names}: left as they are, gaps and all")
    for number, line in enumerate(unseen_lines(summary)):
        print(f"  {'' if number else 'angles left blank':<20}  {line}")
    rows = {name: of for name, of in summary["markers"].items() if of["hidden"] or of["disbelieved"]}
    if rows:
        shown = Table("marker", "gaps", "longest, ms", "hidden", "filled", "± mm", "not believed", box=SIMPLE_HEAD)
        for name, of in rows.items():
            counts = [f"{of[key]:g}" for key in ("gaps", "longest_gap_ms", "hidden", "filled")]
            doubt = "" if of["filled_sd_mm"] is None else f"{of['filled_sd_mm']['median']:.1f}"
            shown.add_row(name, *counts, doubt, f"{of['disbelieved']}")
        STDOUT.print(shown)
    print(f"Open {Path(summary['folder']) / summary['files']['report']}")


def _write_angles(path: Path, tracked: TrackedRecording) -> None:
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    heads, rows = angle_rows(tracked)
    writer.writerow(heads)
    writer.writerows(rows)
    write_file(path, buffer.getvalue().encode())


def _write_filled(path: Path, person: OnePerson, tracked: TrackedRecording) -> None:
    hidden = tracked.hidden & tracked.usable
    columns = {}
    for m in range(len(tracked.marker_set)):
        if (label := person.label(m)) is not None:
            columns[label] = (tracked.filled[:, m], hidden[:, m])
    write_filled(person.path, path, columns)


def _command(options: TrackOptions, folder: Path) -> list[str]:
    words = ["highfive", "track", str(options.file)]
    for name in ("person", "marker_set", "subject"):
        if (value := getattr(options, name)) is not None:
            words += [f"--{name.replace('_', '-')}", str(value)]
    return [*words, *([] if options.fit else ["--no-fit"]), "--out", str(folder)]
