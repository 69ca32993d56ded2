"""Parts and whole of a rig's latency have to agree."""

from __future__ import annotations

from dataclasses import replace

import pytest

from highfive.calibration.arm_latency import ArmLatency
from highfive.calibration.servo_lag import ServoLag
from highfive.calibration.stream_delay import StreamDelay
from highfive.model.errors import HighFiveError

LAG = ServoLag(0.004, 45.0, 0.6, 1e-4, 1.0, 1e-3)


def later(lag: ServoLag, seconds: float) -> ServoLag:
    """The same, ``seconds`` later."""
    return replace(lag, delay=lag.delay + seconds)


MEASURED = ArmLatency({"waist": LAG}, StreamDelay(0.012, 1e-4, 1.0, 5e-4), 0.002, later(LAG, 0.0145), "waist")


def test_parts_that_add_up_pass() -> None:
    """Half a millisecond off."""
    MEASURED.check()
    assert MEASURED.disagreement == pytest.approx(5e-4)
    replace(MEASURED, whole=None).check()


@pytest.mark.parametrize("off", [0.003, -0.004])
def test_parts_that_do_not_add_up_are_refused(off: float) -> None:
    """A stamp that is 3 ms wrong is found, either way."""
    with pytest.raises(HighFiveError, match="a stamp is wrong"):
        replace(MEASURED, whole=later(LAG, 0.014 + off)).check()
