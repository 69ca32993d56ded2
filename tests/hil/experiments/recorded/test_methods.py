"""The methods paragraph says what the protocol, the log and the rules say, of every template."""

from dataclasses import replace
from pathlib import Path

import pytest
from helpers.experiments import answer, head, study, written

from highfive.hil.commands.experiment_analyse import METHODS, AnalyseOptions, analyse
from highfive.hil.experiments.exclusion import ExclusionRules
from highfive.hil.experiments.recorded.methods import methods
from highfive.hil.experiments.study_rows import study_rows
from highfive.hil.experiments.trial_log import open_log


def took_part(folder: Path, code: str, simulated: bool = False) -> None:
    with open_log(folder, replace(head(code), simulated=simulated), False) as log:
        answer(log, rt_s=1.0)


@pytest.mark.parametrize("template", ["tipping", "morph", "high_five"])
def test_all_of_the_protocol_is_in_it(template: str, tmp_path: Path) -> None:
    lines = written(tmp_path, template).read_text(encoding="utf-8").splitlines()
    people = next(line for line in lines if line.startswith("participants = "))
    folder = study(tmp_path, template, {people: "participants = 1" if template == "morph" else "participants = 2"})
    took_part(folder, "P00" if template == "high_five" else "P01")
    found = study_rows(folder)
    protocol = found.protocol
    text = methods(folder, found, 0.9, ExclusionRules("ours.toml", "abc123"))
    for block in protocol.blocks:
        assert f"{block.name}, {protocol.trials_of(block)} trials" in text
    for word in (*protocol.labels, *(one.text for one in protocol.ratings)):
        assert word in text
    timing = protocol.timing
    for figure in (timing.between_s, timing.trial_s, timing.answer_s, protocol.order.alike, protocol.seed, 90):
        assert f"{figure:g}" in text
    assert f"version {protocol.consent}" in text and "ours.toml (SHA-256 abc123" in text and "High Five 1.0" in text
    assert f"Of {len(found.rows)} trials {len(found.counted)} are analysed" in text
    assert ("Williams square" in text) is (len(protocol.parts) > 1)
    assert ("expected entropy" in text) is protocol.adaptive
    assert text.count("[") == text.count("]") >= 3


def test_it_is_written_with_the_analysis_and_says_that_nobody_took_part(tmp_path: Path) -> None:
    folder = study(tmp_path)
    for code in ("P01", "P02"):
        took_part(folder, code, simulated=True)
    analyse(AnalyseOptions(None, study=folder, out=tmp_path / "out"))
    text = (tmp_path / "out" / METHODS).read_text(encoding="utf-8")
    assert "All participants were simulated" in text and "2 simulated participants took part in 2 sessions" in text
    assert "no consent was asked for" in text and "signed version" not in text and "ethics" not in text
    assert "nothing was rendered" in text and "rendered again" not in text
    assert "practice, 6" in text and "a filler block, 24" in text
