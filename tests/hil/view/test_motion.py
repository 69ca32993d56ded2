"""What the page draws of the poses that it has (``motion.js`` in Chromium): never a leap, whenever they come."""

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from highfive.hil.bench.drawn import Motions, drawn_bodies, drawn_mm
from highfive.hil.sim.scene import Scene, build_scene
from highfive.hil.view import SHIPPED_RECORDING
from highfive.hil.view.browser import Browser, browser_here
from highfive.hil.view.live_page import LivePage
from highfive.hil.view.recorded import recorded_trials
from highfive.hil.view.wire import PoseMessage
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

pytestmark = pytest.mark.skipif(browser_here() is None, reason="no Chromium here")
FRAME_MS = 1000.0 / 90.0
LATE_MS = 3.0
OFF_M, GAIN = 0.5e-3, 11.0
NOTHING = np.zeros((0, 3)), np.zeros(0, dtype=bool)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return build_scene()


@pytest.fixture(scope="module")
def high_fives(scene: Scene) -> list[Motions]:
    return [Motions(trial.style, trial.times, trial.bodies) for trial in recorded_trials(SHIPPED_RECORDING, scene)]


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with LivePage({"mode": "session"}, port=0) as page, Browser((400, 300)) as opened:
        opened.go(page.address)
        yield opened


def at(place: Array, turn: float = 0.0) -> Array:
    """(1, 7) of a body."""
    return np.concatenate([place, rotations.from_axis_angle("z", turn)])[None]


def message(holds_ms: float, body: Array, time_ms: float | None = None, rate: float = 1.0) -> PoseMessage:
    time_s = 1e-3 * (holds_ms if time_ms is None else time_ms)
    return PoseMessage(0, round(1e6 * holds_ms), 0, 0, rate, time_s, body, *NOTHING)


def pictures(first: float, last: float) -> list[tuple[float, float]]:
    return [(float(now), float(now + FRAME_MS)) for now in np.arange(first, last, FRAME_MS)]


