"""A recording that is played in time."""

from collections.abc import Iterator

import numpy as np

from highfive.hil.arm.lifecycle import at_their_time
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.session.session import PERIOD_NS
from highfive.mocap_bridge.frames import MarkerFrame

LOOKS_NS = 10_000
"""What looks at the virtual clock take."""


def frames() -> Iterator[MarkerFrame]:
    for number in range(100):
        yield MarkerFrame((), np.zeros((0, 3)), np.zeros(0, bool), number, number * PERIOD_NS, 0, np.zeros((0, 3)))


def test_what_a_pause_of_the_machine_missed_does_not_come_in_a_burst() -> None:
    """After 0.4 s the person goes on from where she was; after one late tick she is made up for."""
    for stalled_ns, late_ns in ((400_000_000, 400_000_000 - PERIOD_NS), (PERIOD_NS + 2_000_000, 0)):
        with VirtualClock() as clock:
            came = []
            for frame in at_their_time(frames(), clock):
                came.append(frame.arrival_time_ns)
                if frame.number == 50:
                    clock.wait_until(clock.now() + stalled_ns)
        gaps = np.diff(came)
        np.testing.assert_allclose(np.delete(gaps, [50, 51]), PERIOD_NS, atol=LOOKS_NS)
        np.testing.assert_allclose(gaps[50], stalled_ns, atol=LOOKS_NS)
        np.testing.assert_allclose(came[-1] - came[0], 99 * PERIOD_NS + late_ns, atol=LOOKS_NS)
