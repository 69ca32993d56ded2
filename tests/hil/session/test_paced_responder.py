"""The model keeps its own pace, whatever comes: laws of the pacing, and of what it answers between its steps."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from highfive.hil.bench.live_people import System, frames_of
from highfive.hil.session.open_responder import open_responder
from highfive.hil.session.paced_responder import PacedResponder
from highfive.hil.session.session import RATE_HZ, Session, tick_times
from highfive.hil.sim.people.capture import CLEAN
from highfive.hil.sim.scene import Scene
from highfive.hil.trials.partners import Partner, simulated_partner
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.tracking.human_arm import HumanArmEstimator
from highfive.mocap_bridge.tracking.tracker import Tracker
from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.online.reaction import Reaction

PERIOD_NS = 1e9 / RATE_HZ


@pytest.fixture(scope="module")
def person() -> Partner:
    return simulated_partner("angry", "B2", 0, np.random.default_rng(4), CLEAN)


class Counting:
    """A responder that notes what it is asked for."""

    def __init__(self, inner) -> None:
        self.inner, self.steps, self.skipped = inner, [], 0

    def __getattr__(self, name: str):
        return getattr(self.inner, name)

    def step(self, hand, covariance=None, arm=None) -> Reaction:
        self.steps.append(hand)
        return self.inner.step(hand, covariance, arm)

    def skip(self, ticks: int) -> None:
        self.skipped += ticks
        self.inner.skip(ticks)


def paced(model: HGPDM, person: Partner) -> tuple[Counting, PacedResponder, Callable[[MarkerFrame], None]]:
    counting = Counting(open_responder(model, "angry", RATE_HZ))
    arm, tracker = HumanArmEstimator(person.marker_set), Tracker(person.marker_set, RATE_HZ)
    responder = PacedResponder(counting, RATE_HZ, arm)

    def take(frame: MarkerFrame) -> None:
        markers = tracker.update(frame)
        responder.observe(markers, arm(markers))

    return counting, responder, take


@pytest.mark.parametrize("rate", [30.0, 60.0, 90.0, 120.0, 240.0, 500.0])
@pytest.mark.slow
def test_the_model_steps_at_its_own_rate(rate: float, model: HGPDM, person: Partner) -> None:
    counting, _, take = paced(model, person)
    frames = frames_of(person, System(rate), 0, np.random.default_rng(0))[: round(2.0 * rate)]
    for frame in frames:
        take(frame)
    seconds = 1e-9 * (frames[-1].source_time_ns - frames[0].source_time_ns)
    assert len(counting.steps) == pytest.approx(seconds * RATE_HZ + 1.0, abs=1.0)
    assert counting.skipped == 0 and all(hand is not None for hand in counting.steps)


def test_stamps_that_jitter_or_drift_a_little_neither_interpolate_nor_predict(model: HGPDM, person: Partner) -> None:
    counting, responder, take = paced(model, person)
    frames = frames_of(person, System(RATE_HZ, drift_ppm=900.0), 0, np.random.default_rng(0))[:200]
    for number, frame in enumerate(frames):
        take(frame)
        assert len(counting.steps) == number + 1
        assert responder.answer(frame.source_time_ns).ahead == 0.0


def test_after_a_pause_there_is_no_burst_of_steps(model: HGPDM, person: Partner) -> None:
    counting, _, take = paced(model, person)
    frames = frames_of(person, System(), 0, np.random.default_rng(0))
    for frame in frames[:200]:
        take(frame)
    before = len(counting.steps)
    take(frames[260])
    assert counting.skipped == 59 and len(counting.steps) - before == 2 and counting.steps[-2] is None


def test_a_hand_of_which_nothing_is_heard_is_hidden_after_the_patience(model: HGPDM, person: Partner) -> None:
    counting, responder, take = paced(model, person)
    frames = frames_of(person, System(), 0, np.random.default_rng(0))
    for frame in frames[:200]:
        take(frame)
    for ticks in range(1, 30):
        responder.wait(frames[199].source_time_ns + round(ticks * PERIOD_NS))
        hidden = [hand for hand in counting.steps[200:] if hand is None]
        assert len(hidden) == len(counting.steps) - 200 == max(0, ticks - 6)


def test_what_is_answered_between_steps_goes_smoothly_from_one_to_the_next(model: HGPDM, person: Partner) -> None:
    """Ahead of nothing it is the answer itself; a step ahead it is nearer to the next answer than the last one is."""
    _, responder, take = paced(model, person)
    frames = frames_of(person, System(), 0, np.random.default_rng(0))
    nearer, further = [], []
    for frame in frames[240:420]:
        if responder._time_ns is not None:
            ahead, before = responder.answer(frame.source_time_ns), responder.answer(round(responder._time_ns))
            take(frame)
            now = responder.answer(frame.source_time_ns)
            nearer.append(np.abs(ahead.joints - now.joints).max())
            further.append(np.abs(before.joints - now.joints).max())
        else:
            take(frame)
    assert np.mean(nearer) < 0.7 * np.mean(further)


def test_a_session_needs_a_frame_to_begin_with(model: HGPDM, person: Partner, scene: Scene) -> None:
    session = Session(model, {"angry": 1.0}, person.marker_set, scene)
    with pytest.raises(HighFiveError, match="needs a time, and a frame before it"):
        session.step(None, 5)


@pytest.mark.slow
def test_a_session_shown_later_is_the_session_at_that_time(model: HGPDM, person: Partner, scene: Scene) -> None:
    """Predicted over 20 ms, person and palm are nearer to where they will be than the frame has them."""
    session = Session(model, {"angry": 1.0}, person.marker_set, scene)
    frames = frames_of(person, System(), 0, np.random.default_rng(0))
    now = [session.step(frame) for frame in frames]
    session.reset()
    later = [session.step(frame, frame.source_time_ns + 25_000_000) for frame in frames]
    assert all(
        b.time_ns - a.time_ns == 25_000_000 == b.person.time_ns - a.person.time_ns
        for a, b in zip(now, later, strict=True)
    )
    palms = np.array([tick.person.palm.position for tick in now])
    ahead = np.array([tick.person.palm.position for tick in later])
    moving = np.linalg.norm(palms[3:] - palms[:-3], axis=1) > 0.01
    off = np.linalg.norm(ahead[:-3] - palms[3:], axis=1)[moving]
    held = np.linalg.norm(palms[:-3] - palms[3:], axis=1)[moving]
    assert np.mean(off) < 0.35 * np.mean(held)


@pytest.mark.parametrize(("rate", "late_ms"), [(30.0, 45), (60.0, 80), (120.0, 110)])
@pytest.mark.slow
def test_a_source_that_is_late_hides_no_hand(
    rate: float, late_ms: int, model: HGPDM, person: Partner, scene: Scene
) -> None:
    """With ticks in between, the model knows after each frame what it knows of a source that is not late."""
    frames = frames_of(person, System(rate), 0, np.random.default_rng(0))[: round(2.6 * rate)]
    session = Session(model, {"angry": 1.0}, person.marker_set, scene)
    in_time = [session.step(frame).response.contact for frame in frames]
    session.reset()
    late = []
    for frame in frames:
        shown = frame.source_time_ns + late_ms * 1_000_000
        late.append(session.step(frame, shown).response.contact)
        for n in range(1, round(RATE_HZ / rate)):
            session.step(None, shown + round(n * PERIOD_NS))
    for one, other in zip(in_time, late, strict=True):
        assert one is not None and other is not None
        np.testing.assert_array_equal(other.point, one.point)
        np.testing.assert_array_equal(other.covariance, one.covariance)


def test_times_of_ticks_go_on_where_the_clock_of_the_frames_was_set(
    model: HGPDM, person: Partner, scene: Scene
) -> None:
    session = Session(model, {"angry": 1.0}, person.marker_set, scene)
    frames = frames_of(person, System(60.0), 0, np.random.default_rng(0))[:8]
    set_back = [replace(f, source_time_ns=f.source_time_ns - (n > 3) * 32_000_000_000) for n, f in enumerate(frames)]
    steps = np.diff(tick_times([session.step(frame) for frame in set_back]))
    np.testing.assert_allclose(steps, [1 / 60] * 3 + [1 / RATE_HZ] + [1 / 60] * 3, atol=1e-8)
