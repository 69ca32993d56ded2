"""``highfive experiment analyse``: one JSON object of the whole study, one line for bad input."""

import csv
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from paths import ROOT

from highfive.hil.cli import main as cli
from highfive.hil.experiments.analysis.psychometric import p_second

COUNTS = "participant,condition,correct,n\n" + "".join(
    f"S{number},interactive,{i},{n}\nS{number},replay,{r},{n}\n"
    for number, (i, r, n) in enumerate([(47, 39, 72), (57, 55, 72), (59, 62, 72), (50, 45, 60), (55, 56, 72)], start=1)
)


@pytest.fixture
def analyse(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "counts.csv").write_text(COUNTS)

    def run(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["highfive", "experiment", "analyse", *map(str, words)])
        with pytest.raises(SystemExit) as exit_info:
            cli.main()
        return int(exit_info.value.code or 0), *capsys.readouterr()

    return run


def test_the_tables_figures_come_as_json(analyse) -> None:
    code, out, err = analyse("--counts", "counts.csv", "--json")
    assert (code, err) == (0, "")
    found = json.loads(out)
    assert set(found["table"]) == {"S1", "S2", "S3", "S4", "S5", "overall"}
    assert found["table"]["S1"]["interactive"]["mean"] == pytest.approx(0.617, abs=0.001)
    assert found["table"]["S4"]["replay"]["se"] == pytest.approx(0.055, abs=0.001)
    assert found["table"]["S3"]["p_interactive_higher"] == pytest.approx(0.252, abs=0.001)
    assert found["table"]["overall"] == pytest.approx(0.969, abs=0.0005)
    assert "no significance" in found["overall_warning"]
    low, high = found["hierarchical"]["interval"]
    assert low < 0 < found["hierarchical"]["mean"] < high


def test_people_are_told_the_same_and_warned(analyse) -> None:
    code, out, _ = analyse("--counts", "counts.csv")
    assert code == 0
    assert "0.617 ± 0.054" in out and "overall P" in out and "no significance" in out and "95% interval" in out


EMOTIONS = ("angry", "fearful", "neutral")


def simulated_study() -> str:
    """Three observers who tell emotions apart better in interaction, and whose PSE it shifts by −.1."""
    rng, lines = np.random.default_rng(4), ["participant,condition,emotion,answer,weight"]
    for person in ("A1", "B2", "C3"):
        for condition, right, pse in (("interactive", 0.9, 0.45), ("replay", 0.7, 0.55)):
            for shown in EMOTIONS * 12:
                said = shown if rng.random() < right else EMOTIONS[rng.integers(3)]
                lines.append(f"{person},{condition},{shown},{said},")
            for weight in np.repeat(np.linspace(0.0, 1.0, 7), 12):
                said = "angry" if rng.random() < p_second(weight, pse, 0.12, 0.03) else "neutral"
                lines.append(f"{person},{condition},angry,{said},{weight:.6g}")
    return "\n".join(lines) + "\n"


