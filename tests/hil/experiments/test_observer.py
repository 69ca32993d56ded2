"""Simulated participants answer as they were made: shares of labels, PSE, reaction times; the same ones again."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from highfive.hil.experiments.analysis.psychometric import fit
from highfive.hil.experiments.observer import Observer, Perception, SimulatedParticipant, read_observer, said
from highfive.model.errors import HighFiveError

KEYS = {"neutral": "1", "angry": "2", "sad": "3"}
LABELS = list(KEYS)


def trial(style: str = "angry", expected: str = "angry", weights: dict[str, float] | None = None, ask: int = 1):
    return {
        "style": style, "expected": expected, "weights": weights or {style: 1.0}, "condition": "interactive",
        "ask": ask,
    }  # fmt: skip


def shares(seen: Perception, shown: dict, count: int = 4000) -> dict[str, float]:
    rng = np.random.default_rng(1)
    found = Counter(said(seen, shown, LABELS, rng) for _ in range(count))
    return {label: found[label] / count for label in LABELS}


def test_shares_of_answers_are_those_of_the_file() -> None:
    seen = shares(Perception(right=0.8), trial())
    assert seen["angry"] == pytest.approx(0.8, abs=0.02) and seen["sad"] == pytest.approx(0.1, abs=0.02)
    row = {"angry": {"angry": 0.5, "sad": 0.5}}
    assert shares(Perception(confusion=row), trial())["neutral"] == 0.0
    assert shares(Perception(confusion=row), trial("sad", "sad"))["sad"] == pytest.approx(0.75, abs=0.02)
    lapsing = shares(Perception(right=1.0, lapse=0.3), trial())
    assert lapsing["angry"] == pytest.approx(0.7 + 0.1, abs=0.02)


def test_the_psychometric_function_is_that_of_the_file() -> None:
    seen, rng = Perception(pse=0.6, jnd=0.1), np.random.default_rng(2)
    weights = np.repeat(np.linspace(0.0, 1.0, 11), 60)
    answers = [
        said(seen, trial("m", "", {"neutral": 1.0 - w, "angry": w}), ["angry", "neutral"], rng) == "angry"
        for w in weights
    ]
    found = fit(weights, np.array(answers))
    assert found.pse.value == pytest.approx(0.6, abs=0.02) and found.jnd.value == pytest.approx(0.1, rel=0.2)


def test_the_same_participant_gives_the_same_answer_to_the_same_trial_and_another_one_another() -> None:
    def told(code: str) -> list:
        one = SimulatedParticipant(Observer(seed=4), code)
        one.hear("experiment", {"keys": KEYS, "sliders": []})
        found = []
        for ask in range(1, 60):
            one.hear("experimenter", trial(ask=ask))
            found += one.hear("participant", {"phase": "question", "asks": "answer"})
        return found

    assert told("P01") == told("P01") != told("P02")
    times = np.log([reply.after_s for reply in told("P01")])
    assert times.mean() == pytest.approx(np.log(0.9), abs=0.15) and times.std() == pytest.approx(0.3, abs=0.1)


def test_a_file_is_checked(tmp_path: Path) -> None:
    path = tmp_path / "observer.toml"
    path.write_text(
        "seed = 3\n[interactive]\nright = 0.9\n[interactive.confusion]\nsad = {sad = 0.5, angry = 0.5}\n"
        "[replay]\npse = 0.6\n[reaction]\nmedian_s = 1.5\nsilent = 0.1\n",
        encoding="utf-8",
    )
    found = read_observer(path)
    assert (found.seed, found.interactive.right, found.replay.pse, found.rt_s, found.silent) == (3, 0.9, 0.6, 1.5, 0.1)
    assert found.interactive.confusion == {"sad": {"sad": 0.5, "angry": 0.5}}
    for text, word in (
        ("[interactive]\nright = 2", "right"),
        ("[interactive]\nwrong = 2", "wrong means nothing"),
        ("[interactive.confusion]\nsad = {sad = 0.5}", "sum to 0.5"),
        ("[reaction]\nmedian_s = 0", "median_s"),
        ("seed = 'x'", "seed"),
        ("[interactive]\nconfusion = 3", "confusion"),
    ):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(HighFiveError, match=word):
            read_observer(path)
