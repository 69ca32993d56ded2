"""Learns from approaches and other gestures whether a contact is coming, and calibrates it on those left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.gp import sparse
from highfive.model.gp.kernels import MotionKernel
from highfive.model.gp.optimise import ProgressCallback
from highfive.model.gp.posterior import Posterior
from highfive.model.gp.regression import learned
from highfive.model.gp.sparse import Layer, Targets
from highfive.model.hgpdm.dataset import KNUCKLES, hand_history
from highfive.model.hgpdm.intent_features import HISTORY, fit_intent_features
from highfive.model.hgpdm.intent_layer import IntentLayer, probabilities
from highfive.model.hgpdm.trials import Gesture, Trial
from highfive.model.settings import Settings, setting

_LEAST = 1e-9  # probability
_SLOPES, _BIASES = np.geomspace(0.3, 30.0, 21), np.linspace(-0.4, 0.4, 33)  # of the probit, and over its slope
_RESTING = 0.1  # of all weights, of frames before the rise


@dataclass(frozen=True)
class IntentTrainingSettings(Settings):
    """How the layer learns. Chosen on simulated high fives and gestures that were held out; places by hand."""

    rate_hz: float = setting(30.0, "Hz", above=0.0)
    """Of the frames that it learns from, ..."""
    held_hz: float = setting(8.0, "Hz", above=0.0)
    """... and of those that come later than ``early`` after the hand's rise: a held hand tells the same again."""
    early: float = setting(0.6, "s", above=0.0)
    moved: float = setting(0.02, "m", above=0.0)
    """A hand that is further from where it began has risen; frames before are of nobody's intent."""
    rest: float = setting(0.2, "s", least=0.0)
    """So long before the rise frames count for both classes alike: nobody knows yet."""
    past: float = setting(0.1, "s", least=0.0)
    """Frames of an approach count until so long after contact."""
    copies: int = setting(3, least=0)
    """Of each hand, moved and turned as a whole: people stand elsewhere, ..."""
    turned: float = setting(15.0, "°", least=0.0)
    aside: float = setting(0.08, "m", least=0.0)
    nearer: float = setting(0.05, "m", least=0.0)
    further: float = setting(0.20, "m", least=0.0)
    sizes: tuple[float, float] = setting((0.9, 1.12), above=0.0)
    """Of the copies over the person's: heights and lengths."""
    slip: float = setting(0.02, "m", least=0.0)
    """Wrist and knuckles of others are elsewhere in their hands, by so much in each direction."""
    late: float = setting(0.35, least=0.0, most=1.0)
    """... and so large a share of the copies comes into sight on its way."""
    inducing: int = setting(200, least=2)
    frames: int = setting(3000, least=2)
    """Of all, at random, that choose kernel and inducing inputs; the weights are then of all."""
    noise: tuple[float, float] = setting((0.05, 1.0), above=0.0)
    iterations: int = setting(150, "steps", least=1)
    folds: int = setting(6, least=2)


INTENT_TRAINING = IntentTrainingSettings()


@dataclass(frozen=True)
class Examples:
    """Frames to learn from.

    Attributes:
        hands: (N, H + 1, 6) m.
        labels: (N,) 1 or −1; 0 before the hand's rise.
        track: (N,) of which trial or gesture; copies count as the same.
        weights: (N,) both classes alike, and all tracks of a class.
    """

    hands: Array
    labels: Array
    track: NDArray[np.int64]
    weights: Array


def examples(
    trials: Sequence[Trial], gestures: Sequence[Gesture], seed: int, settings: IntentTrainingSettings = INTENT_TRAINING
) -> Examples:
    """Frames of approaches and of gestures, as they are and as copies of them."""
    rng = np.random.default_rng(seed)
    tracks: list[Trial | Gesture] = [*trials, *gestures]
    hands: list[Array] = []
    labels: list[Array] = []
    number: list[NDArray[np.int64]] = []
    for index, track in enumerate(tracks):
        for copy in range(settings.copies + 1):
            seen = track if copy == 0 else _elsewhere(track, rng, settings)
            first = _late(seen, rng, settings) if copy and rng.uniform() < settings.late else 0
            risen, found = _frames(seen, first, rng, settings)
            hands.append(found)
            labels.append(np.where(risen, 1.0 if isinstance(track, Trial) else -1.0, 0.0))
            number.append(np.full(len(found), index))
    every, of = np.concatenate(labels), np.concatenate(number)
    return Examples(np.concatenate(hands), every, of, _balanced(every, of))


def _balanced(labels: Array, track: NDArray[np.int64]) -> Array:
    counts = np.bincount(track)
    weights = 1.0 / counts[track]
    for label, share in ((1.0, 0.5), (-1.0, 0.5), (0.0, _RESTING)):
        of = labels == label
        weights[of] *= share * len(labels) / max(weights[of].sum(), 1e-9)
    return weights


def _rise(knuckles: Array, settings: IntentTrainingSettings) -> int:
    """The first frame of knuckles (T, 3), m, that have moved; the last where they never do."""
    moved = np.linalg.norm(knuckles - knuckles[0], axis=1) > settings.moved
    return int(np.argmax(moved)) if moved.any() else len(knuckles) - 1


def _last(track: Trial | Gesture, settings: IntentTrainingSettings) -> int:
    end = len(track.hand_points) - 1
    return min(end, track.contact_frame + round(settings.past * track.rate_hz)) if isinstance(track, Trial) else end


def _late(track: Trial | Gesture, rng: np.random.Generator, settings: IntentTrainingSettings) -> int:
    """A frame between the hand's rise and the last tenth of a second of its approach, or of its first second."""
    rise = _rise(track.hand_points[:, 1], settings)
    until = track.contact_frame if isinstance(track, Trial) else rise + round(track.rate_hz)
    last = min(until, len(track.hand_points) - 2) - round(0.1 * track.rate_hz)
    return int(rng.integers(rise, max(last, rise + 1)))


