import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highfive.model.hgpdm.trained import HGPDM
from highfive.model.online.style_timing import StyleTiming, StyleTimingSettings, peak_speeds

PROGRESS = np.linspace(-0.3, 1.3, 641)


@pytest.fixture(scope="module")
def timing(model: HGPDM) -> StyleTiming:
    return StyleTiming(model)


def course(timing: StyleTiming, style: np.ndarray, progress: np.ndarray = PROGRESS) -> np.ndarray:
    """How far the avatar is for how far the model is, on a straight way of half a metre."""
    where = timing._where  # the palm's rest is among the channels of the resting pose
    start = timing.rest(style)[where.palm]
    meeting = start + np.array([0.3, 0.0, 0.4])
    return np.array([p * timing.fraction(start + p * (meeting - start), meeting, style) for p in progress])


@given(st.floats(0.0, 1.0))
def test_it_holds_back_and_is_on_time(timing: StyleTiming, weight: float) -> None:
    style = np.array([1.0 - weight, weight])
    gone, sharpness = course(timing, style), timing.sharpness(style)
    np.testing.assert_allclose(course(timing, style, np.array([0.0, 0.5, 1.0])), [0.0, 0.5, 1.0], atol=1e-12)
    assert np.diff(gone).min() > -1e-12  # never turns back
    inside = (PROGRESS > 0.0) & (PROGRESS < 0.5)
    assert np.all(gone[inside] <= PROGRESS[inside] + 1e-12)
    # Minimum jerk is 15/8 as fast in the middle as on average (Flash & Hogan 1985).
    fastest = np.diff(gone).max() / (PROGRESS[1] - PROGRESS[0])
    assert fastest == pytest.approx(max(1.0 + 0.875 * sharpness, 1.0), abs=1e-3)


def test_its_course_has_neither_step_nor_corner(timing: StyleTiming) -> None:
    gone, step = course(timing, np.array([0.0, 1.0])), PROGRESS[1] - PROGRESS[0]
    # The curvature of the minimum-jerk curve is 5.8 at the most; a corner would be of the order of 1 / step.
    assert np.abs(np.diff(gone, n=2)).max() / step**2 < 6.5


def test_the_faster_style_is_the_sharper_one_and_the_slower_is_left_alone(model: HGPDM) -> None:
    speeds = peak_speeds(model)
    slow, fast = np.eye(2)[[np.argmin(speeds), np.argmax(speeds)]]
    timing = StyleTiming(model)
    weights = np.linspace(0.0, 1.0, 11)
    sharpness = [timing.sharpness((1.0 - w) * slow + w * fast) for w in weights]
    assert sharpness[0] == 0.0
    assert np.all(np.diff(sharpness) > 0.0)
    np.testing.assert_array_equal(course(timing, slow), PROGRESS)


def test_peak_speeds_are_those_of_the_recordings(model: HGPDM, trials) -> None:
    for k, name in enumerate(model.emotions):
        own = [t for t in trials if t.emotion == name and not t.test]
        recorded = [np.linalg.norm(np.diff(t.palm, axis=0), axis=1).max() * t.rate_hz for t in own]
        assert peak_speeds(model)[k] == pytest.approx(np.median(recorded), rel=0.2)


def test_settings_reach_it(model: HGPDM) -> None:
    quick = np.eye(2)[np.argmax(peak_speeds(model))]
    assert StyleTiming(model, StyleTimingSettings(sharpening=0.0)).sharpness(quick) == 0.0
    assert StyleTiming(model).sharpness(quick) > 0.0
