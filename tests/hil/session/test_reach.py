"""The reach: it comes to contact from whatever is forecast, smoothly, and lets go again."""

from itertools import pairwise

import numpy as np
import pytest

from highfive.hil.session.reach import Expectation, Phase, Reach, ReachTarget
from highfive.hil.session.reach_settings import ReachSettings
from highfive.hil.sim.profiles import minimum_jerk
from highfive.mocap_bridge.frames import PalmPose

DT = 1.0 / 120.0
OUT = np.array([1.0, 0.0, 0.0])
UP = np.array([0.0, 0.0, 1.0])
SHOULDER = np.array([0.0, -0.19, 1.43])


def palm(position: np.ndarray, normal: np.ndarray, velocity: np.ndarray = np.zeros(3)) -> PalmPose:  # noqa: B008
    return PalmPose(position, normal, UP, velocity)


def run(
    clock_error: float = 0.0,
    deviation: float = 0.05,
    clock_gain: float = 1.0,
    miss: float = 0.04,
    hidden: slice = slice(0, 0),
    noise: float = 0.0,
) -> tuple[list[ReachTarget], np.ndarray, np.ndarray, int]:
    """Two hands that meet at 1.5 s but for a miss; the clock is off by an error and a factor."""
    rng = np.random.default_rng(0)
    times = np.arange(0.0, 3.0, DT)
    contact = 1.5
    progress = minimum_jerk((times - 0.5) / 1.05) - minimum_jerk((times - 1.6) / 1.0)
    generated = np.array([0.1, -0.2, 0.9]) + progress[:, None] * np.array([0.4, 0.2 + miss, 0.5])
    person = np.array([1.0, 0.2, 0.9]) + progress[:, None] * np.array([-0.5, -0.2, 0.5])
    velocity = np.gradient(person, DT, axis=0)
    person = person + noise * rng.normal(size=person.shape)
    reach, targets = Reach(), []
    for i, t in enumerate(times):
        seen = not hidden.start <= i < hidden.stop if hidden.stop else True
        clock = clock_gain * (contact - t) + clock_error
        targets.append(
            reach.step(
                palm(generated[i], OUT),
                palm(person[i], -OUT, velocity[i]) if seen else None,
                Expectation(float(clock), deviation, True),
                SHOULDER,
                DT,
            )
        )
    return targets, generated, person, round(contact / DT)


def touches(targets: list[ReachTarget]) -> list[int]:
    return [i for i, target in enumerate(targets) if target.phase is Phase.TOUCH]


@pytest.mark.parametrize("error", [-0.15, -0.05, 0.0, 0.05, 0.15])
def test_palms_meet_once_near_the_time_whatever_the_clock_says(error: float) -> None:
    targets, _, person, contact = run(clock_error=error)
    frames = touches(targets)
    assert frames
    assert frames[-1] - frames[0] + 1 == len(frames)
    assert abs(frames[0] - contact) < 0.2 / DT
    for i in frames:
        np.testing.assert_allclose(targets[i].position, person[i], atol=1e-9)


@pytest.mark.parametrize("gain", [0.5, 2.0])
def test_a_clock_that_runs_wrong_is_survived(gain: float) -> None:
    targets, _, _, contact = run(clock_gain=gain)
    assert touches(targets)
    assert abs(touches(targets)[0] - contact) < 0.25 / DT


def test_a_clock_that_does_not_know_is_survived() -> None:
    times = touches(run(clock_gain=0.0, clock_error=0.2, deviation=2.0)[0])
    assert times  # the palms come close enough for the nearest approach to count


def test_weight_rises_and_falls_smoothly_and_the_rest_is_untouched() -> None:
    targets, generated, _, _ = run()
    weight = np.array([t.weight for t in targets])
    assert weight[0] == weight[-1] == 0.0
    assert weight.max() == 1.0
    peak = int(np.argmax(weight))
    assert np.all(np.diff(weight[: peak + 1]) >= -1e-12)
    assert np.abs(np.diff(weight)).max() < 0.08
    idle = weight == 0.0
    np.testing.assert_array_equal(np.array([t.position for t in targets])[idle], generated[idle])


