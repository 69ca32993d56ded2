"""A study's folder to its figures: what counts, what does not and why, and that simulated rows are no people's."""

import csv
import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
from helpers.experiments import head, study

from highfive.hil.commands.experiment_analyse import AnalyseOptions, analyse, print_analysis
from highfive.hil.commands.export_study import export_study
from highfive.hil.experiments.exclusion import read_rules
from highfive.hil.experiments.study_rows import study_rows
from highfive.hil.experiments.trial_log import open_log
from highfive.hil.experiments.trial_row import Outcome
from highfive.model.errors import HighFiveError


def take_part(folder: Path, code: str, wrong: dict[str, int], simulated: bool = False, blocks: int = 99) -> None:
    """Answers rightly but for so many of a mode; I2-02 has no answer, I2-03 is broken off."""
    left = dict(wrong)
    seen: list[str] = []
    with open_log(folder, replace(head(code), simulated=simulated), resume=False) as log:
        while (trial := log.following) is not None:
            seen = [*dict.fromkeys([*seen, trial.block])]
            if len(seen) > blocks:
                return
            log.begin()
            answer = trial.answer
            if trial.block in ("I1", "I3", "R1", "R3") and left.get(trial.mode, 0) > 0:
                left[trial.mode] -= 1
                answer = next(label for label in log.plan.keys if label != trial.answer)
            outcome = Outcome(answer=answer, rt_s=1.0 if trial.mode == "interactive" else 2.0)
            if trial.name == "I2-02":
                outcome = Outcome(excluded_why="no answer within 15 s")
            if trial.name == "I2-03":
                outcome = Outcome(broken_off="coughed")
            log.finish(outcome)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = study(tmp_path, changes={"participants = 12": "participants = 4"})
    take_part(made, "P01", {"interactive": 3, "own_replay": 9})
    take_part(made, "P02", {"interactive": 5, "own_replay": 6})
    return made


def test_counts_are_those_of_the_answers_and_all_else_is_listed_with_its_reason(folder: Path) -> None:
    found = study_rows(folder)
    result = analyse(AnalyseOptions(None, study=folder))
    why = [one["why"] for one in result["excluded"]]
    # I1, I2, I3 of 12 with two of I2 lost; R1 to R3, of which R2 lacks the trial that was broken off
    for person, wrong in (("P01", (3, 9)), ("P02", (5, 6))):
        for condition, lost, n in (("interactive", wrong[0], 34), ("replay", wrong[1], 35)):
            k = n - lost
            assert result["table"][person][condition]["mean"] == pytest.approx((k + 3) / (n + 9))
    assert why.count("practice") == 6 and why.count("a filler block") == 24
    assert why.count("broken off: coughed") == 2 and why.count("no answer within 15 s") == 2
    assert len(found.rows) == len(found.counted) + len(found.excluded) == result["trials"]["all"]
    assert result["timing"]["interactive"]["reaction_s"] == {"n": 68, "median": 1.0, "q1": 1.0, "q3": 1.0}
    assert result["timing"]["own_replay"]["reaction_s"]["median"] == 2.0
    assert set(result) >= {"table", "hierarchical", "psychometric", "timing", "excluded"} and not result["simulated"]


