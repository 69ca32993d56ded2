from dataclasses import replace

import numpy as np
import pytest

from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.dataset import CLOCK_SCALE, Channels, hand_history, output_channels, training_set
from highfive.model.hgpdm.features import fit_feature_map
from highfive.model.hgpdm.presets import DEFAULT, PAPER, preset_named
from highfive.model.hgpdm.trials import Trial


def resampled(trial: Trial, rate_hz: float) -> Trial:
    """The same motion at another rate."""
    old = np.arange(len(trial.joints)) / trial.rate_hz
    new = np.arange(0.0, old[-1] + 1e-9, 1.0 / rate_hz)

    def interpolate(values: np.ndarray) -> np.ndarray:
        flat = values.reshape(len(values), -1)
        return np.stack([np.interp(new, old, column) for column in flat.T], axis=1).reshape(-1, *values.shape[1:])

    arrays = {
        name: interpolate(getattr(trial, name)) for name in ("hand_points", "joints", "root", "palm", "person_palm")
    }
    contact = round(trial.contact_frame / trial.rate_hz * rate_hz)
    return replace(trial, rate_hz=rate_hz, contact_frame=contact, **arrays)


@pytest.mark.parametrize("rate_hz", [15.0, 30.0, 120.0])
def test_history_and_channels_do_not_depend_on_the_frame_rate(trials: list[Trial], rate_hz: float):
    times, lags = np.linspace(0.3, 2.0, 12), (0.1, 0.2)
    other = resampled(trials[0], rate_hz)
    history = hand_history(trials[0], times, lags)
    np.testing.assert_allclose(hand_history(other, times, lags), history, atol=0.01)
    got, expected = output_channels(other, times), output_channels(trials[0], times)
    clock = Channels(trials[0].joints.shape[1]).clock
    np.testing.assert_allclose(np.delete(got, clock, axis=1), np.delete(expected, clock, axis=1), atol=0.06)
    # The contact lies on a frame: half a frame of rounding at either rate.
    np.testing.assert_allclose(got[:, clock], expected[:, clock], atol=(0.5 / rate_hz + 0.5 / 60.0) / CLOCK_SCALE)


def test_channels_hold_clock_and_contact_point(trials: list[Trial]):
    trial = trials[0]
    where = Channels(trial.joints.shape[1])
    contact = trial.contact_frame / trial.rate_hz
    outputs = output_channels(trial, np.array([contact - 0.2, contact, contact + 0.2]))
    assert outputs.shape[1] == where.size
    np.testing.assert_allclose(CLOCK_SCALE * np.arctanh(outputs[:, where.clock]), [0.2, 0.0, -0.2], atol=1e-12)
    np.testing.assert_allclose(outputs[:, where.contact], np.tile(trial.palm[trial.contact_frame], (3, 1)))
    np.testing.assert_allclose(outputs[1, where.palm], trial.palm[trial.contact_frame])
    np.testing.assert_allclose(outputs[1, where.root], trial.root[trial.contact_frame])


def test_held_out_trials_are_never_learned_from(trials: list[Trial]):
    data = training_set(trials, DEFAULT)
    assert data.trial.max() + 1 == sum(not trial.test for trial in trials)
    spoiled = [replace(t, joints=t.joints + 100.0) if t.test else t for t in trials]
    assert training_set(spoiled, DEFAULT).data_hash == data.data_hash


def test_points_follow_the_preset_and_mixed_rates_work(trials: list[Trial]):
    mixed = [resampled(t, rate) for t, rate in zip(trials, (15.0, 30.0, 60.0, 120.0) * 3, strict=True)]
    data = training_set(mixed, replace(DEFAULT, points=200))
    assert 150 <= len(data.outputs) <= 260
    assert np.all(data.styles.sum(axis=1) == 1.0)


def test_feature_map_is_the_hand_and_its_differences():
    history = np.random.default_rng(0).normal(size=(50, 3, 6))
    features = fit_feature_map(history)(history)
    assert features.shape == (50, 18)
    expected = np.concatenate([history[:, 0], history[:, 0] - history[:, 1], history[:, 0] - history[:, 2]], axis=1)
    for block in range(3):
        part = slice(6 * block, 6 * block + 6)
        ratio = (features[:, part] - features[:, part].mean(0)) / (expected[:, part] - expected[:, part].mean(0))
        np.testing.assert_allclose(ratio, ratio[0, 0], rtol=1e-9)
        assert np.isclose(np.sqrt(np.mean(features[:, part].var(axis=0))), 1.0)


def broken(trial: Trial, **changes: object) -> list[Trial]:
    return [replace(trial, **changes)]


def shortened(trial: Trial, frames: int) -> list[Trial]:
    arrays = {name: getattr(trial, name)[:frames] for name in ("hand_points", "joints", "root", "palm")}
    return broken(trial, contact_frame=frames // 2, **arrays)


def trembling(points: np.ndarray) -> np.ndarray:
    return points[:1] + np.random.default_rng(0).normal(scale=0.001, size=points.shape)


def still(trial: Trial, name: str, value: float) -> Trial:
    return replace(trial, **{name: np.full_like(getattr(trial, name), value)})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: [], "no training trials"),
        (lambda t: broken(t, test=True), "no training trials"),
        (lambda t: broken(t, joints=np.where(t.joints == t.joints[3, 2], np.nan, t.joints)), "joints holds NaN"),
        (lambda t: broken(t, hand_points=t.hand_points[:5]), "expected \\(5, 9\\)"),
        (lambda t: broken(t, contact_frame=9999), "contact frame 9999"),
        (lambda t: broken(t, rate_hz=5.0), "5 frames per second"),
        (lambda t: broken(t, hand_points=np.ones_like(t.hand_points)), "hand never moves"),
        (lambda t: broken(t, joints=np.ones_like(t.joints)), "actor never moves"),
        (lambda t: [still(t, "hand_points", 0.0), still(t, "hand_points", 1.0)], "hand never moves"),
        (lambda t: broken(t, hand_points=trembling(t.hand_points)), "hand never moves"),
        (lambda t: broken(t, palm=trembling(t.palm)), "actor never moves"),
        (lambda t: [still(t, "joints", 0.0), still(t, "joints", 1.0)], "actor never moves"),
        (lambda t: shortened(t, 20), "at least 50"),
        (lambda t: broken(t, hand_points=1e3 * t.hand_points), "hand_points reaches .* millimetres"),
        (lambda t: broken(t, joints=np.degrees(t.joints)), "joints reaches .* degrees"),
        (lambda t: broken(t, emotion="bored"), "emotion bored"),
    ],
)
def test_bad_trials_are_named(trials: list[Trial], change, message: str):
    with pytest.raises(HighFiveError, match=message):
        training_set(change(trials[0]), DEFAULT, ["neutral"])


def test_latents_step_from_point_to_point(trials: list[Trial]):
    data = training_set(trials, replace(PAPER, points=240))
    assert np.isclose(data.lag, 2.4 * 10 / 240, rtol=0.05)


def test_unknown_preset_is_named():
    with pytest.raises(HighFiveError, match="default, paper"):
        preset_named("best")
