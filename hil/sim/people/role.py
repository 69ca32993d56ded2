"""One actor's part in a trial, and the motion that comes of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from highfive.hil.sim.avatar import avatar_skeleton
from highfive.hil.sim.people.emotions import EmotionStyle
from highfive.model.geometry.rotations import Array
from highfive.model.geometry.skeleton import Skeleton

RATE_HZ = 120.0

ARM = ("right_shoulder", "right_elbow", "right_wrist")
TRUNK = ("lumbar_5", "lumbar_3", "thoracic_12", "thoracic_8")


@dataclass(frozen=True)
class ActorMotion:
    """Motion of one actor at 120 Hz.

    Attributes:
        skeleton: the actor's body.
        root_in_world: (T, 3) m.
        quaternions: (T, 53, 4), the pelvis relative to the world.
    """

    skeleton: Skeleton
    root_in_world: Array
    quaternions: Array


@dataclass(frozen=True)
class PalmTarget:
    """A palm at contact, the swivel of the elbow and the trunk's extra lean (rad) behind it."""

    position: Array
    normal: Array
    fingers: Array
    elbow_out: float
    extra_lean: float


@dataclass(frozen=True)
class Individual:
    """How one performance differs from the next: angles in rad, lengths in m, times in s."""

    posture: Array
    sway_amplitude: Array
    sway_frequency: Array
    sway_phase: Array
    trunk_lead: float
    rest_arm: Array
    elbow_out: float
    wobble: Array


@dataclass(frozen=True)
class Role:
    """One actor's part in a trial, in the actor's own frame (pelvis over the origin, facing +x)."""

    skeleton: Skeleton
    style: EmotionStyle
    individual: Individual
    palm: PalmTarget
    contact_s: float
    end_s: float
    onset_s: float


def draw_individual(rng: np.random.Generator) -> Individual:
    """One performance's own, at random."""
    joints = len(avatar_skeleton())
    return Individual(
        posture=np.radians(rng.normal(0.0, 1.2, (joints, 3))) * _NOISY[:, None],
        sway_amplitude=np.radians(rng.normal(0.0, 0.35, (2, joints, 3))) * _NOISY[:, None],
        sway_frequency=rng.uniform(0.15, 0.6, (2, joints, 3)),
        sway_phase=rng.uniform(0, 2 * np.pi, (2, joints, 3)),
        trunk_lead=rng.uniform(0.03, 0.09),
        rest_arm=np.radians(rng.normal(0.0, [4, 2, 6, 6, 0, 8, 4, 3, 0], (2, 9))),
        elbow_out=np.radians(rng.normal(0.0, 5.0)),
        wobble=rng.normal(0.0, 0.02, 3),
    )


# Legs and fingers do not sway: the feet are planted and the fingers are set by the posture.
_NOISY = np.array(
    [
        float(n in (*TRUNK, "pelvis", "neck", "head", "left_shoulder", "left_elbow", "right_clavicle"))
        for n in avatar_skeleton().names
    ]
)
