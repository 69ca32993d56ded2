"""What the online belief is tuned by."""

from __future__ import annotations

from dataclasses import dataclass

from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class BeliefSettings(Settings):
    """How the belief over the latents goes on. Set by hand, but for what says otherwise."""

    style_time: float = setting(0.1, "s", above=0.0)
    """Time constant of each of the two smoothings of the style weights."""
    residual_time: float = setting(0.3, "s", above=0.0)
    """In which what X¹ has beyond I dies away where no hand says it."""
    pool_time: float = setting(0.025, "s", above=0.0)
    """Time constant of each of two smoothings of what the direct answers have beyond the hierarchy's."""
    speed_span: int = setting(4, "ticks", least=1)
    """Over which the speed of a hand is taken that is about to be hidden: fewer are too noisy."""
    covariance_limit: float = setting(10.0, above=0.0)
    """Variance of a latent beyond which more means nothing: the data have variance 1."""
    out_of_distribution: float = setting(0.18, above=0.0)
    """Standard deviation of the interaction latents now and a lag ago (all together; their own is 1 each) beyond which
    the model is lost, ..."""
    beyond_usual: float = setting(1.165, above=0.0)
    """... or so many times that of a hand at rest where training trials begin, if that is more: it is each model's own.

    1 to 1.06 in nine tenths of the reaches of simulated people, 1.12 to 1.26 with a taller one who walks by (CMU 20).
    """
    never_known: float = setting(0.36, above=0.0)
    """... and beyond this in any case: a model that is never sure does not know whom it sees."""


BELIEF = BeliefSettings()
