"""What is asked after a trial: which answers count, when, and what is told of the others."""

import numpy as np
import pytest
from helpers.experiments import protocol

from highfive.hil.experiments.protocol import Rating
from highfive.hil.experiments.question import (
    ANSWER,
    DONE,
    RATE,
    Question,
    Sheet,
    Wrong,
    heard,
    question_of,
    timed_out,
    why_excluded,
)
from highfive.hil.experiments.words import PAGE

S = 1_000_000_000
SLIDER = Rating("natural", "How natural?", "artificial", "natural", 7)
PLAIN = Question({"neutral": "2", "angry": "1"}, (), 5.0)
RATED = Question({"neutral": "2", "angry": "1"}, (SLIDER,), 5.0)


def said_of(wrong: Wrong | None) -> str:
    assert wrong is not None and wrong.word in PAGE
    return wrong.detail


def pressed(key: str, at_ms: float | None = None) -> dict[str, object]:
    return {"key": key, "at_ms": at_ms}


@pytest.mark.parametrize(("key", "answer"), [("1", "angry"), ("2", "neutral"), ("ANGRY", "angry")])
def test_an_answer_is_given_by_its_key_or_its_name(key: str, answer: str) -> None:
    sheet, wrong = heard(Sheet(PLAIN, 10 * S), ANSWER, pressed(key), 12 * S)
    assert (sheet.answer, sheet.key, sheet.answer_ns, sheet.done, wrong) == (
        answer, PLAIN.keys[answer], 12 * S, True, None,
    )  # fmt: skip
    assert why_excluded(sheet) == ""


@pytest.mark.parametrize("key", ["3", "x", "Enter", "happy", "é"])
def test_a_key_that_means_nothing_changes_nothing_and_is_told_with_those_that_do(key: str) -> None:
    before = Sheet(PLAIN, 0)
    sheet, wrong = heard(before, ANSWER, pressed(key), S)
    assert (
        sheet == before
        and "means nothing" in said_of(wrong)
        and "1 angry" in said_of(wrong)
        and "2 neutral" in said_of(wrong)
    )


def test_the_first_answer_counts() -> None:
    sheet, _ = heard(Sheet(RATED, 0), ANSWER, pressed("1"), S)
    again, wrong = heard(sheet, ANSWER, pressed("2"), 2 * S)
    assert again == sheet and "first answer counts" in said_of(wrong)


def test_what_was_pressed_before_the_motion_was_over_is_no_answer() -> None:
    sheet, wrong = heard(Sheet(PLAIN, 10 * S), ANSWER, pressed("1", 1e3 * 9.9), 10 * S + 1)
    assert sheet.answer == "" and "not yet" in said_of(wrong)


def test_time_is_the_pages_where_that_can_be_and_else_when_it_came() -> None:
    rng = np.random.default_rng(3)
    for own in (*rng.uniform(10.0, 12.0, 20), 12.001, 3.0, 1e9):
        sheet, _ = heard(Sheet(PLAIN, 10 * S), ANSWER, pressed("1", 1e3 * own), 12 * S)
        believed = 7.0 <= own <= 12.0
        if own >= 10.0 or not believed:
            assert sheet.answer_ns == pytest.approx((own if believed else 12.0) * S, abs=2)


def test_an_answer_after_the_limit_is_in_the_data_and_does_not_count() -> None:
    sheet, _ = heard(Sheet(RATED, 0), ANSWER, pressed("1"), 5 * S + 1)
    assert sheet.answer == "angry" and sheet.done and why_excluded(sheet) == "answered after 5 s"
    silent = timed_out(Sheet(RATED, 0), 5 * S + 1)
    assert silent.done and why_excluded(silent) == "no answer within 5 s"
    assert heard(silent, ANSWER, pressed("1"), 6 * S) == (silent, Wrong("too_late", "too late: this trial is over"))
    assert not timed_out(Sheet(RATED, 0), 5 * S).done


def test_sliders_come_after_the_answer_within_their_bounds_and_have_a_limit_of_their_own() -> None:
    sheet = Sheet(RATED, 0)
    assert heard(sheet, RATE, {"name": "natural", "value": 4.0}, S) == (
        sheet,
        Wrong("no_key", "the answer comes first"),
    )
    assert heard(sheet, DONE, None, S) == (sheet, Wrong("no_key", "the answer comes first"))
    sheet, _ = heard(sheet, ANSWER, pressed("1"), 4 * S)
    assert sheet.open == RATE and not sheet.done
    for value, taken in ((0.9, False), (1.0, True), (7.0, True), (7.1, False)):
        after, wrong = heard(sheet, RATE, {"name": "natural", "value": value}, 5 * S)
        assert (after.values.get("natural") == value) is taken and bool(wrong) is not taken
    _, wrong = heard(sheet, RATE, {"name": "valence", "value": 0.5}, 5 * S)
    assert "asked are natural" in said_of(wrong)
    assert not timed_out(sheet, 9 * S).done and timed_out(sheet, 9 * S + 1).done
    assert why_excluded(timed_out(sheet, 9 * S + 1)) == ""  # a slider that was left alone excludes no answer
    assert heard(sheet, DONE, None, 5 * S)[0].done


def test_certainty_is_asked_beside_the_ratings() -> None:
    asked = question_of(protocol("high_five"), {"neutral": "1"})
    assert [one.name for one in asked.sliders] == ["certainty", "valence", "arousal", "natural", "reacted"]
    assert asked.limit_s == 30.0 and question_of(protocol("morph"), {}).sliders == ()
