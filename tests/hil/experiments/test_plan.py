"""Plans break no constraint, whatever the seed; judged by a checker of its own, which knows the words only."""

from collections import Counter
from dataclasses import replace
from itertools import groupby

import numpy as np
import pytest
from experiments import protocol

from highfive.hil.experiments.balance import check_balance
from highfive.hil.experiments.plan import Plan, PlannedTrial, draw_plan, draw_plans
from highfive.hil.experiments.protocol import ADAPTIVE, Morph, Order, Protocol, Style

ADAPTIVE_RUN = protocol(
    "morph",
    morph=Morph("neutral", "angry", ()),
    styles=(Style("angry0", {"neutral": 1.0, "angry": 0.0}), Style("angry1", {"neutral": 0.0, "angry": 1.0})),
)
ADAPTIVE_RUN = replace(
    ADAPTIVE_RUN,
    blocks=tuple(replace(block, repetitions=20) for block in ADAPTIVE_RUN.blocks),
    order=Order(easy_share=0.2),
)
KINDS = {
    "tipping": protocol("tipping"),
    "high_five": protocol("high_five"),
    "morph": protocol("morph"),
    "adaptive": ADAPTIVE_RUN,
    "never two alike": protocol("tipping", order=Order(alike=1)),
}


def broken(asked: Protocol, plan: Plan, before: Plan | None) -> list[str]:
    """What is wrong with a plan."""
    found: list[str] = []
    kinds = {block.name: block for block in asked.blocks}
    order = [name for name, _ in groupby(trial.block for trial in plan.trials)]
    if sorted(order) != sorted(["practice"] * (asked.practice > 0) + list(kinds)):
        found.append(f"blocks {order}")
    shown = {style.name for style in asked.styles} | {ADAPTIVE}
    for name, group in groupby(plan.trials, lambda trial: trial.block):
        trials = list(group)
        if name == "practice":
            continue
        if any(trial.style not in shown or trial.mode != kinds[name].mode for trial in trials):
            found.append(f"{name}: style or mode")
        counts = Counter(trial.style for trial in trials if trial.style != ADAPTIVE)
        if len(set(counts.values())) != 1 or len(counts) != len(asked.styles):
            found.append(f"{name}: {counts}")
        for style, run in groupby(trials, lambda trial: trial.style):
            if style != ADAPTIVE and len(list(run)) > asked.order.alike:
                found.append(f"{name}: {style} more than {asked.order.alike} times in a row")
        found += _source(asked, plan, before, order, trials)
    places = Counter(
        (None if asked.morph and not asked.morph.levels else trial.style, trial.cell, trial.clip)
        for trial in plan.trials
        if trial.block in kinds and trial.mode == "interactive" and not kinds[trial.block].filler
    )
    if len(set(places.values())) != 1:
        found.append(f"cells or clips: {places}")
    if sorted(plan.keys) != sorted(asked.labels) or sorted(plan.keys.values()) != sorted(asked.keys):
        found.append(f"keys {plan.keys}")
    if len({trial.name for trial in plan.trials}) != len(plan.trials):
        found.append("names")
    return found


def _source(
    asked: Protocol, plan: Plan, before: Plan | None, order: list[str], trials: list[PlannedTrial]
) -> list[str]:
    """What is wrong with a replay."""
    block = next(block for block in asked.blocks if block.name == trials[0].block)
    if not block.of:
        return [f"{block.name} has sources"] if any(trial.source for trial in trials) else []
    if block.other:
        assert before is not None
        source = {f"{before.participant}:{trial.name}": trial for trial in before.trials if trial.block == block.of}
    else:
        source = {trial.name: trial for trial in plan.trials if trial.block == block.of}
        between = order[order.index(block.of) + 1 : order.index(block.name)]
        if not any(one.name in between and one.mode == "interactive" for one in asked.blocks):
            return [f"{block.name} comes right after {block.of}: {order}"]
    if sorted(trial.source for trial in trials) != sorted(source):
        return [f"{block.name}: sources"]
    same = all(
        (trial.style, trial.weights, trial.answer, trial.cell, trial.clip)
        == (one.style, one.weights, one.answer, one.cell, one.clip)
        for trial in trials
        for one in [source[trial.source]]
    )
    return [] if same else [f"{block.name}: not what its source shows"]


