"""A live system by its address: the newest frame, whenever it is requested.

live_source.py vicon://192.168.10.1        (or qtm://, natnet://, lsl://, a plug-in's, or a C3D file)
"""

import sys
import time

import highfive

source = highfive.open_source(sys.argv[1])
for _ in range(20):
    time.sleep(0.1)
    if (frame := source.newest(time.monotonic_ns())) is not None:
        print(f"frame {frame.number}: {frame.valid.sum()} of {len(frame.names)} markers")
source.close()
