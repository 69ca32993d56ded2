"""A live source, by its address or of one's own: the newest frame, whenever it is asked for.

    live_source.py vicon://192.168.10.1        (or qtm://, natnet://, lsl://, a plug-in's, or a C3D file)

Without an address a connection of one's own is opened: a class that gives frames. High Five does the rest: a thread
that listens, connecting again, lost frames. One sees the frames arrive. Takes 2 s.
"""

import sys
import time

import numpy as np

import highfive
from highfive.mocap_bridge.sources.live import LiveSource


class WavingHand:
    """Two markers that wave, 100 times a second; a lab's own reads its system here."""

    rate_hz, number = 100.0, 0

    def receive(self, timeout_s: float) -> list[highfive.MarkerFrame]:
        time.sleep(0.01)
        self.number += 1
        points = np.array([[0.6, 0.1 * np.sin(0.05 * self.number), 1.4], [0.6, 0.0, 1.3]])
        seen, now = np.array([True, self.number % 7 > 0]), time.monotonic_ns()  # one is hidden now and then
        return [highfive.MarkerFrame(("RFIN", "RWRA"), points, seen, self.number, now, now, np.zeros((0, 3)))]

    def close(self) -> None: ...


source = highfive.open_source(sys.argv[1]) if sys.argv[1:] else LiveSource("waving", WavingHand)
for _ in range(10):
    time.sleep(0.1)
    if (frame := source.newest(time.monotonic_ns())) is not None:
        print(f"frame {frame.number}: {frame.valid.sum()} of {len(frame.names)} markers")
source.close()
