"""The arithmetic of one tick, compiled: no Python between the layers.

Everything that is compiled stands in this one file, with its types and constants, so that the stored machine code is
renewed whenever any of it changes (see :mod:`highfive.model.compiled`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry.rotations import Array

SPEED_SPAN = 4  # ticks over which the speed of a hand is taken that is about to be hidden: fewer are too noisy
COVARIANCE_LIMIT = 10.0  # variance of a latent beyond which more doubt means nothing (the data have variance 1)


class Moving(NamedTuple):
    """How time passes: ``substeps`` times ``fraction`` of a lag, at most one.

    Attributes:
        steady: (2 q, 2 q) what a substep makes of (I now, I one lag ago).
        share: (2 q, q) what it makes of the learned change.
        fraction, substeps: as said.
    """

    steady: Array
    share: Array
    fraction: float
    substeps: int


class Plan(NamedTuple):
    """What does not change from tick to tick.

    Attributes:
        dynamics, interaction, human, avatar: the layers, each as :func:`highfive.model.online.belief.packed`.
        back: the back projections, one after the other; the last gives I and, where X¹ has one, X¹.
        inputs: (2 q, 2 q) from (I now, I one lag ago) to the dynamics' input.
        features, feature_offset: (F, P (H + 1)) and (F,), the feature map.
        ticks, earlier: (H + 1, L) interpolate the hand's history, and that of one lag ago, from its last L ticks.
        repeats: ticks a lag: how often a back projection's own doubt is met.
        human_first: where X² begins in the interaction layer's output, after X¹.
        tick: one tick.
        style_share: how far each smoothing of the style goes in a tick.
        residual_left: how much of what X¹ has beyond I is left after a tick.
    """

    dynamics: Array
    interaction: Array
    human: Array
    avatar: Array
    back: Array
    inputs: Array
    features: Array
    feature_offset: Array
    ticks: Array
    earlier: Array
    repeats: float
    human_first: int
    tick: Moving
    style_share: float
    residual_left: float


class Belief(NamedTuple):
    """What is carried from tick to tick; no array of it is ever written to.

    Attributes:
        latent: (2 q,) mean of I now and one lag ago.
        covariance: (2 q, 2 q).
        residual: (2, q_1) what X¹ has beyond what I says, and its variance as a share of the interaction layer's doubt.
        hands: (L, 2, P) the hand of the last L ticks, m, and its variances, m², newest first; predicted while unseen.
        away: ticks since the hand was last seen.
        generated_hand: (P,) m, the hand as the human layer generates it.
        style: (2, K) the style weights after one and after two smoothings.
        started: a hand has been seen.
    """

    latent: Array
    covariance: Array
    residual: Array
    hands: Array
    away: int
    generated_hand: Array
    style: Array
    started: bool


class Generated(NamedTuple):
    """What a belief generates.

    Attributes:
        avatar, avatar_deviations: (channels,) mean and standard deviation, noise included.
        avatar_slope: (channels, q_1) derivative of the mean by X¹.
        human, human_deviations: (P,) m, mean and standard deviation of the hand.
        spread: (q_1 + q_2, q_1 + q_2) covariance of X¹ and X².
    """

    avatar: Array
    avatar_deviations: Array
    avatar_slope: Array
    human: Array
    human_deviations: Array
    spread: Array

    def covariance(self, channels: slice) -> Array:
        """Covariance (D', D') of some avatar channels: what they share through X¹, and the doubt of each."""
        slope = self.avatar_slope[channels]
        dims = slope.shape[1]
        covariance = slope @ self.spread[:dims, :dims] @ slope.T
        np.fill_diagonal(covariance, self.avatar_deviations[channels] ** 2)
        return covariance


# Loops are spelled out: a call of BLAS costs more than these products do and may wait for its threads, and expressions
# of whole arrays double the time to compile.


@compiled
def _rows(a: Array, b: Array) -> Array:
    """a · bᵀ for (A, N) and (B, N)."""
    result = np.empty((a.shape[0], b.shape[0]))
    for i in range(a.shape[0]):
        for j in range(b.shape[0]):
            total = 0.0
            for k in range(a.shape[1]):
                total += a[i, k] * b[j, k]
            result[i, j] = total
    return result


@compiled
def _product(a: Array, b: Array) -> Array:
    """a · b for (A, N) and (N, N), which may be the upper left part of a larger matrix."""
    size = a.shape[1]
    result = np.zeros((a.shape[0], size))
    for i in range(a.shape[0]):
        for k in range(size):
            for j in range(size):
                result[i, j] += a[i, k] * b[k, j]
    return result


@compiled
def _applied(a: Array, b: Array) -> Array:
    """a · b for (A, N) and (N,)."""
    result = np.empty(a.shape[0])
    for i in range(a.shape[0]):
        total = 0.0
        for k in range(a.shape[1]):
            total += a[i, k] * b[k]
        result[i] = total
    return result


@compiled_entry
def predicted(layer: Array, point: Array, style: Array) -> tuple[Array, Array, Array]:
    """A layer at one input and style: mean (D,), its derivative (D, q), and variances (D,), noise included.

    Args:
        layer: as :func:`highfive.model.online.belief.packed`; other layers may follow.
        point: (q,); what follows after the first q numbers is not read.
        style: (K,) weights.
    """
    dims, size, styles, channels = int(layer[1]), int(layer[2]), int(layer[3]), int(layer[4])
    log_rbf, bias, begin = layer[5], layer[6], 7
    precision, begin = layer[begin:], begin + dims
    linear, begin = layer[begin:], begin + dims
    offset, begin = layer[begin:], begin + channels
    units, begin = layer[begin:], begin + channels
    noise, begin = layer[begin:], begin + channels
    between, begin = layer[begin:], begin + styles * styles
    inducing, begin = layer[begin:], begin + dims * size
    lines, begin = layer[begin:], begin + dims * size
    shares, begin = layer[begin:], begin + styles * size
    weights, reduction = layer[begin:], layer[begin + channels * size :]

    share, own = _shared(style, shares, between, size)
    towards = _covariances(point, share, log_rbf, bias, precision, inducing, lines, dims)
    prior = math.exp(log_rbf) + bias
    for j in range(dims):
        prior += linear[j] * point[j] * point[j]
    variance = max(own * prior - _quadratic(reduction, towards[0]), 0.0)
    mean, slope, doubt = np.empty(channels), np.empty((channels, dims)), np.empty(channels)
    for d in range(channels):
        doubt[d] = (variance + noise[d]) * units[d]
        own_weights = weights[d * size : (d + 1) * size]
        total = 0.0
        for m in range(size):
            total += own_weights[m] * towards[0, m]
        mean[d] = offset[d] + total
        for j in range(0, dims - 3, 4):  # four at a time: a weight is read once for all of them
            _four(own_weights, towards, j, slope[d])
        for j in range(dims - dims % 4, dims):
            total = 0.0
            for m in range(size):
                total += own_weights[m] * towards[1 + j, m]
            slope[d, j] = total
    return mean, slope, doubt


@compiled
def _four(weights: Array, towards: Array, first: int, slope: Array) -> None:
    """Four entries of a row of the slope (q,), from ``first`` on: weights (M,) times rows of ``towards`` (1 + q, M)."""
    a, b, c, d = 0.0, 0.0, 0.0, 0.0
    for m in range(len(weights)):
        weight = weights[m]
        a += weight * towards[1 + first, m]
        b += weight * towards[2 + first, m]
        c += weight * towards[3 + first, m]
        d += weight * towards[4 + first, m]
    slope[first], slope[first + 1], slope[first + 2], slope[first + 3] = a, b, c, d


@compiled
def _shared(style: Array, shares: Array, between: Array, size: int) -> tuple[Array, float]:
    """Factors by the style: of the covariance with each inducing input (M,), and of the variance."""
    share, own = np.zeros(size), 0.0
    for k in range(len(style)):
        for m in range(size):
            share[m] += style[k] * shares[k * size + m]
        for n in range(len(style)):
            own += style[k] * between[k * len(style) + n] * style[n]
    return share, own


@compiled
def _covariances(
    point: Array, share: Array, log_rbf: float, bias: float, precision: Array, inducing: Array, lines: Array, dims: int
) -> Array:
    """Covariance (1 + q, M) with the inducing inputs in row 0; in row 1 + j its derivative by input j."""
    size = len(share)
    towards, rbf = np.full((dims + 1, size), bias), np.full(size, log_rbf)
    for j in range(dims):
        half = 0.5 * precision[j]
        for m in range(size):
            away = point[j] - inducing[j * size + m]
            rbf[m] -= half * away * away
            towards[0, m] += point[j] * lines[j * size + m]
    for m in range(size):
        rbf[m] = math.exp(rbf[m]) * share[m]
        towards[0, m] = towards[0, m] * share[m] + rbf[m]
    for j in range(dims):
        for m in range(size):
            away = point[j] - inducing[j * size + m]
            towards[1 + j, m] = lines[j * size + m] * share[m] - precision[j] * away * rbf[m]
    return towards


@compiled
def _quadratic(triangle: Array, vector: Array) -> float:
    """Quadratic form of a packed lower triangle: half of a matrix is read, and reading is what takes the time."""
    result, begin = 0.0, 0
    for i in range(len(vector)):
        total = 0.0
        for j in range(i + 1):
            total += triangle[begin + j] * vector[j]
        result += total * vector[i]
        begin += i + 1
    return result


@compiled
def _spread(slope: Array, covariance: Array, doubt: Array, repeats: float) -> Array:
    """Covariance (D, D) of channels with variances ``doubt`` (D,) of their own, counted ``repeats`` times.

    Their input (q,) has the upper left part of ``covariance``.
    """
    result = _rows(_product(slope, covariance), slope)
    for d in range(len(doubt)):
        result[d, d] += repeats * doubt[d]
    return result


@compiled
def _deviations(slope: Array, covariance: Array, first: int, doubt: Array) -> Array:
    """Standard deviations (D,) of channels; their input's covariance begins at ``first`` on the diagonal."""
    result = np.empty(len(doubt))
    for d in range(len(doubt)):
        total = doubt[d]
        for i in range(slope.shape[1]):
            for j in range(slope.shape[1]):
                total += slope[d, i] * covariance[first + i, first + j] * slope[d, j]
        result[d] = math.sqrt(total)
    return result


