"""The recording that comes with the project, as exports are made from it."""

from functools import cache

from highfive.hil.recording.exports.session_arrays import SessionArrays, session_arrays
from highfive.hil.recording.recording import SessionRecording, read_recording
from highfive.hil.view import SHIPPED_RECORDING


@cache
def shipped_recording() -> SessionRecording:
    return read_recording(SHIPPED_RECORDING)


@cache
def shipped() -> SessionArrays:
    return session_arrays(shipped_recording(), "session.mcap")


def shipped_trials() -> list[SessionArrays]:
    return [shipped().trial(place) for place in range(len(shipped().spans))]
