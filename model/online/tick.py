"""The arithmetic of one tick, compiled: predict, observe, update, generate, without Python between the layers."""

from __future__ import annotations

import numpy as np

from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry.rotations import Array
from highfive.model.linear_algebra import cholesky, cholesky_solve
from highfive.model.online.layer import (
    predict_layer,
    propagated_deviations,
    propagated_variance,
    times,
    times_transposed,
    times_vector,
)
from highfive.model.online.tick_values import Belief, Generated, Moving, Plan

# Loops are spelled out: a call of BLAS costs more than these products do and may wait for its threads, and expressions
# of whole arrays double the time to compile.


@compiled_entry
def predict(plan: Plan, moving: Moving, latent: Array, covariance: Array) -> tuple[Array, Array]:
    """The belief over (I now, I one lag ago) a time later: the dynamics, linearised."""
    size, none = len(latent), np.ones(1)
    for _ in range(moving.substeps):
        change, slope, variances = predict_layer(plan.dynamics, times_vector(plan.inputs, latent), none)
        reach = times(slope, plan.inputs)  # (q, 2 q), the change's derivative by the latents
        transition, ahead = moving.steady.copy(), times_vector(moving.steady, latent)
        for i in range(size):
            for k in range(len(change)):
                ahead[i] += moving.share[i, k] * change[k]
                for j in range(size):
                    transition[i, j] += moving.share[i, k] * reach[k, j]
        latent, covariance = ahead, times_transposed(times(transition, covariance), transition)
        largest = 0.0
        for i in range(size):
            if i < len(variances):
                covariance[i, i] += moving.fraction * variances[i]
            largest = max(largest, covariance[i, i])
        if largest > plan.covariance_limit:
            for i in range(size):
                for j in range(size):
                    covariance[i, j] *= plan.covariance_limit / largest
    return latent, covariance


@compiled
def features(plan: Plan, ticks: Array, hands: Array) -> tuple[Array, Array]:
    """Features (F,) of the hand's last ticks (L, 2, P), and their covariance (F, F)."""
    times, coordinates = len(ticks), hands.shape[2]
    doubts = np.zeros(times * coordinates)
    for time in range(times):
        for p in range(coordinates):
            for tick in range(len(hands)):
                doubts[time * coordinates + p] += ticks[time, tick] * hands[tick, 1, p]
    scaled = plan.features.copy()
    for f in range(len(scaled)):
        for place in range(len(doubts)):
            scaled[f, place] *= doubts[place]
    return feature_value(plan.features, plan.feature_offset, ticks, hands), times_transposed(scaled, plan.features)


@compiled
def feature_value(matrix: Array, offset: Array, ticks: Array, hands: Array) -> Array:
    """Features (F,) of the hand's last ticks (L, 2, P)."""
    value, coordinates = offset.copy(), hands.shape[2]
    for time in range(len(ticks)):
        for p in range(coordinates):
            point = 0.0
            for tick in range(len(hands)):
                point += ticks[time, tick] * hands[tick, 0, p]
            for f in range(len(value)):
                value[f] += matrix[f, time * coordinates + p] * point
    return value


@compiled
def history_of(ticks: Array, points: Array, row: int) -> Array:
    """Places (row 0) or variances (row 1) now and at each earlier time, (P (H + 1),), of the last ticks (L, 2, P).

    Few of the weights ``ticks`` (H + 1, L) are not zero: two for each time.
    """
    coordinates = points.shape[2]
    result = np.zeros(len(ticks) * coordinates)
    for time in range(len(ticks)):
        for tick in range(len(points)):
            weight = ticks[time, tick]
            if weight != 0.0:
                for p in range(coordinates):
                    result[time * coordinates + p] += weight * points[tick, row, p]
    return result


