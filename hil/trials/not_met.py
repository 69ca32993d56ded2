"""Why palms did not meet, in a sentence for people: the first thing that was in the way."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from highfive.hil.session.doubt import DOUBT
from highfive.hil.session.reach import Phase
from highfive.hil.session.reach_settings import ReachSettings
from highfive.hil.session.session import Tick
from highfive.hil.sim.contact_check import ContactReport
from highfive.model.geometry.rotations import Array
from highfive.model.online.reaction import probability_of_contact

PICTURES_HZ = 5.0
"""Fewer pictures of a person say too little of a hand that comes up within half a second (docs/webcam.md)."""
RAISED_M = ReachSettings().raised
"""A hand below is not held out to be met."""
HIDDEN = 0.5
"""A hand that is not seen for this share of the time after it was first seen was hidden."""


def why_not_met(ticks: Sequence[Tick], times: Array, contact: ContactReport, out_of_reach: bool) -> str:
    """The reason, without a capital or a full stop; '' where the palms met.

    Args:
        ticks: of the trial, one or more.
        times: (T,) s, of the ticks.
        contact: what the contact check found.
        out_of_reach: the palm could not be reached at contact.
    """
    if contact.met:
        return ""
    known = [tick for tick in ticks if tick.person.valid]
    pictures, seconds = sum(tick.sighting is not None for tick in ticks), float(times[-1])
    if seconds > 1.0 and (known or pictures) and pictures < PICTURES_HZ * seconds:
        rate = pictures / seconds
        return f"only {rate:.1f} pictures of the person came in a second; fewer than {PICTURES_HZ:g} are too few"
    if not known:
        return "the person's hand was not seen"
    return _of_the_person(ticks, known) or _of_the_reach(
        ticks, known, f"the palms came no nearer than {1e3 * contact.distance:.0f} mm", out_of_reach
    )


def _of_the_person(ticks: Sequence[Tick], known: Sequence[Tick]) -> str:
    """What was in the way before the model had a word; ``known`` are the ticks in which her hand is."""
    first = next(i for i, tick in enumerate(ticks) if tick.person.valid)
    hidden = np.mean([not tick.person.valid for tick in ticks[first:]])
    if hidden > HIDDEN:
        return f"the person's hand was hidden for {100.0 * hidden:.0f} % of the time that came after it was first seen"
    height = max(float(tick.person.palm.position[2]) for tick in known)
    if height < RAISED_M:
        return f"the person's hand was not raised: it came up to {height:.2f} m, and counts from {RAISED_M:g} m on"
    return ""


def _of_the_reach(ticks: Sequence[Tick], known: Sequence[Tick], nearest: str, out_of_reach: bool) -> str:
    """What was in the way of the avatar."""
    if all(tick.target.phase is Phase.IDLE for tick in ticks):
        return _doubted([tick for tick in known if tick.person.palm.position[2] >= RAISED_M]) or (
            f"the avatar did not reach for it: nothing said that the hand was on its way to be met, and {nearest}"
        )
    if out_of_reach:
        return f"the person's hand was out of the avatar's reach: {nearest}"
    return f"the avatar reached for it, and {nearest}"


def _doubted(raised: Sequence[Tick]) -> str:
    """Why no reach began for a hand that is ``raised`` in these ticks, where the model's doubt is the reason."""
    said = [
        (probability, DOUBT.enough(tick.response.in_distribution))
        for tick in raised
        if (probability := probability_of_contact(tick.response)) is not None
    ]
    if not said or any(probability >= enough for probability, enough in said):
        return ""
    likely, enough = max(said, key=lambda pair: pair[0] - pair[1])
    return (
        f"the model took it for no high five: that a contact was coming had a probability of {likely:.2f} at the most, "
        f"and a reach begins at {enough:g}"
    )
