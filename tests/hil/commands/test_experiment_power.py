"""``highfive experiment power``: the tables of how many people, from trials, from an experiment, and odd input."""

import json
from pathlib import Path

import pytest
from experiments import protocol, written

from highfive.hil.cli import main as cli
from highfive.hil.commands.experiment_power import PowerOptions, power
from highfive.hil.experiments.analysis.power import PowerSettings
from highfive.hil.experiments.analysis.pse_error import MorphObserverSettings, adaptive_error, constant_error


@pytest.fixture
def highfive(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path):
    monkeypatch.chdir(tmp_path)

    def run(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["highfive", "experiment", "power", *map(str, words)])
        with pytest.raises(SystemExit) as left:
            cli.main()
        out, err = capsys.readouterr()
        return int(left.value.code or 0), out, err

    return run


def no_bar(label: str, total: int):
    return lambda note="", done=None: None


@pytest.mark.slow
def test_the_table_is_the_one_that_was_made_apart_and_the_number_of_people_lies_in_it(highfive) -> None:
    code, out, _ = highfive("--trials", 72, "--difference", 0.08, "--people", 8, "--people", 12, "--json")
    found = json.loads(out)
    assert code == 0 and found["trials"] == 72 and found["people"] == [8, 12]
    (row,) = found["effects"]
    assert row["power"] == pytest.approx([0.66, 0.85], abs=0.03)
    assert 8 < row["needed"] < 12
    code, out, _ = highfive()
    assert code == 0 and "for 80%" in out and "assumed, not measured" in out and "36 trials" in out
    assert "in interaction and in replays" in out


def test_an_experiment_says_how_many_trials_are_compared(tmp_path: Path) -> None:
    few = PowerSettings(studies=200)
    tipping = power(PowerOptions(written(tmp_path, "tipping"), settings=few, people=(8,)), no_bar)
    # I1, I2, I3 are shown again; the filler is not
    assert (tipping["of"], tipping["trials"], tipping["planned"]) == ("rate_difference", 36, 12)
    morph = power(PowerOptions(written(tmp_path, "morph"), settings=few, people=(8,)), no_bar)
    assert (morph["of"], morph["trials"]) == ("pse_shift", 56)
    # 7 levels × 8: another simulation, with the PSE in the middle, has .049
    assert morph["assumed"]["pse_error"] == pytest.approx(0.049, abs=0.012)


@pytest.mark.slow
def test_more_trials_make_a_better_pse_and_chosen_ones_half_of_them_do() -> None:
    levels = list(protocol("morph").morph.levels)  # pyright: ignore[reportOptionalMemberAccess]
    four, sixteen = constant_error(levels * 4, 1), constant_error(levels * 16, 1)
    assert sixteen < 0.75 * four
    chosen = adaptive_error(28, 0.1, 1, MorphObserverSettings(observers=40))
    assert chosen < 0.9 * four


@pytest.mark.slow
def test_what_does_not_go_together_is_one_line(highfive, tmp_path: Path) -> None:
    tipping, morph = written(tmp_path, "tipping"), written(tmp_path, "morph")
    alone = written(tmp_path / "alone", "high_five")
    text = alone.read_text(encoding="utf-8").replace('"own_replay"', '"other_replay"')
    alone.write_text(text, encoding="utf-8")
    for words, said in {
        ("--difference", "0.1", "--shift", "0.1"): "of two kinds of study",
        (str(tipping), "--trials", "3"): "leave out --trials",
        (str(tipping), "--shift", "0.1"): "shows no morphs",
        (str(morph), "--difference", "0.1"): "have no right answer",
        ("--pse-error", "0.1"): "is of morphs",
        ("--people", "1"): "expected 2 to 10000",
        ("--difference", "0.3"): "--difference 0.3 from a rate of 0.75",
        ("nowhere.toml",): "cannot read the experiment",
        (str(alone),): "there is nothing to compare",
        ("--difference", "nan"): "'--difference'",
        ("--shift", "inf"): "'--shift'",
    }.items():
        code, out, err = highfive(*words)
        lines = [line for line in err.splitlines() if line.strip()]
        assert (code, out) == (2, "") and len(lines) == 1 and said in err, (words, err)
