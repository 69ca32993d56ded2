"""The recording that comes with the project, as exports are made from it."""

import json
import tempfile
from functools import cache, partial
from pathlib import Path

from mcap.writer import Writer

from highfive.hil.recording.exports.trial_arrays import ExportTrial, TrialArrays, export_trials
from highfive.hil.recording.recording import SessionRecording, read_recording
from highfive.hil.recording.session_reader import read_session
from highfive.hil.view import SHIPPED_RECORDING

FIRST, LAST = ("/session", "/trial"), ("/contact", "/event")


@cache
def shipped_recording() -> SessionRecording:
    return read_recording(SHIPPED_RECORDING)


@cache
def shipped_trials() -> tuple[TrialArrays, ...]:
    return tuple(trial.load() for trial in export_trials(read_session(SHIPPED_RECORDING)))


def exported(*trials: TrialArrays) -> list[ExportTrial]:
    """As they are exported."""
    return [ExportTrial(trial.span, partial(_itself, trial), lambda: None) for trial in trials]


def _itself(trial: TrialArrays) -> TrialArrays:
    return trial


def written(recording: SessionRecording, path: Path | None = None) -> Path:
    """A file that holds it, message by message, in the order of time; without an end where it is not complete."""
    path = path or Path(tempfile.mkdtemp()) / "s.mcap"
    about = {"settings": recording.settings, "joints": list(recording.joints), "chain": recording.chain}
    rows = [(-1, 0, "/session", about)]
    for topic, messages in recording.channels.items():
        if topic != "/session":
            order = 0 if topic in FIRST else 2 if topic in LAST else 1
            rows += [(message.time_ns, order, topic, message.data) for message in messages]
    with path.open("wb") as file:
        writer, channels = Writer(file), dict[str, int]()
        writer.start()
        for time_ns, _, topic, data in sorted(rows, key=lambda row: row[:2]):
            if topic not in channels:
                schema = writer.register_schema(topic, "jsonschema", b"{}")
                channels[topic] = writer.register_channel(topic, "json", schema)
            writer.add_message(channels[topic], max(time_ns, 0), json.dumps(data).encode(), max(time_ns, 0))
        if recording.complete:
            writer.finish()
        else:
            writer.flush()
    return path
