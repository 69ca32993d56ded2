"""Parts and whole of a rig's latency have to agree."""

from __future__ import annotations

from dataclasses import replace

import pytest

from highfive.calibration.arm_latency import ArmLatency
from highfive.model.errors import HighFiveError

MEASURED = ArmLatency(mocap=0.012, host=0.002, servo=0.031, whole=0.0455, followed="waist")


def test_parts_that_add_up_pass() -> None:
    """Half a millisecond off."""
    MEASURED.check()
    assert MEASURED.disagreement == pytest.approx(5e-4)


@pytest.mark.parametrize("off", [0.003, -0.004])
def test_parts_that_do_not_add_up_are_refused(off: float) -> None:
    """A stamp that is 3 ms wrong is found, either way."""
    with pytest.raises(HighFiveError, match="a stamp is wrong"):
        replace(MEASURED, whole=MEASURED.parts + off).check()
