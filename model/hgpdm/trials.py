"""The value from which the model is trained: aligned trials of a person's hand and an avatar actor's pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Trial:
    """One recorded trial of two people, sampled at ``rate_hz`` on one clock.

    Attributes:
        rate_hz: frames per second.
        hand_points: (T, 2, 3) m, the person's wrist and knuckle centre (the paper's Y²).
        joints: (T, D) rad, the avatar actor's joint rotations as rotation vectors relative to the rest pose (the
            paper's Y¹, D = 159).
        root: (T, 3) m, the avatar actor's pelvis.
        palm: (T, 3) m, the avatar actor's palm centre.
        person_palm: (T, 3) m, the person's palm centre.
        contact_frame: frame at which the palms are nearest.
        emotion: emotion of the trial.
        cell: cell of the grid, or '' where not known.
        repetition: repetition, or -1 where not known.
        test: the trial is held out.
        arm_points: (T, 3, 3) m, the person's elbow, shoulder and head centre; None where they are not known.
    """

    rate_hz: float
    hand_points: Float[np.ndarray, "T 2 3"]
    joints: Float[np.ndarray, "T D"]
    root: Float[np.ndarray, "T 3"]
    palm: Float[np.ndarray, "T 3"]
    person_palm: Float[np.ndarray, "T 3"]
    contact_frame: int
    emotion: str
    cell: str
    repetition: int
    test: bool
    arm_points: Float[np.ndarray, "T 3 3"] | None = None


@dataclass(frozen=True)
class Gesture:
    """A person's right hand in a trial in which no contact comes.

    Attributes:
        rate_hz: frames per second.
        hand_points: (T, 2, 3) m, wrist and knuckle centre, as of a :class:`Trial`.
        name: what she does, '' where not known.
        test: the trial is held out.
    """

    rate_hz: float
    hand_points: Float[np.ndarray, "T 2 3"]
    name: str = ""
    test: bool = False
