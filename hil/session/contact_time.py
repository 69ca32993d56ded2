"""When palms will meet, where that can be said."""

from __future__ import annotations

from highfive.hil.session.reach import Phase
from highfive.model.online.reaction import Reaction, current_forecast

SURE_S = 0.3
"""A time of a larger standard deviation, s, says nothing to who looks on: some 0.4 s are left as a reach begins."""
REACHING = (Phase.APPROACH, Phase.TOUCH)
"""Until a hand is raised the model, which knows people only as they are about to, has a time all the same."""


def sure_contact_s(reaction: Reaction, phase: Phase) -> float | None:
    """Time to contact, s: by the forecast of the contact, or else by the model's clock.

    None where it would mislead: nobody reaches, the hand does what no hand did in training, or the time is not known
    to :data:`SURE_S`.
    """
    if phase not in REACHING or not reaction.in_distribution:
        return None
    forecast = current_forecast(reaction)
    if forecast is not None:
        return forecast.time if forecast.deviation <= SURE_S else None
    return reaction.time_to_contact if reaction.time_to_contact_std <= SURE_S else None
