"""``highfive experiment analyse``: one JSON object of the whole study, one line for bad input."""

import json
from pathlib import Path

import pytest

from highfive.hil.cli import main as cli

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


def test_bad_input_is_one_line(analyse, tmp_path: Path) -> None:
    (tmp_path / "named.csv").write_text(COUNTS.replace("S1", "overall"))
    (tmp_path / "empty.csv").write_text("participant,condition,correct,n\n")
    for words, said in {
        (): "nothing to analyse",
        ("--counts", "nowhere.csv"): "cannot read nowhere.csv",
        ("--counts", "empty.csv"): "holds no answers",
        ("--counts", "named.csv"): "a participant is called overall",
        ("--counts", "counts.csv", "--emotions", "1"): "emotions",
    }.items():
        code, out, err = analyse(*words)
        assert (code, out) == (2, "") and said in err.lower() and len(err.strip().splitlines()) == 1
