import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from highfive.hil.sim.avatar import avatar_skeleton
from highfive.model.errors import HighFiveError
from highfive.model.evaluation import style_classifier
from highfive.model.evaluation.style_classifier import (
    FEATURES,
    Motion,
    accuracy,
    confusion,
    features,
    fit_style_classifier,
)

RATE = 120.0


def motion(
    speed: float = 1.0, bend: float = 0.1, before: float = 0.3, after: float = 0.3, rate: float = RATE
) -> Motion:
    """A hand that goes out and back, and a trunk that bends; it waits before and after."""
    skeleton = avatar_skeleton()
    course = np.sin(np.linspace(0.0, np.pi, round(rate * 1.5 / speed))) ** 2
    course = np.concatenate([np.zeros(round(before * rate)), course, np.zeros(round(after * rate))])
    joints = np.zeros((len(course), len(skeleton), 3))
    joints[:, skeleton.index("lumbar_3"), 1] = bend
    joints[:, skeleton.index("right_elbow"), 1] = -1.5 * course
    palm = np.array([0.2, -0.3, 0.8]) + course[:, None] * np.array([0.3, 0.1, 0.5])
    return Motion(rate, joints.reshape(len(course), -1), palm)


def named(values: np.ndarray) -> dict[str, float]:
    return dict(zip(FEATURES, values, strict=True))


@pytest.mark.parametrize(("before", "after", "rate"), [(2.0, 0.3, RATE), (0.3, 3.0, RATE), (1.0, 1.0, 60.0)])
def test_neither_waiting_nor_the_frame_rate_changes_what_is_seen(before: float, after: float, rate: float) -> None:
    usual = features(motion(), avatar_skeleton())
    np.testing.assert_allclose(features(motion(1.0, 0.1, before, after, rate), avatar_skeleton()), usual, atol=0.03)


def test_features_are_what_they_are_called() -> None:
    slow, fast = (named(features(motion(speed), avatar_skeleton())) for speed in (1.0, 2.0))
    for name in ("palm, log peak speed", "right elbow, log median speed"):
        assert fast[name] - slow[name] == pytest.approx(np.log(2.0), abs=0.05)
    length, peak = np.linalg.norm([0.3, 0.1, 0.5]), np.pi / 1.5  # of sin²: its derivative's largest value
    assert np.exp(slow["palm, log peak speed"]) == pytest.approx(length * peak, rel=0.02)
    assert slow["trunk, mean rotation about y"] == pytest.approx(0.1, abs=1e-6)
    assert fast["trunk, mean rotation about y"] == pytest.approx(0.1, abs=1e-6)


def test_motion_that_is_none_is_refused_in_one_line() -> None:
    still = Motion(RATE, np.zeros((200, 159)), np.zeros((200, 3)))
    short = Motion(RATE, np.zeros((20, 159)), np.zeros((20, 3)))
    for bad in (still, short):
        with pytest.raises(HighFiveError, match="whole high five"):
            features(bad, avatar_skeleton())


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_with_many_motions_it_is_the_best_classifier_there_is(seed: int) -> None:
    """Gaussian classes of one covariance: the rule of Bayes, known here, is what the fit comes to."""
    rng = np.random.default_rng(seed)
    means = rng.normal(size=(3, 2))
    mix = np.diag(np.exp(0.5 * rng.normal(size=2))) @ np.array([[1.0, 0.4], [0.0, 1.0]])
    index = np.repeat(np.arange(3), 3000)
    values = means[index] + rng.normal(size=(9000, 2)) @ mix.T
    labels = [("a", "b", "c")[k] for k in index]
    distance = values[:, None] - means
    best = np.einsum("nki,ij,nkj->nk", distance, np.linalg.inv(mix @ mix.T), distance).argmin(axis=1)
    learned = accuracy(labels, fit_style_classifier(values, labels).recognise(values))
    assert learned > np.mean(best == index) - 0.03


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_units_and_offsets_of_features_do_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    labels = ["calm", "wild"] * 20
    values = rng.normal(size=(40, 5)) + np.array([[0.0], [0.5]] * 20)
    scale, offset = np.exp(rng.normal(size=5)), rng.normal(size=5)
    probabilities = fit_style_classifier(values, labels).probabilities(values)
    again = fit_style_classifier(values * scale + offset, labels).probabilities(values * scale + offset)
    np.testing.assert_allclose(again, probabilities, atol=1e-6)
    np.testing.assert_allclose(probabilities.sum(axis=1), 1.0)


def test_chance_is_chance() -> None:
    rng = np.random.default_rng(0)
    labels = ["a", "b", "c", "d"] * 250
    values = rng.normal(size=(1000, 4))
    seen = fit_style_classifier(values[:500], labels[:500]).recognise(values[500:])
    assert 0.15 < accuracy(labels[500:], seen) < 0.35


def test_confusion_counts_every_motion_once() -> None:
    shown, seen = ["a", "a", "b", "b"], ["a", "c", "b", "b"]
    table = confusion(shown, seen)
    assert table == {"a": {"a": 1, "b": 0, "c": 1}, "b": {"a": 0, "b": 2, "c": 0}}
    assert accuracy(shown, seen) == 0.75


@pytest.mark.parametrize("labels", [["sad"] * 4, ["sad", "sad", "sad", "angry"]])
def test_too_little_to_learn_from_is_said_in_one_line(labels: list[str]) -> None:
    with pytest.raises(HighFiveError, match="of sad") as error:
        fit_style_classifier(np.zeros((4, 3)), labels)
    assert "\n" not in str(error.value)


def test_parts_are_joints_of_the_avatar() -> None:
    names = {name for part in style_classifier.PARTS.values() for name in part}
    assert names <= set(avatar_skeleton().names)
