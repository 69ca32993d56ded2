"""A recording through the tracker: gaps filled, the right arm's angles with their uncertainty.

    track_file.py FILE.c3d [PERSON]

Without a file a simulated person is recorded first, who loses markers at times. One sees how much was hidden, how much
is filled, and what the elbow did. Takes 3 s.
"""

import sys
import tempfile

import numpy as np

import highfive
from highfive.hil.sim.people.capture import Defects
from highfive.hil.trials.partners import simulated_partner
from highfive.mocap_bridge.files.c3d import write_c3d

if sys.argv[1:]:
    tracked = highfive.track(*sys.argv[1:3])
else:
    losing = Defects(gaps_a_second=0.4)  # of each marker; each gap is 0.03 to 0.25 s long
    person = simulated_partner("happy", "B2", 0, np.random.default_rng(0), losing)
    with tempfile.NamedTemporaryFile(suffix=".c3d") as file:
        write_c3d(file.name, person.recording)
        tracked = highfive.track(file.name)
print(f"{len(tracked)} frames at {tracked.rate_hz:g} Hz, marker set {tracked.marker_set.name!r}")
print(f"{tracked.there.mean():.1%} of the markers seen, {tracked.usable.mean():.1%} after filling")
elbow, spread = np.degrees(tracked.angles[:, 3]), np.degrees(tracked.deviations[:, 3])
print(f"elbow flexion from {np.nanmin(elbow):.0f}° to {np.nanmax(elbow):.0f}°, ± {np.nanmedian(spread):.1f}°")
