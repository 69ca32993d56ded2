"""Questionnaires: scores by hand, reversed items, what is missing, alpha, and what is no questionnaire."""

from pathlib import Path

import numpy as np
import pytest

from highfive.hil.experiments.analysis.questionnaire import (
    alpha,
    read_questionnaire,
    read_questionnaire_answers,
    scores,
    summary,
)
from highfive.model.errors import HighFiveError

HEAD = 'name = "own"\nlicence = "CC0"\nsource = "ours"\nlow = 1\nhigh = 5\nanswers = "own.csv"\n'
ITEMS = "".join(
    f'[[items]]\nname = "{name}"\nsubscale = "{subscale}"\n{more}'
    for name, subscale, more in (
        ("warm", "warmth", 'low = "cold"\nhigh = "warm"\n'), ("stern", "warmth", "reversed = true\n"),
        ("kind", "warmth", ""), ("able", "competence", ""),
    )
)  # fmt: skip


def written(folder: Path, rows: str, head: str = HEAD, items: str = ITEMS) -> Path:
    (folder / "own.csv").write_text("participant,item,value\n" + rows, encoding="utf-8")
    (folder / "own.toml").write_text(head + items, encoding="utf-8")
    return folder / "own.toml"


def test_scores_are_means_with_reversed_items_turned(tmp_path: Path) -> None:
    asked = read_questionnaire(written(tmp_path, "P1,warm,5\nP1,stern,2\nP1,kind,3\nP2,warm,4\nP2,able,1\n"))
    answers = read_questionnaire_answers(asked)
    found = scores(asked, answers)
    with pytest.raises(HighFiveError, match="line 5: participant is 'P2'; the study has P1"):
        read_questionnaire_answers(asked, ["P1"])
    assert found["P1", ""] == {"warmth": pytest.approx((5 + 4 + 3) / 3), "competence": None}
    assert found["P2", ""] == {"warmth": None, "competence": 1.0}  # one of three is less than half
    said = summary(asked, answers)
    assert said["subscales"]["warmth"][""] == {"n": 1, "mean": 4.0, "sd": None, "alpha": None}
    assert said["licence"] == "CC0"


def test_alpha_is_that_of_the_covariance_matrix_and_one_for_items_that_agree(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    values = rng.integers(1, 6, (9, 3))
    names = ("warm", "stern", "kind")
    rows = "".join(f"P{p},{names[i]},{value}\n" for (p, i), value in np.ndenumerate(values))
    asked = read_questionnaire(written(tmp_path, rows))
    turned = values.astype(float)
    turned[:, 1] = 6 - turned[:, 1]
    covariance = np.cov(turned.T)
    wanted = 3 / 2 * (1 - np.trace(covariance) / covariance.sum())
    assert alpha(asked, "warmth", read_questionnaire_answers(asked)) == pytest.approx(wanted)
    same = "".join(f"P{n},warm,{n}\nP{n},stern,{6 - n}\nP{n},kind,{n}\n" for n in range(1, 6))
    asked = read_questionnaire(written(tmp_path, same))
    assert alpha(asked, "warmth", read_questionnaire_answers(asked)) == pytest.approx(1.0)
    assert alpha(asked, "competence", read_questionnaire_answers(asked)) is None


@pytest.mark.parametrize(
    ("rows", "head", "items", "says"),
    [
        ("P1,warm,6\n", HEAD, ITEMS, "line 2: value is '6'; expected a number from 1 to 5"),
        ("P1,cold,2\n", HEAD, ITEMS, "item is 'cold'; own has warm, stern, kind, able"),
        ("P1,warm,2\nP1,warm,3\n", HEAD, ITEMS, "line 3: warm is answered twice"),
        ("", HEAD, ITEMS, "holds no answers"),
        ("P1,warm,2\n", HEAD.replace("high = 5", "high = 1"), ITEMS, "low is 1 and high 1"),
        ("P1,warm,2\n", HEAD, ITEMS + ITEMS, "item warm is there twice"),
        ("P1,warm,2\n", HEAD, "items = []\n", "expected a table"),
        ("P1,warm,2\n", HEAD.replace('licence = "CC0"\n', ""), ITEMS, "licence missing"),
        ("P1,warm,2\n", HEAD.replace("CC0", " "), ITEMS, "licence is empty"),
        ("P1,warm,2\n", HEAD, ITEMS + "reversed = 1\n", "reversed"),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path: Path, rows: str, head: str, items: str, says: str) -> None:
    with pytest.raises(HighFiveError, match=says):
        read_questionnaire_answers(read_questionnaire(written(tmp_path, rows, head, items)))
