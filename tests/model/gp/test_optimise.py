import jax.numpy as jnp
import numpy as np
import pytest

from highfive.model.errors import HighFiveError
from highfive.model.gp.optimise import OPTIMISER, Diverged, Progress, State, fall_at_the_end, minimise


def bowl(vector: jnp.ndarray) -> jnp.ndarray:
    return jnp.sum((vector - jnp.arange(3.0)) ** 2 * jnp.array([1.0, 10.0, 100.0]))


def valley(vector: jnp.ndarray) -> jnp.ndarray:
    """Rosenbrock's function in 6 dimensions: hundreds of steps to its minimum at 1."""
    return jnp.sum(100.0 * (vector[1:] - vector[:-1] ** 2) ** 2 + (1.0 - vector[:-1]) ** 2)


def test_minimise_finds_the_minimum_and_reports_every_step():
    seen: list[Progress] = []
    found, trace = minimise(bowl, jnp.zeros(3), 60, adam_steps=20, progress=seen.append)
    np.testing.assert_allclose(found, np.arange(3.0), atol=1e-4)
    assert [report.iteration for report in seen] == list(range(len(seen)))
    assert [report.objective for report in seen[1:]] == trace
    assert trace[-1] < 1e-6 < trace[0]
    np.testing.assert_allclose(trace[-1], bowl(found), rtol=1e-9)


@pytest.mark.parametrize(("steps", "adam_steps"), [(60, 60), (75, 30), (230, 20)])
def test_a_run_resumed_from_any_of_its_states_takes_the_same_way(steps: int, adam_steps: int):
    states: list[State] = []
    whole, trace = minimise(valley, jnp.full(6, -0.5), steps, adam_steps, keep=states.append)
    assert states
    for state in states:
        seen: list[Progress] = []
        resumed, again = minimise(valley, jnp.zeros(6), steps, adam_steps, progress=seen.append, resume=state)
        np.testing.assert_array_equal(resumed, whole)
        assert again == trace
        assert seen[0].iteration == len(state.trace) > 0


def test_ctrl_c_hands_out_the_last_step(monkeypatch: pytest.MonkeyPatch):
    states: list[State] = []

    def interrupt(report: Progress) -> None:
        if report.iteration == 33:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        minimise(valley, jnp.zeros(6), 60, 60, progress=interrupt, keep=states.append)
    assert [len(state.trace) for state in states] == [20, 33]


def test_a_step_into_the_unusable_is_taken_at_half_the_rate():
    """x − log x has its minimum at 1 and no value below 0, where steps of this length lead from near 1."""
    states: list[State] = []
    slope, start = lambda v: v[0] - jnp.log(v[0]), jnp.array([3.0])
    found, trace = minimise(slope, start, 300, 300, learning_rate=10.0, keep=states.append)
    assert states[-1].rate in [0.5**halvings for halvings in range(1, OPTIMISER.halvings + 1)]
    np.testing.assert_allclose(found, 1.0, atol=0.2)
    assert np.all(np.isfinite(trace))


def test_unusable_start_and_divergence_are_named():
    with pytest.raises(Diverged, match="cannot start: a covariance is not positive definite"):
        minimise(lambda v: jnp.log(v[0]), jnp.array([-1.0]), 5)
    with pytest.raises(HighFiveError, match="diverged after"):
        minimise(lambda v: jnp.log(v[0]), jnp.array([0.3]), 50 * OPTIMISER.halvings, adam_steps=50 * OPTIMISER.halvings)


def test_convergence_is_told_by_the_fall_at_the_end():
    assert fall_at_the_end([]) == fall_at_the_end([1.0]) == 0.0
    assert fall_at_the_end([9.0] * 30) == 0.0
    # The same fall whatever the sign of the objective: from the 18th of 20 values to the last.
    assert fall_at_the_end([*range(40, 20, -1)]) == pytest.approx(2.0 / 21.0)
    assert fall_at_the_end([*range(-20, -40, -1)]) == pytest.approx(2.0 / 39.0)
