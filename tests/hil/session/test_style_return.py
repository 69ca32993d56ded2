"""The way back: in the style's own time whoever the person is, without a jerk, and never in a face."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highfive.hil.session.reach import Phase
from highfive.hil.session.style_return import StyleReturn, StyleReturnSettings
from highfive.hil.sim.avatar import Pose, avatar_skeleton
from highfive.hil.sim.profiles import minimum_jerk
from highfive.hil.sim.scene import rest_pose
from highfive.model.online.return_pace import ReturnPace

PACE = ReturnPace(np.array([0.1, 0.5]), np.array([0.8, 2.5]))
QUICK, SLOW = np.eye(2)
DT = 1.0 / 120.0
ELBOW = avatar_skeleton().index("right_elbow")
RAISED = 1.2  # rad, by which the elbow is bent at contact


def bent(angle: float) -> Pose:
    rest = rest_pose(avatar_skeleton())
    hinges = rest.hinges.copy()
    hinges[ELBOW, np.argmax(np.ptp(avatar_skeleton().hinge_limits[ELBOW], axis=-1))] += angle
    return Pose(rest.root_in_world, hinges)


def angles(style: np.ndarray, person_s: float, face=lambda t: (np.inf, np.inf), again_s: float = np.inf) -> np.ndarray:
    """The elbow's angle from contact on, tick by tick, for 5 s, where the model's goes back in ``person_s``."""
    back, waiting, found = StyleReturn(PACE), bent(0.0), []
    which = np.unravel_index(np.argmax(np.abs(bent(RAISED).hinges - waiting.hinges)), waiting.hinges.shape)
    for tick in range(-10, 600):
        t = tick * DT
        phase = Phase.TOUCH if t < 0.0 else Phase.RELEASE if t < 0.5 else Phase.IDLE
        model = RAISED * (1.0 - minimum_jerk(t / person_s) * (1.0 - minimum_jerk((t - again_s) / 0.6)))
        phase = Phase.APPROACH if t >= again_s else phase
        pose = back.step(bent(model), waiting, style, phase, DT, face(t))
        found.append((pose.hinges - waiting.hinges)[which] * np.sign((bent(1.0).hinges - waiting.hinges)[which]))
    return np.array(found[10:])


@pytest.mark.parametrize(("style", "number"), [(QUICK, 0), (SLOW, 1)])
def test_it_takes_the_styles_own_time_whoever_the_person_is(style: np.ndarray, number: int) -> None:
    half = PACE.onset[number] + 0.5 * PACE.duration[number]
    for person_s in (0.5, 1.5, 3.0):
        found = angles(style, person_s)
        assert np.argmax(found < 0.5 * RAISED) * DT == pytest.approx(half, abs=0.06)
        assert abs(found[-1]) < 1e-9


@given(st.floats(0.0, 1.0), st.floats(0.4, 3.0), st.floats(0.3, 4.0))
def test_no_hand_over_is_a_step(weight: float, person_s: float, again_s: float) -> None:
    found = angles(np.array([1.0 - weight, weight]), person_s, again_s=again_s)
    # The quintic's acceleration is at most 5.8 of a difference per easing², and 3.2 of a speed per easing.
    quickest = RAISED * 1.875 * (1.0 / min(person_s, 0.6) + 1.0 / PACE.duration.min())
    easing = StyleReturnSettings().easing
    most = 2.0 * (5.8 * RAISED / easing**2 + 4.0 * quickest / easing)
    assert np.abs(np.diff(found)).max() / DT < RAISED * 1.875 / easing + 2.0 * quickest
    assert np.abs(np.diff(found, n=2)).max() / DT**2 < most
    if again_s < 3.0:
        assert found[round((again_s + 0.8) / DT)] == pytest.approx(RAISED, abs=1e-9)


def test_a_hand_near_a_face_is_the_models() -> None:
    model = RAISED * (1.0 - minimum_jerk(np.arange(600) * DT / 0.5))
    np.testing.assert_allclose(angles(SLOW, 0.5, lambda t: (0.25, 0.25)), model, atol=1e-9)
    # The person bows: from 0.4 s on the hand that stays out is in her way, and leaves.
    bowed = angles(SLOW, 0.5, lambda t: (0.25, 0.6) if t > 0.4 else (0.6, 0.6))
    assert abs(bowed[round((0.41 + StyleReturnSettings().easing) / DT) + 1]) < 0.05 * RAISED
    assert angles(SLOW, 0.5)[round(0.62 / DT)] > 0.9 * RAISED


def test_without_a_pace_poses_stay_as_they_are() -> None:
    back, pose = StyleReturn(None), bent(1.0)
    assert back.step(pose, bent(0.0), QUICK, Phase.RELEASE, DT) is pose
