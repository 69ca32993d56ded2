from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from model.errors import HighFiveError
from model.hgpdm import HGPDM
from model.optimise import Progress, load_checkpoint, minimise
from model.presets import PAPER
from model.training import train
from model.trials import Trial


def bowl(vector: jnp.ndarray) -> jnp.ndarray:
    return jnp.sum((vector - jnp.arange(3.0)) ** 2 * jnp.array([1.0, 10.0, 100.0]))


def test_minimise_finds_the_minimum_and_reports_every_step():
    seen: list[Progress] = []
    found, trace = minimise(bowl, jnp.zeros(3), 60, adam_steps=20, progress=seen.append)
    np.testing.assert_allclose(found, np.arange(3.0), atol=1e-4)
    assert [report.iteration for report in seen] == list(range(1, len(seen) + 1))
    assert [report.objective for report in seen] == trace
    assert trace[-1] < 1e-6 < trace[0]


def test_resumes_from_a_checkpoint_of_the_same_key_only(tmp_path: Path):
    path = tmp_path / "run.npz"

    class Killed(Exception):
        pass

    def kill(report: Progress) -> None:
        if report.iteration == 45:
            raise Killed

    with pytest.raises(Killed):
        minimise(bowl, jnp.zeros(3), 60, adam_steps=60, progress=kill, checkpoint=path, key="a")
    iteration, vector = load_checkpoint(path, "a", 3) or (0, np.zeros(3))
    assert iteration == 40
    assert float(bowl(jnp.asarray(vector))) < float(bowl(jnp.zeros(3)))
    assert load_checkpoint(path, "b", 3) is None
    seen: list[Progress] = []
    minimise(bowl, jnp.zeros(3), 60, adam_steps=60, progress=seen.append, checkpoint=path, key="a")
    assert seen[0].iteration == 41


def test_broken_checkpoint_is_named(tmp_path: Path):
    path = tmp_path / "run.npz"
    path.write_bytes(b"nonsense")
    with pytest.raises(HighFiveError, match="delete it to start afresh"):
        minimise(bowl, jnp.zeros(3), 5, checkpoint=path, key="a")


def test_unusable_start_and_divergence_are_named():
    with pytest.raises(HighFiveError, match="not positive definite"):
        minimise(lambda v: jnp.log(v[0]), jnp.array([-1.0]), 5)
    with pytest.raises(HighFiveError, match="diverged after"):
        minimise(lambda v: jnp.log(v[0]), jnp.array([0.3]), 50, adam_steps=50)


def test_latents_have_unit_variance_and_both_layers_reconstruct(model: HGPDM, trials: list[Trial]):
    np.testing.assert_allclose(model.interaction_latents.std(axis=0), 1.0, rtol=1e-4)
    assert model.settings["points"] == len(model.trial)
    assert set(np.unique(model.emotion)) == {0, 1}


def test_paper_preset_trains_and_generates(trials: list[Trial]):
    small = replace(PAPER, points=300, adam_steps=40, iterations=45)
    trained = train(trials, small, inducing=25)
    assert len(trained.back) == 2
    assert trained.interaction_latents.shape[1] == 3
    neutral = np.array([1.0, 0.0])
    generated = trained.generate(trained.interaction_latents.astype(float), neutral)[:, : trained.joints]
    recorded = np.concatenate([t.joints for t in trials if t.emotion == "neutral" and not t.test])
    # Hardly trained: it stays within the range in which the joints move.
    assert np.abs(generated.mean(axis=0) - recorded.mean(axis=0)).max() < np.ptp(recorded, axis=0).max() / 2
    assert generated.std() > 0.5 * recorded.std()


def test_too_few_inducing_inputs_are_named(trials: list[Trial]):
    with pytest.raises(HighFiveError, match="at least 2"):
        train(trials, inducing=1)
