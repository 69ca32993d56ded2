"""The least-squares problem of one part of the skeleton: hinge angles from markers, with limits and a prior.

Levenberg–Marquardt with the analytic Jacobian on many frames at once. Levenberg 1944, Marquardt 1963; limits by
projection with an active set (Bertsekas 1982, SIAM J. Control Optim. 20(2)).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.body.kinematic_part import Kinematics, Part, forward, jacobian
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class BodyFitSettings(Settings):
    """What the fit of a body to markers assumes, and how far it goes. Set by hand."""

    marker_sigma: float = setting(0.003, "m", above=0.0)
    """Standard deviation of a marker about the model: noise, skin movement and misfit of the segments."""
    angle_sigma: float = setting(1.0, "rad", above=0.0)
    """Standard deviation of a hinge about the rest pose: decides only where the markers say nothing."""
    neighbour_sigma: float = setting(0.3, "rad", above=0.0)
    """Standard deviation of a hinge about what the frames before and after say."""
    outlier: float = setting(0.05, "m", above=0.0)
    """Residuals beyond it count linearly (Huber): a swapped label must not bend the body."""
    mislabelled: float = setting(0.15, "m", above=0.0)
    """A marker so far off does not belong where its label says."""
    key_step: int = setting(12, least=1)
    """Every so many frames is solved from scratch, the frames between from the interpolated result; 1 if the frames
    are not neighbours in time."""
    iterations: int = setting(40, least=1)
    """Of Levenberg–Marquardt, at most, from scratch; ..."""
    near_iterations: int = setting(15, least=1)
    """... from the frames before and after; ..."""
    again_iterations: int = setting(10, least=1)
    """... from a solution on another body of nearly the same size."""
    smoothings: int = setting(3, least=0)
    """Times that key frames are solved with a prior at their smoothed neighbours."""
    poor: float = setting(4.0, above=1.0)
    """A frame that costs this many times the median ended in a poor minimum, and is tried again from its neighbours."""
    bends: tuple[float, ...] = setting((0.0, 0.4, 0.8), least=0.0, most=1.0)
    """Of a finger, from rest to its limit, from which it is solved: from the stretched one a fist is not always
    found."""
    converged: float = setting(1e-5, least=0.0)
    """Fraction of the cost; a frame that gains less is solved."""
    damping: float = setting(1e-3, above=0.0)
    """Of the first iteration, relative to the matrix's diagonal; ..."""
    most_damping: float = setting(1e6, above=0.0)
    """... a frame that needs more than this is given up."""
    batch: int = setting(256, least=1)
    """Frames solved at once; bounds the memory of the Jacobian."""


BODY_FIT = BodyFitSettings()


@dataclass(frozen=True)
class Problem:
    """What is known of one part in T frames.

    Markers (T, N, 3), seen (T, N), the base's position (T, 3) and rotation (T, 3, 3), and the prior: hinges (T, H) with
    one standard deviation, rad.
    """

    measured: Array
    seen: NDArray[np.bool_]
    base: Array
    rotation: Array
    prior: Array
    prior_sigma: float
    settings: BodyFitSettings = BODY_FIT

    def take(self, frames: NDArray[np.intp]) -> Problem:
        """The same for some of the frames."""
        return Problem(
            self.measured[frames],
            self.seen[frames],
            self.base[frames],
            self.rotation[frames],
            self.prior[frames],
            self.prior_sigma,
            self.settings,
        )

    def near(self, parameters: Array) -> Problem:
        """The same with a prior at other hinge angles, tighter than the one about the rest pose."""
        return replace(self, prior=parameters[:, : self.prior.shape[1]], prior_sigma=self.settings.neighbour_sigma)


def minimise(part: Part, problem: Problem, start: Array, iterations: int) -> Array:
    """Parameters (T, P) that explain the markers best, from ``start``, chunk by chunk."""
    out, batch = np.empty_like(start), problem.settings.batch
    for first in range(0, len(start), batch):
        c = np.arange(first, min(first + batch, len(start)))
        out[c] = _levenberg_marquardt(part, problem.take(c), start[c], iterations)
    return out


