"""A recording through the tracker: gaps filled, the right arm's angles.

track_file.py FILE.c3d [PERSON]
"""

import sys

import numpy as np

import highfive

tracked = highfive.track(*sys.argv[1:3])
seen, filled = tracked.there.mean(), tracked.usable.mean()
elbow = np.degrees(tracked.angles[:, 3])
print(f"{len(tracked)} frames at {tracked.rate_hz:g} Hz; {seen:.1%} of the markers seen, {filled:.1%} after filling")
print(f"elbow flexion from {np.nanmin(elbow):.0f}° to {np.nanmax(elbow):.0f}°")
