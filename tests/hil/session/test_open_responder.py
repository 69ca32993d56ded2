"""A model of somebody else's in a session: what it must answer, and what is said when it does not."""

import time
from dataclasses import replace

import numpy as np
import pytest
from reaction_models import Standing, misshapen, raises, standing

from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.session.open_responder import Patience, open_responder
from highfive.hil.session.style_timing import timing_of
from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.store import load_model
from highfive.model.online.responder import Responder
from highfive.model.plugins import PluginError

HAND = np.array([[0.6, -0.2, 1.2], [0.6, -0.2, 1.3]])


def test_the_hierarchical_model_answers_by_its_own_responder() -> None:
    assert isinstance(open_responder(load_model(), "happy", 120.0), Responder)


def test_another_model_answers_as_it_does_by_itself() -> None:
    responder = open_responder(Standing(), {"happy": 1.0}, 120.0)
    np.testing.assert_array_equal(responder.style, [0.0, 1.0, 0.0, 0.0])
    assert responder.step(HAND).time_to_contact == standing(1).time_to_contact  # the warm-up was forgotten
    responder.set_style("angry")
    assert responder.style[3] == 1.0


def test_its_resting_pose_is_played_while_it_waits() -> None:
    timing = timing_of(Standing())
    waiting = timing.waiting(np.array([1.0, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(waiting.root_in_world, [0.0, 0.0, 0.93])
    pose = timing.answering(standing(1), np.array([1.0, 0.0, 0.0, 0.0]), waiting)
    np.testing.assert_allclose(pose.hinges, waiting.hinges)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"joints": np.zeros(158)}, r"joints has shape \(158,\); expected \(159,\)"),
        ({"root": np.zeros((1, 3))}, r"root has shape \(1, 3\); expected \(3,\)"),
        ({"palm": np.array([0.0, np.nan, 0.0])}, "palm holds NaN"),
        ({"contact_point": "there"}, "contact_point is str"),
        ({"time_to_contact": np.inf}, "time_to_contact is inf"),
        ({"time_to_contact": None}, "time_to_contact raised TypeError"),
        ({"time_to_contact_std": np.nan}, "time_to_contact_std is nan"),
        ({"time_to_contact_std": -0.1}, r"time_to_contact_std is -0\.1"),
        ({"contact": "soon"}, "contact is str; expected a ContactForecast or None"),
        ({"in_distribution": np.ones(2)}, "in_distribution is ndarray; expected True or False"),
    ],
)
def test_a_wrong_answer_is_named_before_the_session_begins(change: dict, says: str) -> None:
    model = Standing(lambda number: replace(standing(number), **change))
    with pytest.raises(PluginError, match=rf"^the model reaction_models\.Standing: {says}"):
        open_responder(model, "neutral", 120.0)


@pytest.mark.parametrize(
    ("answer", "says"), [(raises, "step raised KeyError: 'elbow'"), (misshapen, "joints has shape")]
)
def test_what_goes_wrong_later_is_named_in_its_tick(answer, says: str) -> None:
    responder = open_responder(Standing(answer), "neutral", 120.0)
    for _ in range(19):
        responder.step(HAND)
    with pytest.raises(PluginError, match=says):
        responder.step(HAND)
    responder.reset()
    responder.step(HAND)  # a new trial may go well


def test_one_that_ends_the_program_is_named() -> None:
    def leaves(number: int):
        raise SystemExit(3)

    with pytest.raises(PluginError, match="step raised SystemExit: 3"):
        open_responder(Standing(leaves), "neutral", 120.0)


def test_nothing_of_an_earlier_trial_is_answered_before_the_first_step() -> None:
    responder = open_responder(Standing(), "neutral", 120.0)
    assert responder.ahead(0.1).time_to_contact == standing(1).time_to_contact - 0.1
    for _ in range(5):
        responder.step(HAND)
    responder.reset()
    assert responder.ahead(0.1).time_to_contact == standing(1).time_to_contact - 0.1


def test_what_is_no_answer_at_all() -> None:
    with pytest.raises(PluginError, match="joints raised AttributeError"):
        open_responder(Standing(lambda number: None), "neutral", 120.0)


def test_one_tick_that_takes_too_long_is_named() -> None:
    with VirtualClock() as clock:

        def slow(number: int):
            clock.spend(50_000_000 if number > 5 else 0)
            return standing(number)

        responder = open_responder(Standing(slow), "neutral", 120.0, Patience(single_s=0.04), clock)
        with pytest.raises(PluginError, match=r"took 50 ms for one tick; at most 40 ms"):
            for _ in range(8):
                responder.step(HAND)


def test_a_model_that_is_always_a_little_too_slow_is_named() -> None:
    with VirtualClock() as clock:

        def slow(number: int):
            clock.spend(10_000_000)
            return standing(number)

        responder = open_responder(Standing(slow), "neutral", 120.0, Patience(single_s=60.0, window_s=0.1), clock)
        for _ in range(11):
            responder.step(HAND)
        with pytest.raises(PluginError, match=r"too slow: its median tick takes 10\.0 ms, ticks come every 8\.3 ms"):
            responder.step(HAND)
        patient = open_responder(Standing(slow), "neutral", 120.0, None, clock)
        for _ in range(20):
            patient.step(HAND)


def test_in_virtual_time_no_model_is_too_slow() -> None:
    """What it computes takes no time there: the same session comes out on a busy machine."""

    def slow(number: int):
        time.sleep(0.02)
        return standing(number)

    with VirtualClock() as clock:
        responder = open_responder(Standing(slow), "neutral", 120.0, Patience(single_s=0.01, window_s=0.03), clock)
        for _ in range(6):
            responder.step(HAND)


def test_a_model_for_another_body_or_without_the_style_is_refused() -> None:
    with pytest.raises(HighFiveError, match="for skeleton abc"):
        open_responder(Standing(skeleton_hash="abc"), "neutral", 120.0)
    with pytest.raises(HighFiveError, match="furious"):
        open_responder(Standing(), "furious", 120.0)
