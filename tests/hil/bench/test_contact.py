"""How near palms come, against what was recorded: cells × emotions × avatar, twin and emulated rig.

``contact_baseline.json`` is what ``highfive bench contact --virtual --json`` said when it was recorded.
"""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from highfive.hil.arm.contact_outcome import OutcomeSettings, notice, with_known_contact
from highfive.hil.bench.contact import ContactOptions, bench_contact, played_by, twin_loop
from highfive.hil.bench.retarget import reference_trajectories
from highfive.hil.session.session import RATE_HZ
from highfive.hil.trials.locked_set import locked_trials
from highfive.model import DEFAULT_MODEL
from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.store import load_model

BASELINE = Path(__file__).with_name("contact_baseline.json")
SLACK_MM = {"avatar": 1.0, "twin": 10.0, "rig": 15.0}
"""By how much the error of one high five may grow, and half of what it was: a plan that differs in its last digits
takes another turn."""
MEDIAN_MM = {"avatar": 0.5, "twin": 2.0, "rig": 5.0}
"""The same of the median."""


def quiet(_: str, __: int):
    return lambda *_, **__: None


def baseline() -> dict[str, Any]:
    return json.loads(BASELINE.read_text(encoding="utf-8"))


def table(rows: list[dict[str, Any]]) -> str:
    lines = [f"{'':8}{'emotion':<10}{'cell':<6}{'error, mm':>10}{'change':>10}"]
    lines += [
        f"{row['player']:<8}{row['emotion']:<10}{row['cell']:<6}{row['error_mm']:>10.1f}{row['change_mm']:>+10.1f}"
        for row in rows
    ]
    return "\n".join(lines)


def further_off(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    assert all(row["change_mm"] is not None for row in rows), "a high five that the baseline does not know"
    before = [row["error_mm"] - row["change_mm"] for row in rows]
    return [row for row, was in zip(rows, before, strict=True) if row["change_mm"] > SLACK_MM[row["player"]] + was / 2]


def check(result: dict[str, Any], player: str) -> None:
    rows = [row for row in result["rows"] if row["player"] == player]
    assert rows
    worse = further_off(rows)
    assert not worse, f"further off than recorded:\n{table(worse)}"
    before = [row["error_mm"] - row["change_mm"] for row in rows]
    growth = float(np.median([row["error_mm"] for row in rows]) - np.median(before))
    assert growth <= MEDIAN_MM[player], f"the median grew by {growth:.1f} mm:\n{table(rows)}"


@pytest.mark.contact
@pytest.mark.slow(90)
def test_avatar_and_twin_meet_hands_as_near_as_recorded() -> None:
    options = ContactOptions(players=("avatar", "twin"), baseline=BASELINE)
    result = bench_contact(options, load_model(DEFAULT_MODEL), quiet)
    check(result, "avatar")
    check(result, "twin")
    assert result["twin"]["commanded_closing_speed"] <= 0.78 + 1e-3
    assert len(result["twin"]["missed"]) <= len(baseline()["twin"]["missed"]) + 2


@pytest.mark.contact
@pytest.mark.slow(55)
def test_the_emulated_rig_meets_hands_as_near_as_recorded() -> None:
    """A third of the high fives, in virtual time."""
    options = ContactOptions(cells=("B1", "C2", "A3"), players=("rig",), baseline=BASELINE, virtual=True)
    result = bench_contact(options, load_model(DEFAULT_MODEL), quiet)
    check(result, "rig")
    assert result["rig"]["stops"] == 0
    assert len(result["rig"]["missed"]) <= len(baseline()["rig"]["missed"]) + 2


@pytest.mark.slow
def test_the_map_tells_what_was_possible(tmp_path: Path) -> None:
    """One high five, and the same with a hand that is out of reach, or known of too late."""
    reference = reference_trajectories(load_model(DEFAULT_MODEL), ["sad"], ["B2"], 3, quiet)[0]
    retarget = twin_loop().retarget
    had = notice(reference, retarget)
    assert had.possible
    assert had.known < had.given
    assert notice(reference, retarget, OutcomeSettings(known=1.0)).known > had.known  # who needs no more than a metre
    assert not notice(reference, retarget, OutcomeSettings(reached=1e-15)).reached
    away = [
        None if goal.contact is None else replace(goal.contact, point=goal.contact.point + 1.0)
        for goal in reference.goals
    ]
    far = replace(
        reference,
        person=reference.person + 1.0,
        goals=tuple(replace(goal, contact=contact) for goal, contact in zip(reference.goals, away, strict=True)),
    )
    assert not notice(far, retarget).reached
    assert notice(far, retarget).known == had.known
    late = reference.due - round(0.5 * had.needed * RATE_HZ)
    unknown = tuple(replace(goal, contact=None, hypotheses=None) for goal in reference.goals[:late])
    unknown += reference.goals[late:]
    assert not notice(replace(reference, goals=unknown), retarget).possible
    rows = bench_contact(
        ContactOptions(("sad",), ("B2",), ("twin",), picture=tmp_path / "map.png"), load_model(DEFAULT_MODEL), quiet
    )["rows"]
    assert 0.0 < rows[0]["needed_s"] < rows[0]["given_s"]
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")


def test_a_contact_that_is_foretold_exactly_is_so_from_when_it_was_first_spoken_of() -> None:
    reference = reference_trajectories(load_model(DEFAULT_MODEL), ["happy"], ["B2"], 3, quiet)[0]
    began = next(i for i, goal in enumerate(reference.goals) if goal.contact or goal.hypotheses)
    exact = with_known_contact(reference)
    assert exact.goals[:began] == reference.goals[:began]
    assert exact.goals[reference.due :] == reference.goals[reference.due :]
    for i, goal in enumerate(exact.goals[began : reference.due], began):
        assert goal.contact is not None
        np.testing.assert_array_equal(goal.contact.point, reference.person[reference.due])
        assert goal.contact.time == pytest.approx((reference.due - i) / RATE_HZ)
        assert (goal.palm, goal.person) == (reference.goals[i].palm, reference.goals[i].person)
    assert notice(exact, twin_loop().retarget).known == pytest.approx((reference.due - began) / RATE_HZ)


@pytest.mark.parametrize(
    ("player", "picture", "said"), [("avatar", "map.png", "let twin or rig"), ("twin", "none/map.png", "no folder")]
)
def test_a_map_that_cannot_be_drawn_is_reported_before_anything_is_run(player, picture, said, tmp_path: Path) -> None:
    with pytest.raises(HighFiveError, match=said):
        bench_contact(ContactOptions(players=(player,), picture=tmp_path / picture), load_model(DEFAULT_MODEL), quiet)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (ContactOptions(locked=True, seed=7), "leave --seed out: the locked set"),
        (ContactOptions(locked=True, picture=Path("map.png")), "leave --picture out: the locked set"),
    ],
)
def test_the_locked_set_has_its_own_people(options: ContactOptions, said: str) -> None:
    with pytest.raises(HighFiveError, match=said):
        bench_contact(options, load_model(DEFAULT_MODEL), quiet)


