"""A study's folder: plans that stay as they were drawn, and people who are forgotten."""

import json
import os
import shutil
from dataclasses import asdict
from pathlib import Path

import pytest
from experiments import answer, head, protocol, study, written

from highfive.hil.commands.experiment_forget import print_forgotten
from highfive.hil.experiments.forget import BEYOND, forget
from highfive.hil.experiments.plan import draw_plan, draw_plans
from highfive.hil.experiments.plan_file import difference, plan_of, plan_toml, read_plan
from highfive.hil.experiments.protocol_file import TEMPLATES, read_protocol, templates
from highfive.hil.experiments.study import (
    PROTOCOL,
    check_planned,
    check_plans,
    participants,
    stored_plan,
    study_protocol,
    write_study,
)
from highfive.hil.experiments.trial_log import open_log
from highfive.model.errors import HighFiveError


@pytest.mark.parametrize("name", templates())
def test_a_plan_is_read_as_it_was_written(name: str, tmp_path: Path) -> None:
    plan = draw_plan(protocol(name, participants=2), 1)
    path = tmp_path / "plan.toml"
    path.write_bytes(plan_toml(plan))
    assert read_plan(path) == plan
    assert plan_of(json.loads(json.dumps(asdict(plan)))) == plan


@pytest.mark.parametrize("place", range(0, 6000, 150))
def test_whatever_is_changed_in_a_plan_is_found_out(place: int, tmp_path: Path) -> None:
    path = tmp_path / "plan.toml"
    content = bytearray(plan_toml(draw_plan(protocol("tipping", participants=2), 1)))
    start = content.index(b"\ndigest")
    place = start + place
    while chr(content[place]) in ' \n"=[]{}#,.':
        place += 1
    content[place] = ord("8") if content[place] == ord("7") else ord("7")
    path.write_bytes(bytes(content))
    with pytest.raises(HighFiveError):
        read_plan(path)


def test_the_difference_of_two_plans_is_a_line() -> None:
    one = draw_plan(protocol("tipping"), 1)
    assert difference(one, one) == ""
    fewer = draw_plan(protocol("tipping", practice=0), 1)
    assert "trial practice-01: name was practice-01, is I1-01" in difference(one, fewer)
    assert "more" in difference(one, fewer) and "\n" not in difference(one, fewer)


def test_a_study_holds_what_was_planned(tmp_path: Path) -> None:
    for name in templates():
        path = written(tmp_path, name)
        asked = protocol(name, participants=4, seed=77)
        write_study(tmp_path / name, path, asked, draw_plans(asked)[:1])
        assert study_protocol(tmp_path / name) == asked


def test_a_protocol_keeps_its_comments_and_odd_spelling(tmp_path: Path) -> None:
    changes = {"[experiment]": "[ experiment ]  # mine", "seed = 0\n": "", "participants = 12": "participants=12 # few"}
    path = written(tmp_path, "tipping", changes)
    asked = protocol("tipping", participants=3, seed=9)
    write_study(tmp_path / "s", path, asked, [])
    text = (tmp_path / "s" / "protocol.toml").read_text()
    assert study_protocol(tmp_path / "s") == asked and "[ experiment ]  # mine" in text and "clip is no clue" in text
    path.write_text("experiment = " + path.read_text().partition("[ experiment ]")[0] + "{}")
    with pytest.raises(HighFiveError):
        read_protocol(path)


def test_a_plan_in_another_ones_folder_is_refused(tmp_path: Path) -> None:
    folder = study(tmp_path)
    people = folder / "participants"
    (people / "P02" / "plan.toml").write_bytes((people / "P01" / "plan.toml").read_bytes())
    with pytest.raises(HighFiveError, match="is that of P01, expected P02's"):
        stored_plan(folder, "P02")


def test_more_people_are_added_and_the_others_keep_their_plans(tmp_path: Path) -> None:
    folder = study(tmp_path)
    before = (folder / "participants" / "P01" / "plan.toml").read_bytes()
    asked = protocol("tipping", participants=3)
    new = check_plans(folder, draw_plans(asked))
    assert [plan.participant for plan in new] == ["P03"]
    write_study(folder, folder / "protocol.toml", asked, new)
    assert participants(folder) == ["P01", "P02", "P03"]
    assert (folder / "participants" / "P01" / "plan.toml").read_bytes() == before
    assert study_protocol(folder).participants == 3


def test_another_plan_is_refused_with_the_difference_and_never_drawn_anew_for_who_took_part(tmp_path: Path) -> None:
    folder = study(tmp_path)
    other = draw_plans(protocol("tipping", participants=2, seed=5))
    with pytest.raises(HighFiveError, match=r"participant P01 has another plan .* seed was 0, is 5; .*--overwrite"):
        check_plans(folder, other)
    assert check_plans(folder, other, redraw=True) == other
    with open_log(folder, head("P01"), resume=False) as log:
        answer(log, 1)
    with pytest.raises(HighFiveError, match=r"participant P01 has another plan .* she took part already"):
        check_plans(folder, other, redraw=True)


