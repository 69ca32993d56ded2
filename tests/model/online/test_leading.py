"""The palm is led where the forecast says, smoothly, and only while somebody comes."""

import numpy as np
import pytest

from highfive.hil.sim.avatar import avatar_arm
from highfive.model.geometry.arm_chain import palm_and_slope
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.dataset import CLOCK_SCALE, Channels
from highfive.model.hgpdm.task_space import APART, KNOTS, TaskSpace, time_weights
from highfive.model.online.contact_forecast import ContactForecast
from highfive.model.online.leading import Leading

RATE = 120.0
CHAIN, WHERE = avatar_arm(), Channels(159)
SIZE = 3 + 3 * len(CHAIN.joints)
SPACE = TaskSpace(CHAIN, 0.02 * np.eye(SIZE), np.stack([np.full(len(KNOTS), 0.25), np.linspace(0.5, 0.1, len(KNOTS))]))


def pose(time: float) -> Array:
    """Channels some time before contact, whose palm is generated as it is by the joints."""
    channels = np.zeros(WHERE.size)
    channels[: WHERE.joints] = 0.2 * np.random.default_rng(0).normal(size=WHERE.joints)
    channels[WHERE.root] = [0.0, 0.0, 0.95]
    channels[WHERE.clock] = np.tanh(time / CLOCK_SCALE)
    channels[WHERE.palm] = palm_of(channels)
    channels[WHERE.contact] = palm_of(channels) + np.array([0.2, 0.0, 0.1])
    return channels


def palm_of(channels: Array) -> Array:
    turns = channels[: WHERE.joints].reshape(-1, 3)[CHAIN.joints]
    return palm_and_slope(CHAIN, np.ascontiguousarray(channels[WHERE.root]), turns)[0]


def forecast(channels: Array, time: float) -> ContactForecast:
    return ContactForecast(channels[WHERE.contact] + np.array([0.03, -0.05, 0.02]), time, 1e-4 * np.eye(4))


def test_the_palm_comes_to_where_the_learned_functions_say() -> None:
    leading, channels = Leading(SPACE, WHERE, RATE), pose(0.2)
    said = forecast(channels, 0.1)
    for _ in range(100):
        led = leading.step(channels, said)
    first, second = SPACE.slopes @ time_weights(np.array([0.15]))[0]
    palm = channels[WHERE.palm]
    expected = palm + first * (said.point - channels[WHERE.contact]) + second * (said.point - palm)
    assert np.linalg.norm(expected - palm) > 0.05
    np.testing.assert_allclose(palm_of(led), expected, atol=2e-3)
    others = np.setdiff1d(np.arange(WHERE.size), leading._columns)
    np.testing.assert_array_equal(led[others], channels[others])


@pytest.mark.parametrize(
    ("clock", "time"), [(0.2, None), (0.9, 0.8), (-0.45, -0.4), (0.2, 0.2 + 1.01 * APART)],
    ids=["nobody seen", "too early", "past", "clock and forecast apart"],
)  # fmt: skip
def test_nobody_comes(clock: float, time: float | None) -> None:
    leading, channels = Leading(SPACE, WHERE, RATE), pose(clock)
    for _ in range(20):
        led = leading.step(channels, None if time is None else forecast(channels, time))
    np.testing.assert_array_equal(led, channels)


def test_it_comes_and_goes_without_a_jump() -> None:
    leading, channels = Leading(SPACE, WHERE, RATE), pose(0.2)
    said = [None] * 5 + [forecast(channels, 0.2)] * 60 + [None] * 60
    palms = np.array([palm_of(leading.step(channels, one)) for one in said])
    largest = np.linalg.norm(palms - palms[0], axis=1).max()
    speed = np.linalg.norm(np.diff(palms, axis=0), axis=1)
    assert speed.max() < 0.15 * largest
    np.testing.assert_allclose(palms[-1], palms[0], atol=1e-3)
    leading.reset()
    assert not np.any(leading.change)


def test_weights_of_the_time_are_those_of_linear_interpolation() -> None:
    values = np.random.default_rng(1).normal(size=len(KNOTS))
    times = np.linspace(-1.0, 1.5, 101)
    np.testing.assert_allclose(time_weights(times) @ values, np.interp(times, KNOTS, values), atol=1e-12)
