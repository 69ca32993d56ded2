"""Words of the participant's page in another language: shown as the lab wrote them, the data keep their labels."""

from pathlib import Path

import pytest
from experiments import protocol, study, written

from highfive.hil.experiments.conduct import about
from highfive.hil.experiments.plan import draw_plan
from highfive.hil.experiments.protocol_file import read_protocol, templates
from highfive.hil.experiments.question import question_of
from highfive.hil.experiments.study import study_protocol
from highfive.hil.experiments.words import PAGE, page_words, read_words, words_toml
from highfive.model.errors import HighFiveError

WRONG = {
    "an unknown word": ("[page]\nstart = 'x'", "start means nothing here"),
    "an answer without": ("[answers]\nneutral = 'x'\nanger = 'y'\nfearful = 'z'", "[answers]: angry missing"),
    "a slider without": ("[sliders.valence]\ntext = 'x'", "[sliders]: certainty missing"),
    "an odd entry of a slider": (
        "[sliders.certainty]\ntext = 'a'\nlow = 'b'\nhigh = 'c'\nhight = 'x'",
        "hight means nothing here",
    ),
    "a slider without its ends": ("[sliders.certainty]\ntext = 'x'", "high, low missing"),
    "no tables": ("answers = 3", "[answers]: got 3, expected a table"),
    "no text": ("[page]\ngo = 1", "go is 1, expected a text"),
    "an empty text": ("[page]\ngo = ' '", "expected a line of 1 to 200 characters"),
    "two lines": ('[page]\ngo = "a\\nb"', "expected a line of 1 to 200 characters"),
    "two answers alike": ("[answers]\nneutral = 'x'\nangry = 'X'\nfearful = 'z'", "one word for two answers"),
    "no TOML": ("[page", "it is no TOML file"),
    "a language that has no instructions": (None, "fr.toml has words of a language without instructions"),
}


@pytest.mark.parametrize("name", templates())
def test_german_words_come_along_in_full_and_reach_the_study(name: str, tmp_path: Path) -> None:
    asked = protocol(name)
    words = asked.words["de"]
    assert set(words["page"]) == set(PAGE) and set(words["answers"]) == set(asked.labels)
    assert all(set(words[f"sliders.{one.name}"]) == {"text", "low", "high"} for one in asked.ratings)
    changes = {f"participants = {asked.participants}": f"participants = {asked.participants}"}
    assert study_protocol(study(tmp_path, name, changes)).words == asked.words


def test_pages_are_told_them_and_english_where_there_is_none() -> None:
    asked = protocol("tipping")
    plan = draw_plan(asked, 1)
    question = question_of(asked, plan.keys)
    english, german = (about(asked, plan, question, language) for language in ("en", "de"))
    assert english["words"] == dict(PAGE) and english["shown"] == {label: label for label in asked.labels}
    assert german["words"]["go_on"] == "Weiter" and german["shown"]["fearful"] == "ängstlich"
    assert german["keys"] == english["keys"]
    assert [one["text"] for one in german["sliders"]] == ["Wie sicher sind Sie?"]
    assert page_words({"page": {"go": "Vai"}}) == {**PAGE, "go": "Vai"}


def test_what_is_written_is_what_is_read(tmp_path: Path) -> None:
    words = {"page": {"go": 'Los "jetzt" \\ ä'}, "answers": {"neutral": "n"}, "sliders.certainty": {}}
    words["sliders.certainty"] |= {"text": "sicher?", "low": "tief", "high": "hoch"}
    (tmp_path / "de-CH.toml").write_bytes(words_toml(words))
    assert read_words(tmp_path, ["neutral"], ["certainty"]) == {"de-CH": words}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_is_said_in_a_line(what: str, tmp_path: Path) -> None:
    text, message = WRONG[what]
    path = written(tmp_path, "tipping")
    folder = tmp_path / "tipping_instructions"
    (folder / ("fr.toml" if text is None else "de.toml")).write_text(text or "[page]\ngo = 'Va'\n", encoding="utf-8")
    with pytest.raises(HighFiveError) as told:
        read_protocol(path)
    assert message in str(told.value) and "\n" not in str(told.value)
