"""Where an arm stands and by what it differs from its drawing, from markers on its plate: robust least squares.

All is fitted at once, with a Gaussian prior on every number: what the poses do not tell stays as drawn, and moves the
plate nowhere. Errors are whitened by what joints do not repeat (J Σ Jᵀ + σ²); a marker further off than 2.5 σ counts
less (Huber). Levenberg–Marquardt with the Jacobian of :mod:`highfive.calibration.arm_kinematics`; torques are of the
encoders' angles, and taken anew once the base is known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from highfive.calibration.arm_kinematics import (
    KINDS,
    ArmErrors,
    ArmShape,
    Frames,
    as_drawn,
    frames_of,
    gravity_torques,
    jacobian,
    joint_columns,
    marker_places,
    true_angles,
)
from highfive.calibration.arm_poses import ArmPoses
from highfive.calibration.rigid_fit import RigidFit, rigid_fit
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting

ALL = ("base_turn", "base_place", "zero", "compliance", "length", "tilt", "marker")
"""What is fitted by itself; play and ripple need poses that show them."""
EXTRINSICS = ("base_turn", "base_place", "marker")
"""What a calibration fits that believes the arm's drawing."""

_ROUNDS = 3
"""Times that torques and robust weights are taken anew."""
_STEPS = 40


@dataclass(frozen=True)
class ArmFitSettings(Settings):
    """What is believed of an arm before it is seen, and of what is measured: assumptions, no real arm was measured."""

    base_turn: float = setting(np.radians(10.0), "rad", above=0.0)
    base_place: float = setting(0.1, "m", above=0.0)
    """About where one rigid motion puts the base."""
    zero: float = setting(np.radians(3.0), "rad", above=0.0)
    """A horn is put on by hand, a spline's tooth is 15°: 3° is what remains of careful work."""
    compliance: float = setting(0.002, "rad/(N·m)", above=0.0)
    length: float = setting(0.001, "m", above=0.0)
    tilt: float = setting(np.radians(0.3), "rad", above=0.0)
    marker: float = setting(0.008, "m", above=0.0)
    """Markers by the template, the plate mounted by hand."""
    play: float = setting(np.radians(0.3), "rad", above=0.0)
    """Of 15′ in the gears, the encoder sees a part."""
    ripple: float = setting(np.radians(0.2), "rad", above=0.0)
    joint_noise: float = setting(np.radians(0.08), "rad", above=0.0)
    """What a joint does not repeat, with its count of 0.088° and a ripple that is not fitted."""
    marker_noise: float = setting(0.0005, "m", above=0.0)
    """Of a pose's mean."""
    cut: float = setting(2.5, "σ", above=0.0)
    """From here on a marker counts less."""
    fewest: int = setting(6, least=3)
    """Poses: with fewer the priors say more than the poses."""
    worst_rms: float = setting(0.003, "m", above=0.0)
    """Larger residuals are no noise: a reversed joint, swapped or loose markers (5 mm and more of a reversed one)."""
    worst_zero: float = setting(float(np.radians(10.0)), "rad", above=0.0)
    """A reversed wrist looks like a roll that is 180° off, to the last micrometre."""
    strays: float = setting(0.25, above=0.0, below=1.0)
    """Most of the markers that may be further off than ten deviations: with more it is the arm that is wrong."""
    scale: float = setting(0.01, above=0.0)
    """By which the motion capture's metre may differ."""


ARM_FIT = ArmFitSettings()


