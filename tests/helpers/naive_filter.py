"""The filter's formulas as they are written down, one layer after the other: what the compiled tick is held to."""

import jax
import jax.numpy as jnp
import numpy as np

from highfive.model.geometry.rotations import Array
from highfive.model.gp import sparse
from highfive.model.gp.posterior import Posterior
from highfive.model.hgpdm.dynamics import dynamics_input, dynamics_mean
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.online.belief import lagrange, tick_weights
from highfive.model.online.belief_settings import BELIEF
from highfive.model.online.tick_values import Belief, Generated


@jax.jit
def predicted(posterior: Posterior, point: Array, style: Array | None = None) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Mean (D,), derivative (D, q) and variances (D,), noise included, at one input."""
    posterior = sparse.with_kernel(posterior)

    def mean(at: jax.Array) -> jax.Array:
        return sparse.means(posterior, at[None], None if style is None else style[None])[0]

    cross = posterior.kernel.cross(point[None], posterior.inducing)[0]
    own = posterior.kernel.diagonal(point[None])[0]
    if style is not None:
        cross, own = cross * (posterior.style @ style), own * (style @ posterior.style_covariance @ style)
    variance = jnp.maximum(own - cross @ posterior.reduction @ cross, 0.0)
    return mean(point), jax.jacrev(mean)(point), (variance + posterior.noise) * posterior.scale**2


def carried(slope: Array, spread: Array, variances: Array) -> Array:
    """Covariance of channels whose input has the covariance ``spread``."""
    return slope @ spread @ slope.T + np.diag(variances)


def moved(model: HGPDM, latent: Array, covariance: Array, seconds: float) -> tuple[Array, Array]:
    """The dynamics, linearised, over a part of one lag."""
    dims, fraction, units = model.preset.interaction_dims, seconds / model.lag, np.eye(len(latent))
    inputs = np.asarray(dynamics_input(units[:, :dims], units[:, dims:], model.lag)).T  # both are linear
    ahead = np.asarray(dynamics_mean(units[:, :dims], units[:, dims:], model.lag, model.preset)).T
    change, slope, variances = predicted(model.dynamics, inputs @ latent)
    next_latent, next_slope = ahead @ latent + change, ahead + slope @ inputs
    means, slopes, identity = [], [], np.eye(2 * dims)
    for at in (fraction, fraction - 1.0):  # on the parabola through one lag ago, now and one lag ahead
        before, now, after = lagrange(at)
        means.append(before * latent[dims:] + now * latent[:dims] + after * next_latent)
        slopes.append(before * identity[dims:] + now * identity[:dims] + after * next_slope)
    transition = np.concatenate(slopes)
    noise = np.concatenate([fraction * variances, np.zeros(dims)])
    covariance = transition @ covariance @ transition.T + np.diag(noise)
    return np.concatenate(means), covariance * min(1.0, BELIEF.covariance_limit / np.diag(covariance).max())


def measured(model: HGPDM, hands: Array, rate: float, ago: float = 0.0) -> tuple[Array, Array]:
    """I, and X¹ if the back projections give it, now or some time ago, with their covariance."""
    longest = model.lag + max((0.0, *model.preset.history))
    history = np.einsum("hl,lvp->vhp", tick_weights(model.preset.history, rate, ago, longest), hands)
    matrix = model.feature_map.matrix
    value, covariance = model.feature_map(history[0]), matrix @ np.diag(history[1].reshape(-1)) @ matrix.T
    for stage in model.back:
        value, slope, variances = predicted(stage, value)
        covariance = carried(slope, covariance, max(1.0, model.lag * rate) * variances)
    return value, covariance


def updated(latent: Array, covariance: Array, value: Array, noise: Array) -> tuple[Array, Array]:
    """Joseph's form of the Kalman update by a measurement of the first latents."""
    seen = np.eye(len(value), len(latent))
    gain = covariance @ seen.T @ np.linalg.inv(seen @ covariance @ seen.T + noise)
    remaining = np.eye(len(latent)) - gain @ seen
    return latent + gain @ (value - seen @ latent), remaining @ covariance @ remaining.T + gain @ noise @ gain.T


def generated(model: HGPDM, latent: Array, covariance: Array, residual: Array, style: Array) -> Generated:
    """Down the hierarchy."""
    dims, split = model.preset.interaction_dims, model.preset.avatar_dims
    below, slope, variances = predicted(model.interaction, latent[:dims])
    below = np.concatenate([below[:split] + residual[0], below[split:]])
    variances = np.concatenate([variances[:split] * residual[1], variances[split:]])
    return output(model, below, carried(slope, covariance[:dims, :dims], variances), style)