def test_a_study_trial_by_trial_gives_a_page_figures_and_a_tidy_table(analyse, tmp_path: Path) -> None:
    (tmp_path / "trials.csv").write_text(simulated_study())
    code, out, _ = analyse("--trials", "trials.csv", "--out", "study", "--json")
    found = json.loads(out)
    assert code == 0 and found["page"] == "study/report.html"
    assert found["emotions"] == 3 and set(found["table"]) == {"A1", "B2", "C3", "overall"}
    matrix = np.array(found["confusion"]["interactive"]["counts"])
    assert matrix.sum() == 108 and np.trace(matrix) > 0.8 * 108
    shift = found["psychometric"]["pse_shift"]
    assert shift["interval"][0] < -0.1 < shift["interval"][1]
    assert set(found["psychometric"]["conditions"]["replay"]["people"]) == {"A1", "B2", "C3"}

    study = tmp_path / "study"
    names = ("rates", "effects", "confusions", "psychometric")
    assert {path.name for path in (study / "figures").iterdir()} == {
        f"{name}.{ending}" for name in names for ending in ("png", "svg", "pdf")
    }
    page = (study / "report.html").read_text()
    assert page.count("<figure>") == 4 and "no significance" in page and "<script" not in page
    with (study / "trials.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3 * 2 * (36 + 84)
    right = [int(row["correct"]) for row in rows if row["participant"] == "B2" and row["condition"] == "replay"
             and row["correct"]]  # fmt: skip
    assert found["table"]["B2"]["replay"]["mean"] == pytest.approx((sum(right) + 3) / (36 + 9))
    assert json.loads((study / "report.json").read_text()) == {k: v for k, v in found.items() if k != "page"}

    with (study / "summary.csv").open() as file:
        at = ("table", "condition", "item", "figure")
        rows = {tuple(row[key] for key in at): row for row in csv.DictReader(file)}
    assert rows["recognition", "replay", "B2", "rate"]["estimate"] == repr(found["table"]["B2"]["replay"]["mean"])
    moved = rows["psychometric", "interactive - replay", "", "shift of the pse"]
    assert [float(moved[key]) for key in ("low", "high")] == shift["interval"] and moved["range"] == "95% interval"
    angry = rows["emotions", "interactive", "angry", "rate"]
    rate = found["confusion"]["interactive"]["emotions"]["angry"]["mean"]
    assert (angry["n"], float(angry["estimate"])) == ("36", rate)
    assert len(rows) == 3 * 3 + 1 + 2 * 3 * 3 + 2 * (3 * 3 + 2) + 1

    code, _, err = analyse("--trials", "trials.csv", "--out", "study")
    assert code == 2 and "study holds something already" in err


@pytest.mark.slow
def test_another_process_makes_the_same_files_bit_for_bit(tmp_path: Path) -> None:
    (tmp_path / "trials.csv").write_text(simulated_study())
    made = []
    for seed in "12":
        words = ["experiment", "analyse", "--trials", "trials.csv", "--out", f"study-{seed}"]
        environment = os.environ | {"PYTHONHASHSEED": seed, "PYTHONPATH": str(ROOT)}
        program = [sys.executable, "-m", "highfive.hil.cli.main", *words]
        subprocess.run(program, cwd=tmp_path, env=environment, check=True, capture_output=True)
        study = tmp_path / f"study-{seed}"
        made.append({str(p.relative_to(study)): p.read_bytes() for p in sorted(study.rglob("*")) if p.is_file()})
    assert len(made[0]) == 16 and made[0] == made[1]
    text = made[0]["figures/rates.svg"] + made[0]["figures/rates.pdf"]
    assert not re.search(rb"<dc:date>|/CreationDate", text)


@pytest.mark.slow
def test_names_are_shown_as_they_are(analyse, tmp_path: Path) -> None:
    (tmp_path / "trials.csv").write_text(simulated_study().replace("A1", "$\\no<b>$").replace("angry", "$\\x$"))
    code, _, err = analyse("--trials", "trials.csv", "--out", "study")
    assert (code, err) == (0, "")
    page = (tmp_path / "study" / "report.html").read_text()
    assert "$\\no&lt;b&gt;$" in page and "<b>" not in page


def test_counts_alone_give_a_page_without_trials(analyse, tmp_path: Path) -> None:
    code, out, _ = analyse("--counts", "counts.csv", "--out", "study")
    assert code == 0 and "Open study/report.html" in out
    assert not (tmp_path / "study" / "trials.csv").exists()
    assert "counts alone" in (tmp_path / "study" / "report.html").read_text()


def test_bad_input_is_one_line(analyse, tmp_path: Path) -> None:
    (tmp_path / "named.csv").write_text(COUNTS.replace("S1", "overall"))
    (tmp_path / "few.csv").write_text(simulated_study())
    (tmp_path / "empty.csv").write_text("participant,condition,correct,n\n")
    for words, said in {
        (): "nothing to analyse",
        ("--counts", "counts.csv", "--trials", "counts.csv"): "give one of them",
        ("--trials", "few.csv", "--emotions", "2"): "few.csv has 3 (angry, fearful, neutral); give that many or more",
        ("--trials", "counts.csv"): "expected participant,condition,emotion,answer",
        ("--counts", "nowhere.csv"): "cannot read nowhere.csv",
        ("--counts", "empty.csv"): "holds no answers",
        ("--counts", "named.csv"): "a participant is called overall",
        ("--counts", "counts.csv", "--emotions", "1"): "emotions",
    }.items():
        code, out, err = analyse(*words)
        assert (code, out) == (2, "") and said in err.lower() and len(err.strip().splitlines()) == 1
