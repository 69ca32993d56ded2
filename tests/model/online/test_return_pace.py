"""Onset and duration of the way back, against the recordings that the model learned from."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Trial
from highfive.model.online.return_pace import _minimum_jerk, _times, return_pace


def test_half_of_the_way_is_done_when_the_recordings_had_done_it(model: HGPDM, trials: list[Trial]) -> None:
    pace = return_pace(model)
    assert pace is not None
    for k, name in enumerate(model.emotions):
        halves = []
        for trial in trials:
            if trial.emotion == name and not trial.test:
                after = trial.palm[trial.contact_frame :]
                way = after[-1] - after[0]
                gone = (after - after[0]) @ way / (way @ way)
                halves.append(np.argmax(gone >= 0.5) / trial.rate_hz)
        onset, duration = pace.of(np.eye(len(model.emotions))[k])
        assert onset + 0.5 * duration == pytest.approx(np.median(halves), abs=2.0 * model.lag)


@given(st.floats(0.0, 1.0), st.floats(0.3, 4.0), st.floats(0.2, 1.2))
def test_a_minimum_jerk_way_is_found_again(onset: float, duration: float, length: float) -> None:
    lag = 0.01
    t = lag * np.arange(round(7.0 / lag)) - 1.0
    s = np.clip((t - onset) / duration, 0.0, 1.0)
    out = np.clip((t + 0.5) / 0.5, 0.0, 1.0) - s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    found = _times(out[:, None] * np.array([0.6, 0.0, 0.8]) * length, -t, lag)
    assert found is not None
    np.testing.assert_allclose(_minimum_jerk(found), (onset, duration), atol=0.02 + 0.01 * duration)


def test_a_recording_that_ends_on_the_way_says_nothing() -> None:
    t = np.linspace(-1.0, 1.0, 201)
    out = np.where(t < 0.0, t + 1.0, 1.0 - 0.5 * t)
    assert _times(out[:, None] * np.array([0.5, 0.0, 0.5]), -t, 0.01) is None
    assert _times(np.zeros((201, 3)), -t, 0.01) is None
    assert _times(out[:, None] * np.ones(3), np.ones(201), 0.01) is None  # no contact
