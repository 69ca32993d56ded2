"""A trained model adapted to a few trials of another laboratory: body, tempo and style move, the rest is prior.

Hyperparameters and back projections are the trained model's. What moves, in this order:

- the body: each joint channel by an offset and a gain, since another actor stands otherwise, and a solver of other
  markers leaves joints still that moved before;
- the avatar layer, from X¹ and style to the channels, and the contact layer, from the hand to way and time left: the
  trained posterior, to the power of a share, is the prior of the new points (model/gp/streaming.py);
- how sure the model is: the channels' noise, and the contact layer's calibration, by trials left out in turn.

The shares are chosen by those trials, too; what answers them no better for having moved stays as it was. Nothing is
optimised step by step: it takes seconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.gp import sparse
from highfive.model.gp.posterior import Posterior
from highfive.model.gp.streaming import Evidence, evidence, function_variance, means, updated
from highfive.model.hgpdm.arm_features import arm_history, have_arms, with_arms
from highfive.model.hgpdm.contact_layer import ArmContactLayer, ContactLayer, pooled
from highfive.model.hgpdm.contact_places import contact_places
from highfive.model.hgpdm.contact_training import approaches, calibration, knuckle_speed, precision
from highfive.model.hgpdm.dataset import hand_history, training_set
from highfive.model.hgpdm.pose_ensemble import HIERARCHY
from highfive.model.hgpdm.pose_ensemble_training import direct_answers
from highfive.model.hgpdm.tempo import tempo_history
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Trial
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class AdaptationSettings(Settings):
    """How far a few trials move a model.

    Chosen on five trials a style of a simulated laboratory (other people, a fifth slower) and of one whose people come
    walking; counts and shares by hand, on a coarse grid (docs/decisions/2026-11-27-few-trials.md).
    """

    shares: tuple[float, ...] = setting((1.0, 0.1, 0.01), least=0.0, most=1.0)
    """Of what was learned that may still hold; trials left out say which."""
    counts: float = setting(0.2, above=0.0, most=1.0)
    """Of each of the avatar layer's points: those of a trial err together."""
    contact_counts: float = setting(0.1, above=0.0, most=1.0)
    """The same of the contact layer's, of which there are thrice as many a second."""
    gain: float = setting(1.0, above=0.0)
    """Deviation of a joint's gain from 1 that is expected beforehand."""
    worth: float = setting(0.02, above=0.0, most=1.0)
    """Share of the error of trials left out that a part has to lose by moving: else it stays as it was."""
    inducing: int = setting(60, least=0)
    """Points of each layer that become inducing inputs, too."""
    folds: int = setting(5, least=2)
    """Of trials, left out in turn; each trial alone where there are fewer."""


ADAPTATION = AdaptationSettings()


@dataclass(frozen=True)
class Adaptation:
    """What moved, and by how much: root mean squares over the new trials' points.

    Attributes:
        trials: new trials.
        emotions: their styles; the model keeps all that it had.
        share, contact_share, arm_share: what still holds of the avatar, of the contact layer and of that of the whole
            arm; None where there is none.
        body: rad, the mean pose.
        gain: median over the joint channels that moved before.
        pose: rad, generated joint channels, the body's move included.
        palm: m, of each style, the palm as generated directly.
        contact_point, time: m and s, the forecast's mean move; 0 where the model has no contact layer.
        left_out: error of each of these at trials left out, of the model as it was and adapted: rad, m, m and s.
        kept: which parts stay as they were, since adapting them brings nothing at trials left out: ``pose``,
            ``forecast``, ``arm``.
    """

    trials: int
    emotions: tuple[str, ...]
    share: float
    contact_share: float
    arm_share: float | None
    body: float
    gain: float
    pose: float
    palm: dict[str, float]
    contact_point: float
    time: float
    left_out: dict[str, tuple[float, float]]
    kept: tuple[str, ...]


class _Points(NamedTuple):
    """Inputs (N, q), values (N, D), counts (N,), style weights (N, K) or None, and the trial (N,) of each."""

    inputs: Array
    values: Array
    counts: Array
    styles: Array | None
    trial: NDArray[np.int64]

    def of(self, rows: NDArray[np.bool_]) -> _Points:
        styles = None if self.styles is None else self.styles[rows]
        return _Points(self.inputs[rows], self.values[rows], self.counts[rows], styles, self.trial[rows])


class _Layer(NamedTuple):
    """A trained layer, what it has seen, and how many of its first channels are joints, which have offset and gain."""

    posterior: Posterior
    seen: Evidence
    joints: int


