"""A reach of the least jerk is foreseen from its first part; a palm at rest is where it is."""

import numpy as np
import pytest
from made_up import reach

from highfive.model.evaluation.minimum_jerk import reach_end

RATE = 120.0
START, END = np.array([0.3, -0.2, 0.9]), np.array([0.1, 0.1, 1.4])


def palm(duration: float) -> np.ndarray:
    """Still for 0.5 s, then the reach."""
    times = np.arange(0.0, 0.5 + duration, 1.0 / RATE)
    return START + (END - START) * reach((times - 0.5) / duration)[:, None]


@pytest.mark.parametrize("duration", [0.5, 0.8, 1.2])
def test_where_and_when_a_smooth_reach_ends_is_known_at_three_quarters_of_it(duration: float) -> None:
    seen = round((0.5 + 0.75 * duration) * RATE)
    end, left = reach_end(palm(duration)[: seen + 1], RATE)
    assert np.linalg.norm(end - END) < 0.11 and left == pytest.approx(0.25 * duration, abs=0.08)


def test_at_rest_and_after_the_longest_reach_it_stays() -> None:
    still = np.tile(START, (50, 1))
    assert np.array_equal(reach_end(still, RATE)[0], START) and reach_end(still, RATE)[1] == 0.0
    on = START + np.linspace(0.0, 2.0, 400)[:, None] * np.array([1.0, 0.0, 0.0])  # 3.3 s, on and on
    end, left = reach_end(on, RATE)
    assert np.allclose(end, on[-1]) and left == 0.0
