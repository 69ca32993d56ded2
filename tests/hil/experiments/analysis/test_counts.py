"""Tables of counts: what they give, and one line for each that cannot be analysed."""

from pathlib import Path

import pytest

from highfive.hil.experiments.analysis.counts import Count, PersonCounts, pooled, read_counts
from highfive.model.errors import HighFiveError

HEAD = "participant,condition,correct,n\n"
GOOD = f"{HEAD}S1,interactive,47,72\nS1,replay,39,72\nS2,replay,55,72\nS2,interactive,57,72\n"


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "counts.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_people_come_in_their_order_whatever_the_order_of_rows_and_columns(tmp_path: Path) -> None:
    expected = [
        PersonCounts("S1", Count(47, 72), Count(39, 72)),
        PersonCounts("S2", Count(57, 72), Count(55, 72)),
    ]
    assert read_counts(written(tmp_path, GOOD)) == expected
    turned = "\ufeffn , condition,participant,correct\r\n\r\n72,interactive,S1,47\r\n72, replay,S1,39\r\n"
    turned += "72,replay,S2,55\r\n72,interactive,S2,57\r\n"
    assert read_counts(written(tmp_path, turned)) == expected
    assert pooled(expected) == PersonCounts("pooled", Count(104, 144), Count(94, 144))


BAD = {
    "": "is empty; expected a table with the columns participant,condition,correct,n",
    HEAD: "holds no answers; run the experiment first",
    f"{HEAD}S1,interactive,4,7\nS1,replay,4,7\n": "holds one person, S1; what differs between people needs two",
    f"{HEAD}S1,replay,4,7\nS2,replay,4,7\n": "holds replay trials alone; the comparison needs interactive trials",
    f"{GOOD}S3,replay,4,7\n": "S3 has no interactive trials; complete or leave out S3",
    f"{GOOD}S2,replay,4,7\n": "line 6: S2 has replay twice; give the sum",
    f"{HEAD}S1,interactive,8,7\n": "line 2: 8 correct of 7; expected 0 to 7",
    f"{HEAD}S1,interactive,-1,7\n": "line 2: -1 correct of 7",
    f"{HEAD}S1,interactive,0,0\n": "line 2: n is 0; expected 1 to 1000000 trials",
    f"{HEAD}S1,interactive,0,1{400 * '0'}\n": "expected 1 to 1000000 trials",
    f"{HEAD}S1,interactive,4.5,7\n": "line 2: correct is '4.5'; expected a whole number",
    f"{HEAD}S1,watching,4,7\n": "line 2: condition is 'watching'; expected interactive or replay",
    f"{HEAD},replay,4,7\n": "line 2: participant is empty",
    f"{HEAD}S1,replay,4\n": "line 2: 3 cells; expected 4",
    "participant,condition,correct,n,age\n": "columns participant,condition,correct,n,age; expected participant,",
    "participant,condition,correct\n": "expected participant,condition,correct,n, each once",
    "participant,condition,correct,n,n\n": "each once",
    f'{HEAD}"S1,replay,4,7\n': "is not a table",
}


@pytest.mark.parametrize(("text", "said"), BAD.items())
def test_what_cannot_be_analysed_is_said_in_one_line(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(HighFiveError) as error:
        read_counts(written(tmp_path, text))
    assert said in str(error.value) and "\n" not in str(error.value)


def test_what_is_no_file_is_said(tmp_path: Path) -> None:
    with pytest.raises(HighFiveError, match="cannot read"):
        read_counts(tmp_path / "nowhere.csv")
    path = tmp_path / "bytes.csv"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(HighFiveError, match="is not a table"):
        read_counts(path)
