"""BIDS: files fit each other and the recording; the official validator, where it is installed, finds no error."""

import csv
import importlib.util
import json
import os
import shutil
import subprocess
from dataclasses import replace
from datetime import datetime

import numpy as np
import pytest
from shipped import exported, shipped_trials

from highfive.hil.recording.exports.bids import bids_files

FIRST = ("name", "component", "type", "tracked_point", "units")
"""Columns, in the order that the specification asks for."""
KINDS = {"POS", "ORNT", "LATENCY", "MISC"}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bids")
    for file in bids_files(exported(*shipped_trials()), "session.mcap"):
        (folder / file.name).parent.mkdir(parents=True, exist_ok=True)
        file.write(folder / file.name)
    return folder


def rows_of(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file, delimiter="\t"))


@pytest.mark.parametrize("system", ["person", "avatar"])
def test_channels_describe_the_columns(dataset, system):
    for path in sorted(dataset.glob(f"sub-01/motion/*tracksys-{system}*_motion.tsv")):
        stem = path.name.removesuffix("_motion.tsv")
        channels = rows_of(path.with_name(f"{stem}_channels.tsv"))
        about = json.loads(path.with_name(f"{stem}_motion.json").read_text())
        levels = json.loads(path.with_name(f"{stem}_channels.json").read_text())["reference_frame"]["Levels"]
        assert tuple(channels[0])[: len(FIRST)] == FIRST
        assert len({channel["name"] for channel in channels}) == len(channels) == about["MotionChannelCount"]
        assert {channel["type"] for channel in channels} <= KINDS
        for kind in KINDS:
            assert about[f"{kind}ChannelCount"] == sum(channel["type"] == kind for channel in channels)
        assert {channel["reference_frame"] for channel in channels} - {"n/a"} <= levels.keys()
        lines = [line.split("\t") for line in path.read_text().splitlines()]
        assert {len(line) for line in lines} == {len(channels)}
        assert about["SamplingFrequency"] == pytest.approx(60.0)


def test_values_are_the_recordings(dataset):
    trial = shipped_trials()[1]
    stem = dataset / "sub-01" / "motion" / "sub-01_task-highfive_tracksys-avatar_run-02"
    names = [row["name"] for row in rows_of(stem.with_name(f"{stem.name}_channels.tsv"))]
    values = np.loadtxt(stem.with_name(f"{stem.name}_motion.tsv"), delimiter="\t")
    by_name = dict(zip(names, values.T, strict=True))
    np.testing.assert_allclose(by_name["pelvis_z"], trial.root[:, 2], atol=1e-5)
    np.testing.assert_allclose(by_name["latency"], trial.times - trial.times[0], atol=1e-5)
    np.testing.assert_allclose(by_name["palm_y"], trial.avatar_palm[:, 1], atol=1e-5)
    head = trial.quaternions[:, 6]
    for column, axis in enumerate("wxyz"):
        np.testing.assert_allclose(by_name[f"head_q{axis}"], head[:, column], atol=1e-5)


def test_events_and_starts_are_in_the_recordings_time(dataset):
    starts = {
        row["filename"]: datetime.fromisoformat(row["acq_time"]) for row in rows_of(dataset / "sub-01/sub-01_scans.tsv")
    }
    first = starts["motion/sub-01_task-highfive_tracksys-person_run-01_motion.tsv"]
    begin = shipped_trials()[0].times[0]
    for trial in shipped_trials():
        run = f"run-{trial.span.number + 1:02d}"
        for system in ("person", "avatar"):
            start = starts[f"motion/sub-01_task-highfive_tracksys-{system}_{run}_motion.tsv"]
            assert (start - first).total_seconds() == pytest.approx(trial.times[0] - begin, abs=1e-6)
        events = rows_of(dataset / f"sub-01/motion/sub-01_task-highfive_{run}_events.tsv")
        assert [event["trial_type"] for event in events] == ["high_five", "contact"]
        assert float(events[1]["onset"]) == pytest.approx(trial.span.contact["met_time"], abs=1e-6)
        described = json.loads((dataset / f"sub-01/motion/sub-01_task-highfive_{run}_events.json").read_text())
        assert described.keys() == events[0].keys()


def test_a_style_that_was_changed_on_the_way_is_among_the_events(tmp_path):
    trial = shipped_trials()[0]
    changed = replace(trial, changes=((trial.times[0] + 0.25, "angry"),))
    (file,) = (one for one in bids_files(exported(changed), "session.mcap") if one.name.endswith("_events.tsv"))
    file.write(tmp_path / "events.tsv")
    events = rows_of(tmp_path / "events.tsv")
    assert [event["trial_type"] for event in events] == ["high_five", "answer_changed", "contact"]
    assert float(events[1]["onset"]) == pytest.approx(0.25) and events[1]["style"] == "angry" != events[0]["style"]


@pytest.mark.skipif(
    importlib.util.find_spec("bids_validator_deno") is None and not os.environ.get("BIDS_VALIDATOR"),
    reason="bids-validator-deno is not installed, and BIDS_VALIDATOR names none",
)
def test_the_official_validator_finds_no_error(dataset):
    command = os.environ.get("BIDS_VALIDATOR") or shutil.which("bids-validator-deno")
    assert command
    done = subprocess.run([command, str(dataset), "--json"], stdout=subprocess.PIPE, check=False)
    found = json.loads(done.stdout)
    assert [issue for issue in found["issues"]["issues"] if issue["severity"] == "error"] == []
    assert found["summary"]["dataTypes"] == ["motion"] and found["summary"]["totalFiles"] == 45


def test_simulated_people_are_said_to_be_simulated(dataset):
    simulated = [trial.span.about["simulated"] for trial in shipped_trials()]
    said = [json.loads(path.read_text()) for path in sorted(dataset.glob("sub-01/motion/*_motion.json"))]
    assert all(simulated) and said and all(one["Simulated"] for one in said)
    assert all("nobody took part" in one["TaskDescription"] for one in said)
    (person,) = rows_of(dataset / "participants.tsv")
    assert person["simulated"] == "1" and person["species"] == "n/a"
    about = json.loads((dataset / "dataset_description.json").read_text())
    assert about["Name"].endswith("(simulated)") and "nobody took part" in about["GeneratedBy"][0]["Description"]