@pytest.mark.parametrize("noise", [0.0, 0.0001])
def test_target_never_jumps(noise: float) -> None:
    targets, generated, _, _ = run(noise=noise)
    position = np.array([t.position for t in targets])
    correction = position - generated
    assert np.abs(np.diff(correction, axis=0)).max() < 0.012
    landed = touches(targets)[0]
    closing = np.linalg.norm(np.diff(correction[: landed + 1], n=2, axis=0), axis=1).max() / DT
    assert closing < 0.35  # m/s from tick to tick


def test_normal_turns_to_face_the_person() -> None:
    reach = Reach(ReachSettings())
    tilted = np.array([np.cos(0.3), np.sin(0.3), 0.0])
    person = palm(np.array([0.5, 0.0, 1.4]), -OUT)
    for i in range(120):
        target = reach.step(
            palm(np.array([0.48, 0.0, 1.4]), tilted), person, Expectation(0.4 - i * DT, 0.05, True), SHOULDER, DT
        )
        if target.phase is Phase.TOUCH:
            break
    np.testing.assert_allclose(target.normal, OUT, atol=1e-9)


def test_a_person_who_vanishes_in_the_reach_is_met_where_the_miss_was_last_seen() -> None:
    targets, generated, _, _ = run(hidden=slice(150, 175))
    assert touches(targets)
    correction = np.array([t.position for t in targets]) - generated
    assert np.abs(np.diff(correction, axis=0)).max() < 0.03


def test_a_palm_waits_for_a_hand_that_is_too_quick_to_say_where_it_is() -> None:
    """The clock says now; the hand goes on for half a second, then stands still, and is met there."""
    speed, stop = np.array([0.0, 0.4, 0.0]), 120
    touched = {}
    for name, settings in (("usual", ReachSettings()), ("waits", ReachSettings(quickest=0.3, waiting=0.2))):
        reach, generated = Reach(settings), palm(np.array([0.48, 0.0, 1.4]), OUT)
        for i in range(240):
            moving = i < stop
            place = np.array([0.5, 0.0, 1.4]) - (max(stop - i, 0) * DT) * speed
            person = palm(place, -OUT, speed if moving else np.zeros(3))
            target = reach.step(generated, person, Expectation(max(0.4 - i * DT, 0.0), 0.05, True), SHOULDER, DT)
            if target.phase is Phase.TOUCH and name not in touched:
                touched[name] = i, float(np.linalg.norm(target.position - np.array([0.5, 0.0, 1.4])))
            assert target.weight < 0.8 or not moving or name == "usual"
    assert touched["usual"][0] < stop < touched["waits"][0] < stop + round(0.5 / DT)
    assert touched["usual"][1] > 0.1 and touched["waits"][1] < 1e-6


@pytest.mark.parametrize("speed", [0.02, 0.08])
def test_a_hand_that_creeps_up_is_not_met_before_its_time(speed: float) -> None:
    """Palms touch within 2 mm: at 8 cm/s that is early, unless the other one closes in the quicker. That they touch is
    what comes at its time; that they lie on each other comes after."""
    early, end = {}, 60
    settings_of = {"timed": ReachSettings(), "held back": ReachSettings(touching=0.0)}
    settings_of |= {"not": ReachSettings(closing=0.0, touching=0.0)}
    for name, settings in settings_of.items():
        reach, generated = Reach(settings), palm(np.array([0.47, 0.0, 1.4]), OUT)
        gaps = []
        for i in range(end + 1):
            person = palm(np.array([0.5 + (end - i) * DT * speed, 0.0, 1.4]), -OUT, -speed * OUT)
            target = reach.step(generated, person, Expectation((end - i) * DT, 0.03, True), SHOULDER, DT)
            gaps.append(float(person.position[0] - target.position[0]))
        assert abs(gaps[-1]) < (settings.touching or 1e-6)
        person = palm(np.array([0.5, 0.0, 1.4]), -OUT)
        later = [reach.step(generated, person, Expectation(0.0, 0.03, True), SHOULDER, DT) for _ in range(8)]
        assert abs(person.position[0] - later[-1].position[0]) < 1e-6
        assert min(gaps) > -1e-6  # never into the hand
        assert np.diff(gaps[30:]).max() < 1e-6  # nor back from it
        early[name] = sum(gap < 0.002 for gap in gaps[:-1])
    assert early["timed"] <= round(0.01 / DT) < early["held back"] <= round(0.025 / DT) < early["not"]


