"""``highfive experiment plan`` and ``forget`` as they are typed."""

import json
import tomllib
from io import BytesIO
from pathlib import Path

import pytest
from experiments import answer, head, protocol, written
from PIL import Image

from highfive.hil.cli import main as cli
from highfive.hil.commands.experiment_plan import _notes
from highfive.hil.experiments.plan import draw_plans
from highfive.hil.experiments.trial_log import open_log
from highfive.hil.report.drawing import to_png
from highfive.hil.report.plan_figure import draw_plans as draw_picture


@pytest.fixture
def highfive(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path):
    monkeypatch.chdir(tmp_path)

    def run(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["highfive", "experiment", *map(str, words)])
        with pytest.raises(SystemExit) as left:
            cli.main()
        out, err = capsys.readouterr()
        return int(left.value.code or 0), out, err

    return run


def refused(result: tuple[int, str, str], *parts: str) -> None:
    code, out, err = result
    lines = [line for line in err.splitlines() if line.strip()]
    assert code == 2 and out == "" and len(lines) == 1 and lines[0].startswith("error:")
    for part in parts:
        assert part in err


def test_from_a_template_to_plans_and_back_to_nobody(highfive, tmp_path: Path) -> None:
    code, out, _ = highfive("plan", "--template", "tipping", "--out", "mine/t.toml")
    assert code == 0 and "mine/t.toml" in out
    assert (tmp_path / "mine" / "tipping_instructions" / "en.md").is_file()
    code, out, _ = highfive("plan", "mine/t.toml", "--study", "s", "--participants", 2, "--seed", 4, "--json")
    said = json.loads(out)
    assert code == 0 and said["trials"] == 87 and said["seed"] == 4
    assert said["blocks"]["R1"] == {"mode": "own_replay", "of": "I1", "filler": False, "trials": 12}
    assert [person["participant"] for person in said["participants"]] == ["P01", "P02"]
    for person in said["participants"]:
        stored = tomllib.loads((tmp_path / "s" / "participants" / person["participant"] / "plan.toml").read_text())
        assert stored["digest"] == person["digest"] and stored["keys"] == person["keys"]
        assert [trial["name"] for trial in stored["trials"]] == [trial["trial"] for trial in person["trials"]]
    with Image.open(tmp_path / "s" / "plan.png") as picture:
        assert picture.width > 1000
    before = (tmp_path / "s" / "participants" / "P01" / "plan.toml").read_bytes()
    code, out, _ = highfive("plan", "s/protocol.toml", "--study", "s", "--participants", 3)
    assert code == 0 and "as before" in out and "new" in out and "87 trials a participant" in out
    assert (tmp_path / "s" / "participants" / "P01" / "plan.toml").read_bytes() == before
    code, out, _ = highfive("forget", "P02", "--study", "s", "--json")
    said = json.loads(out)
    assert code == 0 and said["deleted"] and "exports and backups elsewhere" in said["beyond"]
    assert not (tmp_path / "s" / "participants" / "P02").exists()
    drawn = (tmp_path / "s" / "plan.png").read_bytes()
    code, out, _ = highfive("forget", "P03", "--study", "s")
    assert code == 0 and "P03: 2 files deleted in s" in out and "plan.png was drawn again without her" in out
    assert (tmp_path / "s" / "plan.png").read_bytes() != drawn
    code, out, _ = highfive("forget", "P01", "--study", "s")
    assert code == 0 and "plan.png was deleted" in out and not (tmp_path / "s" / "plan.png").exists()


@pytest.mark.slow
def test_bad_input_is_one_line(highfive, tmp_path: Path) -> None:
    path = written(tmp_path, "tipping", {"participants = 12": "participants = 1"})
    refused(highfive("plan"), "give FILE.toml, or --template NAME")
    refused(highfive("plan", path, "--template", "tipping"), "give FILE.toml, or --template NAME")
    refused(highfive("plan", "nowhere.toml"), "cannot read the experiment nowhere.toml")
    refused(highfive("plan", "--template", "turing", "--out", "x.toml"), "there are high_five, morph, tipping")
    refused(highfive("plan", "--template", "tipping"), "tipping.toml is there already")
    refused(highfive("plan", "--template", "tipping", "--out", "x.toml"), "tipping_instructions is there already")
    refused(highfive("plan", path, "--out", "x"), "--out goes with --template")
    refused(highfive("forget", "P01", "--study", "nowhere"), "has no participant P01; it has nobody")
    odd = written(tmp_path / "odd", "high_five")
    refused(highfive("plan", odd, "--participants", 3, "--study", "odd"), "plan 2 or 4 people")
    assert not Path("odd/participants").exists()
    assert highfive("plan", path, "--study", "s")[0] == 0
    refused(
        highfive("plan", path, "--study", "s", "--seed", 1), "P01 has another plan", "seed was 0, is 1", "--overwrite"
    )
    assert highfive("plan", path, "--study", "s", "--seed", 1, "--overwrite")[0] == 0
    with open_log(Path("s"), head(), resume=False) as log:
        answer(log, 1)
        refused(highfive("plan", path, "--study", "s", "--seed", 1), "another command is writing to s")
    refused(highfive("plan", path, "--study", "s", "--overwrite"), "P01 has another plan", "took part already")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("x")
    refused(highfive("plan", path, "--study", "full"), "full holds something already")


def test_a_broken_plan_is_refused_where_it_is_read(highfive, tmp_path: Path) -> None:
    path = written(tmp_path, "tipping", {"participants = 12": "participants = 1"})
    assert highfive("plan", path, "--study", "s")[0] == 0
    plan = tmp_path / "s" / "participants" / "P01" / "plan.toml"
    plan.write_text(plan.read_text().replace('style = "angry"', 'style = "neutral"', 1))
    refused(highfive("plan", path, "--study", "s"), "plan s/participants/P01/plan.toml was changed")


def test_notes_tell_of_the_pilot_and_of_few_clips() -> None:
    assert "P00 is the pilot" in _notes(protocol("high_five"))[0]
    assert "2 clips of each style" in _notes(protocol("tipping", clips=2))[0]
    assert _notes(protocol("morph")) == _notes(protocol("tipping")) == []


@pytest.mark.slow
def test_the_picture_is_the_same_twice_and_shows_every_kind_and_the_first_of_many() -> None:
    heights: dict[tuple[str, int], int] = {}
    caption = ""
    for name, people in (("high_five", 2), ("morph", 2), ("tipping", 2), ("tipping", 26)):
        asked = protocol(name, participants=people)
        one, two = (draw_picture(asked, draw_plans(asked)) for _ in range(2))
        content, caption = to_png(one.figure), one.caption
        assert content == to_png(two.figure)
        with Image.open(BytesIO(content)) as picture:
            heights[name, people] = picture.height
    assert heights["tipping", 26] > 3 * heights["tipping", 2]
    assert "; 2 more participants" in caption