class _Chosen(NamedTuple):
    """The adapted layer, its share, the errors (N, D) and function variances (N,) of trials left out, None of one; and
    whether it moved at all."""

    posterior: Posterior
    share: float
    error: Array | None
    variance: Array | None
    moved: bool = True

    def of(self, rows: NDArray[np.bool_]) -> _Chosen:
        if self.error is None or self.variance is None:
            return self
        return self._replace(error=self.error[rows], variance=self.variance[rows])


def adapt(
    model: HGPDM, trials: Sequence[Trial], seed: int = 0, settings: AdaptationSettings = ADAPTATION
) -> tuple[HGPDM, Adaptation]:
    """Adapts a trained model to the trials that are not held out.

    Args:
        model: of the same skeleton; its styles stay, also those that the trials do not show.
        trials: new trials, of styles that the model has.
        seed: of the choice of further inducing inputs.
        settings: how far it may move.

    Raises:
        HighFiveError: a style that the model has not, other joints, too little data, or a model without learned back
            projections.
    """
    learned = [trial for trial in trials if not trial.test]
    _check(model, learned)
    avatar_points, answered = _avatar_points(model, learned, settings)
    avatar = _adapted(_layer(model.avatar, model.joints), avatar_points, answered, seed, settings)
    contact, arm, contact_points, forecast, by_arm = None, None, None, None, None
    if model.contact is not None:
        contact_points = _contact_points(model, learned, settings)
        speed, _, _ = approaches(learned, knuckle_speed)
        told = _means(model.contact.posterior, contact_points) - contact_points.values
        forecast = _adapted(_layer(model.contact.posterior, 0), contact_points, told, seed, settings)
        contact = model.contact
        if forecast.moved:
            contact = ContactLayer(forecast.posterior, _calibration(model.contact, contact_points, speed, forecast))
        if model.arm_contact is not None and have_arms(learned):
            features, layer = model.arm_contact.features, model.arm_contact.layer
            armed = with_arms(learned)
            rows, known = np.isin(contact_points.trial, armed), [learned[index] for index in armed]
            inputs = features(*(approaches(known, look)[0] for look in (arm_history, tempo_history)))
            points = contact_points.of(rows)._replace(inputs=inputs)
            points = points._replace(trial=np.searchsorted(armed, points.trial))
            told = _means(layer.posterior, points) - points.values
            by_arm = _adapted(_layer(layer.posterior, 0), points, told, seed, settings)
            share, arm = model.arm_contact.share, model.arm_contact
            if by_arm.moved or forecast.moved:
                both = _calibration(layer, points, speed[rows], by_arm, (forecast.of(rows), share))
                arm = ArmContactLayer(features, ContactLayer(by_arm.posterior, both), share)
    posterior = _with_noise(avatar, avatar_points) if avatar.moved else model.avatar
    about: dict[str, object] = {"adapted_from": model.data_hash, "adapted_trials": len(learned), "share": avatar.share}
    if forecast is not None:
        about["contact_share"] = forecast.share
    if by_arm is not None:
        about["arm_share"] = by_arm.share
    adapted = replace(
        model,
        avatar=posterior,
        contact=contact,
        arm_contact=arm,
        places=contact_places(learned, seed) if forecast is None or forecast.moved else model.places,
        ensemble=None if avatar.moved else model.ensemble,  # it answers as the trials of before do
        data_hash=training_set(learned, model.preset).data_hash,
        settings=model.settings | about,
    )
    return adapted, _moved(model, adapted, learned, avatar, avatar_points, answered, forecast, contact_points, by_arm)


def _check(model: HGPDM, trials: Sequence[Trial]) -> None:
    if not model.preset.back_constrained:
        raise HighFiveError(
            f"a model of preset {model.preset.name} has no back projections to carry over; "
            "adapt one of preset default, or train without --from"
        )
    if not trials:
        raise HighFiveError("no training trials; give at least one trial whose split is 'train'")
    if unknown := sorted({trial.emotion for trial in trials} - set(model.emotions)):
        raise HighFiveError(
            f"trials of emotion {', '.join(unknown)}, but the model to adapt knows {', '.join(model.emotions)}; "
            "rename them in trials.csv, or train without --from"
        )
    if other := next((t for t in trials if t.joints.shape[1] != model.joints), None):
        raise HighFiveError(f"trials of {other.joints.shape[1]} joint channels; the model has {model.joints}")


