"""Answers trial by trial: counts, matrices and functions of them, one tidy row each, one line for what cannot be."""

from pathlib import Path

import pytest

from highfive.hil.experiments.analysis.answers import (
    Answer,
    confusions_of,
    counts_of,
    fits_of,
    read_answers,
    tidy_csv,
)
from highfive.hil.experiments.analysis.counts import Count, PersonCounts
from highfive.hil.experiments.analysis.psychometric import fit
from highfive.model.errors import HighFiveError

HEAD = "participant,condition,emotion,answer,weight\n"
WHOLE = "".join(
    f"{person},{condition},{emotion},{answer},\n"
    for person in ("S1", "S2")
    for condition, answer in (("interactive", "sad"), ("replay", "happy"))
    for emotion in ("sad", "happy", "sad")
)
MORPHS = "S1,replay,happy,happy,0.75\nS1,replay,happy,sad,0.25\nS1,replay,happy,sad,0.25\n"


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "trials.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_whole_emotions_are_counted_and_morphs_fitted(tmp_path: Path) -> None:
    answers = read_answers(written(tmp_path, HEAD + WHOLE + MORPHS))
    expected = [PersonCounts(name, Count(2, 3), Count(1, 3)) for name in ("S1", "S2")]
    assert counts_of(answers, "file") == expected
    matrices = confusions_of(answers)
    assert matrices["interactive"].counts.tolist() == [[0, 2], [0, 4]]  # happy, sad
    assert matrices["replay"].counts.tolist() == [[2, 0], [4, 0]]
    assert fits_of(answers) == {"replay": {"S1": fit([0.75, 0.25, 0.25], [True, False, False])}}


def test_a_column_of_weights_is_not_needed(tmp_path: Path) -> None:
    whole = WHOLE.replace(",\n", "\n")
    answers = read_answers(written(tmp_path, "participant,condition,emotion,answer\n" + whole))
    assert len(answers) == 12 and not fits_of(answers)


def test_a_row_a_trial() -> None:
    answers = [
        Answer("S1", "replay", "sad", "sad"),
        Answer("S1", "interactive", "sad", "happy"),
        Answer("S1", "replay", "happy", "sad", 0.25),
    ]
    assert tidy_csv(answers).decode().splitlines() == [
        "participant,condition,trial,emotion,weight,answer,correct",
        "S1,replay,1,sad,,sad,1",
        "S1,interactive,1,sad,,happy,0",
        "S1,replay,2,happy,0.25,sad,",
    ]
    assert counts_of([answers[2]], "file") == []


BAD = {
    HEAD: "holds no answers; run the experiment first",
    f"{HEAD}S1,replay,sad,,\n": "line 2: answer is empty",
    f"{HEAD}S1,replay,sad,sad,1.5\n": "line 2: weight is '1.5'; expected a number from 0 to 1",
    f"{HEAD}S1,replay,sad,sad,nan\n": "line 2: weight is 'nan'",
    f"{HEAD}S1,film,sad,sad,\n": "line 2: condition is 'film'; expected interactive or replay",
    f"{HEAD}S1,replay,sad,sad,0.5\nS1,replay,happy,sad,0.5\n": "morphs towards happy and sad; give each pair",
    "participant,condition,answer\n": "expected participant,condition,emotion,answer and, if wanted, weight",
}


@pytest.mark.parametrize(("text", "said"), BAD.items())
def test_what_cannot_be_analysed_is_said_in_one_line(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(HighFiveError) as error:
        read_answers(written(tmp_path, text))
    assert said in str(error.value) and "\n" not in str(error.value)


def test_one_person_and_one_condition_are_refused() -> None:
    with pytest.raises(HighFiveError, match="file holds replay trials alone"):
        counts_of([Answer("S1", "replay", "sad", "sad")], "file")
    both = [Answer("S1", condition, "sad", "sad") for condition in ("interactive", "replay")]
    with pytest.raises(HighFiveError, match="file holds one person, S1"):
        counts_of(both, "file")


def test_the_tidy_table_of_a_study_is_read_with_what_stands_beside_the_comparison(tmp_path: Path) -> None:
    answers = [*read_answers(written(tmp_path, HEAD + WHOLE + MORPHS)), Answer("S1", "other_replay", "sad", "sad")]
    assert read_answers(written(tmp_path, tidy_csv(answers).decode())) == answers