@compiled_entry
def moved(plan: Plan, moving: Moving, latent: Array, covariance: Array) -> tuple[Array, Array]:
    """The belief over (I now, I one lag ago) a time later: the dynamics, linearised."""
    size, none = len(latent), np.ones(1)
    for _ in range(moving.substeps):
        change, slope, doubt = predicted(plan.dynamics, _applied(plan.inputs, latent), none)
        reach = _product(slope, plan.inputs)  # (q, 2 q), the change's derivative by the latents
        transition, ahead = moving.steady.copy(), _applied(moving.steady, latent)
        for i in range(size):
            for k in range(len(change)):
                ahead[i] += moving.share[i, k] * change[k]
                for j in range(size):
                    transition[i, j] += moving.share[i, k] * reach[k, j]
        latent, covariance = ahead, _rows(_product(transition, covariance), transition)
        largest = 0.0
        for i in range(size):
            if i < len(doubt):
                covariance[i, i] += moving.fraction * doubt[i]
            largest = max(largest, covariance[i, i])
        if largest > COVARIANCE_LIMIT:
            for i in range(size):
                for j in range(size):
                    covariance[i, j] *= COVARIANCE_LIMIT / largest
    return latent, covariance


@compiled
def featured(plan: Plan, ticks: Array, hands: Array) -> tuple[Array, Array]:
    """Features (F,) of the hand's last ticks (L, 2, P), and their covariance (F, F)."""
    times, coordinates = len(ticks), hands.shape[2]
    value, doubts = plan.feature_offset.copy(), np.zeros(times * coordinates)
    for time in range(times):
        for p in range(coordinates):
            place, point = time * coordinates + p, 0.0
            for tick in range(len(hands)):
                point += ticks[time, tick] * hands[tick, 0, p]
                doubts[place] += ticks[time, tick] * hands[tick, 1, p]
            for f in range(len(value)):
                value[f] += plan.features[f, place] * point
    scaled = plan.features.copy()
    for f in range(len(value)):
        for place in range(len(doubts)):
            scaled[f, place] *= doubts[place]
    return value, _rows(scaled, plan.features)


