"""A style classifier: which emotion a motion shows, judged by joint angles and speeds alone.

Linear discriminant analysis of a few named features of one high five, the classifier that leaves least to be chosen. It
learns from captured motion and then judges motion that a model generated: if the emotion survives generation and
correction, it sees there what it saw in the actors. Cues: how spine, head and arms are held, and how fast the arm that
reaches moves (Pollick et al. 2001, Roether et al. 2009). Fingers are left out: a fist would give anger away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfiltfilt

from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.geometry.skeleton import Skeleton
from highfive.model.settings import Settings, setting

PARTS: dict[str, tuple[str, ...]] = {
    "trunk": ("lumbar_5", "lumbar_3", "thoracic_12", "thoracic_8"),
    "head": ("neck", "head"),
    "right shoulder": ("right_clavicle", "right_shoulder"),
    "right elbow": ("right_elbow",),
    "left shoulder": ("left_clavicle", "left_shoulder"),
    "left elbow": ("left_elbow",),
}
"""Parts of the body whose carriage counts; the angle of a part is the sum over its joints."""

REACHING = ("right shoulder", "right elbow")
"""Parts whose speed counts, beside the palm's. The others hardly move: their speed is the noise of the capture."""


@dataclass(frozen=True)
class StyleClassifierSettings(Settings):
    """What counts as movement, and how much is shrunk. All by convention; nothing was chosen on generated motion."""

    cutoff_hz: float = setting(8.0, "Hz", above=0.0)
    """Motion is smoothed by a Butterworth filter, forwards and back, as is usual before differentiating markers (Winter
    2009, ch. 3); captured and generated motion differ in noise."""
    moving: float = setting(0.1, above=0.0, most=1.0)
    """The movement lasts from the first to the last frame in which the palm has this share of its peak speed."""
    still: float = setting(0.05, "m/s", above=0.0)
    """A palm that is never quicker makes no high five."""
    shrinkage: float = setting(0.1, least=0.0, most=1.0)
    """Share of the identity in the covariance of the standardised features, which are about a quarter as many as
    trials."""


CLASSIFIER = StyleClassifierSettings()

ANGLES = tuple(f"{part}, mean rotation about {axis}" for part in PARTS for axis in "xyz")
SPEEDS = tuple(f"{part}, log {which} speed" for part in (*REACHING, "palm") for which in ("median", "peak"))
FEATURES = (*ANGLES, *SPEEDS)
"""What :func:`features` gives, in order."""


@dataclass(frozen=True)
class Motion:
    """One high five of one body.

    Attributes:
        rate_hz: frames per second.
        joints: (T, 3 J) rad, rotation vectors relative to the rest pose.
        palm: (T, 3) m, the right palm's centre.
    """

    rate_hz: float
    joints: Array
    palm: Array

    def palm_speed(self) -> Array:
        """Speed of the palm (T,), m/s, smoothed.

        Raises:
            HighFiveError: the motion is too short to be smoothed.
        """
        return np.linalg.norm(np.gradient(self._smooth(self.palm), axis=0), axis=-1) * self.rate_hz

    def smooth_joints(self) -> Array:
        """Joint rotations (T, J, 3), rad, smoothed."""
        return self._smooth(self.joints).reshape(len(self.joints), -1, 3)

    def _smooth(self, values: Array) -> Array:
        if len(values) < 0.3 * self.rate_hz:
            raise HighFiveError(f"a motion of {len(values)} frames at {self.rate_hz:g} Hz; expected a whole high five")
        if 0.45 * self.rate_hz <= CLASSIFIER.cutoff_hz:  # slow recordings are smooth as they are
            return values
        return sosfiltfilt(butter(2, CLASSIFIER.cutoff_hz, fs=self.rate_hz, output="sos"), values, axis=0)