def _avatar_points(model: HGPDM, trials: Sequence[Trial], settings: AdaptationSettings) -> tuple[_Points, Array]:
    """Each point twice, as the layer is trained: at X¹ projected back from the hand, and at what I gives of it. Beside
    them the errors (N, D) of the model's whole answer there, as it is."""
    data = training_set(trials, replace(model.preset, points=1))
    numbers: list[int] = np.argmax(data.styles, axis=1).tolist()
    names = [data.emotions[number] for number in numbers]
    styles = np.eye(len(model.emotions))[[model.emotions.index(name) for name in names]]
    dims, latent = model.preset.interaction_dims, model.back_project(data.history)
    reached = np.asarray(sparse.means(model.interaction, latent[:, :dims]))[:, : model.preset.avatar_dims]
    counts = np.full(2 * len(latent), 0.5 * settings.counts)
    inputs = np.concatenate([latent[:, dims:], reached])
    points = _Points(inputs, np.tile(data.outputs, (2, 1)), counts, np.tile(styles, (2, 1)), np.tile(data.trial, 2))
    answer = _means(model.avatar, points)
    if model.ensemble is not None:
        features = np.tile(np.asarray(model.feature_map(data.history)), (2, 1))
        direct, trust = direct_answers(model.ensemble, features, np.tile(styles, (2, 1)))
        answer += trust[:, None] * (direct - (1.0 - HIERARCHY) * answer)
    return points, answer - points.values


def _contact_points(model: HGPDM, trials: Sequence[Trial], settings: AdaptationSettings) -> _Points:
    seen, left, number = approaches(trials, lambda trial, times: hand_history(trial, times, model.preset.history))
    counts = settings.contact_counts * precision(left[:, 3])
    return _Points(np.asarray(model.feature_map(seen)), left, counts, None, number)


def _calibration(
    layer: ContactLayer, points: _Points, speed: Array, own: _Chosen, beside: tuple[_Chosen, float] | None = None
) -> Array:
    """Calibration of an adapted layer by trials left out, pooled, with a share of its own, with what the hand's
    ``beside`` it says; of one trial, as before."""
    if own.error is None or own.variance is None:
        return layer.calibration
    error, variance = own.error, _variances(own.posterior, own.variance)
    if beside is not None:
        hand, share = beside
        assert hand.error is not None and hand.variance is not None  # left out as the arm's were
        error = pooled(error, hand.error, share)
        variance = pooled(variance, _variances(hand.posterior, hand.variance), share)
    return calibration(error, variance, points.values, speed, points.trial)


def _layer(posterior: Posterior, joints: int) -> _Layer:
    return _Layer(posterior, evidence(posterior), joints)


def _with_body(layer: _Layer, points: _Points, settings: AdaptationSettings) -> tuple[Posterior, Array]:
    """The layer with the joint channels' offset and gain, and the gains (D,): a ridge regression about 1."""
    posterior, joints = layer.posterior, slice(0, layer.joints)
    gain = np.ones(points.values.shape[1])
    if layer.joints == 0:
        return posterior, gain
    said, given = (np.asarray(values)[:, joints] for values in (_means(posterior, points), points.values))
    weights = points.counts / points.counts.sum()
    centre, mean = weights @ said, weights @ given
    noise = np.maximum(weights @ (given - mean - said + centre) ** 2, 1e-12) / points.counts.sum()
    prior = settings.gain**-2
    gain[joints] = (weights @ ((said - centre) * (given - mean)) / noise + prior) / (
        weights @ (said - centre) ** 2 / noise + prior
    )
    gain = np.maximum(gain, 0.0)  # a joint that turns the other way is one that the hand does not tell
    offset = np.array(posterior.offset)
    offset[joints] = mean - gain[joints] * (centre - offset[joints])
    return posterior._replace(weights=np.asarray(posterior.weights) * gain, offset=offset), gain


def _means(posterior: Posterior, points: _Points) -> Array:
    return means(posterior, points.inputs, points.styles)


def _updated(layer: _Layer, points: _Points, share: float, seed: int, settings: AdaptationSettings) -> Posterior:
    body, gain = _with_body(layer, points, settings)
    seen = layer.seen._replace(score=layer.seen.score * gain)
    count = min(settings.inducing, len(points.inputs))
    added = np.sort(np.random.default_rng(seed).choice(len(points.inputs), count, replace=False))
    return updated(body, seen, points.inputs, points.values, points.counts, points.styles, share, added)


