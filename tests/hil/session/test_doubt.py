"""A hand that comes for something else is not met; one that comes for a high five is met as if nobody had doubted."""

import numpy as np
import pytest

from highfive.hil.session.doubt import DOUBT, Doubt
from highfive.hil.session.reach import Expectation, Phase, Reach, ReachTarget
from highfive.hil.sim.profiles import minimum_jerk
from highfive.mocap_bridge.frames import PalmPose

DT = 1.0 / 120.0
CONTACT = 1.5
TIMES = np.arange(0.0, 3.0, DT)
SHOULDER = np.array([0.0, -0.19, 1.43])
OUT, UP = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


def played(probability: np.ndarray | None) -> tuple[list[ReachTarget], list[bool]]:
    """Two hands that meet at 1.5 s, where a model says (T,) that they will."""
    progress = minimum_jerk((TIMES - 0.5) / 1.05) - minimum_jerk((TIMES - 1.6) / 1.0)
    generated = np.array([0.1, -0.2, 0.9]) + progress[:, None] * np.array([0.4, 0.24, 0.5])
    person = np.array([1.0, 0.2, 0.9]) + progress[:, None] * np.array([-0.5, -0.2, 0.5])
    velocity = np.gradient(person, DT, axis=0)
    reach, targets, refused = Reach(), [], []
    for n, time in enumerate(TIMES):
        said = None if probability is None else float(probability[n])
        expectation = Expectation(float(CONTACT - time), 0.05, True, probability=said)
        ours, theirs = PalmPose(generated[n], OUT, UP, np.zeros(3)), PalmPose(person[n], -OUT, UP, velocity[n])
        targets.append(reach.step(ours, theirs, expectation, SHOULDER, DT))
        refused.append(reach.refused)
    return targets, refused


def test_a_model_that_is_sure_all_along_changes_nothing() -> None:
    for one, other in zip(played(None)[0], played(np.ones(len(TIMES)))[0], strict=True):
        assert (one.phase, one.weight) == (other.phase, other.weight)
        assert np.array_equal(one.position, other.position)


@pytest.mark.parametrize("probability", [0.0, DOUBT.likely - 0.01])
def test_nothing_begins_while_a_contact_is_not_likely(probability: float) -> None:
    targets, refused = played(np.full(len(TIMES), probability))
    assert all(target.phase is Phase.IDLE and target.weight == 0.0 for target in targets)
    assert all(refused) if probability < DOUBT.unlikely else not any(refused)


def test_a_moment_of_certainty_begins_nothing_and_a_little_more_does() -> None:
    for seconds, begins in ((DOUBT.certain - 1.5 * DT, False), (DOUBT.certain + 1.5 * DT, True)):
        sure = (TIMES >= 1.2) & (1.2 + seconds > TIMES)
        assert any(t.phase is not Phase.IDLE for t in played(np.where(sure, 1.0, 0.5))[0]) is begins


def test_a_reach_that_was_begun_in_error_goes_back_smoothly() -> None:
    targets, _ = played(np.where(TIMES < 1.05, 1.0, 0.0))
    weights = np.array([target.weight for target in targets])
    assert 0.0 < weights.max() < 0.5 and weights[-1] == 0.0
    assert np.abs(np.diff(weights)).max() < 0.05
    assert all(target.phase in (Phase.IDLE, Phase.APPROACH) for target in targets)


def test_a_late_doubt_breaks_nothing_off_and_a_hand_that_was_met_is_not_refused_on_its_way_back() -> None:
    targets, refused = played(np.where(TIMES < 1.35, 1.0, 0.0))
    assert any(target.phase is Phase.TOUCH for target in targets)
    coming_back = (TIMES > 1.6) & (TIMES < 2.3)
    assert not np.array(refused)[coming_back].any()


def test_without_a_word_there_is_no_doubt() -> None:
    doubt = Doubt()
    assert not doubt.likely
    doubt.weigh(None, True, DT)
    assert doubt.likely and not doubt.unlikely
    doubt.weigh(0.0, True, DT)
    assert doubt.unlikely and not doubt.likely
    doubt.reset()
    assert not doubt.unlikely and not doubt.likely