def test_nobody_there_nothing_happens() -> None:
    reach = Reach()
    for _ in range(200):
        target = reach.step(palm(np.zeros(3), OUT), None, Expectation(0.1, 0.05, True), SHOULDER, DT)
        assert target.phase is Phase.IDLE
        assert target.weight == 0.0


def test_hands_that_stay_together_do_not_touch_again_and_again() -> None:
    reach, phases = Reach(), []
    for i in range(600):
        target = reach.step(
            palm(np.array([0.5, 0, 1.4]), OUT),
            palm(np.array([0.52, 0, 1.4]), -OUT),
            Expectation(0.5 - i * DT, 0.05, True),
            SHOULDER,
            DT,
        )
        phases.append(target.phase)
    starts = sum(a is not Phase.TOUCH and b is Phase.TOUCH for a, b in pairwise(phases))
    assert starts == 1


def test_an_unfamiliar_hand_is_met_where_it_can_be_reached() -> None:
    """A person walks by with a raised hand while the model knows nothing."""
    reach, touched = Reach(), []
    hanging = palm(np.array([0.0, -0.25, 0.75]), OUT)
    for i in range(240):
        position = np.array([0.45, 1.2 - i * DT, 1.6])
        target = reach.step(
            hanging, palm(position, -OUT, np.array([0.0, -1.0, 0.0])), Expectation(0.0, 9.0, False), SHOULDER, DT
        )
        if target.phase is Phase.TOUCH:
            np.testing.assert_allclose(target.position, position, atol=1e-9)
            touched.append(np.linalg.norm(position - SHOULDER))
    assert touched
    assert max(touched) < 0.62


@pytest.mark.parametrize("position", [np.array([0.45, 0.0, 0.8]), np.array([1.6, 0.0, 1.6])])
def test_an_unfamiliar_hand_that_hangs_or_is_far_is_left_alone(position: np.ndarray) -> None:
    reach = Reach()
    for _ in range(100):
        target = reach.step(
            palm(np.array([0.0, -0.25, 0.75]), OUT), palm(position, -OUT), Expectation(0.0, 9.0, False), SHOULDER, DT
        )
        assert target.phase is Phase.IDLE


@pytest.mark.parametrize("late", [0.03, 0.08, 0.1, 0.2, 0.5])
def test_a_tick_that_was_late_throws_no_hand(late: float) -> None:
    """A computer that stood still in mid-approach: the palm is led no further than it would be anyway."""
    times = np.concatenate([np.arange(0.0, 1.2, DT), 1.2 + late + np.arange(0.0, 1.0, DT)])
    progress = minimum_jerk((times - 0.5) / 1.05)
    generated = np.array([0.1, -0.2, 0.9]) + progress[:, None] * np.array([0.4, 0.24, 0.5])
    person = np.array([1.0, 0.2, 0.9]) + progress[:, None] * np.array([-0.5, -0.2, 0.5])
    velocity, steps = np.gradient(person, times, axis=0), np.diff(times, prepend=-DT)
    reach = Reach()
    for i, t in enumerate(times):
        clock = Expectation(1.5 - float(t), 0.05, True)
        target = reach.step(
            palm(generated[i], OUT), palm(person[i], -OUT, velocity[i]), clock, SHOULDER, float(steps[i])
        )
        aimed = target.position - generated[i]
        assert np.linalg.norm(aimed) < 0.15, (t, aimed)
