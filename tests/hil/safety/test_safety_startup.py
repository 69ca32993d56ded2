"""The start-up check: one line for every thing that keeps the arm from moving."""

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from highfive.hil.safety.limits import JOINTS
from highfive.hil.safety.limits_file import load_limits
from highfive.hil.safety.startup import (
    Check,
    Room,
    ServoLimits,
    limit_mismatches,
    not_armed,
    register_mismatches,
    room_unknown,
    start_up_check,
)

LIMITS = load_limits()
WELL = [
    ServoLimits(name, 5, math.pi, LIMITS.joints[number].current, 65.0, LIMITS.timing.watchdog_s, True)
    for number, name in enumerate(JOINTS)
]
REQUIRED = {1: {"operating_mode": 5, "homing_offset": 0}, 2: {"operating_mode": 5, "homing_offset": -12}}


def check(**other: Any) -> tuple[str, ...]:
    usual = {"required": REQUIRED, "found": REQUIRED, "servos": WELL, "real_port": True, "armed": True, "time_ns": 7}
    usual["room"] = Room(nobody_near=True)
    found = start_up_check(LIMITS, **(usual | other))
    assert found.time_ns == 7
    return found.mismatches


def test_nothing_is_wrong_with_servos_that_are_as_they_have_to_be() -> None:
    assert check() == ()
    assert Check(0, ()) == Check(0, ())


def test_a_real_port_has_to_be_armed() -> None:
    assert "--arm" in check(armed=False)[0]
    assert check(armed=False, real_port=False) == ()
    assert not_armed(real_port=False, armed=True) == []


REGISTERED = Room("vicon://host", registered=True)


@pytest.mark.parametrize(
    ("room", "says"),
    [
        (Room(), "--nobody-near"),
        (Room(), "--slow"),
        (Room("vicon://host"), "--calibration"),
        (Room("vicon://host", slow=True), "--calibration"),
        (Room("vicon://host", nobody_near=True), "contradicts"),
        (replace(REGISTERED, nobody_near=True), "contradicts"),
        (replace(REGISTERED, mismatches=("it is of another arm", "it is old")), "it is of another arm"),
    ],
)
def test_a_real_arm_does_not_move_where_nobody_knows_who_is_beside_it(room: Room, says: str) -> None:
    """Rule.ROOM: a live person whose room is not registered, or nobody tracked and no word of the operator."""
    assert says in " ".join(check(room=room))
    assert room_unknown(real_port=True, room=room)
    assert room_unknown(real_port=False, room=room) == []


@pytest.mark.parametrize("room", [Room(nobody_near=True), Room(slow=True), REGISTERED, replace(REGISTERED, slow=True)])
def test_a_real_arm_moves_where_it_is_known_who_is_beside_it(room: Room) -> None:
    assert check(room=room) == ()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"watchdog_s": 0.0}, "watchdog is 0 ms"),
        ({"watchdog_s": 0.04}, "watchdog is 40 ms"),
        ({"watchdog_s": 0.1}, "it has to be 60 to 80 ms"),
        ({"operating_mode": 3}, "operating mode is 3"),
        ({"torque": False}, "torque is off"),
        ({"speed": 2 * math.pi}, "velocity limit is 6.28"),
        ({"current": 0.5}, "less than the 3.50 it may be sent"),
        ({"temperature": 60.0}, "switches itself off at 60"),
        ({"joint": "hip"}, "no joint of this arm"),
    ],
)
def test_a_servo_that_would_not_keep_the_limits(change: dict[str, Any], says: str) -> None:
    servos = [WELL[0], replace(WELL[1], **change), *WELL[2:]]
    lines = limit_mismatches(LIMITS, servos)
    assert says in lines[0]
    assert check(servos=servos) == tuple(lines)
    assert all("\n" not in line for line in lines)


def test_a_joint_of_which_nothing_was_read() -> None:
    assert check(servos=WELL[:-1]) == ("wrist_rotate: nothing was read back",)


def test_a_servo_or_a_register_that_was_not_read() -> None:
    found = {1: {"operating_mode": 5}}
    assert check(found=found) == ("servo 1: homing_offset was not read back", "servo 2 did not answer")


@given(st.dictionaries(st.integers(1, 3), st.dictionaries(st.sampled_from("abc"), st.integers(0, 3)), max_size=3))
@settings(deadline=None)
def test_only_what_is_the_same_passes(found: dict[int, dict[str, int]]) -> None:
    required = {1: {"a": 0, "b": 1}, 2: {"a": 2}}
    same = all(found.get(servo, {}).get(name) == value for servo, r in required.items() for name, value in r.items())
    assert (not register_mismatches(required, found)) is same
