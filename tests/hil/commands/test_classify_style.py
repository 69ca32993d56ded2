"""The style classifier's verdicts, on answers that are made up and, once, on the whole chain."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from highfive.hil.cli import main as cli
from highfive.hil.commands.classify_style import BOTH, CUES, Shown, _judge
from highfive.hil.sim.people.actors import simulate_pair
from highfive.hil.sim.people.capture import Defects, record_pair
from highfive.hil.trials.partners import Partner, simulated_partners
from highfive.mocap_bridge.files.c3d import write_c3d
from highfive.mocap_bridge.files.trial_table import write_table
from highfive.model import DEFAULT_MODEL
from highfive.model.evaluation.style_classifier import ANGLES, FEATURES
from highfive.model.hgpdm.store import load_model
from highfive.model.hgpdm.trials import Trial

EMOTIONS = load_model(DEFAULT_MODEL).emotions


@pytest.fixture(scope="module")
def people() -> list[Partner]:
    one = simulated_partners(1, ("neutral",), ("B2",), 2)[0]
    return [one.in_emotion(emotion) for emotion in EMOTIONS for _ in range(3)]


def looks(emotion: str, rng: np.random.Generator, manner: str | None = None) -> np.ndarray:
    """Features of an emotion's posture and, if it is another, of the speed of a manner."""
    values = rng.normal(0.0, 0.1, len(FEATURES))
    values[EMOTIONS.index(emotion)] += 1.0
    values[len(ANGLES) + EMOTIONS.index(manner or emotion)] += 1.0
    return values


def test_who_follows_the_person_is_not_taken_for_who_shows_the_style(people: list[Partner]) -> None:
    rng = np.random.default_rng(0)
    blank = np.zeros((1, 3))
    trials = [
        Trial(120.0, np.zeros((1, 2, 3)), blank, blank, blank, blank, 0, emotion, "", -1, repetition > 4)
        for emotion in EMOTIONS
        for repetition in range(8)
    ]
    values = np.array([looks(trial.emotion, rng) for trial in trials])
    # Before correction posture and speed are the style's; after it, the speed is the person's.
    answers = [
        [Shown(np.array([looks(style, rng), looks(style, rng, person.emotion)]), np.ones(2)) for style in EMOTIONS]
        for person in people
    ]
    judged = {cue: _judge(trials, values, people, answers, EMOTIONS, own) for cue, own in CUES.items()}
    for cue in CUES:
        assert judged[cue]["accuracy"]["captured"] == judged[cue]["accuracy"]["generated"] == 1.0
    assert judged["angles"]["accuracy"]["corrected"] == 1.0
    assert judged["speeds"]["accuracy"]["corrected"] == pytest.approx(1.0 / len(EMOTIONS), abs=0.05)
    assert judged["speeds"]["by_person"]["as the style"]["corrected"] == 1.0
    table = judged[BOTH]["confusion"]["generated"]
    assert {name: sum(counts.values()) for name, counts in table.items()} == dict.fromkeys(EMOTIONS, len(people))


@pytest.mark.sweep
@pytest.mark.slow(70)
def test_the_shipped_model_shows_what_the_actors_showed(tmp_path: Path) -> None:
    rows = []
    for number, emotion in enumerate(EMOTIONS):
        for repetition in range(4):
            rng = np.random.default_rng([77, number, repetition])
            trial = simulate_pair(emotion, ("A1", "B2", "C3", "B1")[repetition], repetition, rng)
            name = f"{emotion}_{repetition}.c3d"
            write_c3d(tmp_path / name, record_pair(trial, Defects(), rng))
            rows.append((name, emotion, trial.cell, str(repetition + 1), "test" if repetition == 3 else "train"))
    write_table(tmp_path, rows)
    words = [
        sys.executable,
        "-m",
        "highfive.hil.cli.main",
        "classify-style",
        str(tmp_path),
        "--people",
        "5",
        "--seed",
        "3",
        "--json",
    ]
    found = json.loads(subprocess.run(words, check=True, stdout=subprocess.PIPE, text=True).stdout)
    assert min(found["observer_accuracy"].values()) >= 0.95
    assert min(found["by_person"]["neutral"].values()) >= 0.95
    for stage in ("generated", "corrected"):
        speeds = np.array(found["morph"][stage]["peak_speed"])
        # A little of another style slows the hand: docs/style.md. Beyond, it is the faster the more there is.
        assert np.all(np.diff(speeds[3:]) > 0.0)
        assert speeds[1:4].min() > 0.85 * speeds[0] and speeds[-1] > 1.25 * speeds[0]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["{model}"], "one data folder"),
        (["{model}", "{folder}", "--morph", "angry"], "expected two styles"),
        (["{folder}", "--morph", "angry,bored"], "bored.*neutral"),
        (["{folder}"], "trials.csv"),
    ],
)
def test_bad_requests_are_answered_in_one_line(
    tmp_path: Path,
    words: list[str],
    message: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    given = [word.format(model=DEFAULT_MODEL, folder=tmp_path) for word in words]
    monkeypatch.setattr("sys.argv", ["highfive", "classify-style", *given])
    with pytest.raises(SystemExit) as end:
        cli.main()
    said = capsys.readouterr().err
    assert end.value.code == 2
    assert said.startswith("error:") and len(said.strip().splitlines()) == 1
    assert re.search(message, said)


@pytest.mark.slow
def test_the_name_before_is_an_alias_that_help_does_not_show(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def said(*words: str) -> str:
        monkeypatch.setattr("sys.argv", ["highfive", *words])
        with pytest.raises(SystemExit) as end:
            cli.main()
        assert end.value.code == 0
        return capsys.readouterr().out

    commands = said("--help")
    assert "classify-style" in commands and "observe" not in commands
    assert (
        said("observe", "--help").replace("observe", "classify-style").split()
        == said("classify-style", "--help").split()
    )
