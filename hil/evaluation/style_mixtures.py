"""One hand answered in mixtures of two styles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from highfive.hil.session.style_timing import StyledTiming
from highfive.hil.sim.avatar import avatar_skeleton, right_palm
from highfive.model.evaluation import metrics
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Trial
from highfive.model.online.responder import Responder

WEIGHTS = (0.0, 0.25, 0.5, 0.75, 1.0)
MOMENTS = (-0.6, -0.4, -0.2, 0.0, 0.3, 0.6)  # s from contact


@dataclass(frozen=True)
class Morph:
    """The answer in one mixture.

    Attributes:
        label: the mixture.
        start, end: the two emotions.
        weight: of the second, 0 to 1.
        source: whose hand it is.
        moments: s from the recorded contact.
        joints: (M, J, 3) m, the avatar's joints at these moments.
        hands: (M, 2, 3) m, the person's wrist and knuckle centre.
        peak_speed: m/s, of the avatar's palm until contact.
    """

    label: str
    start: str
    end: str
    weight: float
    source: str
    moments: tuple[float, ...]
    joints: Array
    hands: Array
    peak_speed: float


def morphs(model: HGPDM, trials: Sequence[Trial]) -> list[Morph]:
    """Answers to one trial's hand from one style to another; none if the model knows but one."""
    if len(model.emotions) < 2:
        return []
    start = "neutral" if "neutral" in model.emotions else model.emotions[0]
    end = "angry" if "angry" in model.emotions and start != "angry" else next(e for e in model.emotions if e != start)
    mine = [trial for trial in trials if trial.emotion == start] or list(trials)
    trial = next((t for t in mine if t.cell == "B2"), mine[len(mine) // 2])
    return [_morph(model, trial, start, end, weight) for weight in WEIGHTS]


def _morph(model: HGPDM, trial: Trial, start: str, end: str, weight: float) -> Morph:
    responder = Responder(model, {start: 1.0 - weight, end: weight}, trial.rate_hz)
    timing, skeleton = StyledTiming(model), avatar_skeleton()
    waiting = timing.waiting(responder.style)
    poses = [timing.answering(responder.step(hand), responder.style, waiting) for hand in trial.hand_points]
    roots, hinges = np.array([pose.root_in_world for pose in poses]), np.array([pose.hinges for pose in poses])
    joints, turned = skeleton.forward_kinematics(roots, skeleton.from_hinges(hinges))
    palm, _, _ = right_palm(skeleton, joints, turned)
    frames = trial.contact_frame + np.round(np.array(MOMENTS) * trial.rate_hz).astype(int)
    frames = frames.clip(0, len(poses) - 1)
    until = max(2, trial.contact_frame + 1)
    speed = metrics.speeds(palm[:until], trial.rate_hz)
    label = f"{start} {100 * (1 - weight):.0f} %\n{end} {100 * weight:.0f} %"
    source = f"{trial.emotion}{trial.cell and ', cell ' + trial.cell}"
    hands = trial.hand_points[frames]
    return Morph(label, start, end, weight, source, MOMENTS, joints[frames], hands, float(speed.max()))