@compiled_entry
def measured(plan: Plan, ticks: Array, hands: Array) -> tuple[Array, Array]:
    """What the back projections make of the hand's last ticks (L, 2, P): mean (B,) and covariance (B, B).

    First I (q), then X¹ where it is projected, too. With the plan's ``ticks`` as they are now, with its ``earlier``
    ones as they were one lag ago.
    """
    value, covariance = featured(plan, ticks, hands)
    none, begin = np.ones(1), 0
    while begin < len(plan.back):
        layer = plan.back[begin:]
        value, slope, doubt = predicted(layer, value, none)
        covariance = _spread(slope, covariance, doubt, plan.repeats)
        begin += int(layer[0])
    return value, covariance


@compiled_entry
def updated(latent: Array, covariance: Array, value: Array, noise: Array) -> tuple[Array, Array]:
    """Kalman update of (I now, I one lag ago) by a measurement of I now: mean (2 q,) and covariance (2 q, 2 q)."""
    size, dims = len(latent), len(value)
    mean, remaining, lower, gain = latent.copy(), covariance.copy(), np.zeros((dims, dims)), np.empty(dims)
    for j in range(dims):  # Cholesky factor of S
        for i in range(j, dims):
            total = covariance[i, j] + noise[i, j]
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            lower[i, j] = math.sqrt(total) if i == j else total / lower[j, j]
    for row in range(size):
        for i in range(dims):
            total = covariance[row, i]
            for k in range(i):
                total -= lower[i, k] * gain[k]
            gain[i] = total / lower[i, i]
        for back in range(dims):
            i = dims - 1 - back
            total = gain[i]
            for k in range(i + 1, dims):
                total -= lower[k, i] * gain[k]
            gain[i] = total / lower[i, i]
        for i in range(dims):
            mean[row] += gain[i] * (value[i] - latent[i])
            for column in range(size):
                remaining[row, column] -= gain[i] * covariance[column, i]
    return mean, remaining


