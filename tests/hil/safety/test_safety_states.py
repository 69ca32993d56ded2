"""The table of states, as properties; and the loop led through it by any inputs."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from envelope_cases import FAR, LIMITS, READY_POSE, REST, TICK_NS, Loop, said
from hypothesis import given, settings
from hypothesis import strategies as st

from highfive.hil.safety.startup import Check
from highfive.hil.safety.states import MOVING, TABLE, Event, State, after
from highfive.model.geometry.rotations import Array

EVENTS = st.lists(st.sampled_from(Event), max_size=40)


@given(st.sampled_from([State.ESTOPPED, State.STOPPED]), EVENTS)
@settings(deadline=None)
def test_no_stop_is_left_without_a_person(state: State, events: list[Event]) -> None:
    for event in events:
        if event is Event.ACKNOWLEDGE:
            break
        state = after(state, event)
        assert state in (State.ESTOPPED, State.STOPPED)


@given(EVENTS)
@settings(deadline=None)
def test_nothing_moves_before_a_check_passed(events: list[Event]) -> None:
    """From the beginning, and again after every stop."""
    state, checked = State.UNCHECKED, False
    for event in events:
        before, state = state, after(state, event)
        if state is State.UNCHECKED:
            checked = False
        elif before is State.UNCHECKED and event is Event.CHECKED:
            checked = True
        if state in MOVING:
            assert checked


@pytest.mark.parametrize("state", State)
def test_the_emergency_stop_is_taken_in_every_state(state: State) -> None:
    assert after(state, Event.ESTOP) is State.ESTOPPED


@pytest.mark.parametrize("state", State)
def test_a_fault_ends_every_motion(state: State) -> None:
    then = after(state, Event.FAULT)
    assert then not in MOVING or then is State.STOPPING


def test_every_state_can_be_reached_and_be_left() -> None:
    reached = {State.UNCHECKED} | set(TABLE.values())
    assert reached == set(State) == {state for state, _ in TABLE}
    assert all(then is not state for (state, _), then in TABLE.items())
    assert after(State.READY, None) is State.READY


def test_a_session_from_its_beginning_to_its_end() -> None:
    loop = Loop(start=REST)
    assert loop.tick(REST) is None  # nothing is sent before the check
    loop.ready()
    seen = [loop.state]

    def look() -> None:
        if loop.state is not seen[-1]:
            seen.append(loop.state)

    ages = [0] * 100 + [200_000_000] * 20 + [0] * 20 + [600_000_000] * 20 + [0] * 20
    for age in ages:
        loop.human = replace(FAR, age_ns=age)
        loop.tick(READY_POSE)
        look()
    loop.run = False
    for _ in range(900):
        loop.tick(None)
        look()
    s = State
    assert seen == [
        s.READY, s.TRACKING, s.HOLDING, s.TRACKING, s.RETRACTING, s.TRACKING, s.RETRACTING, s.READY,
    ]  # fmt: skip
    assert np.abs(loop.commanded[-1] - REST).max() < 0.01


INPUT = st.sampled_from(
    ["well", "well", "well", "stale", "lost", "nobody", "nothing wanted", "nan", "error", "silent", "late",
     "estop", "acknowledge", "checked", "unchecked", "end", "far away"]
)  # fmt: skip


def known(loop: Loop, happening: str, requested: Array) -> tuple[Array | None, dict[str, Any]]:
    """What is wanted, and what else is known, when that happens."""
    now = loop.now_ns
    loop.run = happening != "end"
    loop.human = {
        "stale": replace(FAR, age_ns=200_000_000),
        "lost": replace(FAR, age_ns=600_000_000),
        "nobody": None,
    }.get(happening, FAR)
    if happening in ("checked", "unchecked"):
        loop.check = Check(now, () if happening == "checked" else ("servo 3 did not answer",))
    others: dict[str, dict[str, Any]] = {
        "error": {"arm": replace(said(loop.measured, now + TICK_NS), errors=np.full(6, 32))},
        "silent": {"arm": None},
        "late": {"elapsed_ns": 90_000_000},
        "estop": {"estop_ns": now},
        "acknowledge": {"acknowledge": True},
    }
    wants = {"nothing wanted": None, "nan": np.full(6, np.nan), "far away": np.full(6, 1e6)}
    return wants.get(happening, requested), others.get(happening, {})


@given(st.lists(st.tuples(INPUT, st.integers(1, 12)), max_size=25), st.integers(0, 2**32))
@settings(max_examples=60, deadline=None)
def test_no_inputs_lead_to_motion_where_there_must_be_none(happenings: list[tuple[str, int]], seed: int) -> None:
    """Whatever happens, in whatever order, to the real loop.

    Nothing is sent before a check passed; nothing moves after an emergency stop until somebody acknowledged it and a
    check passed; what is sent is finite, within the limits of position and never absent once there was a command.
    """
    loop, stopped, chance = Loop(start=READY_POSE), False, np.random.default_rng(seed)
    for happening in (happening for happening, ticks in happenings for _ in range(ticks)):
        requested, other = known(loop, happening, READY_POSE + chance.uniform(-1.0, 1.0, 6))
        before, last = loop.state, loop.commanded[-1] if loop.commanded else None
        command = loop.tick(requested, **other)
        stopped = (stopped or happening == "estop") and happening != "acknowledge"
        assert not stopped or loop.state is State.ESTOPPED
        assert bool(loop.report.reason) or loop.state not in (State.ESTOPPED, State.STOPPED)
        if last is None:
            assert command is None or loop.report.event is Event.CHECKED
            continue
        assert command is not None
        assert np.isfinite(command.positions).all()
        assert (LIMITS.lowest - 1e-9 <= command.positions).all()
        assert (command.positions <= LIMITS.highest + 1e-9).all()
        if before not in MOVING and loop.state not in MOVING:
            assert np.array_equal(command.positions, last)
