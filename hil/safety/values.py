"""What goes into the safety envelope in a tick, what it carries on, and what it reports."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from highfive.hil.drivers.values import JointCommand, JointHealth, JointState
from highfive.hil.safety.faults import Watch, watch_from
from highfive.hil.safety.feed_forward import FeedForward, no_lead
from highfive.hil.safety.motion import Motion
from highfive.hil.safety.people import Human, Remembered
from highfive.hil.safety.rules import Rule
from highfive.hil.safety.startup import Check
from highfive.hil.safety.states import Event, State
from highfive.model.geometry.rotations import Array


@dataclass(frozen=True)
class Inputs:
    """What is known in a tick. Where something is missing, nothing moves or the arm stops.

    Attributes:
        requested: (J,) rad, where retargeting has the joints; None where it has no answer.
        arm: what the servos said last.
        health: what they said of themselves.
        human: the person, with the age of what is known; None where nobody was ever seen.
        run: the session runs: the arm shall follow.
        check: what the start-up check found; None where it was not made.
        estop_ns: when the emergency stop was pulled; None while it is not.
        acknowledge: in this tick a person said that it may go on.
        feed_forward: (J,) rad, by how much goals shall lead because joints give way; None leaves that as it is.
    """

    requested: Array | None = None
    arm: JointState | None = None
    health: JointHealth | None = None
    human: Human | None = None
    run: bool = False
    check: Check | None = None
    estop_ns: int | None = None
    acknowledge: bool = False
    feed_forward: Array | None = None


@dataclass(frozen=True)
class EnvelopeState:
    """What the envelope carries from tick to tick.

    Attributes:
        state: what the arm is doing.
        since_ns: when that began.
        reason: why it stopped; empty while it did not.
        motion: the reference: where it was last commanded to be; None before anything was sent.
        watch: what has to last before it is a fault.
        seen: what is known of the person.
        requested_ns: when something was last requested.
        feed_forward: by how much goals lead the reference; what was sent is the sum of both.
        way_point: where it retracts to next.
        stopped_by: the rules that stopped it, as ``reason`` says in words.
    """

    state: State
    since_ns: int
    reason: str
    motion: Motion | None
    watch: Watch
    seen: Remembered
    requested_ns: int
    feed_forward: FeedForward
    way_point: int = 0
    stopped_by: frozenset[Rule] = frozenset()


@dataclass(frozen=True)
class Report:
    """What happened in a tick, to be recorded.

    Attributes:
        time_ns: of the tick.
        state: after it.
        event: what led there; None where nothing happened.
        reason: why the arm stopped, or does not start; empty where it moves.
        requested: (J,) rad; None where nothing was.
        reference: (J,) rad, where the joints shall be; None where nothing is sent.
        sent: what is sent, as it is sent; its positions lead the reference because joints give way. None for nothing.
        acted: the rules that changed the command or the state.
        fraction: how much of the joints' speed the person left, 0 to 1.
        closing_speed: m/s, of plate and hand along the line between them, as commanded, the larger one of reference
            and goals; None where it is not known.
        gap: m, from the plate to the palm, less what the palm's place is not known; None where it is not known.
    """

    time_ns: int
    state: State
    event: Event | None
    reason: str
    requested: Array | None
    reference: Array | None
    sent: JointCommand | None
    acted: frozenset[Rule]
    fraction: float
    closing_speed: float | None
    gap: float | None

    def record(self) -> dict[str, Any]:
        """Numbers, words and lists only."""
        return {
            "time_ns": self.time_ns,
            "state": self.state.value,
            "event": None if self.event is None else self.event.value,
            "reason": self.reason,
            "asked": None if self.requested is None else self.requested.tolist(),
            "reference": None if self.reference is None else self.reference.tolist(),
            "positions": None if self.sent is None else self.sent.positions.tolist(),
            "currents": None if self.sent is None else self.sent.currents.tolist(),
            "acted": sorted(rule.value for rule in self.acted),
            "share": self.fraction,
            "closing_speed": self.closing_speed,
            "gap": self.gap,
        }


def standing(now_ns: int, joints: int, feed_forward: FeedForward | None = None) -> EnvelopeState:
    """Where the envelope begins: nothing is checked, nothing is known, nothing is sent.

    An arm that is held from before goes on from its ``feed_forward``: without it, it would sag.
    """
    kept = no_lead(joints) if feed_forward is None else FeedForward(feed_forward.offsets, np.zeros(joints))
    return EnvelopeState(State.UNCHECKED, now_ns, "", None, watch_from(now_ns, joints), Remembered(), now_ns, kept)