@compiled_entry
def generated(plan: Plan, latent: Array, covariance: Array, residual: Array, style: Array) -> Generated:
    """Down the hierarchy from (I, …), its covariance and the residual: I → X¹, X² → Y¹, Y², linearised."""
    below, slope, doubt = predicted(plan.interaction, latent, np.ones(1))
    return _output(plan, below, slope, doubt, covariance, residual, style)


@compiled
def _residual(plan: Plan, before: Array, below: Array, doubt: Array, value: Array, noise: Array) -> Array:
    """The residual (2, q_1) one tick after ``before``, by a Kalman filter for each dimension.

    What X¹ has beyond I does not come anew each tick: it dies away, an Ornstein-Uhlenbeck process whose variance is the
    interaction layer's ``doubt``. ``value`` (q_1,) is X¹ as the hand has it, of covariance ``noise``; empty where the
    hand is hidden.
    """
    residual, left = np.empty_like(before), plan.residual_left
    for d in range(before.shape[1]):
        residual[0, d] = left * before[0, d]
        residual[1, d] = left**2 * before[1, d] + 1.0 - left**2
        if len(value) > 0:
            variance = residual[1, d] * doubt[d]
            gain = variance / (variance + noise[d, d])
            residual[0, d] += gain * (value[d] - below[d] - residual[0, d])
            residual[1, d] *= 1.0 - gain
    return residual


@compiled
def _output(
    plan: Plan, below: Array, slope: Array, doubt: Array, covariance: Array, residual: Array, style: Array
) -> Generated:
    """Y¹ and Y² from X¹ and X², whose mean is ``below``, whose derivative by I is ``slope``, beside the residual."""
    none = np.ones(1)
    for d in range(residual.shape[1]):
        below[d] += residual[0, d]
        doubt[d] *= residual[1, d]
    spread = _spread(slope, covariance, doubt, 1.0)
    avatar, avatar_slope, doubt = predicted(plan.avatar, below, style)
    avatar_deviations = _deviations(avatar_slope, spread, 0, doubt)
    human, slope, doubt = predicted(plan.human, below[plan.human_first :], none)
    human_deviations = _deviations(slope, spread, plan.human_first, doubt)
    return Generated(avatar, avatar_deviations, avatar_slope, human, human_deviations, spread)


@compiled_entry
def foreseen(plan: Plan, contact: Array, hands: Array) -> tuple[Array, Array]:
    """The ``contact`` layer, packed, at the hand's last ticks (L, 2, P): mean (D,) and covariance (D, D)."""
    value, covariance = featured(plan, plan.ticks, hands)
    mean, slope, doubt = predicted(contact, value, np.ones(1))
    return mean, _spread(slope, covariance, doubt, 1.0)


