"""Where a headset's own space lies in a motion capture system's, from a head that nods and turns; and whether it stays.

The head wears both: the headset, which says where the eyes are in its space, and markers, which make a body in the
world. With X the headset's space in the world and Y the eyes in the body, X · eyes(t) = body(t - delay) · Y holds at
all times: the problem of hand and eye for an unknown base (Zhuang, Roth & Sudhakar 1994, IEEE Trans. Robot. Autom.
10(4)); a linear solution, rotations first, begins the fit. What clocks and tracking differ by in time is found with
it: 20 ms that nobody knows of cost 5 mm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

SIGMA_M, SIGMA_RAD = 0.003, 0.005
"""What a residual of place and of turn counts by."""
LONGEST_DELAY_S, STEP_S = 0.2, 0.04
"""Delays that are tried, one way and the other, and how far apart."""
MOST_POSES = 400
"""Of those that came, evenly taken: more say little more."""
HAND = np.array([0.0, -0.25, -0.5])
"""(3,) m, from the eyes (x right, y up, z backward): where a registration has to be right."""
WORST_M = 0.01
"""A fit that is less sure of that hand than this (a standard deviation) has seen too little motion."""
DRIFTED_M, DRIFTED_RAD = 0.015, 0.026
"""Further off than this, on average over a while, a registration no longer holds."""


@dataclass(frozen=True)
class Track:
    """Poses of one body.

    Attributes:
        times: (T,) s, rising.
        quaternions: (T, 4).
        positions: (T, 3) m.
    """

    times: Float[np.ndarray, " T"]
    quaternions: Float[np.ndarray, "T 4"]
    positions: Float[np.ndarray, "T 3"]

    def at(self, times: Array) -> tuple[Array, Array]:
        """Quaternions (N, 4) and positions (N, 3), m, at times within the track, straight from pose to pose."""
        after = np.clip(np.searchsorted(self.times, times), 1, len(self.times) - 1)
        begin, end = self.times[after - 1], self.times[after]
        share = np.clip((times - begin) / (end - begin), 0.0, 1.0)[:, None]
        turn = rotations.multiply(rotations.conjugate(self.quaternions[after - 1]), self.quaternions[after])
        part = rotations.from_rotation_vector(share * rotations.to_rotation_vector(turn))
        positions = (1.0 - share) * self.positions[after - 1] + share * self.positions[after]
        return rotations.multiply(self.quaternions[after - 1], part), positions


@dataclass(frozen=True)
class HeadsetRegistration:
    """A headset's space in the world.

    Attributes:
        rotation: (4,) quaternion and ...
        translation: ... (3,) m: from the headset's space to the world.
        eyes_rotation, eyes_translation: (4,) and (3,) m, of the eyes in the body that the markers make.
        delay_s: the headset's poses hold for a time that is so much later on the motion capture's clock.
        residual_m, residual_rad: root mean square over the poses.
        hand_sigma_m: m, standard deviation (of the length) of a hand before the eyes, by the fit's own covariance.
    """

    rotation: Float[np.ndarray, "4"]
    translation: Float[np.ndarray, "3"]
    eyes_rotation: Float[np.ndarray, "4"]
    eyes_translation: Float[np.ndarray, "3"]
    delay_s: float
    residual_m: float
    residual_rad: float
    hand_sigma_m: float

    def apply(self, points: Array) -> Array:
        """Points (..., 3), m, of the headset's space in the world."""
        return rotations.rotate(self.rotation, points) + self.translation