def _levenberg_marquardt(part: Part, problem: Problem, start: Array, iterations: int) -> Array:
    size, hinges = part.parameters, 3 * len(part.joints)
    low, high = np.full(size, -np.inf), np.full(size, np.inf)
    low[:hinges], high[:hinges] = part.limits.T
    x = np.clip(start, low, high)
    damping = np.full(len(x), problem.settings.damping)
    cost = cost_of(part, problem, x)
    active = np.arange(len(x))  # frames that still move
    for _ in range(iterations):
        moving = problem.take(active)
        gradient, hessian = _normal_equations(part, moving, x[active])
        diagonal = np.einsum("tpp->tp", hessian)
        diagonal += damping[active, None] * diagonal + 1e-9
        trial = x[active] + _box_step(hessian, gradient, low - x[active], high - x[active])
        trial_cost = cost_of(part, moving, trial)
        better = trial_cost < cost[active]
        done = better & (cost[active] - trial_cost < problem.settings.converged * cost[active])
        done |= damping[active] > problem.settings.most_damping
        x[active[better]], cost[active[better]] = trial[better], trial_cost[better]
        damping[active] *= np.where(better, 0.2, 5.0)
        active = active[~done]
        if not len(active):
            break
    return x


def _box_step(hessian: Array, gradient: Array, low: Array, high: Array) -> Array:
    """Step (T, P) to the minimum of a quadratic, inside limits (T, P), nearly: what would leave them is held at them.

    Two rounds of holding; a third changes nothing that the next iteration does not.
    """
    # Where a parameter is at its limit and the gradient leads outward it is held from the start.
    held = ((low >= 0.0) & (gradient > 0.0)) | ((high <= 0.0) & (gradient < 0.0))
    step = np.zeros_like(gradient)
    for _ in range(3):
        bent = gradient + (hessian @ np.where(held, step, 0.0)[..., None])[..., 0]
        system = hessian * ~(held[:, :, None] | held[:, None, :])
        np.einsum("tpp->tp", system)[held] = 1.0
        free_step = -np.linalg.solve(system, np.where(held, 0.0, bent)[..., None])[..., 0]
        step = np.where(held, step, free_step)
        outside = (step < low) | (step > high)
        if not outside.any():
            break
        step = np.clip(step, low, high)
        held |= outside
    return step


def kinematics_of(part: Part, problem: Problem, x: Array) -> Kinematics:
    """Where the part is with parameters (T, P)."""
    if part.free:
        return forward(part, x[:, :-3], x[:, -3:], problem.rotation)
    return forward(part, x, problem.base, problem.rotation)


def _prior_residual(part: Part, problem: Problem, x: Array) -> Array:
    """Hinges' distance (T, H) from the prior, in its standard deviations; the turn of a free base has no prior."""
    hinges = 3 * len(part.joints)
    residual = (x[:, :hinges] - problem.prior) / problem.prior_sigma
    if part.free:
        residual[:, :3] = 0.0
    return residual


def cost_of(part: Part, problem: Problem, x: Array) -> Array:
    """Huber cost (T,)."""
    distance = np.linalg.norm(problem.measured - kinematics_of(part, problem, x).markers, axis=-1)
    outlier = problem.settings.outlier
    huber = np.where(distance < outlier, distance**2, 2 * outlier * distance - outlier**2)
    of_markers = (huber * problem.seen).sum(axis=1) / problem.settings.marker_sigma**2
    return of_markers + (_prior_residual(part, problem, x) ** 2).sum(axis=1)


def _normal_equations(part: Part, problem: Problem, x: Array) -> tuple[Array, Array]:
    """Half the gradient (T, P) and the Gauss–Newton matrix (T, P, P) of the cost."""
    kinematics = kinematics_of(part, problem, x)
    error = kinematics.markers - problem.measured
    distance = np.linalg.norm(error, axis=-1)
    s = problem.settings
    weight = np.sqrt(problem.seen * np.minimum(1.0, s.outlier / np.maximum(distance, 1e-9))) / s.marker_sigma
    scaled = (jacobian(part, kinematics) * weight[:, None, :, None]).reshape(len(x), -1, part.parameters)
    weighted = (error * weight[..., None]).transpose(0, 2, 1).reshape(len(x), -1, 1)
    transposed = scaled.transpose(0, 2, 1)
    hessian, gradient = transposed @ scaled, (transposed @ weighted)[..., 0]
    hinges = 3 * len(part.joints)
    gradient[:, :hinges] += _prior_residual(part, problem, x) / problem.prior_sigma
    index = np.arange(3 if part.free else 0, hinges)
    hessian[:, index, index] += problem.prior_sigma**-2
    return gradient, hessian


def better(part: Part, problem: Problem, first: Array, second: Array) -> Array:
    """Frame by frame the parameters (T, P) of lower cost."""
    return np.where((cost_of(part, problem, second) < cost_of(part, problem, first))[:, None], second, first)