def beyond(model: HGPDM, rate: float, before: Array, latent: Array, seen: Array, noise: Array) -> Array:
    """The residual of X¹, a Kalman filter in the information form, where the hand is seen."""
    left = np.exp(-1.0 / rate / BELIEF.residual_time)
    mean, share = left * before[0], 1.0 - left**2 * (1.0 - before[1])
    if not len(seen):
        return np.stack([mean, share])
    below, _, variances = predicted(model.interaction, latent[: model.preset.interaction_dims])
    split = model.preset.avatar_dims
    prior, measured_noise = share * variances[:split], np.diag(noise)
    posterior = 1.0 / (1.0 / prior + 1.0 / measured_noise)
    mean = posterior * (mean / prior + (seen - below[:split]) / measured_noise)
    return np.stack([mean, posterior / variances[:split]])


def output(model: HGPDM, below: Array, spread: Array, style: Array) -> Generated:
    """Y¹ and Y²."""
    split = model.preset.avatar_dims
    avatar, avatar_slope, variances = predicted(model.avatar, below[:split], style)
    deviations = np.sqrt(np.diag(carried(avatar_slope, spread[:split, :split], variances)))
    human, slope, variances = predicted(model.human, below[split:])
    human_deviations = np.sqrt(np.diag(carried(slope, spread[split:, split:], variances)))
    return Generated(avatar, deviations, avatar_slope, human, human_deviations, spread, np.ones(len(avatar)))


def remembered(belief: Belief, newest: Array, gap: int) -> Array:
    """The hand's last ticks, those of a ``gap`` that has just ended bridged by a parabola."""
    hands = np.concatenate([newest[None], belief.hands[:-1]])
    if gap == 0:
        return hands
    last = min(gap + 1, len(hands) - 1)
    span = min(BELIEF.speed_span, len(hands) - 1 - last)
    speed = (hands[last, 0] - hands[last + span, 0]) / span if span else np.zeros(len(newest[0]))
    far = newest[0] - hands[last, 0] - speed * last
    for n in range(1, last):
        passed = last - n
        hands[n, 0] = hands[last, 0] + speed * passed + far * (passed / last) ** 2
        hands[n, 1] = np.maximum(hands[n, 1] * n / last, newest[1])
    return hands


def ticked(
    model: HGPDM, rate: float, belief: Belief, hand: Array | None, variance: Array, style: Array
) -> tuple[Belief, Generated]:
    """One tick."""
    latent, covariance = belief.latent, belief.covariance
    if belief.started:
        latent, covariance = moved(model, latent, covariance, 1.0 / rate)
    first = hand is not None and not belief.started
    expected = generated(model, latent, covariance, belief.residual, style)
    newest = np.stack([belief.hands[0, 0] + expected.human - belief.generated_hand, expected.human_deviations**2])
    if hand is not None:
        newest = np.stack([hand, variance])
    hands = remembered(belief, newest, 0 if hand is None else belief.away)
    if not belief.started:
        hands = np.tile(newest, (len(hands), 1, 1))
    if hand is not None:
        seen, variances = measured(model, hands, rate)
        dims = model.preset.interaction_dims
        value, noise = seen[:dims], variances[:dims, :dims]
        if first:
            latent, covariance = np.tile(value, 2), np.kron(np.eye(2), noise)
        elif belief.away:
            before, blur = measured(model, hands, rate, model.lag)
            both = np.block([[noise, np.zeros_like(noise)], [np.zeros_like(noise), blur[:dims, :dims]]])
            latent, covariance = updated(latent, covariance, np.concatenate([value, before[:dims]]), both)
        else:
            latent, covariance = updated(latent, covariance, value, noise)
    share = 1.0 - np.exp(-1.0 / rate / BELIEF.style_time)
    once = belief.style[0] + share * (style - belief.style[0])
    styles = np.stack([once, belief.style[1] + share * (once - belief.style[1])])
    shown = (np.zeros(0), np.zeros((0, 0))) if hand is None else (seen[dims:], variances[dims:, dims:])
    residual = beyond(model, rate, belief.residual, latent, *shown)
    answer = generated(model, latent, covariance, residual, styles[1])
    started, away = belief.started or hand is not None, 0 if hand is not None else belief.away + 1
    return Belief(latent, covariance, residual, hands, away, answer.human, styles, belief.beyond, started), answer
