"""Markers in, the avatar's pose out: tracker, model and contact correction in one call per frame.

session_tick.py [FILE.c3d]
"""

import sys

import highfive

partner = highfive.recorded_partner(sys.argv[1]) if sys.argv[1:] else highfive.simulated_person("happy", "B2", seed=0)
session = highfive.open_session(partner.marker_set, style={"happy": 0.7, "angry": 0.3})
ticks = [session.step(frame) for frame in partner.frames()]
nearest = min(ticks, key=lambda tick: abs(tick.response.time_to_contact))
print(f"{len(ticks)} ticks; at contact the avatar's palm is at {nearest.palm.position.round(3)} m")
