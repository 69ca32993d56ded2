"""The states of the arm and what leads from one to another: a table, from which the code works and which docs/safety.md
draws."""

from __future__ import annotations

from enum import StrEnum


class State(StrEnum):
    """What the arm is doing."""

    UNCHECKED = "unchecked"
    """Nothing was read back from the servos yet, or a person has to look again; a held pose stays held."""
    READY = "ready"
    """Checked; it stands still."""
    TRACKING = "tracking"
    """It goes where it is requested to be."""
    HOLDING = "holding"
    """The person is not seen: it brakes and stays."""
    RETRACTING = "retracting"
    """The person was not seen for longer, or the session ended: it goes slowly to where it rests."""
    STOPPING = "stopping"
    """A fault: it brakes."""
    STOPPED = "stopped"
    """It stands, with torque, until a person acknowledges the fault."""
    ESTOPPED = "estopped"
    """It was stopped at once and stands, with torque, until a person acknowledges it."""


class Event(StrEnum):
    """What happened in a tick; at most one of them, the first of these that did."""

    ESTOP = "estop"
    """The emergency stop is pulled."""
    ACKNOWLEDGE = "acknowledge"
    """A person says that it may go on."""
    FAULT = "fault"
    """A rule wants a controlled stop."""
    CHECKED = "checked"
    """The start-up check found nothing."""
    START = "start"
    """The session runs and the person is seen."""
    END = "end"
    """The session does not run any more."""
    LOST = "lost"
    """The person has not been seen for long."""
    STALE = "stale"
    """The person has not been seen for a moment."""
    FRESH = "fresh"
    """The person is seen again."""
    RETRACTED = "retracted"
    """The arm has come to where it rests."""
    STILL = "still"
    """The arm is commanded to move no more."""


S, E = State, Event
TABLE: dict[tuple[State, Event], State] = {
    (S.UNCHECKED, E.CHECKED): S.READY,
    (S.READY, E.START): S.TRACKING,
    (S.READY, E.FAULT): S.STOPPED,
    (S.TRACKING, E.STALE): S.HOLDING,
    (S.TRACKING, E.LOST): S.RETRACTING,
    (S.TRACKING, E.END): S.RETRACTING,
    (S.TRACKING, E.FAULT): S.STOPPING,
    (S.HOLDING, E.FRESH): S.TRACKING,
    (S.HOLDING, E.LOST): S.RETRACTING,
    (S.HOLDING, E.END): S.RETRACTING,
    (S.HOLDING, E.FAULT): S.STOPPING,
    (S.RETRACTING, E.FRESH): S.TRACKING,
    (S.RETRACTING, E.RETRACTED): S.READY,
    (S.RETRACTING, E.FAULT): S.STOPPING,
    (S.STOPPING, E.STILL): S.STOPPED,
    (S.STOPPED, E.ACKNOWLEDGE): S.UNCHECKED,
    (S.ESTOPPED, E.ACKNOWLEDGE): S.UNCHECKED,
    **{(state, E.ESTOP): S.ESTOPPED for state in S if state is not S.ESTOPPED},
}
"""State and event to the next state; what does not stand here changes nothing."""

MOVING = frozenset({S.TRACKING, S.HOLDING, S.RETRACTING, S.STOPPING})
"""States in which what is sent may change from tick to tick."""


HALTED = frozenset({S.STOPPING, S.STOPPED, S.ESTOPPED})
"""States that only a person can end."""


def after(state: State, event: Event | None) -> State:
    """The state after an event."""
    return state if event is None else TABLE.get((state, event), state)
