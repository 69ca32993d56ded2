"""Simulated studies from plan to analysis: what was put in lies in the intervals, and a wrong interval would not do."""

import numpy as np
import pytest

from highfive.hil.bench import studies
from highfive.hil.bench.studies import StudiesOptions, bench_studies
from highfive.hil.runtime.console import LOGGER
from highfive.model.errors import HighFiveError


def no_bar(label: str, total: int):
    return lambda note="", done=None: None


@pytest.mark.sweep
@pytest.mark.slow(60)
def test_intervals_hold_what_was_put_in() -> None:
    found = bench_studies(StudiesOptions(studies=6, people=3, first=1000), no_bar)
    within = found["within"]
    assert len(within) == 8
    # 36 of each: at a true share of .85 fewer than 24 are one in 2,000; at .5 they are nine in ten.
    for name in ("rate of an emotion", "PSE of a person", "JND of a person"):
        assert within[name]["of"] == 36 and within[name]["share"] * 36 >= 24, (name, within[name])


@pytest.mark.slow
def test_a_truth_that_was_not_put_in_is_not_held() -> None:
    rng = np.random.default_rng(0)
    study = studies._morphs(rng, 2)
    found, truths = studies._played(study, rng, 0.9)
    held = [one for name, one in studies._held((found, truths)) if name == "PSE of a person"]
    off = {"PSE of a person": {key: value + 0.6 for key, value in truths["PSE of a person"].items()}}
    assert len(held) == 4 and sum(held) >= 2
    assert not any(one for _, one in studies._held((found, off)))


@pytest.mark.slow
def test_warnings_are_heard_again_afterwards() -> None:
    level = LOGGER.level
    assert bench_studies(StudiesOptions(studies=1, people=2), no_bar)["studies"] == 1
    assert LOGGER.level == level


def test_one_person_is_no_study() -> None:
    with pytest.raises(HighFiveError, match="1 people; what differs"):
        bench_studies(StudiesOptions(people=1), no_bar)