def register_headset(eyes: Track, body: Track) -> HeadsetRegistration:
    """Fits both transforms and the delay to what headset and motion capture saw of one head.

    Args:
        eyes: in the headset's space, on the headset's clock.
        body: of the markers, in the world, on the motion capture's clock.

    Raises:
        HighFiveError: the tracks are too short, do not overlap, or the head did not nod and turn enough.
    """
    first, last = body.times[0] + LONGEST_DELAY_S, body.times[-1] - LONGEST_DELAY_S
    inside = (eyes.times > first) & (eyes.times < last)
    if inside.sum() < 100:
        raise HighFiveError(
            f"{inside.sum()} poses seen by headset and motion capture, expected 100: nod and turn for 20 s"
        )
    used = np.flatnonzero(inside)[:: max(1, int(inside.sum()) // MOST_POSES)]
    eyes = Track(eyes.times[used], eyes.quaternions[used], eyes.positions[used])
    delays = np.arange(-LONGEST_DELAY_S, LONGEST_DELAY_S + 0.5 * STEP_S, STEP_S)
    starts = [_solved(eyes, body, delay) for delay in delays]
    costs = [float(np.square(_residuals(start, eyes, body)).sum()) for start in starts]
    fit = least_squares(_residuals, starts[int(np.argmin(costs))], args=(eyes, body), loss="soft_l1")
    residuals = _residuals(fit.x, eyes, body).reshape(-1, 6)
    information = fit.jac.T @ fit.jac
    if np.linalg.cond(information) > 1e14:
        raise HighFiveError("the head hardly moved: nod and turn for 20 s")
    covariance = np.linalg.inv(information).astype(np.float64) * max(float(np.square(residuals).mean()), 1e-6)
    hand_sigma = _hand_sigma(fit.x, covariance, eyes)
    if hand_sigma > WORST_M:
        raise HighFiveError(
            f"a hand would be known to {1e3 * hand_sigma:.0f} mm, expected {1e3 * WORST_M:.0f}: nod and turn the head "
            "further, for 20 s"
        )
    if abs(fit.x[12]) > LONGEST_DELAY_S:
        raise HighFiveError(
            f"a delay of {1e3 * fit.x[12]:.0f} ms fits best; expected at most {1e3 * LONGEST_DELAY_S:.0f}"
        )
    return HeadsetRegistration(
        rotations.from_rotation_vector(fit.x[:3]), fit.x[3:6], rotations.from_rotation_vector(fit.x[6:9]), fit.x[9:12],
        float(fit.x[12]), SIGMA_M * float(np.sqrt(np.square(residuals[:, 3:]).sum(axis=1).mean())),
        SIGMA_RAD * float(np.sqrt(np.square(residuals[:, :3]).sum(axis=1).mean())), hand_sigma,
    )  # fmt: skip


def drift(registration: HeadsetRegistration, eyes: Track, body: Track) -> tuple[float, float]:
    """By how much a registration is off in some later seconds: m, of the eyes, and rad, both of the mean over them."""
    unknowns = np.concatenate(
        [
            rotations.to_rotation_vector(registration.rotation), registration.translation,
            rotations.to_rotation_vector(registration.eyes_rotation), registration.eyes_translation,
            [registration.delay_s],
        ]
    )  # fmt: skip
    off = np.median(_residuals(unknowns, eyes, body).reshape(-1, 6), axis=0)
    return SIGMA_M * float(np.linalg.norm(off[3:])), SIGMA_RAD * float(np.linalg.norm(off[:3]))


def has_drifted(registration: HeadsetRegistration, eyes: Track, body: Track) -> str:
    """In one line why a registration no longer holds; '' where it does."""
    distance, angle = drift(registration, eyes, body)
    if distance <= DRIFTED_M and angle <= DRIFTED_RAD:
        return ""
    return (
        f"the headset is {1e3 * distance:.0f} mm and {np.degrees(angle):.1f}° from where it was registered "
        f"(at most {1e3 * DRIFTED_M:.0f} and {np.degrees(DRIFTED_RAD):.1f}): register it anew"
    )


def _solved(eyes: Track, body: Track, delay: float) -> Array:
    """The unknowns (13,), linearly, for a delay, s."""
    turns, places = body.at(eyes.times - delay)
    # X · e = b · Y for rotation matrices, linear in both: the smallest singular vector, brought to rotations.
    e, b, unit = rotations.to_matrix(eyes.quaternions), rotations.to_matrix(turns), np.eye(3)
    left = np.einsum("ia,nbj->nijab", unit, e).reshape(-1, 9)
    right = np.einsum("nia,bj->nijab", b, unit).reshape(-1, 9)
    system = np.concatenate([left, -right], axis=1)
    both = np.linalg.eigh(system.T @ system)[1][:, 0].reshape(2, 3, 3)
    x, y = rotations.from_matrix(rotations.nearest_rotation(both * np.sign(np.linalg.det(both[0]))))
    # R(x) e + t = R(b) s + p: linear in t and s.
    rows = np.concatenate([np.tile(unit, (len(places), 1, 1)), -b], axis=2).reshape(-1, 6)
    apart = (places - rotations.rotate(x, eyes.positions)).reshape(-1)
    solution = np.linalg.lstsq(rows, apart, rcond=None)[0]
    return np.concatenate(
        [rotations.to_rotation_vector(x), solution[:3], rotations.to_rotation_vector(y), solution[3:], [delay]]
    )


def _residuals(unknowns: Array, eyes: Track, body: Track) -> Array:
    """Turn and place (6 N,) by which both ways to the eyes differ, over their deviations."""
    x, y = (rotations.from_rotation_vector(unknowns[k : k + 3]) for k in (0, 6))
    turns, places = body.at(eyes.times - unknowns[12])
    one, other = rotations.multiply(x, eyes.quaternions), rotations.multiply(turns, y)
    turned = rotations.to_rotation_vector(rotations.multiply(one, rotations.conjugate(other)))
    apart = rotations.rotate(x, eyes.positions) + unknowns[3:6] - rotations.rotate(turns, unknowns[9:12]) - places
    return np.concatenate([turned / SIGMA_RAD, apart / SIGMA_M], axis=1).reshape(-1)


def _hand_sigma(unknowns: Array, covariance: Array, eyes: Track) -> float:
    """m, by how much the world's place of a hand before the eyes may be off."""
    hand = eyes.positions.mean(axis=0) + rotations.rotate(eyes.quaternions[len(eyes.times) // 2], HAND)
    slopes = np.zeros((3, 13))
    for k in range(6):
        ahead, behind = unknowns[:6].copy(), unknowns[:6].copy()
        ahead[k], behind[k] = ahead[k] + 1e-5, behind[k] - 1e-5
        places = [rotations.rotate(rotations.from_rotation_vector(u[:3]), hand) + u[3:] for u in (ahead, behind)]
        slopes[:, k] = (places[0] - places[1]) / 2e-5
    return float(np.sqrt(np.trace(slopes @ covariance @ slopes.T)))
