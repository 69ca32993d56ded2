"""The table of a data folder, as it should be and as it comes."""

from pathlib import Path

import pytest

from highfive.mocap_bridge.files.trial_table import HOLD_OUT, TrialRow, read_table, read_without_contact, with_held_out
from highfive.model.errors import HighFiveError


def table(folder: Path, text: str, said: list[str] | None = None) -> list[TrialRow]:
    (folder / "trials.csv").write_text(text, encoding="utf-8")
    return read_table(folder, (said if said is not None else []).append)


def test_what_the_table_says_is_what_counts(tmp_path: Path) -> None:
    said: list[str] = []
    rows = table(tmp_path, "file,emotion,cell,repetition,split\na.c3d,sad,B2,3,test\nb.c3d,sad,,,train\n", said)
    assert rows == [TrialRow("a.c3d", "sad", "B2", 3, True), TrialRow("b.c3d", "sad", "", -1, False)]
    assert not said
    assert with_held_out(rows, said.append) == rows and not said


def test_order_case_marks_and_further_columns_do_not_matter(tmp_path: Path) -> None:
    rows = table(tmp_path, "\ufeffSplit,notes, Emotion ,FILE\nTest,x,sad,a.c3d\nTRAIN,y,sad,b.c3d\n,z,sad,c.c3d\n")
    assert [(row.file, row.test) for row in rows] == [("a.c3d", True), ("b.c3d", False), ("c.c3d", False)]


@pytest.mark.parametrize("columns", ["file,emotion", "file,emotion,split"])
def test_without_a_split_every_fifth_of_each_emotion_is_held_out(tmp_path: Path, columns: str) -> None:
    said: list[str] = []
    lines = [f"{n}.c3d,{'sad' if n % 3 else 'angry'}" + "," * (columns.count(",") - 1) for n in range(33)]
    rows = table(tmp_path, "\n".join([columns, *lines]), said)
    for emotion in ("sad", "angry"):
        of = [row.test for row in rows if row.emotion == emotion]
        assert [n for n, test in enumerate(of) if test] == list(range(HOLD_OUT - 1, len(of), HOLD_OUT))
    assert said == [
        "trials.csv holds out no trial, and scoring needs some: 6 of 33 are, every 5th; split test says which"
    ]


def test_a_table_may_name_files_alone(tmp_path: Path) -> None:
    said: list[str] = []
    rows = table(tmp_path, "file\na\nb\n", said)
    assert [(row.emotion, row.test) for row in rows] == [("neutral", False), ("neutral", True)]
    assert said[0] == "trials.csv names no emotion: all trials count as neutral"


def test_two_trials_are_one_to_learn_from_and_one_to_test(tmp_path: Path) -> None:
    assert [row.test for row in table(tmp_path, "file,emotion\na,sad\nb,sad\n")] == [False, True]
    with pytest.raises(HighFiveError, match="a single trial"):
        table(tmp_path, "file,emotion\na,sad\n")
    assert [row.test for row in table(tmp_path, "file,emotion,split\na,sad,train\n")] == [False]


def test_all_trials_may_be_for_learning(tmp_path: Path) -> None:
    said: list[str] = []
    rows = table(tmp_path, "file,emotion,split\n" + "a,sad,train\n" * 10, said)
    assert not any(row.test for row in rows) and not said
    assert sum(row.test for row in with_held_out(rows, said.append)) == 2 and len(said) == 1


def test_a_set_without_emotions_has_one(tmp_path: Path) -> None:
    said: list[str] = []
    rows = table(tmp_path, "file,emotion,split\na,,train\nb,,test\n", said)
    assert {row.emotion for row in rows} == {"neutral"}
    assert said == ["trials.csv names no emotion: all trials count as neutral"]
    with pytest.raises(HighFiveError, match="line 3: a trial needs a file and an emotion"):
        table(tmp_path, "file,emotion,split\na,sad,train\nb,,test\n")


def test_trials_without_a_contact_are_no_high_fives_and_need_no_emotion(tmp_path: Path) -> None:
    rows = table(tmp_path, "file,emotion,split,contact\na,sad,test,yes\nb,sad,train,1\nc,,,\nd,,test,No\n")
    assert [row.file for row in rows] == ["a", "b"]
    assert [(row.file, row.test) for row in read_without_contact(tmp_path)] == [("c", False), ("d", True)]
    table(tmp_path, "file,emotion,split\na,sad,test\n")
    assert not read_without_contact(tmp_path)


def test_a_table_of_no_high_five_and_another_word_are_refused(tmp_path: Path) -> None:
    with pytest.raises(HighFiveError, match="lists no trial with a contact"):
        table(tmp_path, "file,emotion,split,contact\na,sad,test,\n")
    with pytest.raises(HighFiveError, match="line 2: contact is 'maybe'; expected yes, no or nothing"):
        table(tmp_path, "file,emotion,split,contact\na,sad,test,maybe\n")
