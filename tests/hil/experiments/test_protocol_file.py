"""Experiments as files: templates are right as they are; what is wrong is one line that says what."""

from pathlib import Path

import pytest
from experiments import protocol, written

from highfive.hil.experiments.balance import check_balance
from highfive.hil.experiments.protocol import Mode, Motion, Order
from highfive.hil.experiments.protocol_file import TEMPLATES, read_protocol, templates
from highfive.model.errors import HighFiveError


def test_templates_are_balanced_and_have_instructions_in_two_languages() -> None:
    assert templates() == ["high_five", "morph", "tipping"]
    for name in templates():
        asked = read_protocol(TEMPLATES / f"{name}.toml")
        check_balance(asked)
        assert asked.name == asked.kind == name and set(asked.instructions) == {"de", "en"}


def test_tipping_is_as_the_source_tells_it() -> None:
    asked = protocol("tipping")
    assert [style.name for style in asked.styles] == ["neutral", "fearful", "angry"] == list(asked.labels)
    assert [asked.trials_of(block) for block in asked.sources] == [12, 12, 12]
    replays = [block for block in asked.blocks if block.mode is Mode.OWN_REPLAY]
    assert len(replays) == 3 and asked.motion is Motion.CLIPS and asked.clips == 4


WRONG = {
    "unknown style": ("high_five", 'name = "sad"', 'name = "fearful"', "unknown style 'fearful'; known are neutral"),
    "a style twice": ("high_five", 'name = "sad"', 'name = "happy"', "'happy' is there twice"),
    "weights": ("tipping", 'name = "angry"', 'name = "angry"\nweights = {angry = 0.5}', "weights sum to 0.5"),
    "a key": ("tipping", 'keys = ["1", "2", "3"]', 'keys = ["1", "2"]', "3 labels and 2 keys"),
    "a key twice": ("tipping", 'keys = ["1", "2", "3"]', 'keys = ["a", "A", "3"]', "'a' is there twice"),
    "a cell": ("high_five", '"A1"', '"D1"', "cells has 'D1', expected of A1 to C3"),
    "a mode": ("tipping", 'mode = "own_replay"', 'mode = "replay"', "mode is 'replay', expected one of interactive"),
    "no source": ("tipping", 'of = "I1"', 'of = "I9"', "of is 'I9', expected an interactive block"),
    "a source missing": ("tipping", 'of = "I1"', "", "of does not fit"),
    "a number": ("tipping", "trial_s = 20.0", "trial_s = -1.0", "trial_s is -1.0 s, expected more than 0"),
    "an unknown entry": ("tipping", "seed = 0", "sead = 0", "sead means nothing here"),
    "no instructions": ("tipping", "tipping_instructions", "nowhere", "no instructions in"),
    "levels": ("morph", "0.2, 0.35", "0.35, 0.2", "three or more from 0 to 1 that rise"),
    "levels of an adaptive run": ("morph", '"constant"', '"adaptive"', "levels go with method = 'constant'"),
    "clips of a model": ("high_five", 'motion = "model"', 'motion = "model"\nclips = 4', "with 4 clips"),
    "too long": ("tipping", "repetitions = 4", "repetitions = 40", "has 120 trials, expected 100 at most"),
    "codes": ("tipping", "seed = 0", 'codes = ["Anna M"]', "expected 2 to 12 letters and digits"),
    "a name for a code": ("tipping", "seed = 0", 'codes = ["Anna"]', "one digit at least, and no name"),
    "too few codes": ("tipping", "seed = 0", 'codes = ["AB1"]', "codes are 1, expected a different one"),
    "no TOML": ("tipping", "seed = 0", "seed = ", "it is no TOML file"),
    "a rating": ("high_five", "points = 7", "points = 1", "points is 1, expected 2 to 101"),
    "a rating twice": ("high_five", 'name = "arousal"', 'name = "certainty"', "ratings: 'certainty' is there twice"),
    "a label": ("morph", 'labels = ["neutral", "angry"]', 'labels = ["neutral", "sad"]', "expected neutral and angry"),
    "a viewpoint": ("tipping", 'viewpoint = "live"', 'viewpoint = "x"', "viewpoint is live or recorded"),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_is_said_in_a_line(what: str, tmp_path: Path) -> None:
    name, old, new, message = WRONG[what]
    path = written(tmp_path, name, {old: new})
    with pytest.raises(HighFiveError) as told:
        read_protocol(path)
    assert message in str(told.value) and str(path) in str(told.value)
    assert "\n" not in str(told.value) or what == "no TOML"


UNBALANCED = {
    "cells": ("high_five", "repetitions = 3", "repetitions = 2", "6 times .* of 9 cells equally often; .* 9 in all"),
    "clips": ("tipping", "clips = 4", "clips = 5", "12 times .* each of 5 clips equally often; .* 10 or 15 in all"),
    "people": ("high_five", "participants = 12", "participants = 5", "2 orders, of which 5 .* plan 4 or 6 people"),
    "parts": ("high_five", 'name = "I1"\nmode = "interactive"\nrepetitions = 3\npart = "acting"',
              'name = "I1"\nmode = "interactive"\nrepetitions = 3\npart = "watching"', "have to stand together"),
}  # fmt: skip


@pytest.mark.parametrize("what", UNBALANCED)
def test_what_cannot_be_balanced_is_refused_with_the_reason(what: str, tmp_path: Path) -> None:
    name, old, new, message = UNBALANCED[what]
    asked = read_protocol(written(tmp_path, name, {old: new}))
    with pytest.raises(HighFiveError, match=message) as told:
        check_balance(asked)
    assert "\n" not in str(told.value)


def test_a_replay_right_after_its_source_is_refused() -> None:
    """Also with another replay between them: that is no interactive block."""
    blocks = protocol("tipping").blocks
    without = tuple(block for block in blocks if block.name != "I4")
    with pytest.raises(HighFiveError, match="block R3 comes right after its source I3; put an interactive block"):
        check_balance(protocol("tipping", blocks=without))
    with pytest.raises(HighFiveError, match="block R1 shows I1 before it was played"):
        check_balance(protocol("tipping", blocks=(blocks[2], *blocks[:2], *blocks[3:])))


def test_styles_that_cannot_be_parted_are_refused() -> None:
    one = protocol("tipping", styles=protocol("tipping").styles[:1])
    with pytest.raises(HighFiveError, match="neutral comes 4 times among 4 trials, and at most 2 alike"):
        check_balance(one)
    check_balance(protocol("tipping", styles=one.styles, order=Order(alike=4)))
