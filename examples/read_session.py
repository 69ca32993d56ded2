"""A session's recording, a high five at a time: as arrays, as pandas tables, as a file for MATLAB.

    read_session.py out/session-1

Without one the recording that comes along is read. One sees what each high five was and how it ended; ``session.mat``
then has the wrist, a matrix a high five, for MATLAB's ``load``. Takes 2 s.
"""

import sys

import numpy as np
from scipy.io import savemat

import highfive
from highfive.hil.view import SHIPPED_RECORDING

session = highfive.read_session(sys.argv[1] if sys.argv[1:] else SHIPPED_RECORDING)
print(f"recorded with model {session.settings['model']}, {len(session.joints)} joints")
matrices = {}
for high_five in session:
    if high_five.contact is None:  # broken off
        continue
    person = high_five.arrays("/person")  # high_five.table("/person") is the same for pandas
    moved = np.linalg.norm(np.diff(person["wrist"], axis=0), axis=1).sum()
    met = f"met after {high_five.contact['met_time']:.2f} s" if high_five.contact["met"] else "not met"
    print(f"high five {high_five.number + 1}, {high_five.about['style']}: the wrist went {moved:.2f} m; {met}")
    matrices[f"wrist_{high_five.number + 1}"] = np.column_stack([person["time"], person["wrist"]])  # s; x, y, z in m
savemat("session.mat", matrices)
print(f"session.mat: {', '.join(matrices)}")