@compiled_entry
def observe(plan: Plan, ticks: Array, hands: Array) -> tuple[Array, Array]:
    """What the back projections make of the hand's last ticks (L, 2, P): mean (B,) and covariance (B, B).

    First I (q), then X¹ where it is projected, too. With the plan's ``ticks`` as they are now, with its ``earlier``
    ones as they were one lag ago.
    """
    value, covariance = features(plan, ticks, hands)
    none, begin = np.ones(1), 0
    while begin < len(plan.back):
        layer = plan.back[begin:]
        value, slope, variances = predict_layer(layer, value, none)
        covariance = propagated_variance(slope, covariance, variances, plan.repeats)
        begin += int(layer[0])
    return value, covariance


@compiled_entry
def update(latent: Array, covariance: Array, value: Array, noise: Array) -> tuple[Array, Array]:
    """Kalman update of (I now, I one lag ago) by a measurement of I now: mean (2 q,) and covariance (2 q, 2 q)."""
    size, dims = len(latent), len(value)
    mean, remaining, innovation = latent.copy(), covariance.copy(), np.empty((dims, dims))
    for i in range(dims):
        for j in range(dims):
            innovation[i, j] = covariance[i, j] + noise[i, j]
    if not cholesky(innovation, innovation):
        mean[:] = np.nan  # no such measurement: whoever holds the belief sees that it is spoilt
        return mean, remaining
    gain = np.empty(dims)
    for row in range(size):
        for i in range(dims):
            gain[i] = covariance[row, i]
        cholesky_solve(innovation, gain)
        for i in range(dims):
            mean[row] += gain[i] * (value[i] - latent[i])
            for column in range(size):
                remaining[row, column] -= gain[i] * covariance[column, i]
    return mean, remaining


@compiled_entry
def generate(plan: Plan, latent: Array, covariance: Array, residual: Array, style: Array) -> Generated:
    """Down the hierarchy from (I, …), its covariance and the residual: I → X¹, X² → Y¹, Y², linearised."""
    below, slope, variances = predict_layer(plan.interaction, latent, np.ones(1))
    return _output(plan, below, slope, variances, covariance, residual, style)


@compiled
def _residual(plan: Plan, before: Array, below: Array, variances: Array, value: Array, noise: Array) -> Array:
    """The residual (2, q_1) one tick after ``before``, by a Kalman filter for each dimension.

    What X¹ has beyond I does not come anew each tick: it dies away, an Ornstein-Uhlenbeck process whose variance is the
    interaction layer's ``variances``. ``value`` (q_1,) is X¹ by the hand, of covariance ``noise``; empty where the
    hand is hidden.
    """
    residual, left = np.empty_like(before), plan.residual_left
    for d in range(before.shape[1]):
        residual[0, d] = left * before[0, d]
        residual[1, d] = left**2 * before[1, d] + 1.0 - left**2
        if len(value) > 0:
            variance = residual[1, d] * variances[d]
            gain = variance / (variance + noise[d, d])
            residual[0, d] += gain * (value[d] - below[d] - residual[0, d])
            residual[1, d] *= 1.0 - gain
    return residual


@compiled
def _output(
    plan: Plan, below: Array, slope: Array, variances: Array, covariance: Array, residual: Array, style: Array
) -> Generated:
    """Y¹ and Y² from X¹ and X², whose mean is ``below``, whose derivative by I is ``slope``, beside the residual."""
    none = np.ones(1)
    for d in range(residual.shape[1]):
        below[d] += residual[0, d]
        variances[d] *= residual[1, d]
    spread = propagated_variance(slope, covariance, variances, 1.0)
    avatar, avatar_slope, variances = predict_layer(plan.avatar, below, style)
    avatar_deviations = propagated_deviations(avatar_slope, spread, 0, variances)
    human, slope, variances = predict_layer(plan.human, below[plan.human_first :], none)
    human_deviations = propagated_deviations(slope, spread, plan.human_first, variances)
    factors = np.ones(len(avatar))
    return Generated(avatar, avatar_deviations, avatar_slope, human, human_deviations, spread, factors)


