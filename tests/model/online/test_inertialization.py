"""A pose that stays smooth: it follows, and where what it follows jumps it gets there without a step in speed."""

import numpy as np
import pytest

from highfive.model.online.inertialization import PEAK, InertializationSettings, Inertializer

DT = 1.0 / 120.0
USUAL = InertializationSettings()


def follow(values: np.ndarray, jumps: set[int]) -> np.ndarray:
    inertializer = Inertializer(DT)
    return np.array([inertializer.step(value, number in jumps) for number, value in enumerate(values)])


def test_without_a_jump_it_says_what_it_is_given() -> None:
    values = np.cumsum(np.random.default_rng(0).normal(size=(50, 3)), axis=0)
    np.testing.assert_array_equal(follow(values, set()), values)


@pytest.mark.parametrize(("offset", "drift"), [(0.2, 0.0), (-0.05, 2.0), (0.3, -1.0)])
def test_a_jump_in_place_and_speed_becomes_a_gentle_way(offset: float, drift: float) -> None:
    times = np.arange(120) * DT
    values = np.stack([np.sin(2.0 * times), np.cos(times)], axis=1)
    values[40:, 0] += offset + drift * (times[40:] - times[40])
    said = follow(values, {40})
    arrived = 40 + USUAL.settling + round(USUAL.longest / DT) + 2
    np.testing.assert_allclose(said[arrived:], values[arrived:], atol=1e-12)
    np.testing.assert_allclose(said[:40], values[:40])
    acceleration = np.abs(np.diff(said[:, 0], n=2)).max() / DT**2
    # The quintic takes offset and drift in turn; what the values do themselves comes on top.
    longest = max(offset, 0.1) * PEAK / USUAL.longest**2
    assert acceleration < 1.5 * max(USUAL.gentle, longest) + 6.0 * abs(drift) / 0.08 + 5.0
    assert np.abs(np.diff(values[:, 0], n=2)).max() / DT**2 > 5.0 * acceleration


def test_a_second_jump_on_the_way_is_taken_as_gently() -> None:
    values = np.zeros((120, 1))
    values[30:38], values[38:] = 0.2, -0.1
    said = follow(values, {30, 38})
    assert np.abs(np.diff(said[:, 0], n=2)).max() / DT**2 < 3.0 * USUAL.gentle
    np.testing.assert_allclose(said[90:], values[90:], atol=1e-12)


def test_settings_reach_it() -> None:
    def said(settings: InertializationSettings) -> np.ndarray:
        inertializer = Inertializer(DT, settings)
        return np.array([inertializer.step(np.full(1, float(n >= 5)), n == 5)[0] for n in range(60)])

    quick, usual = said(InertializationSettings(settling=1, shortest=0.02, longest=0.05)), said(USUAL)
    assert np.argmax(quick == 1.0) + 20 < np.argmax(usual == 1.0)
