"""How palms met, out of a study's recordings: what the recording's judgement says, and nothing of what is lost."""

import csv
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.recorded_study import played_study
from shipped import shipped_trials

from highfive.hil.commands.experiment_analyse import AnalyseOptions, analyse, print_analysis
from highfive.hil.experiments.recorded.interaction import SYNCHRONY, TIMING, interaction
from highfive.hil.experiments.study_rows import study_rows


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return played_study(tmp_path_factory.mktemp("study"))


@pytest.mark.slow
def test_figures_are_those_of_the_recorded_contacts(made: Path) -> None:
    rows = [replace(row, condition="interactive", block="I1") for row in study_rows(made).rows]
    found = interaction(made, rows)
    assert len(found.figures) == 8 and not found.missing
    for number, trial in enumerate(shipped_trials(), 1):
        one = found.figures["P01", 1, number]
        judged = trial.span.contact
        met = judged["met_time"]
        # the cue was 100 ms before the first tick: from there both ways lead to the same contact
        late = trial.times[0] - 1e-9 * trial.span.start_ns
        for who in ("person", "avatar"):
            assert one[f"{who}_onset_s"] + one[f"{who}_to_contact_s"] == pytest.approx(met + 0.1, abs=1e-6 + late)
        assert 0.0 <= one["person_waiting_s"] <= met and abs(one["asynchrony_s"]) < 0.01
        assert 0.0 <= one["miss_m"] <= judged["distance"] + 0.02
        # an oracle of its own: palms' distance three frames apart, on the recorded ticks
        distance = np.linalg.norm(trial.points["palm"] - trial.positions[:, _wrist()], axis=1)
        assert one["closing_speed"] > 0.0 and distance[0] > distance[np.searchsorted(trial.times - trial.times[0], met)]
    # the same four recordings twice: each pair has one pseudo-pair at the least, and the two persons' are alike
    for number in range(1, 5):
        first, second = (found.figures[code, 1, number] for code in ("P01", "P02"))
        assert first["synchrony"] == second["synchrony"] and first["asynchrony_s"] == second["asynchrony_s"]


def _wrist() -> int:
    from highfive.hil.sim.avatar import avatar_skeleton  # noqa: PLC0415

    return avatar_skeleton().index("right_wrist")


@pytest.mark.slow
def test_analysis_has_timing_of_conditions_and_columns_of_trials_bit_for_bit(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    results = [analyse(AnalyseOptions(None, study=made, out=tmp_path / name)) for name in ("a", "b")]
    timing = results[0]["timing"]["interactive"]
    assert timing["asynchrony_s"]["n"] == timing["closing_speed"]["n"] == 2  # the three before are practice
    assert "asynchrony_s" not in results[0]["timing"]["own_replay"]
    with (tmp_path / "a/all_trials.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {*TIMING, *SYNCHRONY} <= rows[0].keys()
    assert sum(bool(row["asynchrony_s"]) for row in rows) == 2
    for ending in ("png", "svg", "pdf"):
        figure = f"figures/timing.{ending}"
        assert (tmp_path / "a" / figure).read_bytes() == (tmp_path / "b" / figure).read_bytes()
    assert (tmp_path / "a/report.html").read_bytes() == (tmp_path / "b/report.html").read_bytes()
    assert "Not counted" in (tmp_path / "a/report.html").read_text(encoding="utf-8")
    print_analysis(results[0])
    assert "palms: asynchrony" in capsys.readouterr().out


def test_a_lost_recording_takes_its_timing_alone(made: Path, tmp_path: Path) -> None:
    again = tmp_path / "study"
    shutil.copytree(made, again)
    (again / "participants/P02/session-1/I1.mcap").write_bytes(b"no recording")
    result, whole = analyse(AnalyseOptions(None, study=again)), analyse(AnalyseOptions(None, study=made))
    assert result["table"] == whole["table"]
    assert [one["participant"] for one in result["motion"]["missing"]] == ["P02"]
    assert result["timing"]["interactive"]["asynchrony_s"]["n"] == 1
