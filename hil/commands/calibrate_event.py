"""``highfive calibrate event``: by how much one stream of a recording is later than another, from taps or claps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from highfive.calibration.event_latency import event_latency
from highfive.calibration.event_onsets import impacts, steps
from highfive.calibration.latency_file import KeptLatency, load_latencies, save_latencies
from highfive.hil.recording.one_recording import one_recording
from highfive.hil.recording.recording import RecordedMessage, SessionRecording, read_recording
from highfive.hil.recording.schemas import STREAMS
from highfive.hil.runtime.console import counted
from highfive.hil.runtime.folders import check_file
from highfive.hil.session.session_streams import ARM, PERSON
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array


@dataclass(frozen=True)
class EventCalibration:
    """What to compare.

    Attributes:
        recording: an MCAP file, or a folder that holds one.
        stream: whose latency is sought: ``person``, ``arm``, or ``lsl/NAME``.
        reference: the stream that is in time.
        channel: label of the stream's channel, or of the person's marker; None for the one that shows events best.
        reference_channel: the same of the reference.
        out: the file that keeps it; others' latencies in it stay.
        overwrite: replace what it has of this stream.
    """

    recording: Path
    stream: str
    reference: str
    channel: str | None = None
    reference_channel: str | None = None
    out: Path = Path("latencies.toml")
    overwrite: bool = False


def calibrate_event(options: EventCalibration) -> dict[str, Any]:
    """Finds the events of both, and keeps the latency.

    Raises:
        HighFiveError: there is no such stream or channel, too few events are seen by both, or the file cannot be
            written.
    """
    known = load_latencies(options.out) if options.out.is_file() else {}
    if options.stream in known and not options.overwrite:
        raise HighFiveError(f"{options.out} has {options.stream} already; give another --out, or --overwrite")
    check_file(options.out, overwrite=True)
    path = one_recording(options.recording)
    recording = read_recording(path)
    ours = _events(recording, options.reference, options.reference_channel)
    theirs = _events(recording, options.stream, options.channel)
    found = event_latency([round(1e9 * time) for time in ours], [round(1e9 * time) for time in theirs])
    if found.latency_ns < -found.bound_ns:
        raise HighFiveError(
            f"{options.stream} is {-1e-6 * found.latency_ns:.1f} ms earlier than {options.reference}; "
            "exchange --stream and --reference"
        )
    latency, bound = (round(1e-6 * ns, 3) for ns in (max(found.latency_ns, 0), found.bound_ns))
    date = datetime.now(UTC).isoformat(timespec="seconds")
    kept = KeptLatency(latency, bound, found.events, options.reference, path.name, date)
    save_latencies(options.out, {**known, options.stream: kept}, replace=True)
    return {
        "stream": options.stream,
        "reference": options.reference,
        "latency_ms": latency,
        "bound_ms": bound,
        "events": found.events,
        "seen": {options.stream: len(theirs), options.reference: len(ours)},
        "out": str(options.out),
    }


def print_event(result: dict[str, Any]) -> None:
    """The same for people."""
    print(
        f"{result['stream']} is {result['latency_ms']:.1f} ± {result['bound_ms']:.1f} ms later than "
        f"{result['reference']}, by {counted(result['events'], 'event')} that both have"
    )
    print(f"Kept in {result['out']}: highfive simulate --latencies {result['out']}")


def _events(recording: SessionRecording, stream: str, channel: str | None) -> Array:
    """When a stream has events, s of the recording.

    Raises:
        HighFiveError: there is no such stream or channel, or it says too little.
    """
    try:
        if stream == PERSON:
            return _of_person(recording, channel)
        if stream == ARM:
            messages = _messages(recording, "/arm", stream)
            return impacts(_times(messages), np.array([m.data["positions"] for m in messages], dtype=float))
        return _of_lsl(_messages(recording, STREAMS + stream.removeprefix("lsl/"), stream), channel)
    except HighFiveError as error:
        raise HighFiveError(f"{stream}: {error}") from None


def _messages(recording: SessionRecording, topic: str, stream: str) -> Sequence[RecordedMessage]:
    found = recording.channels.get(topic) or []
    if not found:
        lsl = [f"lsl/{name.removeprefix(STREAMS)}" for name in recording.channels if name.startswith(STREAMS)]
        ours = [name for name, topic in ((PERSON, "/frame"), (ARM, "/arm")) if recording.channels.get(topic)]
        raise HighFiveError(f"the recording has no stream {stream}; it has {', '.join([*ours, *lsl]) or 'none'}")
    return found


def _times(messages: Sequence[RecordedMessage]) -> Array:
    return 1e-9 * np.array([m.time_ns for m in messages], dtype=float)


def _of_lsl(messages: Sequence[RecordedMessage], channel: str | None) -> Array:
    """Texts are events; numbers leave where they rest."""
    times, first = _times(messages), messages[0].data
    if isinstance(first["values"][0], str):
        wanted = [channel is None or channel in m.data["values"] for m in messages]
        return times[np.array(wanted)]
    labels = list(first["labels"])
    same = np.array([list(m.data["labels"]) == labels for m in messages])  # until its channels change
    values = np.array([m.data["values"] for m, fits in zip(messages, same, strict=True) if fits], dtype=float)
    return steps(times[same], values[:, _column(labels, channel, _contrast(values))])


def _of_person(recording: SessionRecording, marker: str | None) -> Array:
    """A marker that is stopped, at the times at which the cameras saw it."""
    frames, ticks = _messages(recording, "/frame", PERSON), recording.channels["/tick"]
    ahead = {m.time_ns: m.data["time_ns"] for m in ticks if m.data["framed"]}
    seen = [m for m in frames if m.time_ns in ahead]
    times = np.array([m.time_ns - (ahead[m.time_ns] - m.data["source_time_ns"]) for m in seen], dtype=float)
    names = list(frames[0].data["names"])
    seen_at = [(t, m.data) for t, m in zip(times, seen, strict=True) if list(m.data["names"]) == names]
    points = np.array([data["positions"] for _, data in seen_at], dtype=float)
    points[~np.array([data["valid"] for _, data in seen_at])] = np.nan
    moved = np.diff(points, 2, axis=0)
    column = _column(names, marker, np.nanmax(np.linalg.norm(moved, axis=2), axis=0, initial=0.0))
    return impacts(1e-9 * np.array([t for t, _ in seen_at]), points[:, column])


def _contrast(values: Array) -> Array:
    """(C,) how far the highest of each channel stands out of what is there besides."""
    off = np.abs(values - np.nanmedian(values, axis=0))
    return np.nanmax(off, axis=0) / (np.nanmedian(off, axis=0) + 1e-3 * np.nanmax(off) + 1e-300)


def _column(labels: list[str], wanted: str | None, best: Array) -> int:
    if wanted is None:
        return int(np.argmax(best))
    if wanted not in labels:
        raise HighFiveError(f"no channel {wanted!r}; there are {', '.join(labels)}")
    return labels.index(wanted)
