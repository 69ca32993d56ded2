"""The events of a study on the time line of an XDF file that was recorded beside it, with EEG or an eye tracker.

The markers of ``run --publish lsl`` are in the file; they are stamped by the clock that the log's times are of, and the
file has how far the recorder's clock is off. So every event of the log has a time there, also those that are no marker.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from highfive.hil.experiments.trial_row import TrialRow
from highfive.mocap_bridge.files.xdf import XdfStream, named, read_xdf
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

MARKERS, CONTACTS = "HighFive-Events", ("contact", "tapped")
EVENTS = ("cue", "contact", "ended", "asked", "answer", "shown")
"""Of a row: its columns of these names in ``_ns``."""
SAME_S = 1e-4
"""A marker and the log's time of it are rounded no further apart."""
BEYOND_S = 2.0
"""The recording may begin and end so much after and before a session's first and last events that are in it."""
COLUMNS = ("file", "participant", "session", "ask", "trial", "event", "host_ns", "xdf_s")


@dataclass(frozen=True)
class XdfEvents:
    """What was found in one file.

    Attributes:
        about: for people and JSON.
        rows: one an event, in :data:`COLUMNS`.
    """

    about: dict[str, Any]
    rows: tuple[tuple[Any, ...], ...]


def xdf_events(path: Path, rows: Sequence[TrialRow]) -> XdfEvents:
    """The events of those sessions of which a contact is among the markers of a file.

    Raises:
        HighFiveError: it cannot be read, has no markers, or those of no session.
    """
    streams = read_xdf(path)
    markers = named(streams, MARKERS, path)
    contacts = np.array([stamp for stamp, row in zip(markers.stamps, markers.texts, strict=False) if _is_contact(row)])
    sessions = dict.fromkeys((row.participant, row.session) for row in rows)
    found: list[tuple[Any, ...]] = []
    matched, beside = 0, list[float]()
    for who in sessions:
        own = [row for row in rows if (row.participant, row.session) == who]
        met = np.array([1e-9 * row.contact_ns for row in own if row.contact_ns is not None])
        near = _nearest(met, contacts)
        if not (near < SAME_S).any():
            continue
        matched += int((near < SAME_S).sum())
        beside += near[near < SAME_S].tolist()
        found += [(path.name, *event) for event in _events(own, markers)]
    if not found:
        raise HighFiveError(
            f"{path} has {len(contacts)} contacts among its markers, none of them one of the study's; give the file "
            "that was recorded beside its runs (run --publish lsl)"
        )
    begin, end = _span(streams)
    inside = [row for row in found if begin - BEYOND_S <= row[-1] <= end + BEYOND_S]
    about = {
        "file": path.name,
        "contacts": len(contacts),
        "matched": matched,
        "beside_ms": round(1e3 * max(beside), 4),
        "events": len(inside),
        "outside": len(found) - len(inside),
        "clock_measurements": len(markers.offsets),
        "streams": [_about(stream) for stream in streams],
    }
    return XdfEvents(about, tuple(inside))


def events_csv(found: Sequence[XdfEvents]) -> bytes:
    """A row an event of all files; ``xdf_s`` is by the recorder's clock, as pyxdf has it without smoothing."""
    text = io.StringIO(newline="")
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    for one in found:
        table.writerows((*row[:-1], f"{row[-1]:.6f}") for row in one.rows)
    return text.getvalue().encode()


def _events(rows: Sequence[TrialRow], markers: XdfStream) -> list[tuple[Any, ...]]:
    found: list[tuple[Any, ...]] = []
    for row in rows:
        for name in EVENTS:
            if (at_ns := getattr(row, f"{name}_ns")) is not None:
                found.append((row.participant, row.session, row.ask, row.trial, name, at_ns))
    times = markers.on_recorder_clock(np.array([1e-9 * event[-1] for event in found]))
    return [(*event, float(time)) for event, time in zip(found, times, strict=True)]


def _is_contact(row: tuple[str, ...]) -> bool:
    try:
        said = json.loads(row[0])
    except (ValueError, IndexError, RecursionError):
        return False
    return isinstance(said, dict) and said.get("event") in CONTACTS


def _nearest(times: Array, others: Array) -> Array:
    """(N,) s from each of the times to the nearest of the others."""
    if not len(others):
        return np.full(len(times), np.inf)
    return np.array([float(np.abs(others - time).min()) for time in times])


def _span(streams: Sequence[XdfStream]) -> tuple[float, float]:
    """First and last sample of all, by the recorder's clock."""
    ends = [stream.on_recorder_clock(stream.stamps[[0, -1]]) for stream in streams if len(stream.stamps)]
    return float(min(end[0] for end in ends)), float(max(end[1] for end in ends))


def _about(stream: XdfStream) -> dict[str, Any]:
    return {
        "name": stream.name, "type": stream.kind, "rate_hz": stream.rate_hz, "channels": len(stream.labels),
        "samples": len(stream.stamps),
    }  # fmt: skip
