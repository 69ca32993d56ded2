"""A study in which the motion of the recording that comes along was played, at times that are known."""

import shutil
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from helpers.experiments import head, study
from shipped import shipped_recording, written

from highfive.hil.experiments.trial_log import open_log
from highfive.hil.experiments.trial_row import Outcome
from highfive.hil.recording.recording import RecordedMessage, SessionRecording

MS = 1_000_000
HOST_NS = 7_000_000_000_000
"""The session's clock as the first high five of a recording begins."""
UTC_NS = 1_760_000_000_000_000_000
"""The time of day then."""


def with_clocks() -> SessionRecording:
    """The recording that comes along, whose high fives say when they were."""
    recording = shipped_recording()
    trials = tuple(
        RecordedMessage(one.time_ns, {**one.data, "host_ns": HOST_NS + one.time_ns, "utc": _utc(one.time_ns)})
        for one in recording.channels["/trial"]
    )
    return replace(recording, channels={**recording.channels, "/trial": trials})


def _utc(time_ns: int) -> str:
    return datetime.fromtimestamp(1e-9 * (UTC_NS + time_ns), UTC).isoformat(timespec="milliseconds")


def played_study(folder: Path, people: int = 2, simulated: bool = False) -> Path:
    """Everybody answered all trials rightly; the first four of each moved as in the recording, the others not at all.

    The cue is 100 ms before a motion, contact 1 s after its begin, its end 2 s, the question 10 ms later, the answer
    1.5 s after that.
    """
    made = study(folder, changes={"participants = 12": f"participants = {people}"})
    recording = with_clocks()
    begins = [HOST_NS + one.time_ns for one in recording.channels["/trial"]]
    file = written(recording)
    for number in range(1, people + 1):
        code = f"P{number:02d}"
        with open_log(made, replace(head(code), simulated=simulated), resume=False) as log:
            for place in range(10_000):
                if (trial := log.begin()) is None:
                    break
                outcome = Outcome(answer=trial.answer, rt_s=1.5, notes="her name is Ada", source_ns=UTC_NS)
                if place < len(begins):
                    at = begins[place]
                    outcome = replace(
                        outcome, recording="I1.mcap", cue_ns=at - 100 * MS, contact_ns=at + 1000 * MS,
                        ended_ns=at + 2000 * MS, asked_ns=at + 2010 * MS, answer_ns=at + 3510 * MS,
                    )  # fmt: skip
                log.finish(outcome)
            shutil.copy(file, log.path.with_name("I1.mcap"))
    return made