@compiled
def remembered(belief: Belief, seen: bool, hand: Array, variance: Array, carried_on: Array, doubt: Array) -> Array:
    """The hand's last ticks (L, 2, P), one tick later.

    A hidden hand is ``carried_on`` with its ``doubt``. Once it is back, what was made up is replaced: the ticks in
    between lie on the parabola that leaves the last one seen with the speed it had then, and are doubted as a Brownian
    bridge is. Left in place, they would mislead the features for as long as these look back.
    """
    count, gap = len(belief.hands), belief.away
    hands = np.empty_like(belief.hands)
    for p in range(len(hand)):
        hands[0, 0, p], hands[0, 1, p] = (hand[p], variance[p]) if seen else (carried_on[p], doubt[p])
        for n in range(1, count):
            for row in range(2):
                hands[n, row, p] = belief.hands[n - 1, row, p] if belief.started else hands[0, row, p]
        if not belief.started or not seen or gap == 0:
            continue
        last = min(gap + 1, count - 1)  # the last tick that was seen, or the oldest known
        span = min(SPEED_SPAN, count - 1 - last)
        speed = (hands[last, 0, p] - hands[last + span, 0, p]) / span if span > 0 else 0.0
        bend = (hand[p] - hands[last, 0, p] - speed * last) / last**2
        for n in range(1, last):
            passed = last - n
            hands[n, 0, p] = hands[last, 0, p] + speed * passed + bend * passed**2
            hands[n, 1, p] = max(hands[n, 1, p] * (1.0 - passed / last), variance[p])
    return hands


@compiled_entry
def ticked(
    plan: Plan, belief: Belief, seen: bool, hand: Array, variance: Array, style: Array
) -> tuple[Belief, Generated]:
    """One tick: predict, measure the hand (P,), of variances (P,), if it was ``seen``, and generate.

    An unseen hand moves on as the human layer generates it at the predicted I, from where it was last seen; see
    :func:`remembered` for one that comes back.
    """
    styles, blend = belief.style.copy(), np.empty(len(style))
    for k in range(len(style)):
        styles[0, k] += plan.style_share * (style[k] - styles[0, k])
        styles[1, k] += plan.style_share * (styles[0, k] - styles[1, k])
        blend[k] = styles[1, k]
    latent, covariance, first = belief.latent, belief.covariance, seen and not belief.started
    if belief.started:
        latent, covariance = moved(plan, plan.tick, latent, covariance)
    carried_on, doubt = hand, variance
    if not seen:
        answer = generated(plan, latent, covariance, belief.residual, blend)
        carried_on = belief.hands[0, 0] + answer.human - belief.generated_hand
        doubt = answer.human_deviations**2
    hands = remembered(belief, seen, hand, variance, carried_on, doubt)
    dims, value, noise = len(latent) // 2, latent, covariance
    if seen:
        value, noise = measured(plan, plan.ticks, hands)
        if first:
            latent, covariance = np.concatenate((value[:dims], value[:dims])), np.zeros_like(covariance)
            for i in range(dims):
                for j in range(dims):
                    covariance[i, j] = covariance[dims + i, dims + j] = noise[i, j]
        elif belief.away > 0:  # where it is and where it came from: otherwise its speed would take a lag to be found
            before, blur = measured(plan, plan.earlier, hands)
            both = np.zeros_like(covariance)
            both[:dims, :dims], both[dims:, dims:] = noise[:dims, :dims], blur[:dims, :dims]
            latent, covariance = updated(latent, covariance, np.concatenate((value[:dims], before[:dims])), both)
        else:
            latent, covariance = updated(latent, covariance, value[:dims], noise)
    symmetric = np.empty_like(covariance)
    for i in range(len(latent)):
        for j in range(len(latent)):
            symmetric[i, j] = 0.5 * (covariance[i, j] + covariance[j, i])
    below, slope, doubts = predicted(plan.interaction, latent, np.ones(1))
    shown = value[dims:] if seen else value[:0]
    residual = _residual(plan, belief.residual, below, doubts, shown, noise[dims:, dims:])
    answer = _output(plan, below, slope, doubts, symmetric, residual, blend)
    away, started = 0 if seen else belief.away + 1, belief.started or seen
    return Belief(latent, symmetric, residual, hands, away, answer.human, styles, started), answer