@dataclass(frozen=True)
class ArmFit:
    """A fitted arm.

    Attributes:
        shape: the arm as drawn.
        errors: by what it differs, and its base.
        up: (3,) unit vector in the motion capture's frame.
        fitted: groups of parameters.
        sigmas: of :meth:`ArmErrors.packed` (P,), after the fit; too small, for not all errors are noise.
        priors: (P,) before it; 0 where nothing was fitted.
        rms: m, of what is left of the markers, strays counted less.
        residuals: (N, M) m, of each marker; 0 where unseen.
        weights: (N, M) of the markers, 1 where none was held for a stray.
    """

    shape: ArmShape
    errors: ArmErrors
    up: Array
    fitted: tuple[str, ...]
    sigmas: Array
    priors: Array
    rms: float
    residuals: Array
    weights: Array

    def predicted(self, encoders: Array, sides: Array | None = None) -> tuple[Array, Array, Array]:
        """Markers (N, M, 3), and centre (N, 3) and axes (N, 3, 3) of the last frame, in the motion capture's frame."""
        sides = np.zeros_like(encoders) if sides is None else sides
        frames = _frames(self.shape, self.errors, encoders, sides, self.up)[0]
        return marker_places(self.shape, self.errors, frames), frames.centres[:, -1], frames.last


def fit_arm(
    shape: ArmShape,
    poses: ArmPoses,
    up: Array,
    fitted: tuple[str, ...] = ALL,
    settings: ArmFitSettings = ARM_FIT,
    start: ArmErrors | None = None,
) -> ArmFit:
    """Fits an arm to what was seen of its plate.

    Args:
        shape: the arm as drawn, 4 to 7 joints.
        poses: encoders and markers.
        up: (3,) unit vector, the vertical in the motion capture's frame.
        fitted: groups of parameters.
        settings: priors and noise.
        start: where it begins, and what is kept of all that is not fitted; None for the arm as drawn, laid on what was
            seen.

    Raises:
        HighFiveError: too few poses, or no arm fits them; one line says what to look at.
    """
    if len(poses) < settings.fewest:
        raise HighFiveError(f"{len(poses)} poses, at least {settings.fewest} are needed; 30 are good")
    if not (np.isfinite(poses.encoders).all() and np.isfinite(poses.markers[poses.seen]).all()):
        raise HighFiveError("a pose has a number that is not finite; leave it out")
    errors = start
    if errors is None:
        laid = placed(shape, poses)
        errors = as_drawn(shape, laid.rotation, laid.translation)
    priors = _priors(errors, fitted, settings)
    weights = poses.seen.astype(float)
    for _ in range(_ROUNDS):
        torques = _frames(shape, errors, poses.encoders, poses.sides, up)[1]
        errors, normal = _levenberg(shape, errors, poses, torques, weights, priors, settings)
        weights = _reweighted(shape, errors, poses, torques, settings)
    free = priors > 0.0
    sigmas = np.zeros_like(priors)
    sigmas[free] = np.sqrt(np.diag(np.linalg.inv(normal)))
    seen = _seen_residuals(shape, errors, poses, up)
    off = np.linalg.norm(seen, axis=-1)
    rms = float(np.sqrt(np.sum(weights * off**2) / max(weights.sum() * 3.0, 1e-12)))
    return ArmFit(shape, errors, up, fitted, sigmas, priors, rms, off, weights)


def whitened_columns(
    shape: ArmShape, postures: Array, up: Array, fitted: tuple[str, ...] = ALL, settings: ArmFitSettings = ARM_FIT
) -> tuple[Array, Array]:
    """What postures (N, J), rad, of the arm as drawn tell: whitened Jacobians (N, 3M, F), and priors (F,) of what is
    fitted; ``up`` (3,) in the base's frame."""
    errors, shown = as_drawn(shape), (len(postures), len(shape.markers))
    poses = ArmPoses(postures, np.zeros_like(postures), np.zeros((*shown, 3)), np.ones(shown, bool))
    torques = _frames(shape, errors, postures, poses.sides, up)[1]
    columns = _system(shape, errors, poses, torques, np.ones(shown), settings)[1]
    priors = _priors(errors, fitted, settings)
    return columns.reshape(len(postures), -1, len(priors))[..., priors > 0.0], priors[priors > 0.0]


