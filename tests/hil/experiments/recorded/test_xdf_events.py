"""A study's events on the time line of a recorder on another computer, and files that are of other runs."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from helpers.experiments import head, study
from helpers.xdf_by_the_format import Written, write_xdf

from highfive.hil.commands.experiment_analyse import XDF_EVENTS, AnalyseOptions, analyse
from highfive.hil.experiments.recorded.xdf_events import EVENTS
from highfive.hil.experiments.trial_log import open_log, read_session
from highfive.hil.experiments.trial_row import Outcome, TrialRow
from highfive.model.errors import HighFiveError

S = 1_000_000_000
BEGAN_NS = 40_000 * S


@pytest.fixture
def made(tmp_path: Path) -> tuple[Path, list[TrialRow]]:
    """A study in which one took part: a trial each 25 s."""
    folder = study(tmp_path)
    with open_log(folder, head(), False) as log:
        at = BEGAN_NS
        while log.begin() is not None:
            contact = at + 1_600_000_123 if log.ask % 3 else None
            log.finish(
                Outcome(
                    answer="angry", rt_s=1.0, cue_ns=at, contact_ns=contact, ended_ns=at + 3 * S, asked_ns=at + 3 * S,
                    answer_ns=at + 4 * S,
                )
            )  # fmt: skip
            at += 25 * S
    return folder, read_session(folder, "P01", 1).rows


def recorders_s(host_s: float) -> float:
    """What the recorder's clock shows: 50 ppm faster, and begun at another time."""
    return 70.0 + (host_s - 39_000.0) * (1.0 + 50e-6)


def file_of(path: Path, rows: list[TrialRow], late_s: float = 0.0, event: str = "contact") -> Path:
    """Markers of what happened, and an amplifier beside them; the clock is measured to a millisecond or so."""
    rng = np.random.default_rng(1)
    markers = [
        (1e-9 * row.contact_ns + late_s, (json.dumps({"event": event, "trial": row.ask - 1}),))
        for row in rows
        if row.contact_ns is not None
    ]
    markers.insert(0, (markers[0][0] - 1.0, ("not JSON",)))
    measured = np.arange(markers[0][0] - 20.0, markers[-1][0] + 60.0, 5.0)
    offsets = [(float(t), recorders_s(float(t)) - float(t) + float(rng.normal(0.0, 1e-3))) for t in measured]
    ends = recorders_s(float(measured[0])), recorders_s(float(measured[-1]))
    eeg = Written("EEG", "EEG", 500.0, "float32", [(ends[0], (0.0,)), (ends[1], (1.0,))])
    return write_xdf(path, [eeg, Written("HighFive-Events", "Markers", 0.0, "string", markers, offsets)])


@pytest.mark.parametrize("event", ["contact", "tapped"])
@pytest.mark.slow
def test_each_event_has_its_time_there_within_two_milliseconds(
    made: tuple[Path, list[TrialRow]], tmp_path: Path, event: str
) -> None:
    folder, rows = made
    path = file_of(tmp_path / "lab.xdf", rows, event=event)
    result = analyse(AnalyseOptions(None, study=folder, xdf=(path,), out=tmp_path / "out"))
    with (tmp_path / "out" / XDF_EVENTS).open(newline="", encoding="utf-8") as file:
        found = list(csv.DictReader(file))
    wanted = {
        (str(row.ask), name): getattr(row, f"{name}_ns")
        for row in rows for name in EVENTS if getattr(row, f"{name}_ns") is not None
    }  # fmt: skip
    assert {(row["ask"], row["event"]): int(row["host_ns"]) for row in found} == wanted
    off = [abs(float(row["xdf_s"]) - recorders_s(1e-9 * int(row["host_ns"]))) for row in found]
    assert np.percentile(off, 95) < 2e-3
    drifted = 50e-6 * 1e-9 * (max(wanted.values()) - min(wanted.values()))
    assert drifted > 20 * max(off)  # which one offset for the file would have left
    (about,) = result["xdf"]
    assert about["matched"] == sum(row.contact_ns is not None for row in rows) and about["beside_ms"] < 0.1
    assert [stream["name"] for stream in about["streams"]] == ["EEG", "HighFive-Events"]


def test_files_of_other_runs_and_without_markers_are_refused(made: tuple[Path, list[TrialRow]], tmp_path: Path) -> None:
    folder, rows = made
    other = file_of(tmp_path / "other.xdf", rows, late_s=3.0)
    with pytest.raises(HighFiveError, match="none of them one of the study's"):
        analyse(AnalyseOptions(None, study=folder, xdf=(other,)))
    none = write_xdf(tmp_path / "none.xdf", [Written("EEG", "EEG", 0.0, "float32", [(1.0, (0.0,))])])
    with pytest.raises(HighFiveError, match="has no stream HighFive-Events; there are EEG"):
        analyse(AnalyseOptions(None, study=folder, xdf=(none,)))
    with pytest.raises(HighFiveError, match="give its folder"):
        analyse(AnalyseOptions(tmp_path / "counts.csv", xdf=(none,)))