def _adapted(layer: _Layer, points: _Points, before: Array, seed: int, settings: AdaptationSettings) -> _Chosen:
    """The layer with the share under which trials left out are likeliest, each channel in the layer's own units; as it
    was, where they are no likelier so than with the errors ``before`` (N, D)."""

    def cost(error: Array) -> float:
        return float(points.counts @ np.mean((error / np.asarray(layer.posterior.scale)) ** 2, axis=1))

    trials = int(points.trial.max()) + 1
    folds = min(settings.folds, trials)
    if folds < 2:
        share = settings.shares[len(settings.shares) // 2]
        return _Chosen(_updated(layer, points, share, seed, settings), share, None, None)
    found: list[tuple[float, float, Array, Array]] = []
    for share in settings.shares:
        error, variance = np.zeros_like(points.values), np.zeros(len(points.inputs))
        for fold in range(folds):
            out = points.trial % folds == fold
            without = _updated(layer, points.of(~out), share, seed, settings)
            error[out] = _means(without, points.of(out)) - points.values[out]
            variance[out] = function_variance(without, points.inputs[out], points.of(out).styles)
        found.append((cost(error), share, error, variance))
    least, share, error, variance = min(found, key=lambda entry: entry[0])
    if (1.0 - settings.worth) ** 2 * cost(before) <= least:
        variance = function_variance(layer.posterior, points.inputs, points.styles)
        return _Chosen(layer.posterior, 1.0, before, variance, moved=False)
    return _Chosen(_updated(layer, points, share, seed, settings), share, error, variance)


def _variances(posterior: Posterior, variance: Array) -> Array:
    """Of each channel (N, D), noise included, from the function's (N,)."""
    return (variance[:, None] + np.asarray(posterior.noise)) * np.asarray(posterior.scale) ** 2


def _with_noise(avatar: _Chosen, points: _Points) -> Posterior:
    """The layer with what trials left out show of each channel's noise, beyond the function's own variance."""
    posterior = avatar.posterior
    if avatar.error is None or avatar.variance is None:
        return posterior
    squares = (avatar.error / np.asarray(posterior.scale)) ** 2
    left = np.average(squares - avatar.variance[:, None], axis=0, weights=points.counts)
    least = np.full(len(left), np.min(np.asarray(posterior.noise)))
    return posterior._replace(noise=np.maximum(left, least))


def _moved(
    before: HGPDM,
    after: HGPDM,
    trials: Sequence[Trial],
    avatar: _Chosen,
    points: _Points,
    answered: Array,
    forecast: _Chosen | None,
    approach: _Points | None,
    by_arm: _Chosen | None,
) -> Adaptation:
    joints, palm = slice(0, before.joints), before.channels.palm
    old, new = _means(before.avatar, points), _means(after.avatar, points)
    assert points.styles is not None
    style = np.argmax(points.styles, axis=1)
    used = tuple(name for number, name in enumerate(before.emotions) if np.any(style == number))
    distance = np.linalg.norm((new - old)[:, palm], axis=1)
    moves = old[:, joints].std(axis=0) > 1e-3
    gains = new[:, joints].std(axis=0)[moves] / old[:, joints].std(axis=0)[moves]
    left_out: dict[str, tuple[float, float]] = {}
    if avatar.error is not None:
        left_out["pose"] = _rms(answered[:, joints]), _rms(avatar.error[:, joints])
        left_out["palm"] = _length(answered[:, palm]), _length(avatar.error[:, palm])
    change = np.zeros((1, 4))
    if forecast is not None and approach is not None and before.contact is not None:
        was = _means(before.contact.posterior, approach)
        change = _means(forecast.posterior, approach) - was
        if forecast.error is not None:
            first = was - approach.values
            left_out["contact_point"] = _length(first[:, :3]), _length(forecast.error[:, :3])
            left_out["time"] = _rms(first[:, 3:]), _rms(forecast.error[:, 3:])
    return Adaptation(
        trials=len(trials),
        emotions=used,
        share=avatar.share,
        contact_share=1.0 if forecast is None else forecast.share,
        arm_share=None if by_arm is None else by_arm.share,
        body=_rms((new - old)[:, joints].mean(axis=0)),
        gain=float(np.median(gains)) if np.any(moves) else 1.0,
        pose=_rms((new - old)[:, joints]),
        palm={name: _rms(distance[style == before.emotions.index(name)]) for name in used},
        contact_point=_length(change[:, :3]),
        time=_rms(change[:, 3:]),
        left_out=left_out,
        kept=tuple(
            name
            for name, part in (("pose", avatar), ("forecast", forecast), ("arm", by_arm))
            if part is not None and not part.moved
        ),
    )


def _rms(values: Array) -> float:
    squares: Array = values**2
    return float(np.sqrt(squares.mean()))


def _length(vectors: Array) -> float:
    """Root mean square length of vectors (N, 3)."""
    squares: Array = np.sum(vectors**2, axis=1)
    return float(np.sqrt(np.mean(squares)))