def test_who_is_forgotten_is_nowhere_but_where_it_is_said(tmp_path: Path) -> None:
    folder = study(tmp_path, "high_five")
    for code in ("P00", "P01"):
        with open_log(folder, head(code), resume=False) as log:
            answer(log, 6)
    (folder / "participants" / "P01" / "session-1" / "session.mcap").write_bytes(b"x")
    (folder / "report.html").write_text("P01 and P010")
    (folder / "other.html").write_text("P010")
    (tmp_path / "exported" / "sub-P01").mkdir(parents=True)
    (tmp_path / "exported" / "dataset_description.json").write_text("{}")
    (tmp_path / "exported" / "participants.tsv").write_text("sub-P01\n")
    (tmp_path / "somebodys").mkdir()
    (tmp_path / "somebodys" / "P01.txt").write_text("not ours")
    shutil.copytree(folder, tmp_path / "backup")
    for name, source in (("results", folder.name), ("others", "another_study")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "report.json").write_text(json.dumps({"source": source, "who": "P01"}))
    (folder / "rules.toml").write_text("# P01 was ill\n")
    found = forget(folder, "P01")
    assert found.beside == ("backup", "exported", "results")
    assert "participants/P01/session-1/session.mcap" in found.deleted
    assert found.shown_to == ("P02",) and found.mentioned == ("report.html",)
    assert not (folder / "participants" / "P01").exists()
    left = [path for path in folder.rglob("*") if path.is_file() and "P01" in path.read_text(errors="replace")]
    assert {path.name for path in left} == {"plan.toml", "plan.csv", "report.html", "other.html", "rules.toml"}
    with pytest.raises(HighFiveError, match="has no participant P01; it has P00, P02"):
        forget(folder, "P01")


def test_whatever_lies_in_and_beside_a_study_what_remains_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = study(tmp_path)
    (folder / "report.html").write_text("P01")
    (folder / "zero.csv").symlink_to("/dev/zero")
    os.mkfifo(folder / "pipe.txt")
    with (folder / "large.csv").open("wb") as file:
        file.truncate(300 << 20)
    for name, content in (("results", "P01"), ("nested", "[" * 200_000 + " P01")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "report.json").write_text(content)
    os.mkfifo(tmp_path / "results" / "protocol.toml")
    (tmp_path / "results" / "participants" / "P01").mkdir(parents=True)
    (tmp_path / "results" / "more.csv").hardlink_to(folder / "large.csv")
    found = forget(folder, "P01")
    assert found.mentioned == ("report.html",) and found.beside == ("nested", "results")
    assert found.unread == ("large.csv", "results/more.csv")
    print_forgotten({**asdict(found), "study": "s", "picture": "", "beyond": BEYOND})
    assert "Not looked into: large.csv, results/more.csv" in capsys.readouterr().out
    assert not (folder / "participants" / "P01").exists()


def test_nobody_is_forgotten_while_a_run_goes_on_or_by_a_path(tmp_path: Path) -> None:
    folder = study(tmp_path)
    with open_log(folder, head("P01"), resume=False), pytest.raises(HighFiveError, match="a run is writing"):
        forget(folder, "P02")
    for code in ("..", "P01/../P02", "", "Anna Maier"):
        with pytest.raises(HighFiveError, match="expected a code"):
            forget(folder, code)
    assert participants(folder) == ["P01", "P02"]


def test_templates_are_files_that_come_along() -> None:
    for name in templates():
        assert sorted(path.name for path in (TEMPLATES / f"{name}_instructions").iterdir()) == [
            "de.md", "de.toml", "en.md",
        ]  # fmt: skip
        assert read_protocol(TEMPLATES / f"{name}.toml").name == name


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("answer_s = ", "answer_s = 1.0 #"), r"timing\.answer_s was .* and is 1\.0"),
        (("trial_s = ", "trial_s = 9.0 #"), r"timing\.trial_s"),
        (('consent_version = "1"', 'consent_version = "2"'), "consent was '1' and is '2'"),
    ],
)
def test_an_experiment_that_was_changed_since_it_was_planned_is_refused_with_the_difference(
    tmp_path: Path, change: tuple[str, str], says: str
) -> None:
    folder = study(tmp_path)
    check_planned(folder, study_protocol(folder))
    file = folder / PROTOCOL
    text = file.read_text()
    assert change[0] in text
    file.write_text(text.replace(*change, 1))
    with pytest.raises(HighFiveError, match=says):
        check_planned(folder, study_protocol(folder))


def test_changed_instructions_are_refused_and_comments_are_no_change(tmp_path: Path) -> None:
    folder = study(tmp_path)
    (folder / PROTOCOL).write_text("# seen by the ethics board\n" + (folder / PROTOCOL).read_text())
    check_planned(folder, study_protocol(folder))
    text = next((folder / "instructions").glob("en.md"))
    text.write_text(text.read_text() + "\nTap twice.\n")
    with pytest.raises(HighFiveError, match=r"instructions\.en is another text"):
        check_planned(folder, study_protocol(folder))
