"""The markers of several systems that see the same person, as one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.marker_mix import mix_frames
from highfive.mocap_bridge.sources.timeline import AHEAD_NS, Between
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class MergeSettings(Settings):
    """How far off a marker is where a system does not say, and when two systems do not mean the same."""

    sigma: float = setting(0.0012, "m", above=0.0)
    """Standard deviation of a measured marker where the frame does not say it; as the tracker has it."""
    acceleration: float = setting(20.0, "m/s²", least=0.0)
    """By so much a hand's path is bent: of a quick high five half of the samples are below."""
    apart: float = setting(0.015, "m", above=0.0)
    """Further apart than this, and than what the standard deviations allow three times, one of the two is wrong: a
    swapped label, or a placement."""


@dataclass(frozen=True)
class Placed:
    """From one system's frame into that of all.

    Attributes:
        rotation: (4,) quaternion.
        translation: (3,) m, added after the rotation.
    """

    rotation: Float[np.ndarray, "4"]
    translation: Float[np.ndarray, "3"]


@dataclass(frozen=True)
class Seen:
    """What one system says of the markers at one time, in the frame of all.

    Attributes:
        names: M markers.
        positions: (M, 3) m.
        valid: (M,) bool.
        covariance: (M, 3, 3) m², with what the time may be off by, and the path between samples.
        unlabelled: (U, 3) m.
    """

    names: tuple[str, ...]
    positions: Float[np.ndarray, "M 3"]
    valid: Bool[np.ndarray, " M"]
    covariance: Float[np.ndarray, "M 3 3"]
    unlabelled: Float[np.ndarray, "U 3"]


def seen_at(
    found: Between[MarkerFrame], time_ns: int, bound_ns: int, placed: Placed, settings: MergeSettings
) -> Seen | None:
    """What a system says for a time; None where it has not said anything for too long.

    Args:
        found: where the time lies among its frames.
        time_ns: the time.
        bound_ns: how far the system's own time may be off.
        placed: where it stands.
        settings: how far off it is.
    """
    if found.age_ns > AHEAD_NS:
        return None
    a, b, share = found.first, found.second, found.share
    frame = a if share == 0.0 else mix_frames(a, b, share, time_ns)
    count = len(frame.names)
    own = np.broadcast_to(settings.sigma**2 * np.eye(3), (count, 3, 3))
    covariance = own if frame.covariance is None else frame.covariance
    if share != 0.0:
        # On a path that is bent by a, the straight line between samples h apart is off by a h² s (1 − s) / 2.
        seconds = 1e-9 * found.apart_ns
        covariance = covariance + (0.5 * settings.acceleration * abs(share * (1.0 - share)) * seconds**2) ** 2 * np.eye(
            3
        )
        off = (b.positions - a.positions) / seconds * (1e-9 * bound_ns)
        covariance = covariance + off[:, :, None] * off[:, None, :]
    turn = rotations.to_matrix(placed.rotation)
    positions = np.where(frame.valid[:, None], frame.positions @ turn.T + placed.translation, 0.0)
    return Seen(
        frame.names, positions, frame.valid, turn @ covariance @ turn.T,
        frame.unlabelled @ turn.T + placed.translation,
    )  # fmt: skip


def merge(
    systems: Sequence[Seen], names: tuple[str, ...], settings: MergeSettings
) -> tuple[Array, Bool[np.ndarray, " M"], Array, tuple[str, ...]]:
    """All markers of ``names`` as all systems see them together.

    A marker that several see is where their covariances weigh it to be. Where two do not mean the same place the less
    certain one is left out.

    Returns:
        positions (M, 3), m; valid (M,); covariances (M, 3, 3), m²; and the names of markers that are not at one place.
    """
    positions, covariance = np.zeros((len(names), 3)), np.tile(np.eye(3), (len(names), 1, 1))
    valid, apart = np.zeros(len(names), dtype=bool), np.zeros(len(names), dtype=bool)
    for system in systems:
        rows = np.array([names.index(name) for name in system.names], dtype=np.intp)
        both = system.valid & valid[rows]
        new = system.valid & ~both
        positions[rows[new]], covariance[rows[new]] = system.positions[new], system.covariance[new]
        valid[rows[new]] = True
        at = rows[both]
        if not len(at):
            continue
        gap, own = system.positions[both] - positions[at], system.covariance[both]
        total = covariance[at] + own
        spread = np.trace(total, axis1=1, axis2=2)
        wrong = np.sum(gap**2, axis=1) > np.maximum(settings.apart**2, 9.0 * spread)
        surer = np.trace(own, axis1=1, axis2=2) < np.trace(covariance[at], axis1=1, axis2=2)
        # Of two independent measurements, as a Kalman filter's update has it.
        gain = covariance[at] @ np.linalg.inv(total)
        gain[wrong & ~surer], gain[wrong & surer] = 0.0, np.eye(3)
        rest = np.eye(3) - gain
        positions[at] += np.einsum("mij,mj->mi", gain, gap)
        covariance[at] = rest @ covariance[at] @ rest.swapaxes(1, 2) + gain @ own @ gain.swapaxes(1, 2)
        apart[at] |= wrong
    return positions, valid, covariance, tuple(np.array(names, dtype=object)[apart].tolist())