def _frames(
    track: Trial | Gesture, first: int, rng: np.random.Generator, settings: IntentTrainingSettings
) -> tuple[NDArray[np.bool_], Array]:
    """Whether a hand has risen (n,), and hands (n, H + 1, 6), m, of a track that is seen from frame ``first`` on."""
    rise, last = _rise(track.hand_points[:, 1], settings), _last(track, settings)
    start = max(rise, first) / track.rate_hz + rng.uniform(0.0, 1.0 / settings.rate_hz)
    early = np.arange(start, start + settings.early, 1.0 / settings.rate_hz)
    held = np.arange(start + settings.early, last / track.rate_hz, 1.0 / settings.held_hz)
    rest = np.arange(max(0.0, start - settings.rest), start, 1.0 / settings.held_hz) if first < rise else early[:0]
    times = np.concatenate([early, held])
    times = times[times <= last / track.rate_hz]
    if isinstance(track, Gesture):  # where it hangs again it is nobody's intent
        knuckles = hand_history(track, times, ())[:, 0, KNUCKLES]
        times = times[np.linalg.norm(knuckles - track.hand_points[0, 1], axis=1) > settings.moved]
    risen = np.arange(len(rest) + len(times)) >= len(rest)
    times = np.concatenate([rest, times])
    seen = replace(track, hand_points=track.hand_points[first:]) if first else track
    return risen, hand_history(seen, times - first / track.rate_hz, HISTORY)


def _elsewhere(track: Trial | Gesture, rng: np.random.Generator, settings: IntentTrainingSettings) -> Trial | Gesture:
    turn = rotations.from_axis_angle("z", np.radians(rng.uniform(-settings.turned, settings.turned)))
    place = np.array([rng.uniform(-settings.nearer, settings.further), rng.normal(0.0, settings.aside), 0.0])
    slip, size = rng.normal(0.0, settings.slip, (2, 3)), rng.uniform(*settings.sizes)
    # Larger and smaller about where the contact is, or about the person's place: near enough to a metre away.
    middle = np.array([1.0, 0.0, 0.0])
    points = middle + size * (rotations.rotate(turn, track.hand_points - middle)) + slip
    return replace(track, hand_points=points + place)


def fit_intent(
    trials: Sequence[Trial],
    gestures: Sequence[Gesture],
    seed: int = 0,
    progress: ProgressCallback | None = None,
    settings: IntentTrainingSettings = INTENT_TRAINING,
) -> IntentLayer:
    """Learns the layer.

    Args:
        trials: high fives; those that are held out are left to the caller.
        gestures: raised hands to which no contact came.
        seed: of copies and inducing inputs.
        progress: called after every step.
        settings: how it learns.

    Raises:
        HighFiveError: there is nothing of one of both.
    """
    if not trials or not gestures:
        raise HighFiveError(f"{len(trials)} trials with and {len(gestures)} without a contact; both are needed")
    found = examples(trials, gestures, seed, settings)
    features = fit_intent_features(found.hands)
    posterior, means, variances = _fitted(features(found.hands), found, seed, progress, settings)
    return IntentLayer(features, posterior, _squash(means, variances, found))


def _fitted(
    inputs: Array, found: Examples, seed: int, progress: ProgressCallback | None, settings: IntentTrainingSettings
) -> tuple[Posterior, Array, Array]:
    """The layer, and what it says of frames whose track was left out: mean (N,) and variance (N,)."""
    count, dims = inputs.shape
    share = found.weights / found.weights.sum()
    rng = np.random.default_rng(seed)
    chosen = np.sort(rng.choice(count, min(settings.inducing, count), replace=False, p=share))
    start = Layer(MotionKernel.initial(dims), jnp.asarray(inputs[chosen]), sparse.raw_noise(0.4, settings.noise))
    values = found.labels[:, None]
    some = np.sort(rng.choice(count, min(settings.frames, count), replace=False))
    points, weights = jnp.asarray(inputs[some]), jnp.asarray(found.weights[some])
    targets = Targets(jnp.asarray(values[some]), 1, 0.0)
    steps, stage = settings.iterations, "is a contact coming"
    layer, noise = learned(start, points, targets, settings.noise, steps, steps, stage, progress, weights=weights)

    def posterior(rows: NDArray[np.bool_]) -> Posterior:
        here = jnp.asarray(found.weights[rows])
        return sparse.fit(layer, jnp.asarray(inputs[rows]), jnp.asarray(values[rows]), noise, weights=here)

    means, variances = np.zeros(count), np.ones(count)
    for fold in range(settings.folds):
        out = found.track % settings.folds == fold
        if out.any() and not out.all():
            without = posterior(~out)
            means[out] = np.asarray(sparse.means(without, inputs[out]))[:, 0]
            variances[out] = np.asarray(sparse.variances(without, inputs[out]))[:, 0]
    return posterior(np.ones(len(values), bool)), means, variances


def _squash(means: Array, variances: Array, found: Examples) -> Array:
    """Slope and bias (2,) under which the frames' labels are likeliest; of a grid, for both are hardly curved."""
    share, best = 0.5 + 0.5 * found.labels, (np.inf, np.zeros(2))  # of an approach
    for slope in _SLOPES:
        for bias in slope * _BIASES:
            given = np.clip(probabilities(means, variances, np.array([slope, bias])), _LEAST, 1.0 - _LEAST)
            surprise = -float(found.weights @ (share * np.log(given) + (1.0 - share) * np.log(1.0 - given)))
            if surprise < best[0]:
                best = surprise, np.array([slope, bias])
    return best[1]