@pytest.mark.slow(10)
def test_the_twin_meets_people_of_the_locked_set_who_have_names() -> None:
    chosen = [trial for trial in locked_trials() if (trial.emotion, trial.cell) == ("neutral", "B2")]
    assert chosen
    options = ContactOptions(("neutral",), ("B2",), ("avatar", "twin"), locked=True)
    result = bench_contact(options, load_model(DEFAULT_MODEL), quiet)
    assert result["locked"] and result["high_fives"] == len(chosen)
    assert [row["subject"] for row in result["rows"]] == 2 * [trial.name for trial in chosen]
    of = result["twin"]
    able = [row for row in result["rows"] if row["player"] == "twin" and row["possible"]]
    assert of["error_mm"]["p95"] == pytest.approx(np.percentile([row["error_mm"] for row in able], 95), abs=0.01)
    missed = [f"{row['subject']} neutral B2" for row in able if not row["touched"]]
    assert of["missed"] == missed


def test_a_worse_contact_fails_with_a_table() -> None:
    rows = [
        {"player": "twin", "emotion": "sad", "cell": cell, "error_mm": error, "change_mm": change}
        for cell, error, change in (("A1", 4.0, 0.2), ("B2", 31.0, 28.5), ("C3", 5.0, -0.3))
    ]
    with pytest.raises(AssertionError) as failure:
        check({"rows": rows}, "twin")
    said = str(failure.value)
    assert "B2" in said and "sad" in said and "+28.5" in said
    assert "A1" not in said.split("further off")[1].split("assert", maxsplit=1)[0]


@pytest.mark.slow
def test_what_was_played_before_tells_in_no_other_high_five() -> None:
    """Where the arm came to rest after one would be a milliradian off in the next."""
    first, second = reference_trajectories(load_model(DEFAULT_MODEL), ("happy",), ("A1", "C3"), 0, quiet)
    together, _ = played_by("twin", [first, second], quiet)
    alone, _ = played_by("twin", [second], quiet)
    assert together[1].met == alone[0].met