def placed(shape: ArmShape, poses: ArmPoses) -> RigidFit:
    """One rigid motion that brings the arm as drawn nearest to what was seen.

    Raises:
        HighFiveError: the motion capture's frame is a mirror image, or its unit is no metre.
    """
    drawn = as_drawn(shape)
    nominal = marker_places(shape, drawn, frames_of(shape, drawn, poses.encoders))
    found = rigid_fit(nominal[poses.seen], poses.markers[poses.seen], 0.03)
    if not 0.05 < found.scale < 20.0:  # a reversed joint may halve it; millimetres are 1000
        raise HighFiveError(
            f"the plate moved {found.scale:.3g} times as far as the arm says; does the motion capture send metres?"
        )
    if found.mirrored:
        raise HighFiveError(
            f"the markers fit a mirror image ({1e3 * found.mirrored_rms:.1f} against {1e3 * found.rms:.1f} mm): "
            "the motion capture's axes are left-handed; set its up axis"
        )
    return found


def check_fit(fit: ArmFit, settings: ArmFitSettings = ARM_FIT) -> None:
    """Refuses a fit that nothing should rest on. A wrong metre comes out as links that are all too long.

    Raises:
        HighFiveError: residuals are no noise, or the scale is off; one line says what to look at.
    """
    offsets = fit.shape.offsets
    scale = 1.0 + float(np.sum(offsets * fit.errors.length) / np.sum(offsets**2))
    astray = float(np.mean(fit.weights[fit.weights > 0.0] < 0.1 * settings.cut))
    worst = int(np.argmax(np.abs(fit.errors.zero)))
    zero = abs(float(fit.errors.zero[worst]))
    if fit.rms > settings.worst_rms or astray > settings.strays or zero > settings.worst_zero:
        raise HighFiveError(
            f"no arm fits: residuals are {1e3 * fit.rms:.1f} mm (root mean square; at most "
            f"{1e3 * settings.worst_rms:g} are noise), {astray:.0%} of the markers are astray, and the zero of "
            f"{fit.shape.names[worst]} is {np.degrees(zero):.1f}° off; is a joint reversed, or a marker loose?"
        )
    if abs(scale - 1.0) > settings.scale:
        raise HighFiveError(
            f"the arm's links come out {scale:.4f} as long as drawn, expected 1 ± {settings.scale:g}; "
            "calibrate the cameras with the right wand"
        )


def _frames(shape: ArmShape, errors: ArmErrors, encoders: Array, sides: Array, up: Array) -> tuple[Frames, Array]:
    """Frames of what encoders (N, J) say, and the torques (N, J), N·m, there."""
    drawn = replace(errors, compliance=np.zeros_like(errors.compliance))
    none = np.zeros_like(encoders)
    torques = gravity_torques(shape, frames_of(shape, drawn, true_angles(drawn, encoders, none, sides)), up)
    return frames_of(shape, errors, true_angles(errors, encoders, torques, sides)), torques


def _priors(errors: ArmErrors, fitted: tuple[str, ...], settings: ArmFitSettings) -> Array:
    if unknown := set(fitted) - set(KINDS):
        raise HighFiveError(f"{', '.join(sorted(unknown))}: nothing that is fitted; there are {', '.join(KINDS)}")
    sizes = [np.full(getattr(errors, kind).size, getattr(settings, kind) if kind in fitted else 0.0) for kind in KINDS]
    return np.concatenate(sizes)


def _seen_residuals(shape: ArmShape, errors: ArmErrors, poses: ArmPoses, up: Array) -> Array:
    frames = _frames(shape, errors, poses.encoders, poses.sides, up)[0]
    return np.where(poses.seen[..., None], poses.markers - marker_places(shape, errors, frames), 0.0)


def _covariances(turns: Array, weights: Array, settings: ArmFitSettings) -> Array:
    """(N, 3M, 3M) m² of what markers are off by; those that count less are less sure, unseen ones by themselves."""
    count, markers, _, joints = turns.shape
    flat = turns.reshape(count, 3 * markers, joints)
    seen = np.repeat(weights > 0.0, 3, axis=1)
    flat = np.where(seen[..., None], flat, 0.0)
    own = np.where(seen, settings.marker_noise**2 / np.repeat(np.maximum(weights, 1e-12), 3, axis=1), 1.0)
    found = settings.joint_noise**2 * flat @ np.swapaxes(flat, 1, 2)
    found[:, np.arange(3 * markers), np.arange(3 * markers)] += own
    return found