def features(motion: Motion, skeleton: Skeleton) -> Array:
    """Means of the parts' rotations (rad) and logarithms of the arm's speeds (rad/s, palm m/s), see ``FEATURES``.

    Only frames of the movement count, so that waiting before and after it makes no difference.

    Raises:
        HighFiveError: the motion is too short, or the palm does not move.
    """
    palm_speed, turns = motion.palm_speed(), motion.smooth_joints()
    if palm_speed.max() < CLASSIFIER.still:
        raise HighFiveError(f"the palm moves at {palm_speed.max():.3f} m/s at the most; expected a whole high five")
    moving = np.flatnonzero(palm_speed >= CLASSIFIER.moving * palm_speed.max())
    window = slice(moving[0], moving[-1] + 1)
    joints = {part: [skeleton.index(name) for name in names] for part, names in PARTS.items()}
    angles = [turns[window, own].sum(axis=1).mean(axis=0) for own in joints.values()]
    speeds = [_angular_speed(turns[:, joints[part]], motion.rate_hz)[window] for part in REACHING]
    quantiles = [(np.median(speed), speed.max()) for speed in (*speeds, palm_speed[window])]
    return np.concatenate([*angles, np.log(np.maximum(quantiles, 1e-3)).ravel()])


def _angular_speed(turns: Array, rate_hz: float) -> Array:
    """Mean angular speed (T,), rad/s, of joints with rotation vectors (T, n, 3)."""
    rotation = rotations.from_rotation_vector(turns)
    step = rotations.to_rotation_vector(rotations.multiply(rotations.conjugate(rotation[:-1]), rotation[1:]))
    speed = np.linalg.norm(step, axis=-1).mean(axis=1) * rate_hz
    return np.append(speed, speed[-1])


@dataclass(frozen=True)
class StyleClassifier:
    """A fitted linear discriminant.

    Attributes:
        emotions: K names.
        weights: (F, K) of the features.
        offsets: (K,).
    """

    emotions: tuple[str, ...]
    weights: Array
    offsets: Array

    def probabilities(self, values: Array) -> Array:
        """Posterior probability (N, K) of each emotion given features (N, F); beforehand all are equally likely."""
        score = values @ self.weights + self.offsets
        likelihood = np.exp(score - score.max(axis=1, keepdims=True))
        return likelihood / likelihood.sum(axis=1, keepdims=True)

    def recognise(self, values: Array) -> list[str]:
        """The likeliest emotion of each row of features (N, F)."""
        return [self.emotions[k] for k in self.probabilities(values).argmax(axis=1)]


def fit_style_classifier(values: Array, labels: Sequence[str]) -> StyleClassifier:
    """Learns from features (N, F) of motions and the emotion of each.

    Raises:
        HighFiveError: fewer than two emotions, or an emotion with a single motion.
    """
    emotions = tuple(dict.fromkeys(labels))
    index = np.array([emotions.index(label) for label in labels])
    counts = np.bincount(index, minlength=len(emotions))
    if len(emotions) < 2 or counts.min() < 2:
        counted = ", ".join(f"{count} of {emotion}" for emotion, count in zip(emotions, counts, strict=True))
        raise HighFiveError(
            f"a classifier learns from two or more motions of two or more emotions; there are {counted}"
        )
    means = np.stack([values[index == k].mean(axis=0) for k in range(len(emotions))])
    within = values - means[index]
    degrees = max(len(values) - len(emotions), 1)
    scale: Array = np.sqrt((within**2).sum(axis=0) / degrees) + 1e-9
    within, means = within / scale, means / scale
    covariance = (1.0 - CLASSIFIER.shrinkage) * within.T @ within / degrees + CLASSIFIER.shrinkage * np.eye(
        values.shape[1]
    )
    weights = np.linalg.solve(covariance, means.T)
    return StyleClassifier(emotions, weights / scale[:, None], -0.5 * (means.T * weights).sum(axis=0))


def confusion(shown: Sequence[str], seen: Sequence[str]) -> dict[str, dict[str, int]]:
    """How often each emotion that was shown was seen as which."""
    names = tuple(dict.fromkeys((*shown, *seen)))
    pairs = list(zip(shown, seen, strict=True))
    return {a: {b: pairs.count((a, b)) for b in names} for a in names if a in shown}


def accuracy(shown: Sequence[str], seen: Sequence[str]) -> float:
    """Share of motions whose emotion was recognised."""
    return float(np.mean([a == b for a, b in zip(shown, seen, strict=True)]))
