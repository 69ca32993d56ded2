"""How near the arm's plate comes to the person's palm, and when, in simulated sessions.

Sessions are run once; what they ask of the arm in every tick can then be played to any arm
(:mod:`highfive.hil.arm.arm_trial`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from highfive.hil.session.session import RATE_HZ, Session
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.partners import Partner, simulated_partners
from highfive.mocap_bridge.sources.source import C3DSource
from highfive.model.hgpdm.trained import HGPDM

if TYPE_CHECKING:
    from highfive.hil.runtime.console import Bar
from highfive.hil.arm.contact_outcome import ReferenceTrajectory, reference_in


def reference_trajectories(
    model: HGPDM, emotions: Sequence[str], cells: Sequence[str], seed: int, bar: Bar, repeats: int = 1
) -> list[ReferenceTrajectory]:
    """Runs the sessions of simulated people."""
    count = repeats * len(emotions) * len(cells)
    return references_of(
        simulated_partners(count, emotions, cells, seed, lambda total: bar("people", total)), model, bar
    )


def references_of(partners: Sequence[Partner], model: HGPDM, bar: Bar) -> list[ReferenceTrajectory]:
    """Runs the sessions of people, who all wear the same marker set."""
    session = Session(model, {partners[0].emotion: 1.0}, partners[0].marker_set, build_scene())
    advance, references = bar("sessions", len(partners)), []
    for partner in partners:
        references.append(_reference(session, partner))
        advance()
    return references


def _reference(session: Session, partner: Partner) -> ReferenceTrajectory:
    session.set_style({partner.emotion: 1.0})
    session.reset()
    ticks = [session.step(frame) for frame in C3DSource(partner.recording, RATE_HZ)]
    return reference_in(ticks, partner.emotion, partner.cell, partner.contact_frame)