def _system(
    shape: ArmShape, errors: ArmErrors, poses: ArmPoses, torques: Array, weights: Array, settings: ArmFitSettings
) -> tuple[Array, Array]:
    """Whitened residuals (R,) and their Jacobian (R, P)."""
    frames = frames_of(shape, errors, true_angles(errors, poses.encoders, torques, poses.sides))
    places = marker_places(shape, errors, frames)
    columns = jacobian(errors, frames, places, poses.encoders, torques, poses.sides)
    residual = np.where(poses.seen[..., None], poses.markers - places, 0.0).reshape(len(poses), -1)
    columns = np.where(poses.seen[..., None, None], columns, 0.0).reshape(*residual.shape, -1)
    lower = np.linalg.cholesky(_covariances(joint_columns(frames, places), weights, settings))
    both: Array = np.linalg.solve(lower, np.concatenate([residual[..., None], columns], axis=-1)).astype(float)
    both = both.reshape(-1, both.shape[-1])
    return both[:, 0], both[:, 1:]


def _levenberg(
    shape: ArmShape,
    errors: ArmErrors,
    poses: ArmPoses,
    torques: Array,
    weights: Array,
    priors: Array,
    settings: ArmFitSettings,
) -> tuple[ArmErrors, Array]:
    """The errors that fit best with these weights, and the normal matrix (F, F) of what is free."""
    free = priors > 0.0
    inverse = 1.0 / priors[free] ** 2

    def look(at: ArmErrors) -> tuple[float, Array, Array]:
        residual, columns = _system(shape, at, poses, torques, weights, settings)
        columns, off = columns[:, free], at.packed()[free]
        cost = float(residual @ residual + off @ (inverse * off))
        return cost, columns.T @ columns + np.diag(inverse), columns.T @ residual - inverse * off

    damping = 1e-3
    cost, normal, slope = look(errors)
    for _ in range(_STEPS):
        step = np.zeros(len(priors))
        step[free] = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), slope)
        tried = errors.unpacked(errors.packed() + step)
        now, ahead, after = look(tried)
        if now < cost:
            done = cost - now < 1e-6 * cost
            errors, cost, normal, slope = tried, now, ahead, after
            damping = max(0.1 * damping, 1e-9)
            if done:
                break
        else:
            damping *= 10.0
            if damping > 1e6:
                break
    return errors, normal


def _reweighted(shape: ArmShape, errors: ArmErrors, poses: ArmPoses, torques: Array, settings: ArmFitSettings) -> Array:
    """(N, M) weights of markers by how far they are from where the others say that the plate is."""
    frames = frames_of(shape, errors, true_angles(errors, poses.encoders, torques, poses.sides))
    places = marker_places(shape, errors, frames)
    turns = joint_columns(frames, places)
    count, markers, _, joints = turns.shape
    flat = np.where(poses.seen[..., None, None], turns, 0.0).reshape(count, 3 * markers, joints)
    residual = np.where(poses.seen[..., None], poses.markers - places, 0.0).reshape(count, -1)
    weights = poses.seen.astype(float)
    for _ in range(2 * _ROUNDS):
        whole = _covariances(turns, weights, settings)
        joints_off = settings.joint_noise**2 * np.swapaxes(flat, 1, 2) @ np.linalg.solve(whole, residual[..., None])
        left = (residual - (flat @ joints_off)[..., 0]).reshape(count, markers, 3)
        off = np.linalg.norm(left, axis=-1) / np.sqrt(3.0)
        weights = np.minimum(1.0, settings.cut * settings.marker_noise / np.maximum(off, 1e-12)) * poses.seen
    return weights
