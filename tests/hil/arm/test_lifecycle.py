"""An arm is made ready and brought to rest: what of its faults was still to come is said."""

import logging

import pytest

from highfive.hil.arm.arm_options import VIRTUAL, ArmOptions
from highfive.hil.arm.lifecycle import ready_arm


def test_a_fault_that_never_came_is_said_at_the_end(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    with ready_arm(ArmOptions(VIRTUAL, faults=("late:1@0-0.1", "hot=4@50"))) as loop:
        assert loop.trouble == ""
        assert not [line for line in caplog.messages if line.startswith("--faults")]
    (said,) = [line for line in caplog.messages if line.startswith("--faults")]
    assert said.startswith("--faults: hot@50 never came; the arm was driven for ")
