"""A session's recording as arrays, a high five at a time; as pandas tables where pandas is installed.

read_session.py out/session-1/session.mcap
"""

import sys

import numpy as np

import highfive

session = highfive.read_session(sys.argv[1])
print(f"recorded with model {session.settings['model']}, {len(session.joints)} joints")
for high_five in session:
    if high_five.contact is None:  # broken off
        continue
    wrist = high_five.arrays("/person")["wrist"]
    moved = np.linalg.norm(np.diff(wrist, axis=0), axis=1).sum()
    met = f"met after {high_five.contact['met_time']:.2f} s" if high_five.contact["met"] else "not met"
    print(f"high five {high_five.number + 1}, {high_five.about['style']}: the wrist went {moved:.2f} m; {met}")
    try:
        high_five.table("/tick")
    except highfive.HighFiveError as error:
        print(error)