@compiled_entry
def forecast(plan: Plan, contact: Array, hands: Array) -> tuple[Array, Array]:
    """The ``contact`` layer, packed, at the hand's last ticks (L, 2, P): mean (D,) and covariance (D, D)."""
    value, covariance = features(plan, plan.ticks, hands)
    mean, slope, variances = predict_layer(contact, value, np.ones(1))
    return mean, propagated_variance(slope, covariance, variances, 1.0)


@compiled
def remember(
    plan: Plan, belief: Belief, seen: bool, hand: Array, variance: Array, carried_on: Array, variances: Array
) -> Array:
    """The hand's last ticks (L, 2, P), one tick later.

    A hidden hand is ``carried_on`` with its ``variances``. Once it is back, what was made up is replaced: the ticks in
    between lie on the parabola that leaves the last one seen with the speed it had then, and are doubted as a Brownian
    bridge is. Left in place, they would mislead the features for as long as these look back.
    """
    count, gap = len(belief.hands), belief.away
    hands = np.empty_like(belief.hands)
    for p in range(len(hand)):
        hands[0, 0, p], hands[0, 1, p] = (hand[p], variance[p]) if seen else (carried_on[p], variances[p])
        for n in range(1, count):
            for row in range(2):
                hands[n, row, p] = belief.hands[n - 1, row, p] if belief.started else hands[0, row, p]
        if not belief.started or not seen or gap == 0:
            continue
        last = min(gap + 1, count - 1)  # the last tick that was seen, or the oldest known
        span = min(plan.speed_span, count - 1 - last)
        speed = (hands[last, 0, p] - hands[last + span, 0, p]) / span if span > 0 else 0.0
        bend = (hand[p] - hands[last, 0, p] - speed * last) / last**2
        for n in range(1, last):
            passed = last - n
            hands[n, 0, p] = hands[last, 0, p] + speed * passed + bend * passed**2
            hands[n, 1, p] = max(hands[n, 1, p] * (1.0 - passed / last), variance[p])
    return hands


@compiled_entry
def step(
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
        latent, covariance = predict(plan, plan.tick, latent, covariance)
    carried_on, variances = hand, variance
    if not seen:
        answer = generate(plan, latent, covariance, belief.residual, blend)
        carried_on = belief.hands[0, 0] + answer.human - belief.generated_hand
        variances = answer.human_deviations**2
    hands = remember(plan, belief, seen, hand, variance, carried_on, variances)
    dims, value, noise = len(latent) // 2, latent, covariance
    if seen:
        value, noise = observe(plan, plan.ticks, hands)
        if first:
            latent, covariance = np.concatenate((value[:dims], value[:dims])), np.zeros_like(covariance)
            for i in range(dims):
                for j in range(dims):
                    covariance[i, j] = covariance[dims + i, dims + j] = noise[i, j]
        elif belief.away > 0:  # where it is and where it came from: otherwise its speed would take a lag to be found
            before, blur = observe(plan, plan.earlier, hands)
            both = np.zeros_like(covariance)
            both[:dims, :dims], both[dims:, dims:] = noise[:dims, :dims], blur[:dims, :dims]
            latent, covariance = update(latent, covariance, np.concatenate((value[:dims], before[:dims])), both)
        else:
            latent, covariance = update(latent, covariance, value[:dims], noise)
    symmetric = np.empty_like(covariance)
    for i in range(len(latent)):
        for j in range(len(latent)):
            symmetric[i, j] = 0.5 * (covariance[i, j] + covariance[j, i])
    below, slope, doubts = predict_layer(plan.interaction, latent, np.ones(1))
    shown = value[dims:] if seen else value[:0]
    residual = _residual(plan, belief.residual, below, doubts, shown, noise[dims:, dims:])
    answer = _output(plan, below, slope, doubts, symmetric, residual, blend)
    away, started = 0 if seen else belief.away + 1, belief.started or seen
    return Belief(latent, symmetric, residual, hands, away, answer.human, styles, belief.beyond, started), answer