def uneven_times(kind: str, end_ms: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """When ticks are for, ms, and when the page has them."""
    even = np.arange(0.0, end_ms, 1000.0 / 120.0)
    if kind == "even":
        return even, even + LATE_MS
    if kind == "pairs":  # a tick without a frame, and a millisecond later one for the frame that came after all
        late = np.sort(rng.choice(even[5:-1], size=len(even) // 3, replace=False))
        both = np.sort(np.concatenate([even, late + 1.0]))
        return both, both + LATE_MS
    if kind == "jitter":
        moved = np.sort(even + rng.uniform(0.0, 7.0, len(even)))
        moved = moved[np.concatenate([[True], np.diff(moved) > 0.5])]
        return moved, moved + LATE_MS
    # Every 300 ms nothing comes for 70, and then all of it at once, but for what lay in a gap of 40 ms.
    phase = even % 300.0
    kept = even[(phase < 200.0) | (phase >= 240.0)]
    phase = kept % 300.0
    return kept, np.where((phase >= 180.0) & (phase < 250.0), kept - phase + 250.0, kept) + LATE_MS


@pytest.mark.parametrize("kind", ["even", "pairs", "jitter", "bursts"])
@pytest.mark.parametrize("style", ["angry", "happy", "sad"])
def test_a_hand_is_never_drawn_further_off_than_it_moves_meanwhile(
    browser: Browser, high_fives: list[Motions], kind: str, style: str
) -> None:
    """The avatar's hand of a recorded high five, in ticks that are 0.5 mm off as predictions are: what is drawn errs by
    no more than the hand moves, at its quickest, between newest pose and picture, and what becomes of their 0.5 mm.
    """
    rng = np.random.default_rng(5)
    motion = next(one for one in high_fives if one.style == style)
    true = CubicSpline(1e3 * motion.times, motion.bodies[:, 10, :3])
    held, arrives = uneven_times(kind, 1e3 * motion.times[-1] - 50.0, rng)
    off = rng.uniform(-1.0, 1.0, (len(held), 3))
    off *= OFF_M / np.linalg.norm(off, axis=1, keepdims=True)
    sent = [(when, message(time, at(true(time) + one))) for time, one, when in zip(held, off, arrives, strict=True)]
    made = pictures(120.0, held[-1])
    drawn = drawn_bodies(browser, sent, made)[:, 0, :3]
    for place, (now, seen) in zip(drawn, made, strict=True):
        newest = held[arrives <= now].max()
        stretch = np.linspace(newest - 40.0, seen, 40)
        quickest = np.linalg.norm(true(stretch, 1), axis=1).max()  # m/ms
        moved = quickest * max(seen - newest, 1000.0 / 120.0)
        assert np.linalg.norm(place - true(seen)) <= moved + GAIN * OFF_M, (now, newest)
    steps = np.linalg.norm(np.diff(drawn, axis=0), axis=1)
    quickest = np.linalg.norm(true(np.linspace(0.0, held[-1], 2000), 1), axis=1).max()
    longest = max(seen - held[arrives <= now].max() for now, seen in made)
    assert steps.max() <= quickest * (FRAME_MS + longest) + GAIN * OFF_M


def test_of_two_ticks_a_millisecond_apart_their_difference_is_not_taken_for_speed(browser: Browser) -> None:
    sent = [(one + LATE_MS, message(one, at(np.zeros(3)))) for one in np.arange(0.0, 100.0, 1000.0 / 120.0)]
    sent.append((103.0, message(101.0, at(np.array([0.003, 0.0, 0.0])))))
    drawn = drawn_bodies(browser, sent, [(104.0, 124.0)])[0, 0, 0]
    assert 0.0 < drawn < 0.013  # not 3 m/s, which were 72 mm
    alone = [(0.0, message(0.0, at(np.zeros(3)))), (1.0, message(1.0, at(np.array([0.003, 0.0, 0.0]))))]
    assert drawn_bodies(browser, alone, [(2.0, 20.0)])[0, 0, 0] == pytest.approx(0.003)  # too little to go by: held


def test_it_goes_on_for_25_ms_and_then_stands_still_by_the_sessions_time(browser: Browser) -> None:
    steady = [
        (one + LATE_MS, message(one, at(np.array([1e-3 * one, 0.0, 0.0]), 1e-3 * one))) for one in range(0, 104, 8)
    ]
    drawn = drawn_bodies(browser, steady, [(110.0, seen) for seen in (104.0, 112.0, 121.0, 122.0, 1000.0)])[:, 0]
    np.testing.assert_allclose(drawn[:, 0], [0.096 + 0.001 * ahead for ahead in (8, 16, 25, 25, 25)], atol=1e-5)
    turns = [rotations.from_axis_angle("z", 1e-3 * seen) for seen in (104.0, 112.0, 121.0, 121.0, 121.0)]
    np.testing.assert_allclose(np.abs((drawn[:, 3:] * turns).sum(axis=1)), 1.0, atol=1e-7)
    # The same in slow motion: 2 mm in 20 ms, not 20; and ticks that the host began late are as far apart as they say.
    slow = [(8.0 * i + LATE_MS, message(8.0 * i, at(np.array([8e-4 * i, 0.0, 0.0])), 0.8 * i, 0.1)) for i in range(13)]
    assert drawn_bodies(browser, slow, [(110.0, 116.0)])[0, 0, 0] == pytest.approx(96e-4 + 20e-4, abs=1e-5)
    late = [(8.0 * i, message(8.0 * i + (i % 3), at(np.array([8e-3 * i, 0.0, 0.0])), 8.0 * i)) for i in range(13)]
    assert drawn_bodies(browser, late, [(110.0, 106.0)])[0, 0, 0] == pytest.approx(96e-3 + 10e-3, abs=1e-4)


@pytest.mark.slow
def test_what_does_not_go_on_is_drawn_as_it_is(browser: Browser) -> None:
    """After a leap of a recording, in a new high five, at a standstill, and after a long gap."""
    steady = [(8.0 * i, message(8.0 * i, at(np.array([1e-3 * i, 0.0, 0.0])))) for i in range(13)]
    far = at(np.array([5.0, 0.0, 0.0]))
    for holds, time, rate in (
        (104.0, 3000.0, 1.0),
        (104.0, 0.0, 1.0),
        (90.0, 90.0, 1.0),
        (104.0, 104.0, 0.0),
        (300.0, 300.0, 1.0),
    ):
        sent = [*steady, (104.0, message(holds, far, time, rate))]
        assert drawn_bodies(browser, sent, [(105.0, holds + 20.0)])[0, 0, 0] == pytest.approx(5.0), (holds, time, rate)


@pytest.mark.slow
def test_markers_go_with_the_hand_and_one_that_is_hidden_stays_where_it_is(browser: Browser) -> None:
    found = browser.evaluate(
        "import('/motion.js').then(({Motion}) => { const m = new Motion(); for (let i = 0; i < 12; i++)"
        "m.add({holds: 8 * i, time: 0.008 * i, rate: 1, bodies: new Float32Array([0, 0, 0, 1, 0, 0, 0]),"
        "seen: new Uint8Array([1, i !== 9]),"
        "markers: new Float32Array([0.008 * i, 0, 0, 0.008 * i, 0, 0])}); return Array.from(m.at(88 + 16).markers)})"
    )
    np.testing.assert_allclose(found, [0.104, 0.0, 0.0, 0.088, 0.0, 0.0], atol=1e-6)


@pytest.mark.parametrize("fine", [True, False])
@pytest.mark.slow
def test_a_recording_is_drawn_where_it_is(
    browser: Browser, scene: Scene, high_fives: list[Motions], fine: bool
) -> None:
    """Its poses are sent ahead, so nothing is guessed; with ticks of 60 Hz as recorded, and of 120 Hz by splines."""
    if fine:
        high_fives = [finer(one) for one in high_fives]
    for style, found in drawn_mm(browser, scene, high_fives, recorded=True).items():
        assert max(found.values()) <= 1.5, (style, found)


def finer(motion: Motions) -> Motions:
    times = np.arange(0.0, motion.times[-1], 1.0 / 120.0)
    bodies = CubicSpline(motion.times, motion.bodies)(times)
    bodies[..., 3:] /= np.linalg.norm(bodies[..., 3:], axis=-1, keepdims=True)
    return Motions(motion.style, times, bodies)
