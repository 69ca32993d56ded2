"""Lets a style keep its own timing with whoever raises a hand.

In recordings an angry actor answers an angry person: how fast the avatar moves is learned as a function of how the
person moves, and the style weights change its posture alone. On the way from one style to another the hand even slows,
since two ways of reaching are not equally far at the same time. So the course of the reach is sharpened by style. With
φ the progress of the generated palm from where it rests to where the palms will meet,

    pose = rest + S(φ) / φ · (generated - rest),    S(φ) = φ + a (φ³ (10 - 15 φ + 6 φ²) - φ):

it holds back, is faster in the middle, and is where the model wants it at rest and at contact. a is 0 in slow styles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.online.belief import packed
from highfive.model.online.layer import predict_layer
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class StyleTimingSettings(Settings):
    """How the reach of a quick style is sharpened. Set by hand; ``highfive classify-style`` shows what comes of it."""

    sharpening: float = setting(2.0, least=0.0)
    """a is this times the logarithm of a style's peak speed over the median style's: twice as much as makes up for it
    in a reach of minimum jerk, because on the way between styles the mixing of poses takes some away."""
    nearest: float = setting(0.2, "m", above=0.0)
    """A meeting point nearer to the resting palm than this is no reach: by hand."""


class StyleTiming:
    """How a model's styles differ in speed, and the poses in which they wait."""

    def __init__(self, model: HGPDM, settings: StyleTimingSettings | None = None) -> None:
        """Looks at the poses that the model gives at its training points."""
        self.settings = settings or StyleTimingSettings()
        styles = np.eye(len(model.emotions))
        self._where = model.channels
        self._rest = np.array([_at_start(model, style) for style in styles])
        self._resting_palm = self._rest[:, self._where.palm].copy()
        speed = peak_speeds(model)
        # A model that was trained on next to nothing shows no speeds: nothing is sharpened then.
        self._relative_speed = np.maximum(speed / max(float(np.median(speed)), 1e-9), 1.0)

    def rest(self, style: Array) -> Array:
        """Channels (C,) in which an avatar of style weights (K,) waits: the model is linear in the weights."""
        return style @ self._rest

    def sharpness(self, style: Array) -> float:
        """How much the course is sharpened, a: 0 for the slower half of the styles; beyond 1 it would turn back."""
        return min(self.settings.sharpening * math.log(float(style @ self._relative_speed)), 1.0)

    def fraction(self, palm: Array, contact_point: Array, style: Array) -> float:
        """S(φ) / φ, the fraction of the way from rest to the generated pose.

        Args:
            palm: (3,) m, as the model gives it beside the joints.
            contact_point: (3,) m, likewise.
            style: (K,) the weights that both were generated with.
        """
        rest = style.dot(self._resting_palm)
        way, gone = contact_point - rest, palm - rest
        progress = float(gone.dot(way)) / max(float(way.dot(way)), self.settings.nearest**2)
        sharpness = self.sharpness(style)
        return 1.0 - sharpness + sharpness * _hold(progress)


def _hold(progress: float) -> float:
    """The minimum-jerk curve (Flash & Hogan 1985) of progress, over progress; 0 before and 1 / φ beyond the reach."""
    if progress >= 1.0:
        return 1.0 / progress
    x = max(progress, 0.0)
    return x * x * (10.0 - 15.0 * x + 6.0 * x * x)


def _at_start(model: HGPDM, style: Array) -> Array:
    """Avatar channels (C,) where training trials begin; by the tick's own compiled layers, which are loaded anyway."""
    below = predict_layer(packed(model.interaction), model.start_mean, np.ones(1))[0]
    avatar = packed(model.avatar, len(model.emotions))
    return predict_layer(avatar, below[: model.preset.avatar_dims], style)[0]


def peak_speeds(model: HGPDM) -> Array:
    """Peak speed of the palm (K,), m/s, in each emotion: medians over the training trials as the model gives them."""
    styles = np.eye(len(model.emotions))[model.emotion]
    layer, latents = packed(model.avatar, len(model.emotions)), model.avatar_latents.astype(float)
    outputs = [predict_layer(layer, latent, style)[0] for latent, style in zip(latents, styles, strict=True)]
    palm = np.array(outputs)[:, model.channels.palm]
    speed = np.linalg.norm(np.diff(palm, axis=0), axis=1) / model.lag
    speed[np.diff(model.trial) != 0] = 0.0
    trials, first = np.unique(model.trial, return_index=True)
    peaks = np.array([speed[model.trial[1:] == trial].max(initial=0.0) for trial in trials])
    shown = model.emotion[first]
    return np.array([np.median(peaks[shown == k]) for k in range(len(model.emotions))])
