"""A session's recording as arrays, or as a pandas table where pandas is installed.

read_session.py out/session-1/session.mcap
"""

import sys

import highfive

recording = highfive.read_recording(sys.argv[1])
tick, avatar = recording.arrays("/tick"), recording.arrays("/avatar")
print(f"{len(set(tick['trial']))} high fives, {tick['time'][-1]:.1f} s, joints {avatar['quaternions'].shape}")
try:
    print(recording.table("/contact")[["trial", "met", "distance", "approach_speed"]])
except highfive.HighFiveError as error:
    print(error)