def break_none(asked: Protocol, seeds: range) -> None:
    for seed in seeds:
        one = replace(asked, seed=seed)
        number = 1 + seed % one.participants
        before = draw_plan(one, number - 1) if one.needs_donor else None
        assert not broken(one, draw_plan(one, number), before), seed


@pytest.mark.parametrize("kind", KINDS)
def test_no_plan_breaks_a_constraint(kind: str) -> None:
    check_balance(KINDS[kind])
    break_none(KINDS[kind], range(60))


@pytest.mark.slow(15)
@pytest.mark.parametrize("kind", KINDS)
def test_no_plan_of_ten_thousand_breaks_a_constraint(kind: str) -> None:
    break_none(KINDS[kind], range(2000))


def test_the_checker_finds_what_is_broken() -> None:
    """A plan with one trial changed is found out, whichever one, unless it is practice."""
    asked = KINDS["tipping"]
    plan = draw_plan(asked, 1)
    rng = np.random.default_rng(0)
    for place in rng.integers(asked.practice * len(asked.styles), len(plan.trials), 40):
        trial = plan.trials[place]
        other = "angry" if trial.style != "angry" else "neutral"
        for wrong in (
            replace(trial, style=other), replace(trial, clip=trial.clip % 4 + 1), replace(trial, source="I1-99")
        ):  # fmt: skip
            if trial.block == "I4" and wrong.clip != trial.clip:
                continue  # a filler's clips are free
            changed = replace(plan, trials=(*plan.trials[:place], wrong, *plan.trials[place + 1 :]))
            assert broken(asked, changed, None), (trial, wrong)


def test_parts_are_in_each_order_equally_often_between_people() -> None:
    asked = protocol("high_five", participants=8)
    first = Counter(plan.trials[-1].block for plan in draw_plans(asked)[1:])
    assert first == {"O2": 4, "R2": 4}


def test_the_same_seed_draws_the_same_plans_and_another_one_others() -> None:
    asked = protocol("high_five", participants=2)
    assert draw_plans(asked) == draw_plans(asked)
    other = draw_plans(replace(asked, seed=1))
    assert all(one.trials != two.trials for one, two in zip(draw_plans(asked), other, strict=True))
    # More people change nobody's plan.
    assert draw_plans(replace(asked, participants=6))[:3] == draw_plans(asked)


def test_keys_are_mapped_each_way_about_equally_often() -> None:
    """60 people, 6 ways: chi square of 5 degrees of freedom is over 20.5 in one of a thousand."""
    asked = protocol("tipping", participants=60)
    seen = Counter(tuple(plan.keys.items()) for plan in draw_plans(asked))
    assert len(seen) == 6 and sum((count - 10) ** 2 / 10 for count in seen.values()) < 20.5


def test_practice_shows_each_style_once_a_round_and_is_no_part_of_the_balance() -> None:
    plan = draw_plan(protocol("tipping", practice=2), 1)
    trials = plan.block("practice")
    assert Counter(trial.style for trial in trials) == {"neutral": 2, "fearful": 2, "angry": 2}
    assert [trial.name for trial in plan.trials[:6]] == [trial.name for trial in trials]


def test_an_adaptive_run_leaves_weights_open_and_holds_both_ends() -> None:
    plan = draw_plan(ADAPTIVE_RUN, 1)
    counts = Counter(trial.style for trial in plan.block("I1"))
    assert counts == {ADAPTIVE: 16, "angry0": 2, "angry1": 2}
    assert all((trial.weights == {}) == (trial.style == ADAPTIVE) for trial in plan.trials)
    assert Counter(trial.style for trial in plan.block("R1")) == counts