def test_simulated_participants_do_not_count_beside_people_and_have_no_table_by_themselves(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = analyse(AnalyseOptions(None, study=folder))
    take_part(folder, "P03", {"interactive": 30}, simulated=True)
    after = analyse(AnalyseOptions(None, study=folder))
    assert after["table"] == before["table"] and after["hierarchical"] == before["hierarchical"]
    assert sum("simulated" in one["why"] for one in after["excluded"]) > 60
    (tmp_path / "alone").mkdir()
    alone = study(tmp_path / "alone")
    for code in ("P01", "P02"):
        take_part(alone, code, {"interactive": 3}, simulated=True)
    result = analyse(AnalyseOptions(None, study=alone, out=tmp_path / "out"))
    assert result["table"] is None and "left out" in result["table_refused"] and result["simulated"]
    assert result["hierarchical"]["mean"] < 0.0
    print_analysis(result)
    said = capsys.readouterr().out
    assert said.startswith("Table 1 of the source study is left out: it is of people")
    for condition, found in result["confusion"].items():
        for name, one in found["emotions"].items():
            assert f"{name} {one['correct']} of {one['shown']} right, estimate {one['mean']:.2f}" in said, condition
    assert "left out" in (tmp_path / "out/report.html").read_text(encoding="utf-8")


def test_somebody_who_is_not_through_is_left_out_and_named(folder: Path) -> None:
    take_part(folder, "P03", {}, blocks=2)
    result = analyse(AnalyseOptions(None, study=folder))
    assert "P03" not in result["table"]
    assert any(one["participant"] == "P03" and "one condition" in one["why"] for one in result["excluded"])


def test_a_plan_that_was_changed_after_it_was_run_is_refused(folder: Path) -> None:
    plan = folder / "participants/P02/plan.toml"
    plan.write_text(plan.read_text(encoding="utf-8").replace('mode = "own_replay"', 'mode = "interactive"', 1))
    with pytest.raises(HighFiveError, match=r"plan .*P02/plan\.toml was changed: its digest is \w+, expected"):
        analyse(AnalyseOptions(None, study=folder))


@pytest.mark.slow
def test_the_same_folder_gives_the_same_files_and_a_row_for_every_trial(folder: Path, tmp_path: Path) -> None:
    results = [analyse(AnalyseOptions(None, study=folder, out=tmp_path / name)) for name in ("a", "b")]
    files = sorted(path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*") if path.is_file())
    for name in files:
        assert (tmp_path / "a" / name).read_bytes() == (
            tmp_path / "b" / name
        ).read_bytes() or name.name == "report.json"
    with (tmp_path / "a/all_trials.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == results[0]["trials"]["all"]
    assert sum(not row["not_counted_why"] for row in rows) == results[0]["trials"]["counted"]
    json.dumps(results[0], allow_nan=False)


def test_nothing_and_two_sources_are_refused(tmp_path: Path) -> None:
    made = study(tmp_path)
    for options, words in (
        (AnalyseOptions(None, study=made), "holds no answers"),
        (AnalyseOptions(None, study=tmp_path), "is no study"),
        (AnalyseOptions(tmp_path / "x.csv", study=made), "leave out --counts"),
        (AnalyseOptions(None), "nothing to analyse"),
        (AnalyseOptions(tmp_path / "x.csv", exclude=tmp_path / "x.toml"), "give its folder"),
        (AnalyseOptions(None, study=made, exclude=tmp_path / "x.toml"), "cannot read the rules"),
    ):
        with pytest.raises(HighFiveError, match=words):
            analyse(options)


@pytest.mark.slow
def test_a_study_of_one_person_has_her_figures_and_a_line_of_what_needs_more(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = study(tmp_path, changes={"participants = 12": "participants = 4"})
    take_part(made, "P01", {"interactive": 3, "own_replay": 9}, blocks=2)
    one = analyse(AnalyseOptions(None, study=made, out=tmp_path / "begun"))
    assert one["table"] is None and one["hierarchical"] is None
    assert "interactive trials alone; the comparison needs replay trials" in one["lacking"]
    assert one["timing"]["interactive"]["reaction_s"]["n"] > 10 and "interactive" in one["confusion"]
    (tmp_path / "whole").mkdir()
    made = study(tmp_path / "whole", changes={"participants = 12": "participants = 4"})
    take_part(made, "P01", {"interactive": 3, "own_replay": 9})
    alone = analyse(AnalyseOptions(None, study=made, out=tmp_path / "alone"))
    assert "one person, P01; what differs between people needs two or more" in alone["lacking"]
    assert alone["hierarchical"] is None and set(alone["table"]) == {"P01", "overall"}
    print_analysis(alone)
    assert "needs two or more" in capsys.readouterr().out
    assert "needs two or more" in (tmp_path / "alone/report.html").read_text(encoding="utf-8")
    take_part(made, "P02", {"interactive": 5, "own_replay": 6})
    both = analyse(AnalyseOptions(None, study=made))
    assert both["table"]["P01"] == alone["table"]["P01"] and "lacking" not in both
    take_part(made, "P03", {}, blocks=2)
    assert analyse(AnalyseOptions(None, study=made))["table"] == both["table"]


RULES = """
[[trials]]
why = "slower than seen"
column = "rt_s"
above = 1.5
conditions = ["own_replay"]

[[trials]]
why = "angry was said"
column = "answer"
is = "angry"

[[people]]
why = "fell asleep (notes)"
codes = ["P02"]
"""


def test_a_labs_rules_leave_out_what_they_say_and_each_trial_has_its_first_reason(folder: Path, tmp_path: Path) -> None:
    take_part(folder, "P03", {"interactive": 1})
    take_part(folder, "P04", {"own_replay": 2})
    path = tmp_path / "rules.toml"
    path.write_text(RULES.replace("above = 1.5", "above = 2.5"), encoding="utf-8")
    plain, ruled = (analyse(AnalyseOptions(None, study=folder, exclude=rules)) for rules in (None, path))
    rows = study_rows(folder).rows
    why = {(one["participant"], one["ask"]): one["why"] for one in ruled["excluded"]}
    before = {(one["participant"], one["ask"]): one["why"] for one in plain["excluded"]}
    for row in rows:
        key = row.participant, row.ask
        if key in before:
            assert why[key] == before[key]  # the log's own reasons come first
        elif row.answer == "angry":
            assert why[key] == "angry was said"
        else:
            assert why.get(key, "") == ("fell asleep (notes)" if row.participant == "P02" else "")
    assert set(ruled["table"]) == {"P01", "P03", "P04", "overall"}
    assert ruled["rules"]["file"] == "rules.toml" and len(ruled["rules"]["digest"]) == 12
    # Who has nothing of a condition left is left out, and named.
    path.write_text(RULES, encoding="utf-8")
    gone = analyse(AnalyseOptions(None, study=folder, exclude=path))
    assert gone["table"] is None and "interactive trials alone" in gone["lacking"]
    assert sum(one["why"] == "slower than seen" for one in gone["excluded"]) == 4 * 35


def test_a_rule_for_somebody_whom_nobody_planned_is_refused(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "rules.toml"
    path.write_text(RULES.replace("P02", "P20"), encoding="utf-8")
    with pytest.raises(HighFiveError, match=r"codes 'P20', which nobody planned; the study has P01, P02"):
        study_rows(folder, read_rules(path))


@pytest.mark.parametrize(
    ("rule", "says"),
    [
        ('column = "ratings.nope"\nbelow = 1', "column 'ratings.nope', which nobody planned; the study has none"),
        ('column = "style"\nis = "happy"', "style is 'happy', which nobody planned; the study has neutral, fearful"),
        ('column = "block"\nis = "I9"', "block is 'I9', which nobody planned; the study has practice, I1"),
        ('column = "answer"\nis = "sad"', "answer is 'sad', which nobody planned; the study has neutral"),
        (
            'column = "condition"\nis = "replay"',
            "condition is 'replay', which nobody planned; the study has interactive",
        ),
    ],
)
def test_a_rule_for_what_no_trial_has_is_refused(folder: Path, tmp_path: Path, rule: str, says: str) -> None:
    path = tmp_path / "rules.toml"
    path.write_text(f'[[trials]]\nwhy = "x"\n{rule}\n', encoding="utf-8")
    with pytest.raises(HighFiveError, match=says):
        study_rows(folder, read_rules(path))


@pytest.mark.slow
def test_anothers_replays_are_compared_with_interaction_where_there_are_none_of_ones_own(tmp_path: Path) -> None:
    """By hand: logits of (k + ½)/(n − k + ½), the smaller share right in what is another's."""
    made = study(tmp_path, "high_five", {"participants = 12": "participants = 2"})
    for code in ("P00", "P01", "P02"):
        with open_log(made, head(code), resume=False) as log:
            wrong = 6
            while (trial := log.begin()) is not None:
                misses = trial.mode == "other_replay" and wrong > 0
                wrong -= misses
                other = next(label for label in log.plan.keys if label != trial.answer)
                log.finish(Outcome(answer=other if misses else trial.answer))
    result = analyse(AnalyseOptions(None, study=made, out=tmp_path / "out"))
    found = result["contrasts"]["other_replay"]
    assert found["people"] == 2 and found["rates"] == {"interactive": 1.0, "other_replay": 0.75}
    by_hand = math.log(36.5 / 0.5) - math.log(18.5 / 6.5)
    assert 0.2 * by_hand < found["effects"]["mean"] < by_hand and found["effects"]["p_positive"] > 0.95
    assert sum(map(sum, result["confusion"]["other_replay"]["counts"])) == 48
    assert "interactive − other replay, logit" in (tmp_path / "out/report.html").read_text(encoding="utf-8")
    rules = tmp_path / "rules.toml"
    rules.write_text('[[trials]]\nwhy = "x"\ncolumn = "condition"\nis = "own_replay"\n', encoding="utf-8")
    without = analyse(AnalyseOptions(None, study=made, exclude=rules))
    assert without["contrasts"] == result["contrasts"] and without["table"] is None
    assert "no replay trials: the source study's table compares" in without["lacking"]


def test_nobody_vanishes_with_a_log_that_a_crash_left(
    folder: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Empty, of zeros, begun and no more, and torn after the first person's last row: each is said everywhere."""
    caplog.set_level("INFO")
    whole = analyse(AnalyseOptions(None, study=folder))
    assert whole["incomplete_logs"] == [] and not caplog.messages
    logs = {
        code: folder / "participants" / code / "session-1" / "trials.jsonl" for code in ("P01", "P02", "P03", "P04")
    }
    content = logs["P01"].read_bytes()
    for left, says in (
        (b"", "it is empty"),
        (bytes(4096), "no line of it is whole, its end is torn (4096 bytes of zeros)"),
        (b"\n", "no line of it is whole, its end is torn (1 byte)"),
    ):
        logs["P03"].parent.mkdir(exist_ok=True)
        logs["P03"].write_bytes(left)
        (one,) = study_rows(folder).incomplete
        assert (one.participant, one.session, one.why) == ("P03", 1, says)
    with open_log(folder, head("P04"), resume=False):
        pass
    for rest in (b"}garbage\n", bytes(9), b'{"kind": '):
        logs["P01"].write_bytes(content + rest)
        result = analyse(AnalyseOptions(None, study=folder, out=tmp_path / "out", overwrite=True))
        why = {one["participant"]: one["why"] for one in result["incomplete_logs"]}
        assert list(why) == ["P01", "P03", "P04"] and why["P04"] == "no trial is over in it"
        assert why["P01"].startswith("its end is torn (9 bytes") and result["trials"] == whole["trials"]
        lines = [message for message in caplog.messages if message.startswith("log of P0")]
        assert len(lines) == 3 and all(line.endswith("or take its log from a backup") for line in lines)
        for name in ("report.html", "report.json", "methods.md"):
            text = (tmp_path / "out" / name).read_text(encoding="utf-8")
            assert all(reason in text for reason in why.values()), name
        caplog.clear()
    exported = export_study(folder, tmp_path / "bids", False, lambda label, total: lambda note="", done=None: None)
    assert exported["participants"] == 2 and sum("log of P0" in message for message in caplog.messages) == 3


def test_where_all_logs_are_lost_it_is_said_and_not_that_nothing_was_run(tmp_path: Path) -> None:
    made = study(tmp_path)
    log = made / "participants/P01/session-1/trials.jsonl"
    log.parent.mkdir()
    log.write_bytes(bytes(10))
    with pytest.raises(HighFiveError, match=r"holds no answers; log of P01, session 1: no line of it is whole"):
        study_rows(made)


def test_people_are_left_out_by_what_of_theirs_counts(folder: Path, tmp_path: Path) -> None:
    """P01 lost 3 of 71 compared trials in each study, and was right in 57 of 69."""
    path = tmp_path / "rules.toml"
    for rule, leaves_out in (
        ("not_counted_above = 0.02", {"P01", "P02"}), ("not_counted_above = 0.06", set()),
        ("right_below = 0.83", {"P01"}), ("right_below = 0.82", set()), ("right_below = 0.9", {"P01", "P02"}),
    ):  # fmt: skip
        path.write_text(f'[[people]]\nwhy = "by rule"\n{rule}\n', encoding="utf-8")
        found = study_rows(folder, read_rules(path))
        assert {one.participant for one in found.excluded if one.why == "by rule"} == leaves_out, rule


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "has no rule"),
        ("= 1", "it is no TOML file"),
        ("trials = 3", "expected \\[\\[trials\\]\\] tables"),
        ("[[trial]]\nwhy = 'x'", "trial means nothing here"),
        ("[[trials]]\nwhy = 'x'\ncolumn = 'rt'\nbelow = 1", "column is 'rt'; there are answer, answer_ns"),
        ("[[trials]]\nwhy = 'x'\ncolumn = 'rt_s'", "expected below, above, both, or is"),
        ("[[trials]]\nwhy = 'x'\ncolumn = 'rt_s'\nbelow = nan", "expected a finite number"),
        ("[[trials]]\nwhy = 'x'\ncolumn = 'answer'\nbelow = 1", "answer is no number; expected is"),
        ("[[trials]]\nwhy = ' '\ncolumn = 'rt_s'\nbelow = 1", "why is empty"),
        ("[[trials]]\nwhy = 'x'\ncolumn = 'rt_s'\nbelow = 1\nconditions = ['replay']", "condition 'replay'; there"),
        ("[[people]]\nwhy = 'x'", "expected one of not_counted_above, right_below, codes"),
        ("[[people]]\nwhy = 'x'\nright_below = 3", "expected a share from 0 to 1"),
        ("[[people]]\nwhy = 'x'\ncodes = []", "expected a list of texts"),
    ],
)
def test_rules_that_mean_nothing_are_one_line(text: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "rules.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(HighFiveError, match=says):
        read_rules(path)
    with pytest.raises(HighFiveError, match="cannot read the rules"):
        read_rules(tmp_path / "absent.toml")
