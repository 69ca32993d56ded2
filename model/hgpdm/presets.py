"""Presets: what is chosen before training, as frozen values with their reasons."""

from __future__ import annotations

from dataclasses import dataclass, replace

from highfive.model.errors import HighFiveError


@dataclass(frozen=True)
class Preset:
    """Sizes, bounds and weights of one kind of model. All lengths of time are in seconds."""

    name: str
    avatar_dims: int  # latent dimensions of the avatar layer, X1
    human_dims: int  # latent dimensions of the human layer, X2
    interaction_dims: int  # latent dimensions of the interaction layer, I
    history: tuple[float, ...]  # earlier times, s, at which the back projection sees the hand; () is the present alone
    back_constrained: bool  # all latents are learned functions of the hand (True) or free, with r and s fitted after
    variational: bool  # add the trace term of Titsias 2009, which makes DTC a lower bound
    avatar_noise: tuple[float, float]  # bounds of the noise of the scaled channels of Y1
    channel_noise: bool  # after training, each channel of Y1 has the noise that it shows there, not one for all
    human_noise: tuple[float, float]  # bounds of the noise of the scaled hand points Y2
    interaction_noise: tuple[float, float]  # bounds of the noise of X1 and X2 given I; latents have unit variance
    dynamics_noise: tuple[float, float]  # bounds of the noise of I given its two predecessors
    velocity_decay: float  # s; the dynamics' mean keeps the latent velocity and forgets it this fast; 0 is a zero mean
    return_tolerance: float  # a trial's first and last X1 differ by about this much (latent units); 0 switches it off
    palm_weight: float  # scale of the palm's position (m) beside the joint angles (rad)
    clock_weight: float  # scale of the contact clock beside the joint angles (rad)
    points: int  # training points in all, more where they would lie too far apart; the common sample rate follows
    channel_tolerance: float  # share of Y1's variance left to the noise when its channels are compressed
    adam_steps: int  # steps of Adam at the beginning of joint training
    iterations: int  # steps of joint training in all; those after Adam's are of L-BFGS
    pooled: bool = False  # a regression and neighbours answer beside the hierarchy (model/hgpdm/pose_ensemble.py)

    def with_iterations(self, iterations: int) -> Preset:
        """The preset with so many steps, in the same proportion of Adam and L-BFGS."""
        return replace(self, iterations=iterations, adam_steps=round(iterations * self.adam_steps / self.iterations))


PAPER = Preset(
    name="paper",
    avatar_dims=2,
    human_dims=2,
    interaction_dims=3,
    history=(),
    back_constrained=False,
    variational=False,
    avatar_noise=(1e-3, 1.0),
    channel_noise=False,
    human_noise=(1e-3, 1.0),
    interaction_noise=(1e-2, 1.0),
    dynamics_noise=(1e-3, 1.0),
    velocity_decay=0.0,
    return_tolerance=0.1,
    palm_weight=1.0,
    clock_weight=1.0,
    points=5600,
    channel_tolerance=1e-3,
    adam_steps=150,
    iterations=250,
)
"""The sizes and the recipe of Taubert et al. 2013."""

DEFAULT = Preset(
    name="default",
    avatar_dims=8,
    human_dims=3,
    interaction_dims=6,
    history=(0.1, 0.2, 0.4),
    back_constrained=True,
    variational=True,
    avatar_noise=(5e-3, 1.0),
    channel_noise=True,
    human_noise=(2e-2, 1.0),
    interaction_noise=(3e-2, 6e-2),
    dynamics_noise=(1e-2, 2e-1),
    velocity_decay=0.5,
    return_tolerance=0.0,
    palm_weight=3.0,
    clock_weight=1.0,
    points=5600,
    channel_tolerance=1e-3,
    adam_steps=150,
    iterations=150,
    pooled=True,
)
"""Larger latents, jointly learned back constraints on the hand and its short history, bounded upper-layer noise, and
direct answers beside the hierarchy."""

PRESETS = {preset.name: preset for preset in (DEFAULT, PAPER)}


def preset_named(name: str) -> Preset:
    """The preset called ``name``.

    Raises:
        HighFiveError: there is none of that name.
    """
    if name not in PRESETS:
        raise HighFiveError(f"no preset called {name!r}; there are {', '.join(PRESETS)}")
    return PRESETS[name]
