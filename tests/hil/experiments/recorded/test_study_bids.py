"""A study as BIDS: onsets are those of the log, nothing says who or when, and the official validator finds no error."""

import csv
import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from command_line import failing, running
from helpers.experiments import study
from helpers.recorded_study import HOST_NS, UTC_NS, played_study
from shipped import shipped_trials

VALIDATOR = os.environ.get("BIDS_VALIDATOR") or shutil.which("bids-validator-deno")
run, fails = running("export"), failing("export")


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file, delimiter="," if path.suffix == ".csv" else "\t"))


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return played_study(tmp_path_factory.mktemp("study"))


@pytest.fixture(scope="module")
def dataset(made: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    from typer.testing import CliRunner  # noqa: PLC0415

    from highfive.hil.cli.main import app  # noqa: PLC0415

    folder = tmp_path_factory.mktemp("bids") / "data"
    done = CliRunner().invoke(app, ["export", str(made), "--to", "bids", "--out", str(folder), "--json"])
    assert done.exit_code == 0, done.output
    said = json.loads(done.stdout)
    files = {str(path) for path in folder.rglob("*") if path.is_file()}
    assert files == set(said["files"]) and said["participants"] == 2 and said["runs"] == 8
    return folder


@pytest.mark.slow
def test_events_are_at_the_times_of_the_log_and_rows_are_those_of_the_study(dataset: Path) -> None:
    for code in ("P01", "P02"):
        for number, trial in enumerate(shipped_trials(), 1):
            stem = dataset / f"sub-{code}/ses-1/motion/sub-{code}_ses-1_task-tipping_run-{number:03d}_events"
            events = {row["trial_type"]: row for row in rows_of(stem.with_suffix(".tsv"))}
            wanted = {
                "cue": -0.1,
                "high_five": 0.0,
                "contact": 1.0,
                "motion_over": 2.0,
                "question": 2.01,
                "answer": 3.51,
            }
            onsets = {name: float(row["onset"]) for name, row in events.items()}
            late = trial.times[0] - 1e-9 * trial.span.start_ns  # the first tick in which both were there
            assert onsets == pytest.approx(
                {n: at - late if n != "high_five" else at for n, at in wanted.items()}, abs=2e-6
            )
            assert float(events["high_five"]["duration"]) == pytest.approx(trial.times[-1] - trial.times[0], abs=2e-6)
            described = json.loads(stem.with_suffix(".json").read_text(encoding="utf-8"))
            assert described.keys() == events["cue"].keys()
        answers = dataset / f"sub-{code}/ses-1/beh/sub-{code}_ses-1_task-tipping_beh.tsv"
        rows, about = rows_of(answers), json.loads(answers.with_suffix(".json").read_text(encoding="utf-8"))
        assert set(rows[0]) == about.keys() - {"TaskName", "TaskDescription"}
        assert [row["ask"] for row in rows] == [str(n + 1) for n in range(len(rows))]
        assert rows[0]["not_counted_why"] == "practice" and rows[20]["answer"] == rows[20]["expected"]
        assert rows[0]["cue_ns"] == str(HOST_NS - 100_000_000)
    everybody = rows_of(dataset / "sourcedata/trials.csv")
    assert {row["participant"] for row in everybody} == {"P01", "P02"}
    assert [row["participant_id"] for row in rows_of(dataset / "participants.tsv")] == ["sub-P01", "sub-P02"]


def test_nothing_says_when_she_took_part_nor_what_the_experimenter_wrote(dataset: Path) -> None:
    texts = [
        path
        for path in dataset.rglob("*")
        if path.suffix in (".tsv", ".json", ".md", ".csv") and "_motion" not in path.name
    ]
    assert len(texts) > 20
    for path in texts:
        text = path.read_text(encoding="utf-8")
        assert "Ada" not in text and str(UTC_NS)[:8] not in text and not re.search(r"\b20[2-9]\d-\d\d", text), path
    for code in ("P01", "P02"):
        scans = rows_of(dataset / f"sub-{code}/ses-1/sub-{code}_ses-1_scans.tsv")
        assert scans[0]["acq_time"].startswith("1900-01-01T00:00:00")
        assert {row["filename"] for row in scans} == {
            f"{path.parent.name}/{path.name}"
            for path in (dataset / f"sub-{code}/ses-1").rglob("*.tsv")
            if path.name.endswith(("_motion.tsv", "_beh.tsv"))
        }


@pytest.mark.skipif(VALIDATOR is None, reason="bids-validator-deno is not installed, and BIDS_VALIDATOR names none")
def test_the_official_validator_finds_no_error(dataset: Path) -> None:
    assert VALIDATOR
    done = subprocess.run([VALIDATOR, str(dataset), "--json"], stdout=subprocess.PIPE, check=False)
    found = json.loads(done.stdout)
    assert [issue for issue in found["issues"]["issues"] if issue["severity"] == "error"] == []
    assert set(found["summary"]["dataTypes"]) == {"motion", "beh"}
    assert sorted(found["summary"]["subjects"]) == [
        "P01",
        "P02",
    ]


def test_a_lost_recording_is_said_and_the_rest_is_exported(made: Path, tmp_path: Path, run) -> None:
    again = tmp_path / "study"
    shutil.copytree(made, again)
    (again / "participants/P02/session-1/I1.mcap").unlink()
    code, out, err = run(again, "--to", "bids", "--json")
    said = json.loads(out)
    assert code == 0 and said["runs"] == 4 and len(said["missing"]) == 1 and "I1.mcap" in err
    assert said["folder"] == str(tmp_path / "study_bids")


def test_what_cannot_be_is_one_line(made: Path, tmp_path: Path, fails) -> None:
    assert "holds no answers" in fails(study(tmp_path), "--to", "bids")
    assert "--to bids exports as a whole" in fails(made, "--to", "csv")
    assert "--to bids exports as a whole" in fails(made, "--to", "bids", "--trial", "1")
    assert "lies in the study" in fails(made, "--to", "bids", "--out", made / "bids")
    (tmp_path / "full").mkdir()
    (tmp_path / "full/other").touch()
    assert "holds something already" in fails(made, "--to", "bids", "--out", tmp_path / "full")
